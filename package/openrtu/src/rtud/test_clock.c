/* SPDX-License-Identifier: GPL-3.0-or-later */
/* The gateway's clock: what it makes of the system's, and of whoever reaches the request ring. */
#include <errno.h>
#include <setjmp.h>
#include <stdarg.h>
#include <stddef.h>
#include <stdint.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <time.h>
#include <unistd.h>

#include <cmocka.h>

#include "map/supervise.h"
#include "map/test_modules.h"
#include "rtud/clock.h"

#define SECOND 1000000000LL
#define MS     1000000LL
#define HOUR   (3600 * SECOND)

static const int64_t wall = 1800000000 * SECOND; /* a whole second */
static char dir[] = "/tmp/test_clock.XXXXXX";
static struct map *rtud, *station;
static uint32_t log_position;
static struct clock_reading now; /* what the kernel says next */

/* A gateway without lines, started at the wall time of the system's clock. */
static void start(enum map_clock_mode mode, bool synchronised)
{
	struct map_config config = {.settings = {.clock = (uint8_t)mode}};
	struct map_module_plan modules[MAP_MODULES_MAX];
	char error[MAP_ERROR_SIZE];

	strcpy(dir + sizeof(dir) - sizeof("XXXXXX"), "XXXXXX");
	assert_non_null(mkdtemp(dir));
	plan_modules(&config, modules, NULL);
	if (map_create(&rtud, dir, &config, 0, error) < 0 ||
	    map_attach(&station, dir, "rtu-iec104", error) < 0)
		fail_msg("%s", error);
	log_position = 0;
	now = (struct clock_reading){.now_ns = map_now_ns(), .error_us = 20000, .synchronised = synchronised};
	now.earliest_ns = wall - now.now_ns;
	now.latest_ns = now.earliest_ns + 2000;
	clock_begin(rtud, &now);
}

static int stop(void **state)
{
	(void)state;
	map_remove(rtud);
	map_detach(station);
	map_detach(rtud);
	return rmdir(dir);
}

static struct map_clock after(int64_t elapsed_ns)
{
	now.now_ns += elapsed_ns;
	clock_follow(rtud, &now);
	return map_clock_read(station);
}

static void step(int64_t ns)
{
	now.earliest_ns += ns;
	now.latest_ns += ns;
}

/* Whether a line with the text was logged since the last one that was asked for. */
static bool was_logged(const char *text)
{
	struct map_log_line line;
	uint32_t lost = 0;

	while (map_log_next(rtud, MAP_RTUD, &log_position, &line, &lost))
		if (strstr(line.text, text) != NULL)
			return true;
	return false;
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

/* ---- what the kernel says ---------------------------------------------------------------- */

static struct timex kernels;
static int kernels_state;

static int kernel(struct timex *out)
{
	assert_int_equal(out->modes, 0); /* it is only asked */
	*out = kernels;
	return kernels_state;
}

static void test_what_synchronised_means(void **state)
{
	static const struct {
		int state, status;
		long max_error;
		bool synchronised;
	} cases[] = {
	    {TIME_OK, 0, 20000, true},           {TIME_OK, STA_PLL | STA_NANO, 15999999, true},
	    {TIME_INS, STA_INS, 20000, true},    {TIME_DEL, STA_DEL, 20000, true},
	    {TIME_OOP, STA_INS, 20000, true},    {TIME_WAIT, 0, 20000, true},
	    {TIME_OK, STA_UNSYNC, 20000, false}, {TIME_INS, STA_INS | STA_UNSYNC, 20000, false},
	    {TIME_ERROR, 0, 20000, false},       {TIME_ERROR, STA_UNSYNC, 16000000, false},
	    {TIME_OK, 0, 16000000, false},       {-1, 0, 0, false},
	};

	(void)state;
	for (size_t i = 0; i < sizeof(cases) / sizeof(cases[0]); i++) {
		struct clock_reading reading;

		kernels_state = cases[i].state;
		kernels = (struct timex){.status = cases[i].status, .maxerror = cases[i].max_error};
		reading = clock_read(kernel);
		assert_int_equal(reading.synchronised, cases[i].synchronised);
		assert_int_equal(reading.state, cases[i].state);
		assert_int_equal(reading.error_us, cases[i].max_error);
		assert_true(reading.earliest_ns <= reading.latest_ns);
		assert_in_range(reading.now_ns, 0, map_now_ns());
	}
}

/* ---- the system's clock ------------------------------------------------------------------ */

static void test_begins_unset_without_a_synchronised_system(void **state)
{
	struct map_clock clock;

	(void)state;
	start(MAP_CLOCK_GATEWAY, false);
	clock = map_clock_read(station);
	assert_false(clock.set);
	assert_int_equal(clock.source, MAP_CLOCK_UNSET);
	assert_in_range(clock.offset_ns, now.earliest_ns, now.latest_ns);
	assert_true(
	    was_logged("the clock starts with the system's, 2027-01-15T08:00:00Z: time tags are invalid"));
}

static void test_begins_set_with_a_synchronised_system(void **state)
{
	(void)state;
	start(MAP_CLOCK_GATEWAY, true);
	assert_true(map_clock_read(station).set);
	assert_true(was_logged("synchronised to 0.020 s"));
}

/* NTP comes long after the start: years are made up for within a tick, and events are told. */
static void test_follows_as_soon_as_it_is_synchronised(void **state)
{
	struct map_cursor cursor;
	struct map_event event;
	struct map_clock clock;

	(void)state;
	start(MAP_CLOCK_GATEWAY, false);
	map_cursor_to_end(station, &cursor);
	step(57 * 365 * 24 * HOUR); /* a step alone makes nobody believe it */
	clock = after(HOUR);
	assert_false(clock.set);
	assert_false(map_event_next(station, &cursor, &event));
	now.synchronised = true;
	clock = after(50 * MS);
	assert_true(clock.set);
	assert_int_equal(clock.source, MAP_CLOCK_SYNCHRONISED);
	assert_in_range(clock.offset_ns, now.earliest_ns, now.latest_ns);
	assert_true(was_logged("synchronised to 0.020 s: the clock follows it, moved by 1797552000.000 s"));
	assert_true(map_event_next(station, &cursor, &event));
	assert_int_equal(event.kind, MAP_EVENT_CLOCK);
	after(50 * MS);
	assert_false(map_event_next(station, &cursor, &event));
}

/* The moment at which two clocks are read is uncertain, by much when the process lost the core: no tag jitters. */
static void test_uncertain_readings_move_nothing(void **state)
{
	int64_t offset_ns, exact_ns;

	(void)state;
	start(MAP_CLOCK_GATEWAY, true);
	offset_ns = map_clock_read(station).offset_ns;
	for (int64_t wide = 0; wide < 100 * MS; wide += MS) {
		now.earliest_ns -= MS;
		now.latest_ns += MS / 2;
		assert_true(after(50 * MS).offset_ns == offset_ns);
	}
	exact_ns = offset_ns + 3 * MS;
	now.earliest_ns = exact_ns - 500;
	now.latest_ns = exact_ns + 500;
	assert_true(after(50 * MS).offset_ns == exact_ns);
	assert_true(was_logged("the clock follows the system's, moved by 0.003 s"));
}

static void test_a_step_of_the_followed_clock_is_followed(void **state)
{
	(void)state;
	start(MAP_CLOCK_GATEWAY, true);
	step(-10 * SECOND);
	assert_in_range(after(50 * MS).offset_ns, now.earliest_ns, now.latest_ns);
	assert_true(was_logged("moved by -10.000 s"));
}

/* ---- the synchronisation is lost --------------------------------------------------------- */

/* 0.02 s were known, 500 ppm from there on: 16 s are reached after 8.88 h. */
static void test_a_lost_clock_runs_on_until_it_may_be_wrong(void **state)
{
	struct map_clock clock;
	int64_t offset_ns;

	(void)state;
	start(MAP_CLOCK_GATEWAY, true);
	offset_ns = after(HOUR).offset_ns;
	now.synchronised = false;
	step(-40 * 24 * HOUR); /* whoever sets it by hand */
	clock = after(9 * SECOND);
	assert_int_equal(clock.source, MAP_CLOCK_SYNCHRONISED);
	assert_true(clock.offset_ns == offset_ns);
	clock = after(2 * SECOND);
	assert_true(clock.set);
	assert_int_equal(clock.source, MAP_CLOCK_HELD);
	assert_true(clock.offset_ns == offset_ns);
	assert_true(was_logged("no longer synchronised: time tags are valid for 8.9 h more"));
	assert_true(after(8 * HOUR).set);
	assert_true(after(3100 * SECOND).set); /* 31911 s */
	clock = after(100 * SECOND);
	assert_false(clock.set);
	assert_int_equal(clock.source, MAP_CLOCK_UNSET);
	assert_true(clock.offset_ns == offset_ns);
	assert_true(was_logged("may be wrong by more than 16 s: time tags are invalid"));
	assert_false(after(100 * HOUR).set);
	assert_false(was_logged(""));
	now.synchronised = true;
	assert_true(after(50 * MS).set);
	assert_in_range(map_clock_read(station).offset_ns, now.earliest_ns, now.latest_ns);
}

/* The daemon died: the kernel counted by itself, and gives up at the same limit. */
static void test_what_the_kernel_gave_up_is_not_held_any_longer(void **state)
{
	(void)state;
	start(MAP_CLOCK_GATEWAY, true);
	now.error_us = 15999800;
	assert_true(after(50 * MS).set);
	now.synchronised = false;
	assert_true(after(9 * SECOND).set);
	assert_false(after(2 * SECOND).set);
}

/* The kernel takes a step for the end of the synchronisation, until chronyd says otherwise. */
static void test_a_step_by_ntp_is_no_loss(void **state)
{
	(void)state;
	start(MAP_CLOCK_GATEWAY, true);
	after(SECOND);
	now.synchronised = false;
	step(HOUR);
	assert_int_equal(after(SECOND).source, MAP_CLOCK_SYNCHRONISED);
	assert_int_equal(set_clock(map_now_ns(), wall), MAP_RESULT_INTERLOCK);
	now.synchronised = true;
	assert_int_equal(after(SECOND).source, MAP_CLOCK_SYNCHRONISED);
	assert_in_range(map_clock_read(station).offset_ns, now.earliest_ns, now.latest_ns);
	assert_true(was_logged("the clock follows the system's, moved by 3600.000 s"));
}

static void test_a_return_within_the_time_is_not_missed(void **state)
{
	(void)state;
	start(MAP_CLOCK_GATEWAY, true);
	for (int i = 0; i < 10; i++) {
		now.synchronised = false;
		assert_int_equal(after(8 * HOUR).source, MAP_CLOCK_HELD);
		assert_true(was_logged("no longer synchronised"));
		now.synchronised = true;
		assert_int_equal(after(8 * HOUR).source, MAP_CLOCK_SYNCHRONISED);
		assert_true(was_logged("the clock follows it"));
	}
}

/* ---- leap seconds ------------------------------------------------------------------------ */

static const struct {
	int due, over;
	int leap_s;
} leaps[] = {{TIME_INS, TIME_OOP, 1}, {TIME_DEL, TIME_WAIT, -1}};

/*
 * What happened before keeps its time, though the offset is another. The kernel tells of the leap from the second's end
 * on, and its clock takes it with the next tick: early is a look between the two.
 */
static void leap(int due, int over, int leap_s, bool early)
{
	int64_t before_ns, offset_ns;
	struct map_clock clock;

	start(MAP_CLOCK_GATEWAY, true);
	now.state = due;
	clock = after(SECOND - 70 * MS); /* 70 ms to go */
	assert_true(
	    was_logged(leap_s > 0 ? "a leap second is inserted at the end" : "a leap second is left out at"));
	assert_int_equal(clock.leap_due_s, leap_s);
	offset_ns = clock.offset_ns;
	before_ns = now.now_ns;
	clock = after(50 * MS);
	assert_true(clock.leap_ns == 0);
	now.state = over;
	if (early)
		clock = after(25 * MS);
	assert_true(clock.leap_ns == 0);
	step(-leap_s * SECOND);
	clock = after(early ? 25 * MS : 50 * MS); /* 30 ms after it */
	assert_true(was_logged(leap_s > 0 ? "a leap second was inserted" : "a leap second was left out"));
	assert_true(clock.set);
	assert_in_range(clock.offset_ns, now.earliest_ns, now.latest_ns);
	assert_true(map_wall_ns(clock, before_ns) == before_ns + offset_ns);
	assert_true(map_wall_ns(clock, before_ns + 69 * MS) == before_ns + 69 * MS + offset_ns);
	assert_true(map_wall_ns(clock, before_ns + 71 * MS) ==
		    before_ns + 71 * MS + offset_ns - leap_s * SECOND);
	now.state = TIME_WAIT;
	clock = after(SECOND);
	now.state = TIME_OK;
	clock = after(HOUR);
	assert_int_equal(clock.leap_due_s, 0);
	assert_false(was_logged(""));
	assert_true(map_wall_ns(clock, before_ns) == before_ns + offset_ns);
	stop(NULL);
}

static void test_leap_seconds(void **state)
{
	(void)state;
	for (size_t i = 0; i < sizeof(leaps) / sizeof(leaps[0]); i++) {
		leap(leaps[i].due, leaps[i].over, leaps[i].leap_s, false);
		leap(leaps[i].due, leaps[i].over, leaps[i].leap_s, true);
	}
}

/* It is announced, and then the server thinks better of it; or somebody steps the clock on such a day. */
static void test_no_leap_second_where_none_was(void **state)
{
	struct map_clock clock;

	(void)state;
	start(MAP_CLOCK_GATEWAY, true);
	now.state = TIME_INS;
	after(SECOND);
	step(-SECOND);
	clock = after(SECOND);
	assert_true(clock.leap_ns == 0);
	assert_true(was_logged("moved by -1.000 s"));
	now.state = TIME_OOP;
	step(-3 * SECOND);
	clock = after(SECOND);
	assert_true(clock.leap_ns == 0);
	assert_true(was_logged("moved by -3.000 s"));
}

/* ---- a controlling station --------------------------------------------------------------- */

static void test_set_by_the_station(void **state)
{
	int64_t at;

	(void)state;
	start(MAP_CLOCK_GATEWAY, false);
	at = map_now_ns();
	assert_int_equal(set_clock(at, wall), MAP_RESULT_DONE);
	assert_true(map_clock_read(station).set);
	assert_int_equal(map_clock_read(station).source, MAP_CLOCK_BY_MASTER);
	assert_true(map_clock_read(station).offset_ns == wall - at);
	step(HOUR); /* of a system that is not synchronised: nobody's business */
	assert_true(after(100 * HOUR).offset_ns == wall - at);
	assert_true(map_clock_read(station).set);
}

static void test_a_synchronised_system_is_not_overruled(void **state)
{
	int64_t at, offset_ns;

	(void)state;
	start(MAP_CLOCK_GATEWAY, false);
	at = map_now_ns();
	assert_int_equal(set_clock(at, wall - HOUR), MAP_RESULT_DONE);
	now.synchronised = true;
	offset_ns = after(50 * MS).offset_ns;
	assert_in_range(offset_ns, now.earliest_ns, now.latest_ns);
	assert_int_equal(set_clock(at, wall - HOUR), MAP_RESULT_INTERLOCK);
	assert_true(was_logged("rtu-iec104 may not set the clock: the system's is synchronised"));
	assert_true(map_clock_read(station).offset_ns == offset_ns);
	now.synchronised = false; /* from here on the station may know better */
	assert_int_equal(after(11 * SECOND).source, MAP_CLOCK_HELD);
	assert_int_equal(set_clock(at, wall - HOUR), MAP_RESULT_DONE);
	assert_int_equal(map_clock_read(station).source, MAP_CLOCK_BY_MASTER);
	assert_true(after(100 * HOUR).set);
}

static void test_the_masters_clock_is_theirs(void **state)
{
	int64_t at;

	(void)state;
	start(MAP_CLOCK_MASTERS, true);
	assert_false(map_clock_read(station).set); /* whatever the system says */
	assert_false(after(HOUR).set);
	at = map_now_ns();
	assert_int_equal(set_clock(at, wall + HOUR), MAP_RESULT_DONE);
	assert_true(after(HOUR).offset_ns == wall + HOUR - at);
}

/* Nobody's clock is set here: it is synchronised, so that the station is refused. */
static void test_the_systems_clock_is_followed_also_unsynchronised(void **state)
{
	(void)state;
	start(MAP_CLOCK_SYSTEM, false);
	assert_false(map_clock_read(station).set);
	step(HOUR);
	assert_in_range(after(50 * MS).offset_ns, now.earliest_ns, now.latest_ns);
	now.synchronised = true;
	assert_true(after(50 * MS).set);
	assert_int_equal(set_clock(map_now_ns(), wall - HOUR), MAP_RESULT_INTERLOCK);
	now.synchronised = false;
	step(HOUR);
	assert_in_range(after(50 * MS).offset_ns, now.earliest_ns, now.latest_ns);
	assert_true(map_clock_read(station).set);
	assert_false(after(9 * HOUR).set);
}

/* Sums with such an offset would overflow. */
static void test_impossible_times_are_refused(void **state)
{
	int64_t at, before;

	(void)state;
	start(MAP_CLOCK_GATEWAY, false);
	at = map_now_ns();
	before = map_clock_read(station).offset_ns;
	assert_int_equal(set_clock(at, INT64_MAX), MAP_RESULT_OUT_OF_RANGE);
	assert_int_equal(set_clock(at, -1), MAP_RESULT_OUT_OF_RANGE);
	assert_int_equal(set_clock(INT64_MIN, wall), MAP_RESULT_OUT_OF_RANGE);
	assert_int_equal(set_clock(at + 1000 * SECOND, wall), MAP_RESULT_OUT_OF_RANGE);
	assert_true(map_clock_read(station).offset_ns == before);
}

/* ---- a configuration with another mode ----------------------------------------------------- */

static int64_t system_set_ns; /* to what; 0: nobody has set it */
static int settable;          /* 0, or why it is not */

/* Nobody's clock is set here. */
int clock_settime(clockid_t clock, const struct timespec *time)
{
	assert_int_equal(clock, CLOCK_REALTIME);
	errno = settable;
	if (settable != 0)
		return -1;
	system_set_ns = time->tv_sec * SECOND + time->tv_nsec;
	return 0;
}

static struct map_clock change_mode(enum map_clock_mode mode)
{
	const struct map_config *config = map_config(rtud);
	const enum map_clock_mode before = (enum map_clock_mode)config->settings.clock;

	((struct map_config *)(uintptr_t)config)->settings.clock = (uint8_t)mode;
	system_set_ns = 0;
	clock_mode_changed(rtud, before);
	return map_clock_read(station);
}

static bool told(struct map_cursor *cursor)
{
	struct map_event event;

	return map_event_next(station, cursor, &event) && event.kind == MAP_EVENT_CLOCK;
}

/* A controlling station's time stays, whoever may set it from now on. */
static void test_modes_that_follow_nobody_else(void **state)
{
	int64_t at;

	(void)state;
	start(MAP_CLOCK_GATEWAY, false);
	at = map_now_ns();
	assert_int_equal(set_clock(at, wall + HOUR), MAP_RESULT_DONE);
	assert_true(change_mode(MAP_CLOCK_MASTERS).set);
	now.synchronised = true; /* which is nothing to this mode */
	assert_true(after(HOUR).offset_ns == wall + HOUR - at);
	assert_true(change_mode(MAP_CLOCK_GATEWAY).offset_ns == wall + HOUR - at);
	assert_int_equal(after(50 * MS).source, MAP_CLOCK_SYNCHRONISED);
	assert_in_range(map_clock_read(station).offset_ns, now.earliest_ns, now.latest_ns);
	assert_true(system_set_ns == 0);
}

static void test_a_synchronised_clock_runs_on_and_may_be_set(void **state)
{
	int64_t at;

	(void)state;
	start(MAP_CLOCK_GATEWAY, true);
	at = map_now_ns();
	assert_int_equal(set_clock(at, wall + HOUR), MAP_RESULT_INTERLOCK);
	change_mode(MAP_CLOCK_MASTERS);
	assert_int_equal(after(50 * MS).source, MAP_CLOCK_HELD);
	assert_true(was_logged("no longer followed"));
	assert_true(map_clock_read(station).set);
	assert_int_equal(set_clock(at, wall + HOUR), MAP_RESULT_DONE);
	assert_true(after(HOUR).offset_ns == wall + HOUR - at);
}

static void test_a_set_clock_becomes_the_systems(void **state)
{
	struct map_cursor cursor;
	int64_t at, least;

	(void)state;
	start(MAP_CLOCK_GATEWAY, false);
	settable = 0;
	at = map_now_ns();
	assert_int_equal(set_clock(at, wall + HOUR), MAP_RESULT_DONE);
	map_cursor_to_end(station, &cursor);
	least = wall + HOUR + map_now_ns() - at;
	assert_true(change_mode(MAP_CLOCK_SYSTEM).set);
	assert_in_range(system_set_ns, least, wall + HOUR + map_now_ns() - at);
	assert_false(told(&cursor)); /* nothing has changed */
	change_mode(MAP_CLOCK_SYSTEM);
	assert_true(system_set_ns == 0); /* it is the system's already */
}

static void test_a_system_that_cannot_be_set_leaves_times_invalid(void **state)
{
	struct map_cursor cursor;

	(void)state;
	start(MAP_CLOCK_MASTERS, false);
	settable = EPERM;
	assert_int_equal(set_clock(map_now_ns(), wall + HOUR), MAP_RESULT_DONE);
	map_cursor_to_end(station, &cursor);
	assert_false(change_mode(MAP_CLOCK_SYSTEM).set);
	assert_true(was_logged("cannot set the system's clock: Operation not permitted"));
	assert_true(told(&cursor));
	now.synchronised = true;
	assert_true(after(50 * MS).set);
}

#define WITH_GATEWAY(test) cmocka_unit_test_teardown(test, stop)

int main(void)
{
	const struct CMUnitTest tests[] = {
	    cmocka_unit_test(test_what_synchronised_means),
	    WITH_GATEWAY(test_begins_unset_without_a_synchronised_system),
	    WITH_GATEWAY(test_begins_set_with_a_synchronised_system),
	    WITH_GATEWAY(test_follows_as_soon_as_it_is_synchronised),
	    WITH_GATEWAY(test_uncertain_readings_move_nothing),
	    WITH_GATEWAY(test_a_step_of_the_followed_clock_is_followed),
	    WITH_GATEWAY(test_a_lost_clock_runs_on_until_it_may_be_wrong),
	    WITH_GATEWAY(test_what_the_kernel_gave_up_is_not_held_any_longer),
	    WITH_GATEWAY(test_a_step_by_ntp_is_no_loss),
	    WITH_GATEWAY(test_a_return_within_the_time_is_not_missed),
	    cmocka_unit_test(test_leap_seconds),
	    WITH_GATEWAY(test_no_leap_second_where_none_was),
	    WITH_GATEWAY(test_set_by_the_station),
	    WITH_GATEWAY(test_a_synchronised_system_is_not_overruled),
	    WITH_GATEWAY(test_the_masters_clock_is_theirs),
	    WITH_GATEWAY(test_the_systems_clock_is_followed_also_unsynchronised),
	    WITH_GATEWAY(test_impossible_times_are_refused),
	    WITH_GATEWAY(test_modes_that_follow_nobody_else),
	    WITH_GATEWAY(test_a_synchronised_clock_runs_on_and_may_be_set),
	    WITH_GATEWAY(test_a_set_clock_becomes_the_systems),
	    WITH_GATEWAY(test_a_system_that_cannot_be_set_leaves_times_invalid),
	};

	return cmocka_run_group_tests(tests, NULL, NULL);
}
