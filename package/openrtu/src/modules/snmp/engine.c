/* SPDX-License-Identifier: GPL-3.0-or-later */
#include "modules/snmp/engine.h"

#include <errno.h>
#include <fcntl.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <sys/stat.h>
#include <time.h>
#include <unistd.h>

#define FILE_NAME       "boots"
#define NEW_NAME        "boots.new"
#define SECONDS_TO_2020 1577836800
#define BOOTS_MAX       2147483646u /* RFC 3414, 2.2.3: at the next one the keys must be changed */

/* ---- boots ------------------------------------------------------------------------------- */

/* Of a file that is not there, 0. False: it holds no number, or cannot be read. */
static bool read_boots(int folder, uint32_t *boots)
{
	const int fd = openat(folder, FILE_NAME, O_RDONLY | O_NOFOLLOW | O_CLOEXEC);
	char text[32], *end;
	ssize_t size;
	unsigned long number;

	*boots = 0;
	if (fd < 0)
		return errno == ENOENT;
	size = read(fd, text, sizeof(text) - 1);
	close(fd);
	if (size <= 0)
		return false;
	text[size] = '\0';
	number = strtoul(text, &end, 10);
	*boots = (uint32_t)number;
	return text[0] >= '1' && text[0] <= '9' && strcmp(end, "\n") == 0 && number <= BOOTS_MAX;
}

/*
 * Of a file that was lost nobody knows what it held, and time must not begin anew for whoever has kept old messages (RFC 3414,
 * 2.2.2). Seconds since 2020 are more than each number that was counted from 1, and than such seconds before. 0: the clock is not set,
 * as at a board's first start.
 */
static uint32_t boots_by_clock(void)
{
	const time_t now_s = time(NULL);

	return now_s <= SECONDS_TO_2020 ? 0 : (uint32_t)(now_s - SECONDS_TO_2020);
}

static void begin_boots(struct map *map, const char *path, uint32_t *boots)
{
	*boots = boots_by_clock();
	map_log(map, MAP_LOG_WARNING, "%s/" FILE_NAME " is not there: it begins with %u, %s", path,
		*boots + 1,
		*boots != 0 ? "by the clock" : "as the clock is not set; if it was lost, make new keys");
}

/* Beside the old one, which stays whole until the new one is. */
static bool write_boots(int folder, uint32_t boots)
{
	const int fd = openat(folder, NEW_NAME, O_WRONLY | O_CREAT | O_TRUNC | O_NOFOLLOW | O_CLOEXEC, 0600);
	char text[32];
	const int size = snprintf(text, sizeof(text), "%u\n", boots);
	bool good;

	if (fd < 0)
		return false;
	good = write(fd, text, (size_t)size) == size && fsync(fd) == 0;
	close(fd);
	return good && renameat(folder, NEW_NAME, folder, FILE_NAME) == 0 && fsync(folder) == 0;
}

static bool keep_boots(struct map *map, int folder, const char *path, uint32_t boots)
{
	const bool good = write_boots(folder, boots);

	if (!good)
		map_log(map, MAP_LOG_ERROR, "cannot write %s/" FILE_NAME ": %s", path, strerror(errno));
	return good;
}

bool engine_count_boot(struct map *map, const char *path, uint32_t *boots)
{
	const int folder = open(path, O_RDONLY | O_DIRECTORY | O_CLOEXEC);
	bool good = false;

	if (folder < 0)
		map_log(map, MAP_LOG_ERROR, "cannot open %s: %s", path, strerror(errno));
	else if (!read_boots(folder, boots))
		map_log(map, MAP_LOG_ERROR,
			"%s/" FILE_NAME " is damaged: give the gateway another engine ID and keys, remove it",
			path);
	else {
		if (*boots == 0)
			begin_boots(map, path, boots);
		good = keep_boots(map, folder, path, ++*boots);
	}
	if (folder >= 0)
		close(folder);
	return good;
}

/* ---- keys -------------------------------------------------------------------------------- */

static bool is_private(FILE *file)
{
	struct stat status;

	return fstat(fileno(file), &status) == 0 && S_ISREG(status.st_mode) && (status.st_mode & 077) == 0;
}

static bool take_lines(struct map *map, const struct snmp_settings *settings, FILE *file,
		       struct snmp_keyring *ring)
{
	char line[SNMP_KEY_LINE + 2];
	unsigned number = 0;
	bool good = true;

	while (good && fgets(line, sizeof(line), file) != NULL) {
		number++;
		good = snmp_keys_take(ring, settings, line);
		if (!good)
			map_log(map, MAP_LOG_ERROR,
				"%s:%u: is no line of openrtu snmp-keys: make the file anew", settings->keys,
				number);
	}
	explicit_bzero(line, sizeof(line));
	return good;
}

bool engine_read_keys(struct map *map, const struct snmp_settings *settings, struct snmp_keyring *ring)
{
	FILE *file = fopen(settings->keys, "re");
	const char *lacks, *name;
	bool good = false;

	if (file == NULL) {
		map_log(map, MAP_LOG_ERROR, "cannot read the keys %s: %s; openrtu snmp-keys makes them",
			settings->keys, strerror(errno));
		return false;
	}
	if (!is_private(file))
		map_log(map, MAP_LOG_ERROR, "%s may be read by others: chmod 0400", settings->keys);
	else
		good = take_lines(map, settings, file, ring);
	fclose(file);
	if (!good)
		return false;
	lacks = snmp_keys_missing(ring, settings, &name);
	if (lacks != NULL)
		map_log(map, MAP_LOG_ERROR, "%s has no keys for the %s %s: make it anew", settings->keys,
			lacks, name);
	return lacks == NULL;
}
