/* SPDX-License-Identifier: GPL-3.0-or-later */
/* Counters: readings, freezes, resets, and what stays of them. */
#include "map/test_stage.h"

#define S 1000000000LL

enum { COUNTER, GROUP_2, OTHER_DEVICE = 4 };

static int set_up_counters(void **state)
{
	struct stage *stage;

	set_up(state);
	stage = *state;
	stage->points[COUNTER].type = stage->points[GROUP_2].type = stage->points[OTHER_DEVICE].type =
	    MAP_COUNTER;
	stage->points[GROUP_2].counter_group = 2;
	stage->points[OTHER_DEVICE].freeze_s = 3600;
	stage->processes[1] = stage->processes[0]; /* both sets are one owner's */
	make_again(stage);
	return 0;
}

#define COUNTERS(name) cmocka_unit_test_setup_teardown(name, set_up_counters, tear_down)

static void count_in(struct map *owner, uint32_t point, bool narrow, uint32_t value, uint8_t quality)
{
	struct map_update update = scaled(point, (int32_t)value, quality, map_now_ns());

	update.flags = narrow ? MAP_UPDATE_NARROW : 0;
	map_publish(owner, &update, 1);
}

/* The device is read. */
static void count(struct map *owner, uint32_t point, uint32_t value)
{
	count_in(owner, point, false, value, MAP_GOOD);
}

/* The same of a counter of one register. */
static void count_narrow(struct map *owner, uint16_t value)
{
	count_in(owner, COUNTER, true, value, MAP_GOOD);
}

static void freeze(struct command_stage *commands, uint32_t point, enum map_freeze mode, uint32_t which)
{
	struct map_request wish = request(point, MAP_FREEZE, 1, (int32_t)which);

	wish.detail = (uint8_t)mode;
	assert_false(post(commands, wish));
	assert_answer(commands, MAP_EXECUTED_COMMAND, MAP_RESULT_DONE);
}

static void assert_total(const struct map *map, uint32_t point, uint32_t value, uint8_t detail)
{
	struct map_sample total;

	assert_true(map_total_read(map, point, &total));
	assert_int_equal(total.value.u, value);
	assert_int_equal(total.detail, detail);
}

static void test_a_freeze_keeps_the_reading_and_counts(void **state)
{
	struct command_stage commands = start_commands(*state);

	count(commands.owner, COUNTER, 100);
	assert_total(commands.requester, COUNTER, 100, 0); /* never frozen: as it is */
	freeze(&commands, COUNTER, MAP_FREEZE_ONLY, 0);
	count(commands.owner, COUNTER, 150);
	assert_total(commands.requester, COUNTER, 100, 1);
	assert_sample(commands.requester, COUNTER, 150, MAP_GOOD);
	for (unsigned i = 0; i < 31; i++)
		freeze(&commands, COUNTER, MAP_FREEZE_ONLY, 0);
	assert_total(commands.requester, COUNTER, 150, 0); /* modulo 32 */
	end_commands(&commands);
}

static void test_a_reset_is_a_subtraction(void **state)
{
	struct command_stage commands = start_commands(*state);

	count(commands.owner, COUNTER, 100);
	freeze(&commands, COUNTER, MAP_FREEZE_AND_RESET, 0);
	assert_total(commands.requester, COUNTER, 100, 1);
	assert_sample(commands.requester, COUNTER, 0, MAP_GOOD);
	count(commands.owner, COUNTER, 130);
	assert_sample(commands.requester, COUNTER, 30, MAP_GOOD);
	freeze(&commands, COUNTER, MAP_RESET_ONLY, 0);
	assert_total(commands.requester, COUNTER, 100, 1); /* not frozen again */
	count(commands.owner, COUNTER, 137);
	freeze(&commands, COUNTER, MAP_FREEZE_ONLY, 0);
	assert_total(commands.requester, COUNTER, 7, 2 | MAP_COUNTER_ADJUSTED);
	freeze(&commands, COUNTER, MAP_FREEZE_ONLY, 0);
	assert_total(commands.requester, COUNTER, 7, 3); /* that was before the last freeze */
	end_commands(&commands);
}

/* A device that stops answering says no value: what it counted before is its reading, and nothing is subtracted again. */
static void test_an_update_that_keeps_the_value_counts_nothing(void **state)
{
	struct command_stage commands = start_commands(*state);
	struct map_update lost = {.point = COUNTER, .flags = MAP_UPDATE_KEEPS_VALUE};

	count(commands.owner, COUNTER, 100);
	freeze(&commands, COUNTER, MAP_RESET_ONLY, 0);
	count(commands.owner, COUNTER, 130);
	lost.sample = (struct map_sample){.value.u = 7, .quality = MAP_NOT_TOPICAL, .time_ns = map_now_ns()};
	map_publish(commands.owner, &lost, 1);
	assert_sample(commands.requester, COUNTER, 30, MAP_NOT_TOPICAL);
	count(commands.owner, COUNTER, 131);
	assert_sample(commands.requester, COUNTER, 31, MAP_GOOD);
	end_commands(&commands);
}

/* A station of several devices freezes as one. */
static void test_a_freeze_is_the_stations(void **state)
{
	struct stage *stage = *state;
	struct command_stage commands;

	stage->sets[1].ca = stage->sets[0].ca;
	stage->points[OTHER_DEVICE].ioa += 1000;
	make_again(stage);
	commands = start_commands(*state);
	count(commands.owner, COUNTER, 7);
	count(commands.owner, OTHER_DEVICE, 8);
	freeze(&commands, COUNTER, MAP_FREEZE_ONLY, 0);
	assert_total(commands.requester, COUNTER, 7, 1);
	assert_total(commands.requester, OTHER_DEVICE, 8, 1);
	end_commands(&commands);
}

static void test_an_overflow_is_carried(void **state)
{
	struct command_stage commands = start_commands(*state);

	count(commands.owner, COUNTER, UINT32_MAX - 5);
	count(commands.owner, COUNTER, 4);
	count(commands.owner, COUNTER, 5);
	freeze(&commands, COUNTER, MAP_FREEZE_ONLY, 0);
	assert_total(commands.requester, COUNTER, 5, 1 | MAP_COUNTER_CARRY);
	freeze(&commands, COUNTER, MAP_FREEZE_ONLY, 0);
	assert_total(commands.requester, COUNTER, 5, 2);
	end_commands(&commands);
}

static void test_a_narrow_counter_goes_on_where_its_register_wraps(void **state)
{
	struct command_stage commands = start_commands(*state);

	count_narrow(commands.owner, 65000);
	for (uint32_t total = 65000; total < 265000; total += 20000)
		count_narrow(commands.owner, (uint16_t)(total + 20000));
	assert_sample(commands.requester, COUNTER, 265000, MAP_GOOD);
	freeze(&commands, COUNTER, MAP_FREEZE_AND_RESET, 0);
	assert_total(commands.requester, COUNTER, 265000, 1); /* neither carried nor adjusted */
	count_narrow(commands.owner, (uint16_t)(265000 + 30000));
	count_narrow(commands.owner, (uint16_t)(265000 + 60000));
	assert_sample(commands.requester, COUNTER, 60000, MAP_GOOD);
	end_commands(&commands);
}

static void test_a_narrow_counter_that_falls_back_goes_on_and_says_so(void **state)
{
	struct command_stage commands = start_commands(*state);

	count_narrow(commands.owner, 60000);
	count_narrow(commands.owner, 10000); /* 15 536 more */
	count_narrow(commands.owner, 5);     /* it was restarted */
	assert_sample(commands.requester, COUNTER, 75541, MAP_GOOD);
	count_narrow(commands.owner, 6);
	freeze(&commands, COUNTER, MAP_FREEZE_ONLY, 0);
	assert_total(commands.requester, COUNTER, 75542, 1 | MAP_COUNTER_ADJUSTED);
	end_commands(&commands);
}

/* A counter that comes as a floating point number may be none for a while. */
static void test_an_invalid_reading_changes_nothing(void **state)
{
	struct command_stage commands = start_commands(*state);

	count(commands.owner, COUNTER, 100);
	count_in(commands.owner, COUNTER, false, 0, MAP_INVALID);
	assert_sample(commands.requester, COUNTER, 100, MAP_INVALID);
	count(commands.owner, COUNTER, 101);
	freeze(&commands, COUNTER, MAP_FREEZE_ONLY, 0);
	assert_total(commands.requester, COUNTER, 101, 1);
	end_commands(&commands);
}

/* A device that overflows after a reset: the reading does not. */
static void test_the_overflow_is_the_readings(void **state)
{
	struct command_stage commands = start_commands(*state);

	count(commands.owner, COUNTER, UINT32_MAX - 5);
	freeze(&commands, COUNTER, MAP_FREEZE_AND_RESET, 0);
	count(commands.owner, COUNTER, 4);
	freeze(&commands, COUNTER, MAP_FREEZE_ONLY, 0);
	assert_total(commands.requester, COUNTER, 10, 2);
	end_commands(&commands);
}

static void test_an_exchanged_device_is_adjusted(void **state)
{
	struct command_stage commands = start_commands(*state);

	count(commands.owner, COUNTER, 1000);
	freeze(&commands, COUNTER, MAP_FREEZE_AND_RESET, 0);
	count(commands.owner, COUNTER, 1500);
	count(commands.owner, COUNTER, 3);
	freeze(&commands, COUNTER, MAP_FREEZE_ONLY, 0);
	assert_total(commands.requester, COUNTER, 3, 2 | MAP_COUNTER_ADJUSTED);
	end_commands(&commands);
}

static void test_groups_and_devices(void **state)
{
	struct command_stage commands = start_commands(*state);

	count(commands.owner, COUNTER, 10);
	count(commands.owner, GROUP_2, 20);
	count(commands.owner, OTHER_DEVICE, 30);
	freeze(&commands, COUNTER, MAP_FREEZE_ONLY, 2);
	assert_total(commands.requester, COUNTER, 10, 0);
	assert_total(commands.requester, GROUP_2, 20, 1);
	freeze(&commands, COUNTER, MAP_FREEZE_ONLY, 0);
	assert_total(commands.requester, COUNTER, 10, 1);
	assert_total(commands.requester, GROUP_2, 20, 2);
	assert_total(commands.requester, OTHER_DEVICE, 30, 0);
	freeze(&commands, COUNTER, MAP_FREEZE_ONLY, MAP_FREEZE_ALL_DEVICES);
	assert_total(commands.requester, OTHER_DEVICE, 30, 1);
	end_commands(&commands);
}

static void test_wrong_and_late_freezes_are_refused(void **state)
{
	struct command_stage commands = start_commands(*state);
	struct map_request wish = request(COUNTER, MAP_FREEZE, 1, 0);

	count(commands.owner, COUNTER, 10);
	assert_false(post(&commands, wish)); /* mode 0 */
	assert_answer(&commands, MAP_REFUSED_COMMAND, MAP_RESULT_OUT_OF_RANGE);
	wish.detail = MAP_FREEZE_ONLY;
	wish.deadline_ns = map_now_ns() - 1;
	assert_false(post(&commands, wish));
	assert_answer(&commands, MAP_REFUSED_COMMAND, MAP_RESULT_TOO_OLD);
	assert_total(commands.requester, COUNTER, 10, 0);
	end_commands(&commands);
}

static void test_totals_survive_their_owner(void **state)
{
	struct stage *stage = *state;
	struct command_stage commands = start_commands(stage);

	count(commands.owner, COUNTER, 100);
	freeze(&commands, COUNTER, MAP_FREEZE_AND_RESET, 0);
	/* it dies while it writes the next total */
	latch_flip(&commands.owner->segments[commands.owner->self].totals[0].latch);
	commands.owner->segments[commands.owner->self].totals[0].copies[0].offset = 12345;
	map_module_ended(stage->rtud, index_of(stage, FIRST), true);
	assert_total(commands.requester, COUNTER, 100, 1);
	map_detach(commands.owner);

	commands.owner = start(stage, FIRST);
	assert_total(commands.requester, COUNTER, 100, 1);
	count(commands.owner, COUNTER, 104);
	assert_sample(commands.requester, COUNTER, 4, MAP_GOOD);
	end_commands(&commands);
}

static void test_a_period_freezes_and_tells(void **state)
{
	struct stage *stage = *state;
	struct command_stage commands = start_commands(stage);
	struct map_clock clock = {.offset_ns = 7200 * S - S / 2 - map_now_ns(), .set = true};
	struct map_cursor cursor;
	struct map_event event;

	map_cursor_to_end(commands.requester, &cursor);
	map_clock_write(stage->rtud, clock);
	map_totals_tick(commands.owner);
	count(commands.owner, OTHER_DEVICE, 55);
	map_totals_tick(commands.owner);
	assert_false(
	    map_event_next(commands.requester, &cursor, &event)); /* only frozen readings are events */
	clock.offset_ns += S;
	map_clock_write(stage->rtud, clock);
	map_totals_tick(commands.owner);
	count(commands.owner, OTHER_DEVICE, 56);
	map_totals_tick(commands.owner);
	assert_true(map_event_next(commands.requester, &cursor, &event));
	assert_int_equal(event.point, OTHER_DEVICE);
	assert_int_equal(event.sample.value.u, 55);
	assert_int_equal(event.sample.detail, MAP_COUNTER_FROZEN | 1);
	assert_false(map_event_next(commands.requester, &cursor, &event));
	end_commands(&commands);
}

int main(void)
{
	const struct CMUnitTest tests[] = {
	    COUNTERS(test_a_freeze_keeps_the_reading_and_counts),
	    COUNTERS(test_a_reset_is_a_subtraction),
	    COUNTERS(test_an_update_that_keeps_the_value_counts_nothing),
	    COUNTERS(test_an_overflow_is_carried),
	    COUNTERS(test_a_freeze_is_the_stations),
	    COUNTERS(test_a_narrow_counter_goes_on_where_its_register_wraps),
	    COUNTERS(test_a_narrow_counter_that_falls_back_goes_on_and_says_so),
	    COUNTERS(test_an_invalid_reading_changes_nothing),
	    COUNTERS(test_the_overflow_is_the_readings),
	    COUNTERS(test_an_exchanged_device_is_adjusted),
	    COUNTERS(test_groups_and_devices),
	    COUNTERS(test_wrong_and_late_freezes_are_refused),
	    COUNTERS(test_totals_survive_their_owner),
	    COUNTERS(test_a_period_freezes_and_tells),
	};

	return cmocka_run_group_tests(tests, NULL, NULL);
}
