/* SPDX-License-Identifier: GPL-3.0-or-later */
#include "journal/file.h"

#include <errno.h>
#include <fcntl.h>
#include <stdio.h>
#include <unistd.h>

static int write_record(int fd, off_t at, const struct journal_builder *record)
{
	size_t written = 0;

	while (written < record->used) {
		ssize_t done =
		    pwrite(fd, record->bytes + written, record->used - written, at + (off_t)written);

		if (done < 0)
			return -1;
		written += (size_t)done;
	}
	return fdatasync(fd);
}

static void close_file(struct journal_file *file)
{
	if (file->fd >= 0)
		close(file->fd);
	file->fd = -1;
}

/* The folder's entry is on the flash when the folder is. */
static int replace(struct journal_file *file, int folder, int fd, const struct journal_builder *record)
{
	if (write_record(fd, 0, record) < 0 || renameat(folder, JOURNAL_FILE_NEW, folder, JOURNAL_FILE) < 0)
		return -1;
	file->fd = fd;
	file->size = (off_t)record->used;
	return fsync(folder);
}

static int create_new(int folder)
{
	unlinkat(folder, JOURNAL_FILE_NEW, 0);
	return openat(folder, JOURNAL_FILE_NEW, O_RDWR | O_CREAT | O_EXCL | O_NOFOLLOW | O_CLOEXEC, 0600);
}

int journal_file_begin(struct journal_file *file, const struct journal_builder *record)
{
	int folder = open(file->folder, O_RDONLY | O_DIRECTORY | O_NOFOLLOW | O_CLOEXEC);
	int fd, error, result = -1;

	close_file(file);
	if (folder < 0)
		return -1;
	fd = create_new(folder);
	if (fd >= 0)
		result = replace(file, folder, fd, record);
	error = errno;
	if (fd >= 0 && result < 0) {
		close(fd);
		file->fd = -1;
		unlinkat(folder, JOURNAL_FILE_NEW, 0);
	}
	close(folder);
	errno = error;
	return result;
}

int journal_file_append(struct journal_file *file, const struct journal_builder *record)
{
	int error;

	if (write_record(file->fd, file->size, record) == 0) {
		file->size += (off_t)record->used;
		return 0;
	}
	error = errno;
	if (ftruncate(file->fd, file->size) < 0)
		close_file(file);
	errno = error;
	return -1;
}
