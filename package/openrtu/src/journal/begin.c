/* SPDX-License-Identifier: GPL-3.0-or-later */
#include "journal/begin.h"

#include <errno.h>
#include <fcntl.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <sys/stat.h>
#include <sys/vfs.h>
#include <unistd.h>

#include <linux/magic.h>

#include "journal/config.h"
#include "journal/record.h"
#include "journal/restore.h"
#include "map/folder.h"

/* ---- the folder -------------------------------------------------------------------------- */

/*
 * What is in it belongs to the user of before, if that was another; rtu-journal makes its files anew. Where it cannot be
 * given away, as on a file system that has turned read-only, it can be read.
 */
static void give_folder(struct map *map, int folder, uid_t owner, gid_t group)
{
	if (owner != 0 && (fchown(folder, owner, group) < 0 || fchmod(folder, 0700) < 0))
		map_log(map, MAP_LOG_ERROR, "cannot give the journal's folder to rtu-journal: %s",
			strerror(errno));
}

static void warn_of_memory(struct map *map, int folder, const char *path)
{
	struct statfs system;

	if (fstatfs(folder, &system) < 0)
		return;
	if ((uint32_t)system.f_type == TMPFS_MAGIC || (uint32_t)system.f_type == RAMFS_MAGIC)
		map_log(map, MAP_LOG_WARNING, "the journal in %s is in memory: a power cut loses it", path);
}

/* ---- the file ---------------------------------------------------------------------------- */

/* As much as can be read. NULL with errno: nothing can. The folder is its writer's, who may put anything there. */
static uint8_t *read_file(int folder, size_t *size, int *error)
{
	int fd = openat(folder, JOURNAL_FILE, O_RDONLY | O_NOFOLLOW | O_NONBLOCK | O_NOCTTY | O_CLOEXEC);
	struct stat status = {0};
	uint8_t *bytes = NULL;
	ssize_t got = 1;

	*size = 0;
	*error = 0;
	if (fd < 0 || fstat(fd, &status) < 0)
		*error = errno;
	else if (!S_ISREG(status.st_mode))
		*error = S_ISDIR(status.st_mode) ? EISDIR : EINVAL;
	else if ((bytes = malloc(JOURNAL_FILE_MAX)) == NULL)
		*error = ENOMEM;
	while (bytes != NULL && got > 0 && *size < JOURNAL_FILE_MAX) {
		got = read(fd, bytes + *size, JOURNAL_FILE_MAX - *size);
		if (got < 0)
			*error = errno;
		else
			*size += (size_t)got;
	}
	if (fd >= 0)
		close(fd);
	return bytes;
}

static void report(struct map *map, const struct map_kept *kept, const struct journal_findings *findings)
{
	if (findings->unread != 0)
		map_log(map, MAP_LOG_WARNING, "the journal's last %zu bytes are incomplete or damaged%s",
			findings->unread, findings->records == 0 ? ": nothing can be read" : "");
	if (findings->unknown != 0)
		map_log(map, MAP_LOG_WARNING,
			"%u events of the journal belong to points that are no longer configured",
			findings->unknown);
	if (findings->dropped != 0)
		map_log(map, MAP_LOG_WARNING,
			"%u retained points of the journal are no longer configured as retained, or have "
			"another type",
			findings->dropped);
	if (findings->dropped_values != 0)
		map_log(
		    map, MAP_LOG_WARNING,
		    "%u retained values of the journal belong to no variable of the programs as they are now",
		    findings->dropped_values);
	map_log(map, MAP_LOG_INFO, "%u events restored from the journal", kept->event_count);
	if (kept->history.start != 0)
		map_log(map, MAP_LOG_INFO, "%u changes for buffered reports restored from the journal",
			kept->history.entry_count);
	if (kept->sample_count != 0)
		map_log(map, MAP_LOG_INFO, "%u retained points restored from the journal, as not topical",
			kept->sample_count);
	if (kept->value_count != 0)
		map_log(map, MAP_LOG_INFO, "%u retained values of programs restored from the journal",
			kept->value_count);
}

/* False: nothing of what there is was restored. */
static bool restore(struct map *map, const uint8_t *bytes, size_t size)
{
	char error[MAP_ERROR_SIZE] = "out of memory";
	struct journal_findings findings;
	struct map_kept kept;
	const bool good =
	    journal_restore(map, bytes, size, &kept, &findings) && map_restore(map, &kept, error) == 0;

	if (good)
		report(map, &kept, &findings);
	else
		map_log(map, MAP_LOG_ERROR, "cannot restore the journal's events: %s", error);
	journal_forget(&kept);
	return good && (size == 0 || findings.records != 0);
}

/*
 * rtu-journal puts a new file in its place soon. One that is kept already is older: nobody has looked at it yet, and it stays.
 */
static void keep_unread(struct map *map, int folder, const char *path)
{
	struct stat status;

	if (fstatat(folder, JOURNAL_FILE, &status, AT_SYMLINK_NOFOLLOW) < 0 || !S_ISREG(status.st_mode))
		return;
	if (linkat(folder, JOURNAL_FILE, folder, JOURNAL_FILE_UNREAD, 0) == 0 && fsync(folder) == 0)
		map_log(map, MAP_LOG_WARNING, "it is kept as %s/%s", path, JOURNAL_FILE_UNREAD);
	else
		map_log(map, MAP_LOG_ERROR, "it is not kept as %s/%s: %s", path, JOURNAL_FILE_UNREAD,
			strerror(errno));
}

void journal_give_folder(struct map *map, const struct map_config *config, uid_t owner, gid_t group)
{
	const struct journal_settings *settings = journal_settings(config);
	int folder;

	if (settings == NULL)
		return;
	folder = map_open_folder(settings->path);
	if (folder < 0) {
		map_log(map, MAP_LOG_ERROR, "no journal: %s: %s", settings->path, strerror(errno));
		return;
	}
	give_folder(map, folder, owner, group);
	warn_of_memory(map, folder, settings->path);
	close(folder);
}

void journal_restore_from_file(struct map *map)
{
	const struct journal_settings *settings = journal_settings(map_config(map));
	const int folder = settings == NULL ? -1 : map_open_folder(settings->path);
	bool restored = false;
	uint8_t *bytes;
	size_t size;
	int error;

	if (folder < 0)
		return; /* the log has it */
	bytes = read_file(folder, &size, &error);
	if (error != 0 && error != ENOENT)
		map_log(map, MAP_LOG_ERROR, "the journal %s/%s cannot be read: %s", settings->path,
			JOURNAL_FILE, strerror(error));
	if (bytes != NULL)
		restored = restore(map, bytes, size);
	if (error != ENOENT && (error != 0 || !restored))
		keep_unread(map, folder, settings->path);
	free(bytes);
	close(folder);
}
