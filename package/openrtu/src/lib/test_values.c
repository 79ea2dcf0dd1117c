/* SPDX-License-Identifier: GPL-3.0-or-later */
/* A value as a double and back, of each type; what a type cannot hold. */
#include "lib/handle.h"
#include "map/type.h"

#include <float.h>
#include <math.h>
#include <setjmp.h>
#include <stdarg.h>
#include <stddef.h>
#include <string.h>

#include <cmocka.h>

static void test_bounds_come_back(void **state)
{
	(void)state;
	for (enum map_type type = 0; type < MAP_TYPES; type++) {
		const double unit = type == MAP_ANGLE ? 1.0 / MAP_ANGLE_PER_DEGREE : 1;
		const double bounds[] = {map_types[type].low * unit, map_types[type].high * unit};

		for (size_t i = 0; i < 2; i++) {
			union map_value value = {.u = 0};

			assert_true(value_of_number(type, bounds[i], &value));
			assert_true(value_number(type, value) == bounds[i]);
		}
	}
}

static void test_what_is_beyond_is_refused_and_changes_nothing(void **state)
{
	(void)state;
	for (enum map_type type = 0; type < MAP_TYPES; type++) {
		const double wrong[] = {map_types[type].low * 2 - 1, map_types[type].high * 2 + 1,
					(double)INFINITY, -(double)INFINITY, (double)NAN};

		for (size_t i = 0; i < sizeof(wrong) / sizeof(wrong[0]); i++) {
			union map_value value = {.u = 0xa5a5a5a5u};

			assert_false(value_of_number(type, wrong[i], &value));
			assert_int_equal(value.u, 0xa5a5a5a5u);
		}
	}
}

static void test_measured_is_rounded_and_a_state_is_not(void **state)
{
	union map_value value;

	(void)state;
	assert_true(value_of_number(MAP_SCALED, 2.6, &value));
	assert_int_equal(value.i, 3);
	assert_true(value_of_number(MAP_FLOAT, 2.5, &value));
	assert_true(value.f == 2.5f);
	assert_false(value_of_number(MAP_SINGLE, 0.5, &value));
	assert_false(value_of_number(MAP_STEP, 1.5, &value));
	assert_false(value_of_number(MAP_BITSTRING, 1.5, &value));
}

int main(void)
{
	const struct CMUnitTest tests[] = {
	    cmocka_unit_test(test_bounds_come_back),
	    cmocka_unit_test(test_what_is_beyond_is_refused_and_changes_nothing),
	    cmocka_unit_test(test_measured_is_rounded_and_a_state_is_not),
	};

	return cmocka_run_group_tests(tests, NULL, NULL);
}
