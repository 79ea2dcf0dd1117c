/* SPDX-License-Identifier: GPL-3.0-or-later */
#include <setjmp.h>
#include <stdarg.h>
#include <stddef.h>
#include <stdint.h>
#include <string.h>

#include <cmocka.h>

#include "gps/track.h"
#include "map/map.h"
#include "map/time_ns.h"

#define METRE_E7 90 /* of latitude, in 1e-7 degree: 1.0008 m */

static const struct gps_limits limits = {
    .speed_mm_s = 50000, .slack_mm = 100000, .believed = 3, .clock_ns = 2 * NS_PER_S};
static const struct gps_rule rule = {
    .distance_mm = 100000, .turn = 2000, .turn_speed_mm_s = 1000, .time_ns = 60 * NS_PER_S};
static struct gps_track track;

static int setup(void **state)
{
	(void)state;
	track = (struct gps_track){0};
	return 0;
}

static struct gps_fix fix_at(int64_t second, int32_t metres)
{
	return (struct gps_fix){.arrival_ns = second * NS_PER_S,
				.time_ns = (second + 1000000) * NS_PER_S,
				.known = GPS_POSITION | GPS_TIME | GPS_SPEED | GPS_COURSE,
				.latitude = 500000000 + metres * METRE_E7,
				.speed_mm_s = 10000,
				.method = GPS_AUTONOMOUS};
}

static uint32_t marks_of(struct gps_fix fix)
{
	gps_track_judge(&track, &limits, &fix);
	return fix.marks;
}

static void test_a_drive(void **state)
{
	(void)state;
	for (int second = 0; second < 100; second++)
		assert_int_equal(marks_of(fix_at(second, second * 49)), 0);
}

static void test_a_jump_and_back(void **state)
{
	(void)state;
	assert_int_equal(marks_of(fix_at(0, 0)), 0);
	assert_int_equal(marks_of(fix_at(1, 5000)), GPS_JUMP);
	assert_int_equal(marks_of(fix_at(2, 20)), 0);
	assert_int_equal(track.jumps, 1);
}

static void test_a_jump_that_lasts(void **state)
{
	(void)state;
	assert_int_equal(marks_of(fix_at(0, 0)), 0);
	assert_int_equal(marks_of(fix_at(1, 5000)), GPS_JUMP);
	assert_int_equal(marks_of(fix_at(2, 5010)), GPS_JUMP);
	assert_int_equal(marks_of(fix_at(3, 5020)), GPS_JUMP);
	assert_int_equal(marks_of(fix_at(4, 5030)), 0);
	assert_int_equal(marks_of(fix_at(5, 5040)), 0);
}

static void test_one_jump_after_the_other_is_not_believed(void **state)
{
	(void)state;
	assert_int_equal(marks_of(fix_at(0, 0)), 0);
	for (int second = 1; second < 50; second++)
		assert_int_equal(marks_of(fix_at(second, second % 2 ? 50000 : 90000)), GPS_JUMP);
}

static void test_time_makes_a_distance_possible(void **state)
{
	(void)state;
	assert_int_equal(marks_of(fix_at(0, 0)), 0);
	assert_int_equal(marks_of(fix_at(100, 5090)), 0);
	assert_int_equal(marks_of(fix_at(400000, 1000000)), 0); /* days later */
}

static void test_too_fast(void **state)
{
	struct gps_fix fix = fix_at(0, 0);

	(void)state;
	fix.speed_mm_s = 50001;
	assert_int_equal(marks_of(fix), GPS_TOO_FAST);
}

static void test_a_clock_that_steps(void **state)
{
	struct gps_fix fix = fix_at(1, 0);

	(void)state;
	assert_int_equal(marks_of(fix_at(0, 0)), 0);
	fix.time_ns += 3 * NS_PER_S;
	assert_int_equal(marks_of(fix), GPS_CLOCK_STEP);
	fix.arrival_ns += NS_PER_S;
	fix.time_ns += NS_PER_S;
	assert_int_equal(marks_of(fix), 0);
	assert_int_equal(marks_of(fix_at(3, 0)), GPS_CLOCK_STEP); /* and back */
}

static void test_no_fix_changes_nothing(void **state)
{
	(void)state;
	assert_int_equal(marks_of(fix_at(0, 0)), 0);
	assert_int_equal(marks_of((struct gps_fix){.arrival_ns = NS_PER_S}), 0);
	assert_int_equal(marks_of(fix_at(2, 5000)), GPS_JUMP);
}

/* ---- events -------------------------------------------------------------------------------- */

static void test_first_and_state(void **state)
{
	const struct gps_fix sent = fix_at(0, 0);
	struct gps_fix fix = fix_at(1, 0);

	(void)state;
	assert_int_equal(gps_due(&rule, NULL, &fix), GPS_FIRST);
	assert_int_equal(gps_due(&rule, &sent, &fix), GPS_NOT_DUE);
	fix.method = GPS_ESTIMATED;
	assert_int_equal(gps_due(&rule, &sent, &fix), GPS_STATE);
	fix = fix_at(1, 0);
	fix.marks = GPS_JUMP;
	assert_int_equal(gps_due(&rule, &sent, &fix), GPS_STATE);
	fix = (struct gps_fix){.arrival_ns = NS_PER_S};
	assert_int_equal(gps_due(&rule, &sent, &fix), GPS_STATE);
}

static void test_distance(void **state)
{
	const struct gps_fix sent = fix_at(0, 0), near = fix_at(1, 99), far = fix_at(1, 100);

	(void)state;
	assert_int_equal(gps_due(&rule, &sent, &near), GPS_NOT_DUE);
	assert_int_equal(gps_due(&rule, &sent, &far), GPS_BY_DISTANCE);
}

static void test_turn(void **state)
{
	struct gps_fix sent = fix_at(0, 0), fix = fix_at(1, 0);

	(void)state;
	sent.course = 35500;
	fix.course = 1499;
	assert_int_equal(gps_due(&rule, &sent, &fix), GPS_NOT_DUE);
	fix.course = 1500;
	assert_int_equal(gps_due(&rule, &sent, &fix), GPS_BY_TURN);
	assert_int_equal(gps_due(&rule, &fix, &sent), GPS_BY_TURN);
	fix.speed_mm_s = 999;
	assert_int_equal(gps_due(&rule, &sent, &fix), GPS_NOT_DUE);
}

static void test_time(void **state)
{
	const struct gps_rule nothing = {0};
	const struct gps_fix sent = fix_at(0, 0), before = fix_at(59, 0), then = fix_at(60, 0);

	(void)state;
	assert_int_equal(gps_due(&rule, &sent, &before), GPS_NOT_DUE);
	assert_int_equal(gps_due(&rule, &sent, &then), GPS_BY_TIME);
	assert_int_equal(gps_due(&nothing, &sent, &then), GPS_NOT_DUE);
}

static void test_quality(void **state)
{
	struct gps_fix fix = fix_at(0, 0);

	(void)state;
	assert_int_equal(gps_quality(&fix, 5 * NS_PER_S, 5 * NS_PER_S), 0);
	assert_int_equal(gps_quality(&fix, 5 * NS_PER_S + 1, 5 * NS_PER_S), MAP_NOT_TOPICAL);
	fix.marks = GPS_JUMP;
	assert_int_equal(gps_quality(&fix, 0, NS_PER_S), MAP_INVALID);
	fix.marks = 0;
	for (uint8_t method = GPS_ESTIMATED; method < GPS_METHODS; method++) {
		fix.method = method;
		assert_int_equal(gps_quality(&fix, 0, NS_PER_S), MAP_SUBSTITUTED);
	}
	fix = (struct gps_fix){0};
	assert_int_equal(gps_quality(&fix, 0, NS_PER_S), MAP_INVALID);
}

int main(void)
{
	const struct CMUnitTest tests[] = {
	    cmocka_unit_test_setup(test_a_drive, setup),
	    cmocka_unit_test_setup(test_a_jump_and_back, setup),
	    cmocka_unit_test_setup(test_a_jump_that_lasts, setup),
	    cmocka_unit_test_setup(test_one_jump_after_the_other_is_not_believed, setup),
	    cmocka_unit_test_setup(test_time_makes_a_distance_possible, setup),
	    cmocka_unit_test_setup(test_too_fast, setup),
	    cmocka_unit_test_setup(test_a_clock_that_steps, setup),
	    cmocka_unit_test_setup(test_no_fix_changes_nothing, setup),
	    cmocka_unit_test(test_first_and_state),
	    cmocka_unit_test(test_distance),
	    cmocka_unit_test(test_turn),
	    cmocka_unit_test(test_time),
	    cmocka_unit_test(test_quality),
	};
	return cmocka_run_group_tests_name("gps track", tests, NULL, NULL);
}
