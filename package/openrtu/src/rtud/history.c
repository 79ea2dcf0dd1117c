/* SPDX-License-Identifier: GPL-3.0-or-later */
#include "rtud/history.h"

#include <ctype.h>
#include <dirent.h>
#include <errno.h>
#include <fcntl.h>
#include <inttypes.h>
#include <limits.h>
#include <stdlib.h>
#include <string.h>
#include <sys/stat.h>
#include <time.h>
#include <unistd.h>

#include "map/hash.h"
#include "web/setup.h"

#define NAME_FORM "%08" PRIu32 "_%s_%s" ENDING
#define TIME_SIZE 24
#define ENDING    ".json"
#define USER_SIZE (WEB_USER_SIZE + sizeof(ENDING)) /* with the ending */
#define NEW       ".new"

struct entry {
	uint32_t number;
	char time[TIME_SIZE], user[USER_SIZE];
	char name[NAME_MAX + 1];
};

/* ---- texts ------------------------------------------------------------------------------- */

static bool read_open(int fd, struct history_text *out)
{
	struct stat status;
	ssize_t got = 0;

	if (fstat(fd, &status) < 0)
		return false;
	errno = S_ISREG(status.st_mode) ? EFBIG : EINVAL;
	if (!S_ISREG(status.st_mode) || status.st_size > HISTORY_TEXT_MAX)
		return false;
	out->octets = malloc((size_t)status.st_size + 1);
	if (out->octets == NULL)
		return false;
	for (; out->length < (size_t)status.st_size; out->length += (size_t)got) {
		got = read(fd, out->octets + out->length, (size_t)status.st_size - out->length);
		if (got <= 0)
			break;
	}
	out->octets[out->length] = '\0';
	out->hash = map_hash_octets(MAP_HASH_BASIS, out->octets, out->length);
	return got >= 0;
}

static bool read_at(int folder, const char *name, struct history_text *out)
{
	const int fd = openat(folder, name, O_RDONLY | O_CLOEXEC | O_NONBLOCK | O_NOCTTY);
	bool read = false;

	*out = (struct history_text){.length = 0};
	if (fd < 0)
		return false;
	read = read_open(fd, out);
	if (!read)
		free(out->octets);
	close(fd);
	return read;
}

bool history_read(const char *path, struct history_text *out)
{
	return read_at(AT_FDCWD, path, out);
}

static bool write_all(int fd, const struct history_text *text)
{
	size_t done = 0;

	while (done < text->length) {
		const ssize_t wrote = write(fd, text->octets + done, text->length - done);

		if (wrote < 0 && errno != EINTR)
			return false;
		done += wrote > 0 ? (size_t)wrote : 0;
	}
	return fsync(fd) == 0;
}

/* A whole file of this name, or none; as the one that it is like, or for its owner alone. False with errno. */
static bool put(int folder, const char *name, const struct history_text *text, const struct stat *like)
{
	char new_name[NAME_MAX + 1];
	bool done;
	int fd;

	if (snprintf(new_name, sizeof(new_name), ".%s" NEW, name) >= (int)sizeof(new_name)) {
		errno = ENAMETOOLONG;
		return false;
	}
	unlinkat(folder, new_name, 0);
	fd = openat(folder, new_name, O_WRONLY | O_CREAT | O_EXCL | O_NOFOLLOW | O_CLOEXEC, 0600);
	if (fd < 0)
		return false;
	done = write_all(fd, text) && (like == NULL || (fchown(fd, like->st_uid, like->st_gid) == 0 &&
							fchmod(fd, like->st_mode & 07777) == 0));
	close(fd);
	done = done && renameat(folder, new_name, folder, name) == 0;
	if (!done) {
		const int why = errno;

		unlinkat(folder, new_name, 0);
		errno = why;
	}
	return done && fsync(folder) == 0;
}

/* ---- the history --------------------------------------------------------------------------- */

static bool history_path(const char *path, char out[PATH_MAX])
{
	return snprintf(out, PATH_MAX, "%s.history", path) < PATH_MAX;
}

static bool read_name(const char *name, struct entry *out)
{
	size_t length;

	if (sscanf(name, "%8" SCNu32 "_%23[0-9TZ:-]_%38[A-Za-z0-9.-]", &out->number, out->time, out->user) !=
		3 ||
	    snprintf(out->name, sizeof(out->name), "%s", name) >= (int)sizeof(out->name))
		return false;
	length = strlen(out->user);
	if (length <= strlen(ENDING) || strcmp(out->user + length - strlen(ENDING), ENDING) != 0)
		return false;
	out->user[length - strlen(ENDING)] = '\0';
	return true;
}

static int by_number(const void *a, const void *b)
{
	const struct entry *first = a, *second = b;

	return first->number < second->number ? 1 : -1;
}

/* The newest first; at most so many, of which the oldest were not looked at. Returns how many. */
static unsigned read_entries(const char *path, struct entry entries[2 * SETUP_HISTORY])
{
	char folder[PATH_MAX];
	DIR *directory = history_path(path, folder) ? opendir(folder) : NULL;
	const struct dirent *file;
	unsigned count = 0;

	while (directory != NULL && count < 2 * SETUP_HISTORY && (file = readdir(directory)) != NULL)
		count += read_name(file->d_name, &entries[count]);
	if (directory != NULL)
		closedir(directory);
	qsort(entries, count, sizeof(*entries), by_number);
	return count;
}

json_t *history_list(const char *path)
{
	struct entry entries[2 * SETUP_HISTORY];
	const unsigned count = read_entries(path, entries);
	json_t *list = json_array();

	for (unsigned i = 0; i < count; i++)
		json_array_append_new(list,
				      json_pack("{s:I, s:s, s:s}", "number", (json_int_t)entries[i].number,
						"time", entries[i].time, "user", entries[i].user));
	return list;
}

static int open_history(const char *path)
{
	char folder[PATH_MAX];

	if (!history_path(path, folder)) {
		errno = ENAMETOOLONG;
		return -1;
	}
	if (mkdir(folder, 0700) < 0 && errno != EEXIST)
		return -1;
	return open(folder, O_RDONLY | O_DIRECTORY | O_NOFOLLOW | O_CLOEXEC);
}

bool history_recall(const char *path, uint32_t number, struct history_text *out)
{
	struct entry entries[2 * SETUP_HISTORY];
	const unsigned count = read_entries(path, entries);
	char folder[PATH_MAX];
	bool read = false;
	int fd;

	errno = ENOENT;
	fd = history_path(path, folder) ? open(folder, O_RDONLY | O_DIRECTORY | O_NOFOLLOW | O_CLOEXEC) : -1;
	if (fd < 0)
		return false;
	errno = ENOENT;
	for (unsigned i = 0; i < count && !read; i++)
		if (entries[i].number == number)
			read = read_at(fd, entries[i].name, out);
	close(fd);
	return read;
}

/* A user's name may have any character but a space. */
static void name_entry(uint32_t number, const char *user, char out[NAME_MAX + 1])
{
	char time_text[TIME_SIZE], safe[WEB_USER_SIZE] = "";
	const time_t now = time(NULL);
	struct tm utc;

	for (size_t i = 0; i < WEB_USER_SIZE - 1 && user[i] != '\0'; i++)
		safe[i] = isalnum((unsigned char)user[i]) || strchr(".-", user[i]) ? user[i] : '-';
	if (safe[0] == '\0')
		safe[0] = '-'; /* or nobody finds the entry again */
	strftime(time_text, sizeof(time_text), "%Y-%m-%dT%H:%M:%SZ", gmtime_r(&now, &utc));
	snprintf(out, NAME_MAX + 1, NAME_FORM, number, time_text, safe);
}

static bool keep_former(const char *path, const struct history_text *former, const char *user)
{
	struct entry entries[2 * SETUP_HISTORY];
	const unsigned count = read_entries(path, entries);
	const int folder = open_history(path);
	char name[NAME_MAX + 1];
	bool kept;

	if (folder < 0)
		return false;
	name_entry(count > 0 ? entries[0].number + 1 : 1, user, name);
	kept = put(folder, name, former, NULL);
	for (unsigned i = SETUP_HISTORY - 1; kept && i < count; i++)
		unlinkat(folder, entries[i].name, 0);
	close(folder);
	return kept;
}

/* path: a whole one. */
static bool replace(const char *path, const struct history_text *text)
{
	char folder_path[PATH_MAX];
	char *slash;
	struct stat like;
	int folder;
	bool done;

	snprintf(folder_path, sizeof(folder_path), "%s", path);
	slash = strrchr(folder_path, '/');
	*slash = '\0';
	folder = open(slash == folder_path ? "/" : folder_path, O_RDONLY | O_DIRECTORY | O_CLOEXEC);
	if (folder < 0)
		return false;
	if (fstatat(folder, slash + 1, &like, AT_SYMLINK_NOFOLLOW) == 0)
		done = put(folder, slash + 1, text, &like);
	else
		done = errno == ENOENT && put(folder, slash + 1, text, NULL);
	close(folder);
	return done;
}

/* Where the file is, or will be. */
static bool find_place(const char *path, char real[PATH_MAX])
{
	if (realpath(path, real) != NULL)
		return true;
	return errno == ENOENT && path[0] == '/' && snprintf(real, PATH_MAX, "%s", path) < PATH_MAX;
}

bool history_replace(const char *path, const struct history_text *former, const struct history_text *text,
		     const char *user, FILE *messages)
{
	char real[PATH_MAX];

	if (find_place(path, real) && keep_former(path, former, user) && replace(real, text))
		return true;
	fprintf(messages, "%s cannot be written: %s\n", path, strerror(errno));
	return false;
}
