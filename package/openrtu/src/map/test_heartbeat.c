/* SPDX-License-Identifier: GPL-3.0-or-later */
/* Points are good for as long as their owner's heart beats, on a clock that wraps. */
#include "map/test_stage.h"

#include <sys/syscall.h>
#include <time.h>
#include <unistd.h>

/* ---- the clock, which a test may shift, and look at in the middle of a call --------------------- */

static int64_t clock_shift_ns;
static void (*after_clock)(void); /* what happens between the reading of the clock and what is made of it */

#ifdef SYS_clock_gettime64 /* a 32-bit processor with 64-bit time_t */
#define READ_CLOCK SYS_clock_gettime64
#else
#define READ_CLOCK SYS_clock_gettime
#endif

/* In place of the C library's. */
int clock_gettime(clockid_t clock, struct timespec *out)
{
	long result = syscall(READ_CLOCK, clock, out);
	int64_t now_ns = out->tv_sec * 1000000000LL + out->tv_nsec + clock_shift_ns;

	out->tv_sec = now_ns / 1000000000;
	out->tv_nsec = (long)(now_ns % 1000000000);
	if (after_clock)
		after_clock();
	return (int)result;
}

/* The millisecond counter, which has 32 bits, wraps in so many ms. */
static void wrap_in_ms(int64_t ms)
{
	clock_shift_ns = 0;
	clock_shift_ns = ((INT64_C(1) << 32) - ms) * 1000000 - map_now_ns();
}

static int right_clock_and_tear_down(void **state)
{
	clock_shift_ns = 0;
	after_clock = NULL;
	return tear_down(state);
}

/* ---- heartbeats --------------------------------------------------------------------------------- */

static void test_points_are_invalid_when_the_heartbeat_stops(void **state)
{
	struct stage *stage = *state;
	struct map *owner = start(stage, FIRST);
	struct map_update update = scaled(0, 7, MAP_GOOD, 10);
	int64_t beaten_after, beaten_before;

	set_heartbeat_limit(stage->rtud, index_of(stage, FIRST), MAP_HEARTBEAT_LIMIT_MS);
	map_publish(owner, &update, 1);
	beaten_after = map_now_ns();
	map_heartbeat(owner);
	beaten_before = map_now_ns();
	for (;;) {
		struct map_sample sample;
		int64_t before = map_now_ns();

		assert_true(map_read(stage->rtud, 0, &sample));
		if (sample.quality == MAP_INVALID)
			break;
		assert_true(before - beaten_before <= (MAP_HEARTBEAT_LIMIT_MS + 1) * 1000000LL);
	}
	assert_true(map_now_ns() - beaten_after >= (MAP_HEARTBEAT_LIMIT_MS - 1) * 1000000LL);
	set_heartbeat_limit(stage->rtud, index_of(stage, FIRST), TEST_HEARTBEAT_LIMIT_MS);
	map_heartbeat(owner);
	assert_sample(stage->rtud, 0, 7, MAP_GOOD);
	map_detach(owner);
}

static void test_a_heartbeat_lives_on_when_the_millisecond_counter_wraps(void **state)
{
	struct stage *stage = *state;
	struct map *owner;
	struct map_update update = scaled(0, 7, MAP_GOOD, 10);
	struct map_module module;
	uint32_t before;

	wrap_in_ms(20);
	owner = start(stage, FIRST);
	map_publish(owner, &update, 1);
	before = now_ms();
	map_heartbeat(owner);
	while (now_ms() >= before)
		assert_sample(stage->rtud, 0, 7, MAP_GOOD);
	assert_sample(stage->rtud, 0, 7, MAP_GOOD); /* beaten before the wrap, read after it */
	clock_shift_ns += (TEST_HEARTBEAT_LIMIT_MS + 1) * INT64_C(1000000);
	assert_sample(stage->rtud, 0, 7, MAP_INVALID);
	map_detach(owner);

	owner = start(stage, FIRST);
	map_module(stage->rtud, index_of(stage, FIRST), &module);
	assert_true(map_now_ns() - module.started_ns < 2000000000); /* since 50 days, not since 0 */
	map_detach(owner);
}

static struct segment_header *beating;

static void beat_a_millisecond_later(void)
{
	after_clock = NULL;
	beating->heartbeat_ms = now_ms() + 1;
}

static void test_a_heartbeat_while_its_age_is_taken_is_not_an_old_one(void **state)
{
	struct stage *stage = *state;
	struct map *owner = start(stage, FIRST);
	struct map_update update = scaled(0, 7, MAP_GOOD, 10);

	map_publish(owner, &update, 1);
	beating = owner->segments[owner->self].header;
	after_clock = beat_a_millisecond_later;
	assert_sample(stage->rtud, 0, 7, MAP_GOOD);
	assert_null(after_clock); /* it did happen */
	map_detach(owner);
}

static unsigned clock_readings;

static void count_reading(void)
{
	clock_readings++;
}

static void test_points_are_read_by_the_time_of_the_turn(void **state)
{
	struct stage *stage = *state;
	struct map *owner = start(stage, FIRST);
	struct map_update update = scaled(0, 7, MAP_GOOD, map_now_ns());

	map_publish(owner, &update, 1);
	map_heartbeat(owner);
	map_begin_cycle(stage->rtud);
	after_clock = count_reading;
	assert_sample(stage->rtud, 0, 7, MAP_GOOD);
	assert_int_equal(clock_readings, 0);
	after_clock = NULL;

	clock_shift_ns += 1000000; /* it beats within the turn */
	map_heartbeat(owner);
	after_clock = count_reading;
	assert_sample(stage->rtud, 0, 7, MAP_GOOD);
	assert_int_equal(clock_readings, 0);
	after_clock = NULL;

	clock_shift_ns += (TEST_HEARTBEAT_LIMIT_MS + 1) * INT64_C(1000000);
	assert_sample(stage->rtud, 0, 7, MAP_GOOD);
	map_begin_cycle(stage->rtud);
	assert_sample(stage->rtud, 0, 7, MAP_INVALID);
	map_detach(owner);
}

/* A turn vouches for nothing that it does not know: what comes after its beginning is judged by the clock. */
static void test_what_is_younger_than_the_turn_is_judged_by_the_clock(void **state)
{
	struct stage *stage = *state;
	struct map *owner = start(stage, FIRST);
	struct map_update update = scaled(0, 7, MAP_GOOD, map_now_ns());

	map_publish(owner, &update, 1);
	map_begin_cycle(stage->rtud);
	clock_shift_ns += 2 * TEST_HEARTBEAT_LIMIT_MS * INT64_C(1000000);
	map_heartbeat(owner);
	update = scaled(0, 8, MAP_GOOD, map_now_ns());
	map_publish(owner, &update, 1);
	assert_sample(stage->rtud, 0, 8, MAP_GOOD);
	update = scaled(0, 9, MAP_GOOD, map_now_ns() + 1000000000);
	map_publish(owner, &update, 1);
	assert_sample(stage->rtud, 0, 0, MAP_INVALID);
	map_detach(owner);
}

int main(void)
{
	const struct CMUnitTest tests[] = {
	    cmocka_unit_test_setup_teardown(test_points_are_invalid_when_the_heartbeat_stops, set_up,
					    right_clock_and_tear_down),
	    cmocka_unit_test_setup_teardown(test_a_heartbeat_lives_on_when_the_millisecond_counter_wraps,
					    set_up, right_clock_and_tear_down),
	    cmocka_unit_test_setup_teardown(test_a_heartbeat_while_its_age_is_taken_is_not_an_old_one, set_up,
					    right_clock_and_tear_down),
	    cmocka_unit_test_setup_teardown(test_points_are_read_by_the_time_of_the_turn, set_up,
					    right_clock_and_tear_down),
	    cmocka_unit_test_setup_teardown(test_what_is_younger_than_the_turn_is_judged_by_the_clock, set_up,
					    right_clock_and_tear_down),
	};

	return cmocka_run_group_tests(tests, NULL, NULL);
}
