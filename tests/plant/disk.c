/* SPDX-License-Identifier: GPL-3.0-or-later */
/*
 * The folder of a world that is a flash. Its files are files, so that all see what was written; beside them is a log of what
 * changed it and of what was synchronised: plant_disk.py makes of it what a power cut leaves. A disk may be full, refuse or give no
 * data for a time. Who was started by the world is no program of the gateway: it does what it wants.
 */
#include <errno.h>
#include <fcntl.h>
#include <limits.h>
#include <stdarg.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <sys/stat.h>
#include <unistd.h>

#include "client.h"

#define LINE_SIZE    (2 * PATH_MAX + 64)
#define FAILS_ONE_OF 2 /* calls on a disk that refuses */

static bool known_files[CLIENT_FDS]; /* of the disk */

static bool has_disk(void)
{
	client_begin();
	return plant && plant->disk[0] && plant->processes[client_self].parent != PLANT_RUNNER;
}

/* ---- what is on it ----------------------------------------------------------------------- */

static bool is_within(const char *path)
{
	const size_t size = strlen(plant->disk);

	return strncmp(path, plant->disk, size) == 0 && (path[size] == '/' || !path[size]);
}

static bool path_of_descriptor(int fd, char path[PATH_MAX])
{
	char link[32];
	ssize_t size;

	snprintf(link, sizeof(link), "/proc/self/fd/%d", fd);
	size = readlink(link, path, PATH_MAX - 1);
	if (size < 0)
		return false;
	path[size] = '\0';
	return true;
}

/* False: it is none of the disk. */
static bool put_path(int folder, const char *name, char path[PATH_MAX])
{
	char of_folder[PATH_MAX] = "";

	if (name[0] != '/' && (folder == AT_FDCWD || !path_of_descriptor(folder, of_folder)))
		return false;
	if (strlen(of_folder) + strlen(name) + 1 >= PATH_MAX)
		return false;
	memcpy(path, of_folder, strlen(of_folder) + 1);
	if (name[0] != '/')
		strcat(path, "/");
	strcat(path, name);
	return is_within(path);
}

static bool is_of_disk(int fd)
{
	client_begin();
	return fd >= 0 && fd < CLIENT_FDS && known_files[fd] && has_disk();
}

void disk_forget(int fd)
{
	if (fd >= 0 && fd < CLIENT_FDS)
		known_files[fd] = false;
}

/* ---- its log ----------------------------------------------------------------------------- */

static void append(const char *suffix, const char *line, const void *octets, size_t size)
{
	char path[PATH_MAX];
	const int error = errno;
	int fd;

	snprintf(path, sizeof(path), "%s.%s", plant->disk, suffix);
	fd = real.openat(AT_FDCWD, path, O_WRONLY | O_CREAT | O_APPEND | O_CLOEXEC, 0666);
	if (fd < 0 || real.write(fd, line, strlen(line)) < 0 || (size && real.write(fd, octets, size) < 0))
		abort();
	real.close(fd);
	errno = error;
}

__attribute__((format(printf, 1, 2))) static void note(const char *format, ...)
{
	char line[LINE_SIZE];
	va_list arguments;

	va_start(arguments, format);
	vsnprintf(line, sizeof(line), format, arguments);
	va_end(arguments);
	append("log", line, NULL, 0);
}

static unsigned long long number_of(int fd)
{
	struct stat status;

	return fstat(fd, &status) == 0 ? status.st_ino : 0;
}

void disk_loses_power(void)
{
	if (has_disk())
		note("power %llu\n", (unsigned long long)plant_random(plant));
}

/* ---- its faults -------------------------------------------------------------------------- */

/* Of a call that changes it: 0, or the error that it gives. */
static int refusal(const char *call)
{
	int error = 0;

	client_call();
	if (plant_disk_is(plant, PLANT_FULL))
		error = ENOSPC;
	else if (plant_disk_is(plant, PLANT_REFUSES) && plant_random(plant) % FAILS_ONE_OF == 0)
		error = EIO;
	client_tell("%s disk -%d", call, error);
	return error;
}

static int refused(int error)
{
	char line[LINE_SIZE];

	snprintf(line, sizeof(line), "%lld %s %d\n", (long long)plant->now_ns,
		 plant->processes[client_self].name, error);
	append("refused", line, NULL, 0);
	errno = error;
	return -1;
}

/* ---- the calls --------------------------------------------------------------------------- */

static int open_on_disk(const char *path, int folder, const char *name, int flags, mode_t mode)
{
	const bool makes = flags & O_CREAT && faccessat(folder, name, F_OK, AT_SYMLINK_NOFOLLOW) < 0;
	const int error = makes ? refusal("create") : 0;
	int fd;

	if (error)
		return refused(error);
	fd = real.openat(folder, name, flags, mode);
	if (fd < 0 || fd >= CLIENT_FDS)
		return fd;
	known_files[fd] = true;
	if (makes)
		note("create %llu %s\n", number_of(fd), path);
	else if (flags & O_TRUNC)
		note("truncate %llu 0\n", number_of(fd));
	return fd;
}

static int open_any(int folder, const char *name, int flags, mode_t mode)
{
	char path[PATH_MAX];

	if (!has_disk() || !put_path(folder, name, path))
		return real.openat(folder, name, flags, mode);
	return open_on_disk(path, folder, name, flags, mode);
}

static mode_t mode_of(int flags, va_list arguments)
{
	return flags & (O_CREAT | O_TMPFILE) ? va_arg(arguments, mode_t) : 0;
}

int openat(int folder, const char *name, int flags, ...)
{
	va_list arguments;
	mode_t mode;

	va_start(arguments, flags);
	mode = mode_of(flags, arguments);
	va_end(arguments);
	return open_any(folder, name, flags, mode);
}

int open(const char *name, int flags, ...)
{
	va_list arguments;
	mode_t mode;

	va_start(arguments, flags);
	mode = mode_of(flags, arguments);
	va_end(arguments);
	return open_any(AT_FDCWD, name, flags, mode);
}

int __openat64_2(int folder, const char *name, int flags);
int __openat64_2(int folder, const char *name, int flags)
{
	return open_any(folder, name, flags, 0);
}

static ssize_t write_on_disk(int fd, const void *octets, size_t size, off_t at)
{
	const int error = refusal("write");
	char line[LINE_SIZE];
	ssize_t written;

	if (error) /* a part of it may be there */
		size = plant_random(plant) % 2 ? size / 2 : 0;
	if (error && size == 0)
		return refused(error);
	written = real.pwrite(fd, octets, size, at);
	if (written <= 0)
		return written;
	snprintf(line, sizeof(line), "write %llu %lld %zd\n", number_of(fd), (long long)at, written);
	append("log", line, octets, (size_t)written);
	return written;
}

ssize_t pwrite(int fd, const void *octets, size_t size, off_t at)
{
	return is_of_disk(fd) ? write_on_disk(fd, octets, size, at) : real.pwrite(fd, octets, size, at);
}

bool disk_writes(int fd, const void *octets, size_t size, ssize_t *written)
{
	off_t at;

	if (!is_of_disk(fd))
		return false;
	at = lseek(fd, 0, fcntl(fd, F_GETFL) & O_APPEND ? SEEK_END : SEEK_CUR);
	*written = write_on_disk(fd, octets, size, at);
	if (*written > 0)
		lseek(fd, at + *written, SEEK_SET);
	return true;
}

/* A worn block gives nothing; what is before it is read. */
bool disk_gives_nothing(int fd)
{
	if (!is_of_disk(fd) || !plant_disk_is(plant, PLANT_WORN))
		return false;
	client_call();
	if (plant_random(plant) % FAILS_ONE_OF)
		return false;
	client_tell("read disk -%d", EIO);
	errno = EIO;
	return true;
}

ssize_t pread(int fd, void *out, size_t size, off_t at)
{
	return disk_gives_nothing(fd) ? -1 : real.pread(fd, out, size, at);
}

int ftruncate(int fd, off_t size)
{
	int error, result;

	if (!is_of_disk(fd))
		return real.ftruncate(fd, size);
	error = refusal("truncate");
	result = error ? refused(error) : real.ftruncate(fd, size);
	if (result == 0)
		note("truncate %llu %lld\n", number_of(fd), (long long)size);
	return result;
}

/* What it is of is on the flash: a file's octets, or a folder's entries. */
static int synchronise(int fd, int (*call)(int))
{
	char path[PATH_MAX] = "";
	int error;

	if (!is_of_disk(fd))
		return call(fd);
	error = refusal("sync");
	if (error)
		return refused(error);
	path_of_descriptor(fd, path);
	note("sync %llu %s\n", number_of(fd), path);
	return 0;
}

int fsync(int fd)
{
	client_begin();
	return synchronise(fd, real.fsync);
}

int fdatasync(int fd)
{
	client_begin();
	return synchronise(fd, real.fdatasync);
}

int renameat(int from_folder, const char *from, int to_folder, const char *to)
{
	char from_path[PATH_MAX], to_path[PATH_MAX];
	int error, result;

	if (!has_disk() || !put_path(from_folder, from, from_path) || !put_path(to_folder, to, to_path))
		return real.renameat(from_folder, from, to_folder, to);
	error = refusal("rename");
	result = error ? refused(error) : real.renameat(from_folder, from, to_folder, to);
	if (result == 0)
		note("rename %s\t%s\n", from_path, to_path);
	return result;
}

int rename(const char *from, const char *to)
{
	return renameat(AT_FDCWD, from, AT_FDCWD, to);
}

int linkat(int from_folder, const char *from, int to_folder, const char *to, int flags)
{
	char from_path[PATH_MAX], to_path[PATH_MAX];
	int error, result;

	if (!has_disk() || !put_path(from_folder, from, from_path) || !put_path(to_folder, to, to_path))
		return real.linkat(from_folder, from, to_folder, to, flags);
	error = refusal("link");
	result = error ? refused(error) : real.linkat(from_folder, from, to_folder, to, flags);
	if (result == 0)
		note("link %s\t%s\n", from_path, to_path);
	return result;
}

int unlinkat(int folder, const char *name, int flags)
{
	char path[PATH_MAX];
	int result;

	if (!has_disk() || !put_path(folder, name, path))
		return real.unlinkat(folder, name, flags);
	client_call();
	result = real.unlinkat(folder, name, flags);
	client_tell("unlink disk %d", result);
	if (result == 0)
		note("remove %s\n", path);
	return result;
}

int unlink(const char *name)
{
	return unlinkat(AT_FDCWD, name, 0);
}

int mkdir(const char *name, mode_t mode)
{
	char path[PATH_MAX];
	int error, result;

	if (!has_disk() || !put_path(AT_FDCWD, name, path) || access(name, F_OK) == 0)
		return real.mkdir(name, mode);
	error = refusal("mkdir");
	result = error ? refused(error) : real.mkdir(name, mode);
	if (result == 0)
		note("folder %s\n", path);
	return result;
}

/* ---- the names without 64 bits of a file's size: these are what the headers call them ---------- */

#define SAME(name, as) __asm__(#name) __attribute__((alias(#as), copy(name)))
int plain_open(const char *name, int flags, ...) SAME(open, open64);
int plain_openat(int folder, const char *name, int flags, ...) SAME(openat, openat64);
ssize_t plain_pwrite(int fd, const void *octets, size_t size, off_t at) SAME(pwrite, pwrite64);
ssize_t plain_pread(int fd, void *out, size_t size, off_t at) SAME(pread, pread64);
int plain_ftruncate(int fd, off_t size) SAME(ftruncate, ftruncate64);
