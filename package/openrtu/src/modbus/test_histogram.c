/* SPDX-License-Identifier: GPL-3.0-or-later */
#include <setjmp.h>
#include <stdarg.h>
#include <stddef.h>
#include <stdint.h>

#include <cmocka.h>

#include "modbus/histogram.h"

static void test_each_duration_has_its_bucket(void **state)
{
	(void)state;
	static const struct {
		int64_t ns;
		uint32_t bucket;
	} durations[] = {
	    {-5, 0},   {0, 0},        {999, 0},      {1000, 1},       {1999, 1},       {2000, 2},
	    {4000, 3}, {1023999, 10}, {1024000, 11}, {524287999, 19}, {524288000, 20}, {INT64_MAX, 20},
	};

	for (size_t i = 0; i < sizeof(durations) / sizeof(durations[0]); i++) {
		struct modbus_histogram histogram = {.longest_us = 0};

		modbus_histogram_add(&histogram, durations[i].ns);
		assert_int_equal(histogram.counts[durations[i].bucket], 1);
	}
}

static void test_the_longest_is_kept(void **state)
{
	(void)state;
	struct modbus_histogram histogram = {.longest_us = 0};

	modbus_histogram_add(&histogram, 7000);
	modbus_histogram_add(&histogram, 5000);
	assert_int_equal(histogram.longest_us, 7);
	assert_int_equal(histogram.counts[3], 2);
	modbus_histogram_add(&histogram, INT64_MAX);
	assert_int_equal(histogram.longest_us, UINT32_MAX);
}

int main(void)
{
	const struct CMUnitTest tests[] = {
	    cmocka_unit_test(test_each_duration_has_its_bucket),
	    cmocka_unit_test(test_the_longest_is_kept),
	};
	return cmocka_run_group_tests_name("modbus histogram", tests, NULL, NULL);
}
