/* SPDX-License-Identifier: GPL-3.0-or-later */
#include <setjmp.h>
#include <stdarg.h>
#include <stddef.h>
#include <stdint.h>

#include <cmocka.h>
#include <errno.h>
#include <fcntl.h>
#include <stdlib.h>
#include <string.h>
#include <unistd.h>

#include "channel/serial.h"

static const struct serial_settings even_line = {.baud = 19200, .stop_bits = 1, .parity = SERIAL_PARITY_EVEN};

static char path[64], hint[SERIAL_HINT_SIZE];
static int master = -1;

static int open_master(void **state)
{
	(void)state;
	master = posix_openpt(O_RDWR | O_NOCTTY);
	return master < 0 || grantpt(master) < 0 || unlockpt(master) < 0 ||
	       ptsname_r(master, path, sizeof(path)) != 0;
}

static int close_master(void **state)
{
	(void)state;
	return close(master);
}

static int open_line(char *error)
{
	bool carries_parity = true;
	int fd = serial_open(path, &even_line, &carries_parity, error, hint);

	if (fd >= 0)
		assert_false(carries_parity);
	return fd;
}

/* The second time nothing changes but the parity that a pty does not take. */
static void test_a_pseudo_terminal_is_accepted_again_and_again(void **state)
{
	(void)state;
	for (int i = 0; i < 3; i++) {
		char error[SERIAL_ERROR_SIZE] = "";
		int fd = open_line(error);

		assert_string_equal(error, "");
		assert_true(fd >= 0);
		close(fd);
	}
}

/* No translation, no echo, no signal characters, no waiting. */
static void test_bytes_pass_unchanged(void **state)
{
	(void)state;
	char error[SERIAL_ERROR_SIZE];
	uint8_t all[256], got[256];
	size_t count = 0;
	int fd = open_line(error);

	assert_int_equal(read(fd, got, sizeof(got)), -1);
	assert_int_equal(errno, EAGAIN);
	for (unsigned i = 0; i < sizeof(all); i++)
		all[i] = (uint8_t)i;
	assert_int_equal(write(fd, all, sizeof(all)), sizeof(all));
	while (count < sizeof(got)) {
		ssize_t length = read(master, got + count, sizeof(got) - count);
		assert_true(length > 0);
		count += (size_t)length;
	}
	assert_memory_equal(got, all, sizeof(all));
	close(fd);
}

static void test_only_one_may_have_it(void **state)
{
	(void)state;
	char error[SERIAL_ERROR_SIZE];
	int fd = open_line(error);

	assert_int_equal(open_line(error), -1);
	assert_string_equal(error, "is used by another process");
	close(fd);
	fd = open_line(error);
	assert_true(fd >= 0);
	close(fd);
}

static void test_what_is_no_port_is_refused(void **state)
{
	(void)state;
	char error[SERIAL_ERROR_SIZE];
	bool carries_parity;

	assert_int_equal(serial_open("/nowhere/ttyS1", &even_line, &carries_parity, error, hint), -1);
	assert_string_equal(error, "cannot be opened: No such file or directory");
	char file[] = "/tmp/test_serial.XXXXXX";
	int fd = mkstemp(file);
	assert_int_equal(serial_open(file, &even_line, &carries_parity, error, hint), -1);
	assert_non_null(strstr(error, "is not a serial port"));
	close(fd);
	unlink(file);
}

static void test_a_pseudo_terminal_has_no_rs485_mode(void **state)
{
	(void)state;
	const struct serial_settings line = {.baud = 19200, .stop_bits = 1, .rs485 = SERIAL_RS485_HIGH};
	char error[SERIAL_ERROR_SIZE];
	bool carries_parity;

	assert_int_equal(serial_open(path, &line, &carries_parity, error, hint), -1);
	assert_non_null(strstr(error, "has no RS-485 mode"));
}

int main(void)
{
	const struct CMUnitTest tests[] = {
	    cmocka_unit_test_setup_teardown(test_a_pseudo_terminal_is_accepted_again_and_again, open_master,
					    close_master),
	    cmocka_unit_test_setup_teardown(test_bytes_pass_unchanged, open_master, close_master),
	    cmocka_unit_test_setup_teardown(test_only_one_may_have_it, open_master, close_master),
	    cmocka_unit_test(test_what_is_no_port_is_refused),
	    cmocka_unit_test_setup_teardown(test_a_pseudo_terminal_has_no_rs485_mode, open_master,
					    close_master),
	};
	return cmocka_run_group_tests_name("serial", tests, NULL, NULL);
}
