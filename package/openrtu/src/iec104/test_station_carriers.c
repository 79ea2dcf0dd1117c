/* SPDX-License-Identifier: GPL-3.0-or-later */
/* An integer of 32 bits as a bitstring, and an angle as a short float, in both directions. */
#include <string.h>

#include "iec104/test_masters.h"

enum { INTEGER = BITS, ANGLE = FLOAT };

static struct map_point former[POINTS];

static int set_up_carried(void **state)
{
	memcpy(former, points, sizeof(former));
	points[INTEGER].type = MAP_INTEGER;
	points[INTEGER].send_period_ms = 1000;
	points[ANGLE].type = MAP_ANGLE;
	return set_up(state);
}

static int tear_down(void **state)
{
	(void)state;
	memcpy(points, former, sizeof(former));
	return 0;
}

#define CARRIED(name) cmocka_unit_test_setup_teardown(name, set_up_carried, tear_down)

static void test_an_integer_goes_as_a_bitstring(void **state)
{
	(void)state;
	publish(INTEGER, -2);
	run();
	EXPECT(0, 33, 1, 3, 0, 0xa1, 0x0f, 7, 0, 0, 0xfe, 0xff, 0xff, 0xff, 0, TIME);
	fake.samples[INTEGER].quality = MAP_OVERFLOW;
	ASK(0, 102, 1, 5, 0, 0xa1, 0x0f, 7, 0, 0);
	EXPECT(0, 7, 1, 5, 0, 0xa1, 0x0f, 7, 0, 0, 0xfe, 0xff, 0xff, 0xff, 1);
}

/* A bitstring may not be cyclic (IEC 60870-5-101, 7.3.1.7): cause 2, background scan. */
static void test_an_integer_with_a_period_is_scanned_in_the_background(void **state)
{
	(void)state;
	fake.samples[INTEGER].value.i = 0x01020304;
	now += 1000 * MS;
	run();
	EXPECT(0, 7, 1, 2, 0, 0xa1, 0x0f, 7, 0, 0, 4, 3, 2, 1, 0);
}

static void test_an_integer_takes_a_bitstring_command(void **state)
{
	(void)state;
	ASK(0, 51, 1, 6, 0, 0xa1, 0x0f, 7, 0, 0, 0xff, 0xff, 0xff, 0xff);
	expect_nothing(0);
	assert_int_equal(fake.request_count, 1);
	assert_int_equal(fake.requests[0].point, INTEGER);
	assert_int_equal(fake.requests[0].value.i, -1);
}

static void test_an_integer_has_no_parameter_of_the_standard(void **state)
{
	(void)state;
	ASK(0, 112, 1, 6, 0, 0xa1, 0x0f, 7, 0, 0, 0, 0, 0x80, 0x3f, 1);
	EXPECT(0, 112, 1, 0x6f, 0, 0xa1, 0x0f, 7, 0, 0, 0, 0, 0x80, 0x3f, 1);
	assert_int_equal(fake.request_count, 0);
}

static void test_an_angle_goes_as_degrees(void **state)
{
	(void)state;
	publish(ANGLE, 1451234567);
	run();
	EXPECT(0, 36, 1, 3, 0, 0xa1, 0x0f, 11, 0, 0, 0x9b, 0x1f, 0x11, 0x43, 0, TIME); /* 145.12346 */
}

static void test_an_angle_takes_a_set_point_in_degrees(void **state)
{
	(void)state;
	ASK(0, 50, 1, 6, 0, 0xa1, 0x0f, 11, 0, 0, 0, 0, 0xb5, 0xc2, 0); /* -90.5 */
	expect_nothing(0);
	assert_int_equal(fake.request_count, 1);
	assert_int_equal(fake.requests[0].value.i, -905000000);
	ASK(0, 50, 1, 6, 0, 0xa1, 0x0f, 11, 0, 0, 0, 0, 0x35, 0x43, 0); /* 181 */
	EXPECT(0, 50, 1, 0x47, 0, 0xa1, 0x0f, 11, 0, 0, 0, 0, 0x35, 0x43, 0);
	assert_int_equal(fake.request_count, 1);
}

static void test_an_angles_parameters_are_degrees(void **state)
{
	(void)state;
	ASK(0, 112, 1, 6, 0, 0xa1, 0x0f, 11, 0, 0, 0, 0, 0, 0x3f, 1); /* 0.5 */
	assert_int_equal(fake.request_count, 1);
	assert_int_equal(fake.requests[0].detail, MAP_THRESHOLD);
	assert_int_equal(fake.requests[0].value.i, 5000000);
	ASK(0, 112, 1, 6, 0, 0xa1, 0x0f, 11, 0, 0, 0, 0, 0x35, 0x43, 4);
	EXPECT(0, 112, 1, 0x47, 0, 0xa1, 0x0f, 11, 0, 0, 0, 0, 0x35, 0x43, 4);
}

int main(void)
{
	const struct CMUnitTest tests[] = {
	    CARRIED(test_an_integer_goes_as_a_bitstring),
	    CARRIED(test_an_integer_with_a_period_is_scanned_in_the_background),
	    CARRIED(test_an_integer_takes_a_bitstring_command),
	    CARRIED(test_an_integer_has_no_parameter_of_the_standard),
	    CARRIED(test_an_angle_goes_as_degrees),
	    CARRIED(test_an_angle_takes_a_set_point_in_degrees),
	    CARRIED(test_an_angles_parameters_are_degrees),
	};

	return cmocka_run_group_tests(tests, NULL, NULL);
}
