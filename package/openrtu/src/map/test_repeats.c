/* SPDX-License-Identifier: GPL-3.0-or-later */
/* How often the log says what happens again and again, in virtual time. */
#include <setjmp.h>
#include <stdarg.h>
#include <stddef.h>

#include <cmocka.h>

#include "map/lines.h"
#include "map/repeats.h"
#include "map/trouble.h"

#define S NS_PER_S

/* Lines about what happens each second for so long. */
static unsigned lines_of(int64_t seconds, uint32_t *said)
{
	struct map_repeats repeats = {0};
	unsigned lines = 0;

	*said = 0;
	for (int64_t at = 0; at < seconds; at++) {
		const uint32_t times = map_repeats_happened(&repeats, 1, at * S);

		lines += times > 0;
		*said += times;
	}
	return lines;
}

static void test_what_repeats_becomes_rare_in_the_log(void **state)
{
	uint32_t said;

	(void)state;
	assert_int_equal(lines_of(10, &said), 1);
	assert_int_equal(lines_of(11, &said), 2);
	assert_int_equal(said, 11);
	assert_int_equal(lines_of(3600, &said), 9);
	assert_int_equal(lines_of(24 * 3600, &said), 9 + 23);
	assert_in_range(said, 23 * 3600, 24 * 3600);
}

static void test_what_was_not_said_is_said_when_it_is_due(void **state)
{
	struct map_repeats repeats = {0};

	(void)state;
	assert_int_equal(map_repeats_due(&repeats, 0), 0);
	assert_int_equal(map_repeats_happened(&repeats, 3, 5 * S), 3);
	assert_int_equal(map_repeats_happened(&repeats, 4, 6 * S), 0);
	assert_int_equal(map_repeats_due(&repeats, 15 * S - 1), 0);
	assert_int_equal(map_repeats_due(&repeats, 15 * S), 4);
	assert_int_equal(map_repeats_due(&repeats, 100 * S), 0);
}

static void test_after_an_hour_it_begins_anew(void **state)
{
	struct map_repeats repeats = {0};

	(void)state;
	for (int64_t at = 0; at < 3600; at++)
		map_repeats_happened(&repeats, 1, at * S);
	map_repeats_due(&repeats, 2 * 3600 * S);
	assert_true(map_repeats_are_over(&repeats, 7200 * S));
	assert_int_equal(map_repeats_happened(&repeats, 1, 7200 * S), 1);
	assert_int_equal(repeats.pause_ns, MAP_REPEATS_FIRST_NS);
}

/* So many at once, then one for each period, however long nobody wrote. */
static void test_lines_have_a_pace(void **state)
{
	const struct map_pace pace = {.period_ns = S, .at_once = 3};
	struct map_lines lines = {0};
	unsigned taken = 0;

	(void)state;
	for (int i = 0; i < 10; i++)
		taken += map_lines_take(&lines, pace, 100 * S);
	assert_int_equal(taken, 3);
	assert_int_equal(lines.withheld, 7);
	assert_false(map_lines_room(&lines, pace, 101 * S - 1));
	assert_true(map_lines_take(&lines, pace, 101 * S));
	assert_false(map_lines_take(&lines, pace, 101 * S));
}

static void test_a_duration_is_said_in_its_unit(void **state)
{
	static const struct {
		int64_t ns;
		const char *said;
	} durations[] = {
	    {S - 1, "999 ms"},          {S, "1 s"},         {299 * S, "299 s"},     {300 * S, "5 min"},
	    {18000 * S - 1, "299 min"}, {18000 * S, "5 h"}, {50 * 3600 * S, "50 h"}};
	char text[MAP_DURATION_SIZE];

	(void)state;
	for (size_t i = 0; i < sizeof(durations) / sizeof(durations[0]); i++)
		assert_string_equal(map_duration(durations[i].ns, text), durations[i].said);
}

int main(void)
{
	const struct CMUnitTest tests[] = {
	    cmocka_unit_test(test_what_repeats_becomes_rare_in_the_log),
	    cmocka_unit_test(test_what_was_not_said_is_said_when_it_is_due),
	    cmocka_unit_test(test_after_an_hour_it_begins_anew),
	    cmocka_unit_test(test_lines_have_a_pace),
	    cmocka_unit_test(test_a_duration_is_said_in_its_unit),
	};
	return cmocka_run_group_tests_name("map repeats", tests, NULL, NULL);
}
