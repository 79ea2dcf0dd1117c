/* SPDX-License-Identifier: GPL-3.0-or-later */
/* The types of points: that each has a whole row, and what an integer and an angle of 32 bits keep. */
#include <math.h>
#include <stdio.h>
#include <string.h>

#include "map/test_stage.h"

enum { POSITION = 1, COUNT = 2 };

static int set_up_types(void **state)
{
	struct stage *stage;

	set_up(state);
	stage = *state;
	stage->points[POSITION].type = MAP_ANGLE;
	stage->points[COUNT].type = MAP_INTEGER;
	make_again(stage);
	return 0;
}

#define TYPED(name) cmocka_unit_test_setup_teardown(name, set_up_types, tear_down)

static void test_each_type_has_a_whole_row(void **state)
{
	(void)state;
	for (int type = 0; type < MAP_TYPES; type++) {
		const struct map_type_row *row = &map_types[type];

		assert_true(row->name != NULL && row->expected != NULL && row->width > 0);
		assert_true(row->low < row->high);
		assert_string_equal(map_type_names[type], row->name);
		for (int other = 0; other < type; other++)
			assert_string_not_equal(row->name, map_types[other].name);
	}
	assert_null(map_type_names[MAP_TYPES]);
}

static void assert_is(enum map_type type, double number, int32_t expected)
{
	union map_value value = {.i = 1};

	assert_true(map_value_of(type, number, &value));
	assert_int_equal(value.i, expected);
}

static void assert_is_none(enum map_type type, double number)
{
	union map_value value = {.i = 77};

	assert_false(map_value_of(type, number, &value));
	assert_int_equal(value.i, 77);
}

static void test_numbers_become_values_and_back(void **state)
{
	(void)state;
	assert_is(MAP_INTEGER, INT32_MAX, INT32_MAX);
	assert_is(MAP_INTEGER, -2147483648.5, INT32_MIN); /* of two the even one */
	assert_is_none(MAP_INTEGER, 2147483647.5);
	assert_is(MAP_SCALED, 32767.4, 32767);
	assert_is_none(MAP_SCALED, 32768);
	assert_is_none(MAP_INTEGER, NAN);
	assert_is_none(MAP_FLOAT, INFINITY);
	assert_is_none(MAP_FLOAT, 1e39);
	assert_is(MAP_BITSTRING, 4294967295.0, -1); /* all 32 bits */
	assert_is(MAP_BITSTRING, 2147483649.0, INT32_MIN + 1);
	assert_is_none(MAP_BITSTRING, -1);
	assert_is(MAP_ANGLE, -180, -1800000000);
	assert_is_none(MAP_ANGLE, 180.0000001);
	for (int32_t angle = -1800000000; angle < 1799000000; angle += 999983)
		assert_is(MAP_ANGLE, map_number(MAP_ANGLE, (union map_value){.i = angle}), angle);
}

static unsigned events_of(const struct map *map, struct map_cursor *cursor)
{
	struct map_event event;
	unsigned count = 0;

	while (map_event_next(map, cursor, &event))
		count++;
	return count;
}

static unsigned published(struct map *owner, const struct map *reader, struct map_cursor *cursor,
			  uint32_t point, int32_t value)
{
	struct map_update update = scaled(point, value, MAP_GOOD, map_now_ns());

	map_publish(owner, &update, 1);
	assert_sample(reader, point, value, MAP_GOOD);
	return events_of(reader, cursor);
}

/* A float holds neither the second integer nor the second angle. */
static void test_all_bits_are_kept(void **state)
{
	struct command_stage commands = start_commands(*state);
	struct map_cursor cursor;

	map_cursor_to_end(commands.requester, &cursor);
	assert_int_equal(published(commands.owner, commands.requester, &cursor, COUNT, 16777216), 1);
	assert_int_equal(published(commands.owner, commands.requester, &cursor, COUNT, 16777217), 1);
	assert_int_equal(published(commands.owner, commands.requester, &cursor, COUNT, INT32_MIN), 1);
	assert_int_equal(published(commands.owner, commands.requester, &cursor, POSITION, 1451234567), 1);
	assert_int_equal(published(commands.owner, commands.requester, &cursor, POSITION, 1451234568), 1);
	assert_int_equal(published(commands.owner, commands.requester, &cursor, POSITION, 1451234568), 0);
	end_commands(&commands);
}

static void test_an_angles_deadband_is_in_degrees(void **state)
{
	struct stage *stage = *state;
	struct command_stage commands;
	struct map_cursor cursor;

	stage->points[POSITION].deadband = 0.001f;
	make_again(stage);
	commands = start_commands(stage);
	map_cursor_to_end(commands.requester, &cursor);
	assert_int_equal(published(commands.owner, commands.requester, &cursor, POSITION, 450000000), 1);
	assert_int_equal(published(commands.owner, commands.requester, &cursor, POSITION, 450009990), 0);
	assert_int_equal(published(commands.owner, commands.requester, &cursor, POSITION, 450010010), 1);
	end_commands(&commands);
}

static void test_an_angles_parameters_are_angles(void **state)
{
	struct command_stage commands = start_commands(*state);
	struct map_request wish =
	    request(POSITION, MAP_PARAMETER, 1, 25000000); /* 2.5 s, as a float has it */
	struct map_parameters parameters;

	wish.detail = MAP_SMOOTHING;
	assert_false(post(&commands, wish));
	assert_answer(&commands, MAP_EXECUTED_COMMAND, MAP_RESULT_DONE);
	wish = request(POSITION, MAP_PARAMETER, 1, 905000000);
	wish.detail = MAP_HIGH_LIMIT;
	assert_false(post(&commands, wish));
	assert_answer(&commands, MAP_EXECUTED_COMMAND, MAP_RESULT_DONE);
	map_parameters_read(commands.requester, POSITION, &parameters);
	assert_true(fabs(parameters.smoothing_s - 2.5) < 1e-9 && fabs(parameters.high - 90.5) < 1e-9);
	end_commands(&commands);
}

static void test_floats_are_written_with_the_fewest_digits(void **state)
{
	static const struct {
		float value;
		const char *text;
	} cases[] = {{0.1f, "0.1"},    {-0.3f, "-0.3"},  {16777216.0f, "16777216"},
		     {0, "0"},         {1e30f, "1e+30"}, {0.100000009f, "0.10000001"},
		     {230.4f, "230.4"}};

	(void)state;
	for (size_t i = 0; i < sizeof(cases) / sizeof(cases[0]); i++) {
		char text[32];

		snprintf(text, sizeof(text), "%.9g", map_shortest(cases[i].value));
		assert_string_equal(text, cases[i].text);
	}
	for (uint32_t bits = 1; bits < 0x7f000000; bits += 104729) { /* they are the same float again */
		float value, again;

		memcpy(&value, &bits, sizeof(value));
		again = (float)map_shortest(value);
		assert_memory_equal(&again, &value, sizeof(value));
	}
}

int main(void)
{
	const struct CMUnitTest tests[] = {
	    cmocka_unit_test(test_each_type_has_a_whole_row),
	    cmocka_unit_test(test_numbers_become_values_and_back),
	    cmocka_unit_test(test_floats_are_written_with_the_fewest_digits),
	    TYPED(test_all_bits_are_kept),
	    TYPED(test_an_angles_deadband_is_in_degrees),
	    TYPED(test_an_angles_parameters_are_angles),
	};

	return cmocka_run_group_tests(tests, NULL, NULL);
}
