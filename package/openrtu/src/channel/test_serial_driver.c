/* SPDX-License-Identifier: GPL-3.0-or-later */
/* What is asked of a port's driver, and what it did not do: a file is the port, and a driver is behind ioctl(). */
#include <setjmp.h>
#include <stdarg.h>
#include <stddef.h>
#include <stdint.h>

#include <cmocka.h>
#include <errno.h>
#include <fcntl.h>
#include <linux/serial.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <unistd.h>

#include "channel/serial.h"
#include "channel/termios2.h"

static struct {
	struct termios2 settings;
	struct serial_rs485 rs485;
	uint32_t slowest, fastest; /* beyond, the speed stays as it is, and nothing is said */
	tcflag_t without;          /* flags it does not take */
	uint32_t longest_ms;       /* it cuts a longer delay */
	bool has_rs485;
	bool exclusive;
} driver;

static char path[] = "/tmp/test_serial_driver.XXXXXX";

/* As serial_core does, and drivers that begin anew with each change. */
static void set(const struct termios2 *settings)
{
	uint32_t old = driver.settings.c_ospeed;

	driver.settings = *settings;
	driver.settings.c_cflag &= ~driver.without;
	if (settings->c_ospeed < driver.slowest || settings->c_ospeed > driver.fastest)
		driver.settings.c_ospeed = driver.settings.c_ispeed = old;
	memset(&driver.rs485, 0, sizeof(driver.rs485));
}

static void set_rs485(const struct serial_rs485 *settings)
{
	driver.rs485 = *settings;
	if (driver.rs485.delay_rts_before_send > driver.longest_ms)
		driver.rs485.delay_rts_before_send = driver.longest_ms;
}

static int answer(unsigned long request, void *argument)
{
	if ((request == TIOCSRS485 || request == TIOCGRS485) && !driver.has_rs485) {
		errno = ENOTTY;
		return -1;
	}
	switch (request) {
	case TCSETS2:
		set(argument);
		break;
	case TCGETS2:
		*(struct termios2 *)argument = driver.settings;
		break;
	case TIOCSRS485:
		set_rs485(argument);
		break;
	case TIOCGRS485:
		*(struct serial_rs485 *)argument = driver.rs485;
		break;
	case TIOCEXCL:
		driver.exclusive = true;
		break;
	default:
		break;
	}
	return 0;
}

/* The linker puts them in ioctl's place; it has the second name where time_t is wider than long. */
int __wrap_ioctl(int fd, unsigned long request, void *argument);
int __wrap___ioctl_time64(int fd, unsigned long request, void *argument);

int __wrap_ioctl(int fd, unsigned long request, void *argument)
{
	(void)fd;
	return answer(request, argument);
}

int __wrap___ioctl_time64(int fd, unsigned long request, void *argument)
{
	return __wrap_ioctl(fd, request, argument);
}

static int set_up(void **state)
{
	(void)state;
	memset(&driver, 0, sizeof(driver));
	driver.settings.c_ospeed = 9600;
	driver.slowest = 2289; /* the vendor's driver: 150 MHz / 65535 */
	driver.fastest = 9375000;
	driver.longest_ms = 100;
	return 0;
}

/* What serial_open says; empty: it is open. */
static const char *opened(const struct serial_settings *line)
{
	static char error[SERIAL_ERROR_SIZE], hint[SERIAL_HINT_SIZE];
	bool carries_parity = false;
	int fd = serial_open(path, line, &carries_parity, error, hint);

	if (fd < 0)
		return error;
	close(fd);
	assert_true(carries_parity);
	assert_true(driver.exclusive);
	return "";
}

static void test_eight_data_bits_and_every_parity_and_stop_bit(void **state)
{
	(void)state;
	static const tcflag_t parities[] = {
	    [SERIAL_PARITY_NONE] = 0, [SERIAL_PARITY_ODD] = PARENB | PARODD, [SERIAL_PARITY_EVEN] = PARENB};

	for (uint8_t parity = SERIAL_PARITY_NONE; parity <= SERIAL_PARITY_EVEN; parity++) {
		for (uint8_t stop_bits = 1; stop_bits <= 2; stop_bits++) {
			struct serial_settings line = {
			    .baud = 19200, .stop_bits = stop_bits, .parity = parity};
			tcflag_t format = CS8 | parities[parity] | (stop_bits == 2 ? CSTOPB : 0);

			assert_string_equal(opened(&line), "");
			assert_int_equal(driver.settings.c_cflag & (CSIZE | PARENB | PARODD | CSTOPB),
					 format);
			assert_int_equal(driver.settings.c_iflag & (INPCK | IGNPAR | PARMRK), INPCK);
		}
	}
}

static void test_every_speed_is_asked_for_as_it_is(void **state)
{
	(void)state;
	static const uint32_t speeds[] = {2400, 9600, 19200, 38400, 57600, 115200, 187500, 460800, 4000000};

	for (size_t i = 0; i < sizeof(speeds) / sizeof(speeds[0]); i++) {
		struct serial_settings line = {.baud = speeds[i], .stop_bits = 1};

		assert_string_equal(opened(&line), "");
		assert_int_equal(driver.settings.c_ospeed, speeds[i]);
	}
}

static void test_a_speed_that_was_not_taken_is_refused(void **state)
{
	(void)state;
	struct serial_settings line = {.baud = 1200, .stop_bits = 1};

	assert_string_equal(opened(&line), "does not accept 1200 bit/s, it stays at 9600");
	driver.slowest = 1200;
	assert_string_equal(opened(&line), "");
	line.baud = 4000000;
	driver.fastest = 460800;
	assert_string_equal(opened(&line), "does not accept 4000000 bit/s, it stays at 1200");
}

static void test_a_format_that_was_not_taken_is_refused(void **state)
{
	(void)state;
	struct serial_settings line = {.baud = 9600, .stop_bits = 2, .parity = SERIAL_PARITY_ODD};

	driver.without = PARODD;
	assert_string_equal(opened(&line), "does not accept these data bits, this parity or these stop bits");
	driver.without = CSTOPB;
	assert_string_equal(opened(&line), "does not accept these data bits, this parity or these stop bits");
	driver.without = 0;
	assert_string_equal(opened(&line), "");
}

/* The driver forgets the mode when termios change: it must be set after them. */
static void test_rs485_is_in_force_when_the_port_is_open(void **state)
{
	(void)state;
	struct serial_settings line = {
	    .baud = 9600, .stop_bits = 1, .rs485 = SERIAL_RS485_HIGH, .before_ms = 2, .after_ms = 100};

	driver.has_rs485 = true;
	for (int i = 0; i < 2; i++) {
		assert_string_equal(opened(&line), "");
		assert_int_equal(driver.rs485.flags, SER_RS485_ENABLED | SER_RS485_RTS_ON_SEND);
		assert_int_equal(driver.rs485.delay_rts_before_send, 2);
		assert_int_equal(driver.rs485.delay_rts_after_send, 100);
	}
	line.rs485 = SERIAL_RS485_LOW;
	assert_string_equal(opened(&line), "");
	assert_int_equal(driver.rs485.flags, SER_RS485_ENABLED | SER_RS485_RTS_AFTER_SEND);
}

static void test_rs485_is_left_alone_where_nobody_asks_for_it(void **state)
{
	(void)state;
	const struct serial_settings line = {.baud = 9600, .stop_bits = 1};

	driver.has_rs485 = true;
	assert_string_equal(opened(&line), "");
	assert_int_equal(driver.rs485.flags, 0);
}

static void test_rs485_that_was_not_taken_is_refused(void **state)
{
	(void)state;
	const struct serial_settings line = {
	    .baud = 9600, .stop_bits = 1, .rs485 = SERIAL_RS485_HIGH, .before_ms = 5};

	char refused[128];

	snprintf(refused, sizeof(refused), "has no RS-485 mode: %s", strerror(ENOTTY));
	assert_string_equal(opened(&line), refused);
	driver.has_rs485 = true;
	driver.longest_ms = 4;
	assert_string_equal(opened(&line), "does not accept this RS-485 level or these delays");
}

/* Root may open and change a port that is ours alone. */
static void test_what_another_program_changes_is_seen(void **state)
{
	(void)state;
	const struct serial_settings line = {
	    .baud = 9600, .stop_bits = 1, .rs485 = SERIAL_RS485_HIGH, .before_ms = 2, .after_ms = 1};
	struct termios2 ours;
	int fd;

	driver.has_rs485 = true;
	assert_string_equal(opened(&line), "");
	ours = driver.settings;
	fd = open(path, O_RDWR | O_CLOEXEC);
	assert_true(serial_is_as_set(fd, &line));
	driver.settings.c_ospeed = 4800;
	assert_false(serial_is_as_set(fd, &line));
	driver.settings = ours;
	driver.settings.c_cflag |= PARENB;
	assert_false(serial_is_as_set(fd, &line));
	driver.settings = ours;
	driver.settings.c_lflag |= ICANON;
	assert_false(serial_is_as_set(fd, &line));
	driver.settings = ours;
	driver.rs485.delay_rts_after_send = 0;
	assert_false(serial_is_as_set(fd, &line));
	close(fd);
	assert_string_equal(opened(&line), "");
	fd = open(path, O_RDWR | O_CLOEXEC);
	assert_true(serial_is_as_set(fd, &line));
	close(fd);
}

int main(void)
{
	const struct CMUnitTest tests[] = {
	    cmocka_unit_test_setup(test_eight_data_bits_and_every_parity_and_stop_bit, set_up),
	    cmocka_unit_test_setup(test_every_speed_is_asked_for_as_it_is, set_up),
	    cmocka_unit_test_setup(test_a_speed_that_was_not_taken_is_refused, set_up),
	    cmocka_unit_test_setup(test_a_format_that_was_not_taken_is_refused, set_up),
	    cmocka_unit_test_setup(test_rs485_is_in_force_when_the_port_is_open, set_up),
	    cmocka_unit_test_setup(test_rs485_is_left_alone_where_nobody_asks_for_it, set_up),
	    cmocka_unit_test_setup(test_rs485_that_was_not_taken_is_refused, set_up),
	    cmocka_unit_test_setup(test_what_another_program_changes_is_seen, set_up),
	};
	int file = mkstemp(path), failed;

	if (file < 0)
		return EXIT_FAILURE;
	close(file);
	failed = cmocka_run_group_tests_name("serial driver", tests, NULL, NULL);
	unlink(path);
	return failed;
}
