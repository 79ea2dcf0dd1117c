/* SPDX-License-Identifier: GPL-3.0-or-later */
#include "rtuctl/data.h"

#include <setjmp.h>
#include <stdarg.h>
#include <stddef.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <sys/statvfs.h>
#include <unistd.h>

#include <cmocka.h>

static char dir[] = "/tmp/test_data.XXXXXX";
static char path[sizeof(dir) + sizeof("/data")];

static void write_state(const char *text)
{
	FILE *file = fopen(path, "w");
	bool good, closed;

	assert_non_null(file);
	good = fputs(text, file) >= 0;
	closed = fclose(file) == 0;
	assert_true(good && closed);
}

static void test_memory(void **state)
{
	char line[DATA_LINE_SIZE];

	(void)state;
	write_state("memory: no UBI volume\n");
	assert_true(data_line(dir, dir, line));
	assert_string_equal(line, "data: in memory, lost at restart: no UBI volume");
}

static void test_flash(void **state)
{
	char line[DATA_LINE_SIZE], expected[DATA_LINE_SIZE];
	struct statvfs space;

	(void)state;
	write_state("flash\n");
	assert_int_equal(statvfs("/proc", &space), 0);
	snprintf(expected, sizeof(expected), "data: flash, %llu MiB free",
		 (unsigned long long)space.f_bavail * space.f_frsize / 1048576);
	assert_true(data_line(dir, "/proc", line));
	assert_string_equal(line, expected);
}

static void test_flash_that_is_gone(void **state)
{
	char line[DATA_LINE_SIZE];

	(void)state;
	write_state("flash\n");
	assert_true(data_line(dir, "/nowhere", line));
	assert_string_equal(line, "data: flash, but /nowhere: No such file or directory");
}

static void test_nothing_said(void **state)
{
	char line[DATA_LINE_SIZE], garbage[1000];

	(void)state;
	unlink(path);
	assert_false(data_line(dir, dir, line));
	write_state("");
	assert_false(data_line(dir, dir, line));
	memset(garbage, 'x', sizeof(garbage) - 1);
	garbage[sizeof(garbage) - 1] = '\0';
	write_state(garbage);
	assert_false(data_line(dir, dir, line));
	memcpy(garbage, "memory: ", 8);
	write_state(garbage);
	assert_true(data_line(dir, dir, line));
	assert_true(strlen(line) < DATA_LINE_SIZE);
}

static int make_folder(void **state)
{
	(void)state;
	if (mkdtemp(dir) == NULL)
		return -1;
	snprintf(path, sizeof(path), "%s/data", dir);
	return 0;
}

static int remove_folder(void **state)
{
	(void)state;
	unlink(path);
	return rmdir(dir);
}

int main(void)
{
	const struct CMUnitTest tests[] = {
	    cmocka_unit_test(test_memory),
	    cmocka_unit_test(test_flash),
	    cmocka_unit_test(test_flash_that_is_gone),
	    cmocka_unit_test(test_nothing_said),
	};

	return cmocka_run_group_tests(tests, make_folder, remove_folder);
}
