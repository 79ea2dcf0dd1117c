/* SPDX-License-Identifier: GPL-3.0-or-later */
/* The journal's file: whatever fails, there is one that can be read. A flash that fails is made of wrapped calls. */
#include <setjmp.h>
#include <stdarg.h>
#include <stddef.h>
#include <stdint.h>

#include <cmocka.h>

#include <errno.h>
#include <fcntl.h>
#include <signal.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <sys/resource.h>
#include <sys/stat.h>
#include <unistd.h>

#include "journal/file.h"

static char folder[32], path[64], path_new[64];
static struct journal_file file;
static bool data_fails, folder_fails, truncation_fails;

int __wrap_fdatasync(int fd);
int __wrap_fsync(int fd);
int __wrap_ftruncate(int fd, off_t size);
int __wrap_ftruncate64(int fd, off_t size);
int __real_fdatasync(int fd);
int __real_fsync(int fd);

static int fail_with(int error)
{
	errno = error;
	return -1;
}

int __wrap_fdatasync(int fd)
{
	return data_fails ? fail_with(EIO) : __real_fdatasync(fd);
}

int __wrap_fsync(int fd)
{
	return folder_fails ? fail_with(EIO) : __real_fsync(fd);
}

/* Through the name: with 64-bit offsets either call may be the one that is wrapped. */
int __wrap_ftruncate(int fd, off_t size)
{
	char name[32];

	snprintf(name, sizeof(name), "/proc/self/fd/%d", fd);
	return truncation_fails ? fail_with(EIO) : truncate(name, size);
}

int __wrap_ftruncate64(int fd, off_t size)
{
	return __wrap_ftruncate(fd, size);
}

static int set_up(void **state)
{
	(void)state;
	strcpy(folder, "/tmp/test_file.XXXXXX");
	assert_non_null(mkdtemp(folder));
	snprintf(path, sizeof(path), "%s/%s", folder, JOURNAL_FILE);
	snprintf(path_new, sizeof(path_new), "%s/%s", folder, JOURNAL_FILE_NEW);
	file = (struct journal_file){.folder = folder, .fd = -1};
	data_fails = folder_fails = truncation_fails = false;
	return 0;
}

static int tear_down(void **state)
{
	(void)state;
	if (file.fd >= 0)
		close(file.fd);
	remove(path);
	assert_int_equal(access(path_new, F_OK), -1); /* nothing half made is left */
	return rmdir(folder);
}

static struct journal_builder record(uint32_t number)
{
	static uint8_t bytes[JOURNAL_QUEUES_SIZE];
	struct journal_builder builder = {.bytes = bytes, .size = sizeof(bytes)};

	journal_begin(&builder, number, 4, NULL, 0);
	journal_end(&builder);
	return builder;
}

static int begin(void)
{
	struct journal_builder first = record(0);

	return journal_file_begin(&file, &first);
}

static int append(uint32_t number)
{
	struct journal_builder further = record(number);

	return journal_file_append(&file, &further);
}

/* Whole records, one behind the other; all of the file. */
static void assert_records(uint32_t records)
{
	int fd = open(path, O_RDONLY | O_CLOEXEC);
	struct journal_record found;
	uint8_t bytes[1024];
	ssize_t size = read(fd, bytes, sizeof(bytes));
	size_t at = 0;

	assert_true(size >= 0);
	for (uint32_t i = 0; i < records; i++, at += found.size)
		assert_true(journal_parse(bytes + at, (size_t)size - at, i, &found));
	assert_int_equal(at, size);
	close(fd);
}

static void limit_files_to(rlim_t size)
{
	struct rlimit limit;

	getrlimit(RLIMIT_FSIZE, &limit);
	limit.rlim_cur = size;
	assert_int_equal(setrlimit(RLIMIT_FSIZE, &limit), 0);
}

static void test_a_file_grows_and_is_replaced(void **state)
{
	struct stat status;

	(void)state;
	assert_int_equal(begin(), 0);
	assert_int_equal(append(1), 0);
	assert_int_equal(append(2), 0);
	assert_records(3);
	assert_int_equal(stat(path, &status), 0);
	assert_int_equal(status.st_mode & 0777, 0600);
	assert_int_equal(begin(), 0);
	assert_records(1);
}

/* What was torn is taken away, and the file goes on. */
static void test_a_record_without_room(void **state)
{
	(void)state;
	assert_int_equal(begin(), 0);
	limit_files_to((rlim_t)file.size + 9);
	assert_int_equal(append(1), -1);
	assert_int_equal(errno, EFBIG);
	limit_files_to(RLIM_INFINITY);
	assert_records(1);
	assert_int_equal(append(1), 0);
	assert_records(2);
}

static void test_a_new_file_without_room(void **state)
{
	(void)state;
	assert_int_equal(begin(), 0);
	assert_int_equal(append(1), 0);
	limit_files_to(9);
	assert_int_equal(begin(), -1);
	assert_int_equal(errno, EFBIG);
	limit_files_to(RLIM_INFINITY);
	assert_records(2); /* the former one */
	assert_int_equal(file.fd, -1);
	assert_int_equal(begin(), 0);
	assert_records(1);
}

static void test_a_flash_that_fails(void **state)
{
	(void)state;
	data_fails = true;
	assert_int_equal(begin(), -1);
	assert_int_equal(errno, EIO);
	data_fails = false;
	assert_int_equal(begin(), 0);
	data_fails = true;
	assert_int_equal(append(1), -1);
	assert_true(file.fd >= 0);
	assert_records(1);
	truncation_fails = true;
	assert_int_equal(append(1), -1);
	assert_int_equal(errno, EIO);
	assert_int_equal(file.fd, -1); /* what is behind the last whole record would hide all further ones */
	data_fails = truncation_fails = false;
	folder_fails = true;
	assert_int_equal(begin(), -1);
	assert_int_equal(file.fd, -1);
	assert_records(1);
}

static void test_a_folder_that_is_none(void **state)
{
	(void)state;
	assert_int_equal(mkdir(path, 0700), 0);
	assert_int_equal(begin(), -1);
	assert_int_equal(errno, EISDIR);
	assert_int_equal(rmdir(path), 0);
	file.folder = path;
	assert_int_equal(begin(), -1);
	assert_int_equal(errno, ENOENT);
	file.folder = folder;
	assert_int_equal(symlink("/dev/null", path_new), 0);
	assert_int_equal(begin(), 0); /* the link is gone, and was not followed */
	assert_records(1);
}

int main(void)
{
	const struct CMUnitTest tests[] = {
	    cmocka_unit_test_setup_teardown(test_a_file_grows_and_is_replaced, set_up, tear_down),
	    cmocka_unit_test_setup_teardown(test_a_record_without_room, set_up, tear_down),
	    cmocka_unit_test_setup_teardown(test_a_new_file_without_room, set_up, tear_down),
	    cmocka_unit_test_setup_teardown(test_a_flash_that_fails, set_up, tear_down),
	    cmocka_unit_test_setup_teardown(test_a_folder_that_is_none, set_up, tear_down),
	};

	signal(SIGXFSZ, SIG_IGN);
	return cmocka_run_group_tests(tests, NULL, NULL);
}
