/* SPDX-License-Identifier: GPL-3.0-or-later */
/* The gateway's clock, set by whoever reaches the request ring. */
#include <setjmp.h>
#include <stdarg.h>
#include <stddef.h>
#include <stdint.h>
#include <stdlib.h>
#include <unistd.h>

#include <cmocka.h>

#include "map/supervise.h"
#include "rtud/clock.h"

#define SECOND 1000000000LL

static const int64_t wall = 1800000000 * SECOND;
static char dir[] = "/tmp/test_clock.XXXXXX";
static struct map *rtud, *station;

/* A gateway without lines. */
static int set_up(void **state)
{
	const struct map_config config = {.settings = {.clock = MAP_CLOCK_GATEWAY}};
	char error[MAP_ERROR_SIZE];

	(void)state;
	assert_non_null(mkdtemp(dir));
	if (map_create(&rtud, dir, &config, 0, error) < 0 ||
	    map_attach(&station, dir, "rtu-iec104", error) < 0)
		fail_msg("%s", error);
	clock_begin(rtud);
	return 0;
}

static int tear_down(void **state)
{
	(void)state;
	map_remove(rtud);
	map_detach(station);
	map_detach(rtud);
	return rmdir(dir);
}

/* Returns what the station is answered. */
static enum map_command_result set_clock(int64_t time_ns, int64_t wall_ns)
{
	struct map_request request = {
	    .action = MAP_SET_CLOCK, .point = MAP_NONE, .time_ns = time_ns, .wall_ns = wall_ns};
	struct map_request taken;
	struct map_answer answer;

	map_heartbeat(rtud);
	assert_int_not_equal(map_request_post(station, request), 0);
	assert_true(map_request_next(rtud, &taken));
	clock_set(rtud, &taken);
	assert_true(map_answer_next(station, &answer));
	return answer.result;
}

static void test_set_by_the_station(void **state)
{
	const int64_t now = map_now_ns();

	(void)state;
	assert_int_equal(set_clock(now, wall), MAP_RESULT_DONE);
	assert_true(map_clock_read(station).set);
	assert_true(map_clock_read(station).offset_ns == wall - now);
}

/* Sums with such an offset would overflow. */
static void test_impossible_times_are_refused(void **state)
{
	const int64_t now = map_now_ns(), before = map_clock_read(station).offset_ns;

	(void)state;
	assert_int_equal(set_clock(now, INT64_MAX), MAP_RESULT_OUT_OF_RANGE);
	assert_int_equal(set_clock(now, -1), MAP_RESULT_OUT_OF_RANGE);
	assert_int_equal(set_clock(INT64_MIN, wall), MAP_RESULT_OUT_OF_RANGE);
	assert_int_equal(set_clock(now + 1000 * SECOND, wall), MAP_RESULT_OUT_OF_RANGE);
	assert_true(map_clock_read(station).offset_ns == before);
}

int main(void)
{
	const struct CMUnitTest tests[] = {
	    cmocka_unit_test(test_set_by_the_station),
	    cmocka_unit_test(test_impossible_times_are_refused),
	};

	return cmocka_run_group_tests(tests, set_up, tear_down);
}
