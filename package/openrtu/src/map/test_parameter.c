/* SPDX-License-Identifier: GPL-3.0-or-later */
/* Parameters of measured values: loaded, in force, refused, and what stays of them. */
#include <math.h>

#include "map/limits.h"
#include "map/test_stage.h"

#define S 1000000000LL

enum { LEVEL = 1, LAMP = 2 };

static int set_up_measured(void **state)
{
	struct stage *stage;

	set_up(state);
	stage = *state;
	stage->points[LEVEL].deadband = 10;
	stage->points[LEVEL].send_period_ms = 1000;
	stage->points[LAMP].type = MAP_BITSTRING;
	make_again(stage);
	return 0;
}

#define MEASURED(name) cmocka_unit_test_setup_teardown(name, set_up_measured, tear_down)

static void load(struct command_stage *commands, uint32_t point, enum map_parameter kind, int32_t value,
		 bool accepted)
{
	struct map_request wish = request(point, MAP_PARAMETER, 1, value);

	wish.detail = (uint8_t)kind;
	assert_false(post(commands, wish));
	if (accepted)
		assert_answer(commands, MAP_EXECUTED_COMMAND, MAP_RESULT_DONE);
	else
		assert_answer(commands, MAP_REFUSED_COMMAND, MAP_RESULT_OUT_OF_RANGE);
}

static struct map_parameters in_force(const struct map *map)
{
	struct map_parameters parameters;

	map_parameters_read(map, LEVEL, &parameters);
	return parameters;
}

static void publish(struct map *owner, int32_t value, int64_t time_ns)
{
	struct map_update update = scaled(LEVEL, value, MAP_GOOD, time_ns);

	map_publish(owner, &update, 1);
}

static unsigned events(const struct map *map, struct map_cursor *cursor)
{
	struct map_event event;
	unsigned count = 0;

	while (map_event_next(map, cursor, &event))
		count++;
	return count;
}

static void test_the_configuration_is_in_force_first(void **state)
{
	struct command_stage commands = start_commands(*state);
	struct map_parameters parameters = in_force(commands.requester);

	assert_true(parameters.loaded == 0 && parameters.cyclic);
	assert_true(fabs(parameters.threshold - 10) < 1e-9 && fabs(parameters.smoothing_s) < 1e-9);
	assert_true(isinf(parameters.low) && isinf(parameters.high));
	end_commands(&commands);
}

static void test_threshold(void **state)
{
	struct command_stage commands = start_commands(*state);
	struct map_cursor cursor;

	map_cursor_to_end(commands.requester, &cursor);
	publish(commands.owner, 100, map_now_ns());
	publish(commands.owner, 110, map_now_ns());
	assert_int_equal(events(commands.requester, &cursor), 1);
	load(&commands, LEVEL, MAP_THRESHOLD, 5, true);
	publish(commands.owner, 106, map_now_ns());
	publish(commands.owner, 102, map_now_ns());
	assert_int_equal(events(commands.requester, &cursor), 1);
	end_commands(&commands);
}

static void test_crossing_a_limit_is_an_event(void **state)
{
	struct command_stage commands = start_commands(*state);
	struct map_cursor cursor;

	map_cursor_to_end(commands.requester, &cursor);
	publish(commands.owner, 100, map_now_ns());
	load(&commands, LEVEL, MAP_HIGH_LIMIT, 103, true);
	load(&commands, LEVEL, MAP_LOW_LIMIT, 97, true);
	assert_int_equal(events(commands.requester, &cursor), 1);
	publish(commands.owner, 103, map_now_ns());
	assert_int_equal(events(commands.requester, &cursor), 0);
	publish(commands.owner, 104, map_now_ns());
	publish(commands.owner, 105, map_now_ns());
	assert_int_equal(events(commands.requester, &cursor), 1);
	publish(commands.owner, 103, map_now_ns());
	publish(commands.owner, 97, map_now_ns());
	assert_int_equal(events(commands.requester, &cursor), 1);
	publish(commands.owner, 96, map_now_ns());
	assert_int_equal(events(commands.requester, &cursor), 1);
	end_commands(&commands);
}

/* Within the deadband of 10; a value on a limit has not crossed it. */
static void test_crossing_a_limit_of_the_configuration_is_an_event(void **state)
{
	static struct map_limits limits = {
	    .point = LEVEL, .high_high = 106, .high = 103, .low = 97, .low_low = 94};
	static const struct {
		int32_t value;
		enum map_range range;
		unsigned events;
	} steps[] = {{100, MAP_RANGE_NORMAL, 1}, {103, MAP_RANGE_NORMAL, 0},    {104, MAP_RANGE_HIGH, 1},
		     {106, MAP_RANGE_HIGH, 0},   {107, MAP_RANGE_HIGH_HIGH, 1}, {97, MAP_RANGE_NORMAL, 1},
		     {96, MAP_RANGE_LOW, 1},     {94, MAP_RANGE_LOW, 0},        {93, MAP_RANGE_LOW_LOW, 1},
		     {92, MAP_RANGE_LOW_LOW, 0}};
	struct stage *stage = *state;
	struct command_stage commands;
	struct map_cursor cursor;

	stage->points[LEVEL].flags |= MAP_POINT_LIMITS;
	map_add_section(&stage->config, MAP_LIMITS, sizeof(limits), 1, &limits);
	make_again(stage);
	commands = start_commands(stage);
	map_cursor_to_end(commands.requester, &cursor);
	for (size_t i = 0; i < sizeof(steps) / sizeof(steps[0]); i++) {
		publish(commands.owner, steps[i].value, map_now_ns());
		assert_int_equal(events(commands.requester, &cursor), steps[i].events);
		assert_int_equal(map_range_of(map_config(commands.requester), LEVEL,
					      (union map_value){.i = steps[i].value}),
				 steps[i].range);
	}
	end_commands(&commands);
}

/* Of several points each has its own, and a value that is no number has crossed none. */
static void test_limits_are_found(void **state)
{
	struct map_limits limits[] = {{.point = 1, .high = 1, .high_high = 1},
				      {.point = 2, .high = 2, .high_high = 9},
				      {.point = 4, .high = 4, .high_high = 9}};
	struct map_point points[5] = {{.type = MAP_FLOAT}};
	struct map_config config = {.points = points, .point_count = 5};

	(void)state;
	for (uint32_t i = 1; i < 5; i++)
		points[i] = (struct map_point){.type = MAP_FLOAT, .flags = i == 3 ? 0 : MAP_POINT_LIMITS};
	assert_int_equal(map_range_of(&config, 1, (union map_value){.f = 99}), MAP_RANGE_NORMAL);
	map_add_section(&config, MAP_LIMITS, sizeof(*limits), 3, limits);
	for (uint32_t i = 0; i < 3; i++)
		assert_ptr_equal(map_limits_of(&config, limits[i].point), &limits[i]);
	assert_int_equal(map_range_of(&config, 0, (union map_value){.f = 99}), MAP_RANGE_NORMAL);
	assert_int_equal(map_range_of(&config, 3, (union map_value){.f = 99}), MAP_RANGE_NORMAL);
	assert_int_equal(map_range_of(&config, 2, (union map_value){.f = 9}), MAP_RANGE_HIGH);
	assert_int_equal(map_range_of(&config, 4, (union map_value){.f = 10}), MAP_RANGE_HIGH_HIGH);
	assert_int_equal(map_range_of(&config, 4, (union map_value){.f = -1}), MAP_RANGE_LOW_LOW);
	assert_int_equal(map_range_of(&config, 4, (union map_value){.f = NAN}), MAP_RANGE_NORMAL);
}

static void test_smoothing(void **state)
{
	struct command_stage commands = start_commands(*state);
	int64_t begin_ns = map_now_ns() - 100 * S;

	load(&commands, LEVEL, MAP_SMOOTHING, 10, true); /* tenths of a second */
	publish(commands.owner, 0, begin_ns);
	publish(commands.owner, 1000, begin_ns + S); /* dt = T: half of it */
	assert_sample(commands.requester, LEVEL, 500, MAP_GOOD);
	for (int i = 2; i < 30; i++)
		publish(commands.owner, 1000, begin_ns + i * S);
	assert_sample(commands.requester, LEVEL, 1000, MAP_GOOD); /* rounding does not keep it away */
	load(&commands, LEVEL, MAP_SMOOTHING, 0, true);
	publish(commands.owner, 7, begin_ns + 30 * S);
	assert_sample(commands.requester, LEVEL, 7, MAP_GOOD);
	end_commands(&commands);
}

static void test_smoothing_begins_with_the_last_value(void **state)
{
	struct command_stage commands = start_commands(*state);
	struct map_update lost = {.point = LEVEL, .flags = MAP_UPDATE_KEEPS_VALUE};
	int64_t begin_ns = map_now_ns() - 100 * S;

	publish(commands.owner, 400, begin_ns);
	load(&commands, LEVEL, MAP_SMOOTHING, 10, true);
	publish(commands.owner, 800, begin_ns + S);
	assert_sample(commands.requester, LEVEL, 600, MAP_GOOD);
	lost.sample = (struct map_sample){.quality = MAP_INVALID, .time_ns = begin_ns + 2 * S};
	map_publish(commands.owner, &lost, 1);
	assert_sample(commands.requester, LEVEL, 600, MAP_INVALID);
	publish(commands.owner, 1000, begin_ns + 2 * S);
	assert_sample(commands.requester, LEVEL, 800, MAP_GOOD);
	end_commands(&commands);
}

/* Whoever blocks a value leaves it the source's. */
static void test_a_blocked_value_is_smoothed_and_an_overflow_is_not(void **state)
{
	struct command_stage commands = start_commands(*state);
	int64_t begin_ns = map_now_ns() - 100 * S;
	struct map_update update = scaled(LEVEL, 1000, MAP_BLOCKED, begin_ns + S);

	load(&commands, LEVEL, MAP_SMOOTHING, 10, true);
	publish(commands.owner, 0, begin_ns);
	map_publish(commands.owner, &update, 1);
	assert_sample(commands.requester, LEVEL, 500, MAP_BLOCKED);
	update = scaled(LEVEL, INT16_MAX, MAP_OVERFLOW, begin_ns + 2 * S);
	map_publish(commands.owner, &update, 1);
	assert_sample(commands.requester, LEVEL, INT16_MAX, MAP_OVERFLOW);
	publish(commands.owner, 300, begin_ns + 3 * S); /* nothing of what came before is in it */
	assert_sample(commands.requester, LEVEL, 300, MAP_GOOD);
	end_commands(&commands);
}

static void test_wrong_values_are_refused(void **state)
{
	struct command_stage commands = start_commands(*state);

	load(&commands, LEVEL, MAP_THRESHOLD, -1, false);
	load(&commands, LEVEL, MAP_SMOOTHING, -1, false);
	load(&commands, LEVEL, 0, 1, false);
	load(&commands, LEVEL, 6, 1, false);
	load(&commands, LEVEL, MAP_LOW_LIMIT, 50, true);
	load(&commands, LEVEL, MAP_HIGH_LIMIT, 49, false);
	load(&commands, LAMP, MAP_THRESHOLD, 1, false);
	load(&commands, 3, MAP_CYCLIC, 1, false); /* has no period */
	assert_int_equal(in_force(commands.requester).loaded, 1u << MAP_LOW_LIMIT);
	end_commands(&commands);
}

static void test_the_limits_may_be_one(void **state)
{
	struct command_stage commands = start_commands(*state);

	load(&commands, LEVEL, MAP_LOW_LIMIT, 50, true);
	load(&commands, LEVEL, MAP_HIGH_LIMIT, 50, true);
	load(&commands, LEVEL, MAP_LOW_LIMIT, 51, false);
	load(&commands, LEVEL, MAP_LOW_LIMIT, 50, true);
	end_commands(&commands);
}

static void test_parameters_survive_their_owner(void **state)
{
	struct stage *stage = *state;
	struct command_stage commands = start_commands(stage);

	load(&commands, LEVEL, MAP_THRESHOLD, 5, true);
	load(&commands, LEVEL, MAP_CYCLIC, 0, true);
	map_module_ended(stage->rtud, index_of(stage, FIRST), true);
	map_detach(commands.owner);
	commands.owner = start(stage, FIRST);
	assert_true(fabs(in_force(commands.requester).threshold - 5) < 1e-9);
	assert_false(in_force(commands.requester).cyclic);
	load(&commands, LEVEL, MAP_CYCLIC, 1, true);
	assert_true(in_force(commands.requester).cyclic);
	end_commands(&commands);
}

/* Up to the size that has no fraction: whole numbers, halves and quarters on both sides of it. */
static void test_numbers_are_rounded_as_rint_does(void **state)
{
	(void)state;
	for (double number = -70000; number <= 70000; number += 0.125)
		assert_int_equal(map_round(number), lrint(number));
	for (int power = 40; power <= 63; power++)
		for (double more = -4; more <= 4; more += 0.25)
			for (int sign = -1; sign <= 1; sign += 2)
				assert_true(map_nearest(sign * (ldexp(1, power) + more)) ==
					    rint(sign * (ldexp(1, power) + more)));
	assert_int_equal(map_round(INT32_MAX), INT32_MAX);
	assert_int_equal(map_round(INT32_MIN), INT32_MIN);
	assert_int_equal(map_round(nextafter(0.5, 0)), 0);
}

int main(void)
{
	const struct CMUnitTest tests[] = {
	    MEASURED(test_the_configuration_is_in_force_first),
	    MEASURED(test_threshold),
	    MEASURED(test_crossing_a_limit_is_an_event),
	    MEASURED(test_crossing_a_limit_of_the_configuration_is_an_event),
	    cmocka_unit_test(test_limits_are_found),
	    MEASURED(test_smoothing),
	    MEASURED(test_smoothing_begins_with_the_last_value),
	    MEASURED(test_a_blocked_value_is_smoothed_and_an_overflow_is_not),
	    MEASURED(test_wrong_values_are_refused),
	    MEASURED(test_the_limits_may_be_one),
	    MEASURED(test_parameters_survive_their_owner),
	    cmocka_unit_test(test_numbers_are_rounded_as_rint_does),
	};

	return cmocka_run_group_tests(tests, NULL, NULL);
}
