/* SPDX-License-Identifier: GPL-3.0-or-later */
/* Scans of a program made by hand; tests/logic/test_logic.py has those of the compiler. */
#include <setjmp.h>
#include <stdarg.h>
#include <stddef.h>
#include <stdint.h>

#include <cmocka.h>

#include "logic/test_program.h"

union memory {
	int64_t aligned;
	uint8_t octets[1024];
};

static union memory memory;
static struct logic logic;

static void load(struct logic *to, union memory *own)
{
	struct program program = sound_program;

	seal(&program, sizeof(program));
	assert_in_range(logic_memory(&program, sizeof(program)), 1, sizeof(*own));
	assert_null(logic_load(to, own, &program, sizeof(program)));
}

static bool scan(int64_t in, uint8_t quality, bool go)
{
	static const struct logic_times times = {.uptime_us = 7};
	struct logic_value value = {.value.i = in, .quality = quality};

	logic_set(&logic, &logic.points[0], &value);
	value = (struct logic_value){.value.i = go};
	logic_set(&logic, &logic.points[2], &value);
	return logic_scan(&logic, &times, 1000);
}

static struct logic_value out(void)
{
	struct logic_value value;

	logic_get(&logic, &logic.points[1], &value);
	return value;
}

static void test_a_scan(void **state)
{
	(void)state;
	load(&logic, &memory);
	assert_true(scan(2, LOGIC_SUBSTITUTED, false));
	assert_int_equal(out().value.i, 2);
	assert_int_equal(out().quality, LOGIC_SUBSTITUTED);
	assert_int_equal(logic.cells[ELEMENTS + 1].i, 2);
	assert_int_equal(logic.cells[UPTIME].i, 7);
}

static void test_faults_are_counted_with_their_line(void **state)
{
	(void)state;
	load(&logic, &memory);
	assert_true(scan(0, 0, false)); /* 5 / 0, and the array begins with 1 */
	assert_int_equal(out().quality, LOGIC_INVALID);
	assert_int_equal(logic.faults[LOGIC_BOUNDS], 1);
	assert_int_equal(logic.faults[LOGIC_DIVISION], 1);
	assert_int_equal(logic.last_line, 4);
	assert_int_equal(logic.quality[ELEMENTS], LOGIC_INVALID);
}

/* A member of structures: only its own elements are written, and in doubt. */
static void test_an_array_with_gaps(void **state)
{
	struct program program = sound_program;

	(void)state;
	program.array.elements = 2;
	program.array.stride = 2;
	seal(&program, sizeof(program));
	assert_null(logic_load(&logic, &memory, &program, sizeof(program)));
	assert_true(scan(2, LOGIC_NOT_TOPICAL, false));
	assert_int_equal(logic.cells[ELEMENTS + 2].i, 2);
	assert_int_equal(logic.cells[ELEMENTS + 1].i, 0);
	assert_int_equal(logic.quality[ELEMENTS], LOGIC_NOT_TOPICAL);
	assert_int_equal(logic.quality[ELEMENTS + 1], 0);
	assert_true(scan(3, 0, false));
	assert_int_equal(logic.faults[LOGIC_BOUNDS], 1);
	assert_int_equal(logic.quality[ELEMENTS + 2], LOGIC_INVALID | LOGIC_NOT_TOPICAL);
}

static void test_what_is_no_value_of_the_type_is_invalid(void **state)
{
	(void)state;
	load(&logic, &memory);
	assert_true(scan((int64_t)INT32_MAX + 1, 0, false));
	assert_int_equal(logic.cells[IN].i, 0);
	assert_int_equal(logic.quality[IN], LOGIC_INVALID);
}

static void test_the_budget_ends_a_scan(void **state)
{
	(void)state;
	load(&logic, &memory);
	assert_false(scan(1, 0, true));
	assert_int_equal(logic.faults[LOGIC_BUDGET], 1);
	assert_int_equal(logic.last_fault, LOGIC_BUDGET);
	assert_int_equal(logic.last_line, 5);
	assert_int_equal(out().quality, LOGIC_INVALID);
	assert_int_equal(logic.quality[FIVE], 0); /* a constant stays good */
	assert_true(scan(1, 0, false));
	assert_int_equal(out().quality, 0);
}

static void test_retained_variables_go_on(void **state)
{
	static union memory other;
	struct logic next;

	(void)state;
	load(&logic, &memory);
	assert_true(scan(3, LOGIC_NOT_TOPICAL, false));
	load(&next, &other);
	assert_int_equal(logic_carry(&next, &logic), 1);
	assert_int_equal(next.cells[ELEMENTS + 2].i, 3);
	assert_int_equal(next.quality[ELEMENTS + 2], LOGIC_NOT_TOPICAL);
	assert_int_equal(next.cells[OUT].i, 0);
}

int main(void)
{
	const struct CMUnitTest tests[] = {
	    cmocka_unit_test(test_a_scan),
	    cmocka_unit_test(test_faults_are_counted_with_their_line),
	    cmocka_unit_test(test_an_array_with_gaps),
	    cmocka_unit_test(test_what_is_no_value_of_the_type_is_invalid),
	    cmocka_unit_test(test_the_budget_ends_a_scan),
	    cmocka_unit_test(test_retained_variables_go_on),
	};
	return cmocka_run_group_tests_name("logic run", tests, NULL, NULL);
}
