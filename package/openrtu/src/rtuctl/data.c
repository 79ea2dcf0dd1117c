/* SPDX-License-Identifier: GPL-3.0-or-later */
#include "rtuctl/data.h"

#include <errno.h>
#include <limits.h>
#include <stdio.h>
#include <string.h>
#include <sys/statvfs.h>

static const char memory[] = "memory: ";

static bool read_state(const char *dir, char state[DATA_LINE_SIZE])
{
	char path[PATH_MAX];
	FILE *file;
	bool found;

	snprintf(path, sizeof(path), "%s/data", dir);
	file = fopen(path, "re");
	if (file == NULL)
		return false;
	found = fgets(state, DATA_LINE_SIZE, file) != NULL;
	fclose(file);
	state[strcspn(state, "\n")] = '\0';
	return found;
}

static void describe_flash(const char *folder, char line[DATA_LINE_SIZE])
{
	struct statvfs space;

	if (statvfs(folder, &space) < 0)
		snprintf(line, DATA_LINE_SIZE, "data: flash, but %s: %s", folder, strerror(errno));
	else
		snprintf(line, DATA_LINE_SIZE, "data: flash, %llu MiB free",
			 (unsigned long long)space.f_bavail * space.f_frsize >> 20);
}

bool data_line(const char *dir, const char *folder, char line[DATA_LINE_SIZE])
{
	char state[DATA_LINE_SIZE] = "";
	const char *why = state + sizeof(memory) - 1;

	if (!read_state(dir, state))
		return false;
	if (strcmp(state, "flash") == 0) {
		describe_flash(folder, line);
		return true;
	}
	if (strncmp(state, memory, sizeof(memory) - 1) != 0)
		return false;
	snprintf(line, DATA_LINE_SIZE, "data: in memory, lost at restart: %.*s", DATA_LINE_SIZE - 40, why);
	return true;
}
