/* SPDX-License-Identifier: GPL-3.0-or-later */
#include "rows/words.h"

#include <math.h>
#include <setjmp.h>
#include <stdarg.h>
#include <stdlib.h>

#include <cmocka.h>

static void assert_quality(uint8_t quality, const char *expected)
{
	char text[WORDS_SIZE];

	words_quality(quality, text);
	assert_string_equal(text, expected);
}

static void test_quality(void **state)
{
	(void)state;
	assert_quality(MAP_GOOD, "good");
	assert_quality(MAP_OVERFLOW, "overflow");
	assert_quality(MAP_INVALID | MAP_NOT_TOPICAL, "invalid,not topical");
	assert_quality(0xff, "invalid,not topical,substituted,blocked,overflow");
}

static void assert_age(double seconds, const char *expected)
{
	char text[WORDS_SIZE];

	words_age(seconds, text);
	assert_string_equal(text, expected);
}

static void test_age(void **state)
{
	(void)state;
	assert_age(0.04, "0.0 s");
	assert_age(0.31, "0.3 s");
	assert_age(9.96, "10 s");
	assert_age(119, "119 s");
	assert_age(121, "2 min");
	assert_age(7201, "2 h");
	assert_age(172801, "2 d");
}

static void test_time(void **state)
{
	char text[WORDS_SIZE];

	(void)state;
	words_time(1739970557249999999, text); /* figure 5.1: 2025/02/19 13:09:17.249 */
	assert_string_equal(text, "2025-02-19T13:09:17.249Z");
}

/* The value as JSON text. */
static void assert_value(enum map_type type, union map_value value, const char *expected)
{
	json_t *json = words_value(type, &value);
	char *text = json_dumps(json, JSON_ENCODE_ANY);

	assert_string_equal(text, expected);
	free(text);
	json_decref(json);
}

static void test_value(void **state)
{
	(void)state;
	assert_value(MAP_SINGLE, (union map_value){.u = 1}, "\"on\"");
	assert_value(MAP_DOUBLE, (union map_value){.u = 0}, "\"intermediate\"");
	assert_value(MAP_DOUBLE, (union map_value){.u = 1}, "\"off\"");
	assert_value(MAP_DOUBLE, (union map_value){.u = 2}, "\"on\"");
	assert_value(MAP_DOUBLE, (union map_value){.u = 3}, "\"indeterminate\"");
	assert_value(MAP_STEP, (union map_value){.i = -64}, "-64");
	assert_value(MAP_BITSTRING, (union map_value){.u = 0xffffffff}, "4294967295");
	assert_value(MAP_NORMALIZED, (union map_value){.i = -16384}, "-0.5");
	assert_value(MAP_SCALED, (union map_value){.i = -32768}, "-32768");
	assert_value(MAP_FLOAT, (union map_value){.f = 0.25f}, "0.25");
	assert_value(MAP_FLOAT, (union map_value){.f = NAN}, "null");
	assert_value(MAP_COUNTER, (union map_value){.i = INT32_MIN}, "-2147483648");
	assert_value(MAP_INTEGER, (union map_value){.i = INT32_MIN}, "-2147483648");
	assert_value(MAP_ANGLE, (union map_value){.i = 450000000}, "45.0");
}

static void assert_parsed(enum map_type type, const char *text, union map_value expected)
{
	union map_value value = {.u = 0xdeadbeef};

	assert_true(words_parse_value(type, text, &value));
	assert_int_equal(value.u, expected.u);
}

static void assert_refused(enum map_type type, const char *text)
{
	union map_value value;

	assert_false(words_parse_value(type, text, &value));
}

static void test_parse_value(void **state)
{
	(void)state;
	assert_parsed(MAP_SINGLE, "on", (union map_value){.u = 1});
	assert_parsed(MAP_SINGLE, "OFF", (union map_value){.u = 0});
	assert_refused(MAP_SINGLE, "2");
	assert_parsed(MAP_DOUBLE, "off", (union map_value){.u = 1});
	assert_parsed(MAP_DOUBLE, "1", (union map_value){.u = 2});
	assert_refused(MAP_DOUBLE, "intermediate");
	assert_parsed(MAP_STEP, "-64", (union map_value){.i = -64});
	assert_refused(MAP_STEP, "64");
	assert_parsed(MAP_BITSTRING, "0xffffffff", (union map_value){.u = 0xffffffff});
	assert_refused(MAP_BITSTRING, "-1");
	assert_parsed(MAP_NORMALIZED, "-1", (union map_value){.i = -32768});
	assert_parsed(MAP_NORMALIZED, "0.5", (union map_value){.i = 16384});
	assert_refused(MAP_NORMALIZED, "1");
	assert_parsed(MAP_SCALED, "255", (union map_value){.i = 255});
	assert_refused(MAP_SCALED, "32768");
	assert_refused(MAP_SCALED, "1.5");
	assert_refused(MAP_SCALED, "");
	assert_refused(MAP_SCALED, "99999999999999999999");
	assert_parsed(MAP_FLOAT, "1.5", (union map_value){.f = 1.5f});
	assert_refused(MAP_FLOAT, "1e39");
	assert_refused(MAP_FLOAT, "nan");
	assert_refused(MAP_FLOAT, "1x");
	assert_parsed(MAP_INTEGER, "-2147483648", (union map_value){.i = INT32_MIN});
	assert_parsed(MAP_INTEGER, "16777217", (union map_value){.i = 16777217});
	assert_refused(MAP_INTEGER, "2147483648");
	assert_refused(MAP_INTEGER, "1.5");
	assert_parsed(MAP_ANGLE, "-180", (union map_value){.i = -1800000000});
	assert_refused(MAP_ANGLE, "180.0000001");
	assert_refused(MAP_ANGLE, "north");
}

static void assert_angle_text(int32_t angle, const char *expected)
{
	json_t *row = json_object();
	char text[WORDS_SIZE];

	json_object_set_new(row, "type", json_string("angle"));
	json_object_set_new(row, "value", words_value(MAP_ANGLE, &(union map_value){.i = angle}));
	json_object_set_new(row, "age_s", json_real(1));
	assert_true(words_angle(row, json_object_get(row, "value"), text));
	assert_string_equal(text, expected);
	assert_parsed(MAP_ANGLE, text, (union map_value){.i = angle});
	assert_false(words_angle(row, json_object_get(row, "age_s"), text));
	json_object_set_new(row, "type", json_string("float"));
	assert_false(words_angle(row, json_object_get(row, "value"), text));
	json_decref(row);
}

/* A float would show the second as 145.12346, 2 m away. */
static void test_an_angle_is_shown_and_read_exactly(void **state)
{
	(void)state;
	assert_angle_text(0, "0.0000000");
	assert_angle_text(1451234567, "145.1234567");
	assert_angle_text(-1, "-0.0000001");
	assert_angle_text(-1800000000, "-180.0000000");
	assert_angle_text(1799999999, "179.9999999");
}

int main(void)
{
	const struct CMUnitTest tests[] = {
	    cmocka_unit_test(test_quality),     cmocka_unit_test(test_age),
	    cmocka_unit_test(test_time),        cmocka_unit_test(test_value),
	    cmocka_unit_test(test_parse_value), cmocka_unit_test(test_an_angle_is_shown_and_read_exactly),
	};

	return cmocka_run_group_tests(tests, NULL, NULL);
}
