/* SPDX-License-Identifier: GPL-3.0-or-later */
#include "rtuctl/realtime.h"

#include <setjmp.h>
#include <stdarg.h>
#include <stddef.h>
#include <stdlib.h>
#include <unistd.h>

#include <cmocka.h>

static void a_kernel_says_what_it_is(void **state)
{
	char path[] = "/tmp/test_realtime.XXXXXX";
	int file = mkstemp(path);

	(void)state;
	assert_false(realtime_kernel("/nowhere/realtime", "#1 SMP PREEMPT_DYNAMIC Debian 6.1.1"));
	assert_true(realtime_kernel("/nowhere/realtime", "#1 PREEMPT_RT Debian 6.1.176"));
	assert_false(realtime_kernel(path, "#1 PREEMPT"));
	assert_int_equal(write(file, "1\n", 2), 2);
	assert_true(realtime_kernel(path, "#1 PREEMPT"));
	assert_int_equal(pwrite(file, "0", 1, 0), 1);
	assert_false(realtime_kernel(path, "#1 PREEMPT"));
	close(file);
	unlink(path);
}

static void a_verdict_needs_a_real_time_kernel_and_priority(void **state)
{
	(void)state;
	assert_string_equal(realtime_verdict(false, 45, 1),
			    "none: this kernel is not PREEMPT_RT, what was measured promises nothing");
	assert_string_equal(realtime_verdict(true, 0, 1),
			    "none: the lines have no real-time priority, what was measured promises nothing");
	assert_string_equal(realtime_verdict(true, 45, 500), "good: no wake-up was more than 500 us late");
	assert_string_equal(realtime_verdict(true, 45, 501), "bad: a wake-up was more than 500 us late");
}

int main(void)
{
	const struct CMUnitTest tests[] = {
	    cmocka_unit_test(a_kernel_says_what_it_is),
	    cmocka_unit_test(a_verdict_needs_a_real_time_kernel_and_priority),
	};
	return cmocka_run_group_tests_name("rtuctl realtime", tests, NULL, NULL);
}
