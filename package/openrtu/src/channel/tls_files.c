/* SPDX-License-Identifier: GPL-3.0-or-later */
#include "channel/tls_files.h"

#include <sys/stat.h>

#define FILES 4

/* The time of the last change of its inode is no program's to set: a file moved here with its old date is seen. */
struct stamp {
	dev_t device;
	ino_t inode;
	off_t size;
	struct timespec modified, changed;
};

static struct stamp stamps[FILES];

/* All zero: it is not there. */
static struct stamp stamp_of(const char *path)
{
	struct stat status;

	if (path[0] == '\0' || stat(path, &status) < 0)
		return (struct stamp){0};
	return (struct stamp){.device = status.st_dev,
			      .inode = status.st_ino,
			      .size = status.st_size,
			      .modified = status.st_mtim,
			      .changed = status.st_ctim};
}

static bool is_same_time(struct timespec one, struct timespec other)
{
	return one.tv_sec == other.tv_sec && one.tv_nsec == other.tv_nsec;
}

static bool is_same(const struct stamp *one, const struct stamp *other)
{
	return one->device == other->device && one->inode == other->inode && one->size == other->size &&
	       is_same_time(one->modified, other->modified) && is_same_time(one->changed, other->changed);
}

bool tls_files_changed(const struct channel_tls *settings)
{
	const char *const paths[FILES] = {settings->certificate, settings->key, settings->ca, settings->crl};
	bool changed = false;

	for (unsigned i = 0; i < FILES; i++) {
		struct stamp stamp = stamp_of(paths[i]);

		changed |= !is_same(&stamp, &stamps[i]);
		stamps[i] = stamp;
	}
	return changed;
}
