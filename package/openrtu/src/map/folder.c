/* SPDX-License-Identifier: GPL-3.0-or-later */
#include "map/folder.h"

#include <errno.h>
#include <fcntl.h>
#include <stdio.h>
#include <string.h>
#include <sys/stat.h>
#include <unistd.h>

#include "map/config.h"

static int open_above(const char *path)
{
	char above[MAP_FILE_SIZE];
	char *slash;

	snprintf(above, sizeof(above), "%s", path);
	slash = strrchr(above, '/');
	if (slash == NULL)
		return open(".", O_RDONLY | O_DIRECTORY | O_CLOEXEC);
	slash[slash == above] = '\0';
	return open(above, O_RDONLY | O_DIRECTORY | O_CLOEXEC);
}

/* Else a power cut takes it away, with all that was synchronised in it. */
static int synchronise_entry(const char *path)
{
	const int above = open_above(path);
	int result, error;

	if (above < 0)
		return -1;
	result = fsync(above);
	error = errno;
	close(above);
	errno = error;
	return result;
}

/* The module's user has to walk through it, whatever the umask. */
static int make_folder(const char *path)
{
	int error;

	if (mkdir(path, 0755) < 0)
		return errno == EEXIST ? 0 : -1;
	if (chmod(path, 0755) == 0 && synchronise_entry(path) == 0)
		return 0;
	error = errno;
	rmdir(path);
	errno = error;
	return -1;
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
