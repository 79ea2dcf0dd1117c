/* SPDX-License-Identifier: GPL-3.0-or-later */
/* How many lines of the log peers make. */
#include <setjmp.h>
#include <stdarg.h>
#include <stddef.h>
#include <stdint.h>

#include <cmocka.h>

#include "channel/lines.h"

#define MINUTE_NS (60 * NS_PER_S)

/* Forty lines a second, of which four are written, with those that say how many are left out. */
static void test_what_is_left_out_is_told_in_lines_that_count(void **state)
{
	struct map_lines lines = {.paid_ns = 0};
	unsigned written = 0, left_out = 0, told = 0;

	(void)state;
	for (int64_t now_ns = NS_PER_S; now_ns < NS_PER_S + MINUTE_NS; now_ns += 25 * NS_PER_MS) {
		if (!channel_may_say(&lines, now_ns)) {
			left_out++;
			continue;
		}
		written += lines.withheld > 0 ? 2 : 1;
		told += lines.withheld;
		lines.withheld = 0;
	}
	assert_in_range(written, 4 * 60, CHANNEL_LINES_AT_ONCE + 4 * 60);
	assert_int_equal(told + lines.withheld, left_out);
	assert_true(left_out > 2000);
}

int main(void)
{
	const struct CMUnitTest tests[] = {
	    cmocka_unit_test(test_what_is_left_out_is_told_in_lines_that_count),
	};

	return cmocka_run_group_tests_name("lines", tests, NULL, NULL);
}
