/* SPDX-License-Identifier: GPL-3.0-or-later */
#include <setjmp.h>
#include <stdarg.h>
#include <stddef.h>
#include <stdint.h>

#include <cmocka.h>

#include "goose/value.h"
#include "quality/quality.h"

static void there_and_back(enum map_type type, union map_value value)
{
	const struct goose_item item = goose_value_out(type, value);
	union map_value back;

	assert_true(goose_value_in(type, &item, &back));
	assert_int_equal(back.u, value.u);
}

static void test_each_type_there_and_back(void **state)
{
	(void)state;
	there_and_back(MAP_SINGLE, (union map_value){.u = 1});
	for (uint32_t i = 0; i < 4; i++)
		there_and_back(MAP_DOUBLE, (union map_value){.u = i});
	there_and_back(MAP_STEP, (union map_value){.i = -64});
	there_and_back(MAP_BITSTRING, (union map_value){.u = 0x80000001});
	there_and_back(MAP_NORMALIZED, (union map_value){.i = -32768});
	there_and_back(MAP_NORMALIZED, (union map_value){.i = 32767});
	there_and_back(MAP_SCALED, (union map_value){.i = -32768});
	there_and_back(MAP_FLOAT, (union map_value){.f = 0.1f});
	there_and_back(MAP_COUNTER, (union map_value){.i = INT32_MIN});
	there_and_back(MAP_INTEGER, (union map_value){.i = INT32_MAX});
	there_and_back(MAP_ANGLE, (union map_value){.i = 204612345});
}

static void refused(enum map_type type, struct goose_item item)
{
	union map_value ignored;

	assert_false(goose_value_in(type, &item, &ignored));
}

static void test_what_a_point_cannot_hold(void **state)
{
	(void)state;
	refused(MAP_SCALED, (struct goose_item){.kind = GOOSE_INTEGER, .integer = 32768});
	refused(MAP_SCALED, (struct goose_item){.kind = GOOSE_FLOAT, .real = 1});
	refused(MAP_COUNTER, (struct goose_item){.kind = GOOSE_UNSIGNED, .bits = 0x80000000});
	refused(MAP_NORMALIZED, (struct goose_item){.kind = GOOSE_FLOAT, .real = 1});
	refused(MAP_SINGLE, (struct goose_item){.kind = GOOSE_INTEGER, .integer = 1});
	refused(MAP_DOUBLE, (struct goose_item){.kind = GOOSE_BITS, .size = 3, .bits = 1});
	refused(MAP_FLOAT, (struct goose_item){.kind = GOOSE_OTHER});
	refused(MAP_FLOAT, (struct goose_item){.kind = GOOSE_TIME});
	refused(MAP_ANGLE, (struct goose_item){.kind = GOOSE_INTEGER, .integer = 1800000001});
}

static void test_each_quality_there_and_back(void **state)
{
	static const uint8_t bits[] = {MAP_OVERFLOW, MAP_BLOCKED, MAP_SUBSTITUTED, MAP_NOT_TOPICAL,
				       MAP_INVALID};

	(void)state;
	for (unsigned set = 0; set < 32; set++) {
		uint8_t quality = 0, back;
		struct goose_item item;

		for (unsigned i = 0; i < 5; i++)
			quality |= set & 1u << i ? bits[i] : 0;
		item = goose_quality_out(quality);
		assert_int_equal(item.bits << 3, quality_of_map(quality)); /* as MMS says it */
		assert_true(goose_quality_in(&item, &back));
		assert_int_equal(back, quality);
	}
}

/* Bit strings as IEC 61850-7-3, table 5, numbers them: the first is bit 0. */
static uint8_t quality_of(const char *bits)
{
	struct goose_item item = {.kind = GOOSE_BITS};
	uint8_t quality;

	for (; *bits != 0; bits++, item.size++)
		item.bits = item.bits << 1 | (uint32_t)(*bits - '0');
	assert_true(goose_quality_in(&item, &quality));
	return quality;
}

static void test_qualities_of_others(void **state)
{
	const struct goose_item twelve = {.kind = GOOSE_BITS, .size = 12};
	uint8_t ignored;

	(void)state;
	assert_int_equal(quality_of("0000000000000"), MAP_GOOD);
	assert_int_equal(quality_of("0100000000000"), MAP_INVALID);
	assert_int_equal(quality_of("1100000000000"), MAP_NOT_TOPICAL);
	assert_int_equal(quality_of("1100000100000"), MAP_NOT_TOPICAL);
	assert_int_equal(quality_of("1110000000000"), MAP_OVERFLOW);
	assert_int_equal(quality_of("0000000000010"), MAP_INVALID); /* for a test */
	assert_int_equal(quality_of("0000000000100"), MAP_SUBSTITUTED);
	assert_int_equal(quality_of("0000000000001"), MAP_BLOCKED);
	assert_false(goose_quality_in(&twelve, &ignored));
}

int main(void)
{
	const struct CMUnitTest tests[] = {
	    cmocka_unit_test(test_each_type_there_and_back),
	    cmocka_unit_test(test_what_a_point_cannot_hold),
	    cmocka_unit_test(test_each_quality_there_and_back),
	    cmocka_unit_test(test_qualities_of_others),
	};

	return cmocka_run_group_tests_name("goose value", tests, NULL, NULL);
}
