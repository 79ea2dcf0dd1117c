/* SPDX-License-Identifier: GPL-3.0-or-later */
#include <setjmp.h>
#include <stdarg.h>
#include <stddef.h>
#include <stdint.h>

#include <cmocka.h>

#include "goose/pace.h"

#define BEGIN_NS NS_PER_S

/* How often it may be until that moment, by somebody who tries each step. */
static unsigned tries(struct goose_pace *pace, int64_t from_ns, int64_t until_ns, int64_t step_ns)
{
	unsigned count = 0;

	for (int64_t now_ns = from_ns; now_ns < until_ns; now_ns += step_ns)
		if (goose_pace_may(pace, now_ns)) {
			goose_pace_take(pace, now_ns);
			count++;
		}
	return count;
}

static void test_a_few_at_once(void **state)
{
	struct goose_pace pace = {0};

	(void)state;
	for (unsigned i = 0; i < PACE_AT_ONCE; i++) {
		assert_true(goose_pace_may(&pace, BEGIN_NS));
		goose_pace_take(&pace, BEGIN_NS);
	}
	assert_false(goose_pace_may(&pace, BEGIN_NS));
	assert_int_equal(goose_pace_free(&pace), BEGIN_NS + PACE_NS);
}

static void test_then_one_a_millisecond(void **state)
{
	struct goose_pace pace = {0};

	(void)state;
	assert_int_equal(tries(&pace, BEGIN_NS, BEGIN_NS + NS_PER_S, 10 * NS_PER_US), PACE_AT_ONCE + 999);
}

static void test_what_comes_more_slowly_is_never_held_up(void **state)
{
	struct goose_pace pace = {0};

	(void)state;
	assert_int_equal(tries(&pace, BEGIN_NS, BEGIN_NS + NS_PER_S, PACE_NS), 1000);
}

static void test_what_happens_anyway_holds_up_no_longer(void **state)
{
	struct goose_pace pace = {0};

	(void)state;
	for (unsigned i = 0; i < 10 * PACE_AT_ONCE; i++)
		goose_pace_take(&pace, BEGIN_NS);
	assert_int_equal(goose_pace_free(&pace), BEGIN_NS + PACE_NS);
}

int main(void)
{
	const struct CMUnitTest tests[] = {
	    cmocka_unit_test(test_a_few_at_once),
	    cmocka_unit_test(test_then_one_a_millisecond),
	    cmocka_unit_test(test_what_comes_more_slowly_is_never_held_up),
	    cmocka_unit_test(test_what_happens_anyway_holds_up_no_longer),
	};

	return cmocka_run_group_tests_name("goose pace", tests, NULL, NULL);
}
