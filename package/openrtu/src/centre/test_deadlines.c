/* SPDX-License-Identifier: GPL-3.0-or-later */
#include <setjmp.h>
#include <stdarg.h>
#include <stddef.h>
#include <stdint.h>

#include <cmocka.h>

#include "centre/deadlines.h"

#define STATIONS 37

static void test_first_is_the_earliest_whatever_is_set(void **state)
{
	struct centre_deadlines deadlines;
	uint32_t seed = 104;

	(void)state;
	assert_true(centre_deadlines_init(&deadlines, STATIONS));
	for (unsigned i = 0; i < 20000; i++) {
		int64_t earliest = INT64_MAX;

		seed = seed * 1664525u + 1013904223u;
		centre_deadlines_set(&deadlines, (seed >> 8) % STATIONS,
				     (seed >> 28) == 0 ? INT64_MAX : (int64_t)(seed >> 20));
		for (uint32_t j = 0; j < STATIONS; j++)
			if (deadlines.due_ns[j] < earliest)
				earliest = deadlines.due_ns[j];
		assert_true(deadlines.due_ns[centre_deadlines_first(&deadlines)] == earliest);
	}
	centre_deadlines_free(&deadlines);
}

static void test_one_station(void **state)
{
	struct centre_deadlines deadlines;

	(void)state;
	assert_true(centre_deadlines_init(&deadlines, 1));
	assert_true(deadlines.due_ns[centre_deadlines_first(&deadlines)] == INT64_MAX);
	centre_deadlines_set(&deadlines, 0, 5);
	assert_true(deadlines.due_ns[centre_deadlines_first(&deadlines)] == 5);
	centre_deadlines_free(&deadlines);
}

int main(void)
{
	const struct CMUnitTest tests[] = {
	    cmocka_unit_test(test_first_is_the_earliest_whatever_is_set),
	    cmocka_unit_test(test_one_station),
	};

	return cmocka_run_group_tests(tests, NULL, NULL);
}
