/* SPDX-License-Identifier: GPL-3.0-or-later */
/* What rtud asks of a watchdog, with a file as the device and a driver behind ioctl(). On a kernel: tests/linux. */
#include "rtud/watchdog.h"

#include <errno.h>
#include <setjmp.h>
#include <stdarg.h>
#include <stddef.h>
#include <stdint.h>
#include <stdlib.h>
#include <string.h>
#include <unistd.h>

#include <linux/watchdog.h>

#include <cmocka.h>

static struct {
	int longest_s; /* 0: it is no watchdog */
	int timeout_s;
	int asked_s;
	unsigned feedings;
} driver;

static char device[32];
static int file;

static int no_watchdog(void)
{
	errno = ENOTTY;
	return -1;
}

static int answer(unsigned long request, int *value)
{
	if (driver.longest_s == 0)
		return no_watchdog();
	switch (request) {
	case WDIOC_SETTIMEOUT:
		driver.asked_s = *value;
		if (*value > driver.longest_s) {
			errno = EINVAL;
			return -1;
		}
		driver.timeout_s = *value;
		return 0;
	case WDIOC_GETTIMEOUT:
		*value = driver.timeout_s;
		return 0;
	case WDIOC_KEEPALIVE:
		driver.feedings++;
		return 0;
	default:
		return no_watchdog();
	}
}

/* The linker puts them in ioctl's place; it has the second name where time_t is wider than long. */
int __wrap_ioctl(int fd, unsigned long request, int *value);
int __wrap___ioctl_time64(int fd, unsigned long request, int *value);

int __wrap_ioctl(int fd, unsigned long request, int *value)
{
	(void)fd;
	return answer(request, value);
}

int __wrap___ioctl_time64(int fd, unsigned long request, int *value)
{
	return __wrap_ioctl(fd, request, value);
}

static int set_up(void **state)
{
	(void)state;
	driver.longest_s = 60;
	driver.timeout_s = 11;
	driver.asked_s = 0;
	driver.feedings = 0;
	strcpy(device, "/tmp/test_watchdog.XXXXXX");
	file = mkstemp(device);
	return file < 0 ? -1 : 0;
}

static int tear_down(void **state)
{
	(void)state;
	unlink(device);
	return close(file);
}

static void assert_written(const char *expected)
{
	char written[8] = "";

	assert_true(pread(file, written, sizeof(written) - 1, 0) >= 0);
	assert_string_equal(written, expected);
}

static void test_gets_the_time_out_that_is_asked_for(void **state)
{
	int timeout_s;

	(void)state;
	assert_true(watchdog_open(device, &timeout_s) >= 0);
	assert_int_equal(driver.asked_s, WATCHDOG_ASKED_S);
	assert_int_equal(timeout_s, WATCHDOG_ASKED_S);
}

/* The vendor's driver: 11 s at most. */
static void test_takes_the_time_out_that_the_device_has(void **state)
{
	int timeout_s;

	(void)state;
	driver.longest_s = 11;
	assert_true(watchdog_open(device, &timeout_s) >= 0);
	assert_int_equal(driver.asked_s, WATCHDOG_ASKED_S);
	assert_int_equal(timeout_s, 11);
}

static void test_what_is_no_watchdog_is_left_as_it_was(void **state)
{
	int timeout_s;

	(void)state;
	driver.longest_s = 0;
	assert_int_equal(watchdog_open(device, &timeout_s), -1);
	assert_int_equal(errno, ENOTTY);
	assert_written("");
	assert_int_equal(watchdog_open("no-such-folder/watchdog", &timeout_s), -1);
	assert_int_equal(errno, ENOENT);
}

static void test_only_the_orderly_end_stops_it(void **state)
{
	int timeout_s, fd = watchdog_open(device, &timeout_s);

	(void)state;
	watchdog_feed(fd);
	watchdog_feed(fd);
	assert_int_equal(driver.feedings, 2);
	assert_written("");
	watchdog_stop(fd);
	assert_written("V");
	assert_int_equal(close(fd), -1);
}

int main(void)
{
	const struct CMUnitTest tests[] = {
	    cmocka_unit_test_setup_teardown(test_gets_the_time_out_that_is_asked_for, set_up, tear_down),
	    cmocka_unit_test_setup_teardown(test_takes_the_time_out_that_the_device_has, set_up, tear_down),
	    cmocka_unit_test_setup_teardown(test_what_is_no_watchdog_is_left_as_it_was, set_up, tear_down),
	    cmocka_unit_test_setup_teardown(test_only_the_orderly_end_stops_it, set_up, tear_down),
	};

	return cmocka_run_group_tests(tests, NULL, NULL);
}
