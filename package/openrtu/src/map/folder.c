/* SPDX-License-Identifier: GPL-3.0-or-later */
#include "map/folder.h"

#include <errno.h>
#include <fcntl.h>
#include <stdio.h>
#include <string.h>
#include <sys/stat.h>

#include "map/config.h"

/* The module's user has to walk through it, whatever the umask. */
static int make_folder(const char *path)
{
	if (mkdir(path, 0755) == 0)
		return chmod(path, 0755);
	return errno == EEXIST ? 0 : -1;
}

/* Each folder on the way, as mkdir -p. */
static int make_folders(const char *path)
{
	char part[MAP_FILE_SIZE];

	snprintf(part, sizeof(part), "%s", path);
	for (char *slash = strchr(part + 1, '/'); slash != NULL; slash = strchr(slash + 1, '/')) {
		*slash = '\0';
		if (make_folder(part) < 0)
			return -1;
		*slash = '/';
	}
	return make_folder(part);
}

int map_open_folder(const char *path)
{
	return make_folders(path) < 0 ? -1 : open(path, O_RDONLY | O_DIRECTORY | O_NOFOLLOW | O_CLOEXEC);
}
