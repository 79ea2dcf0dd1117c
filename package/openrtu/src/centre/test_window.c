/* SPDX-License-Identifier: GPL-3.0-or-later */
#include <setjmp.h>
#include <stdarg.h>
#include <stddef.h>
#include <stdint.h>

#include <cmocka.h>

#include "centre/window.h"

static uint32_t next[8];
static struct centre_window window;

static void test_in_turn(void **state)
{
	(void)state;
	centre_window_init(&window, 2, next);
	assert_int_equal(centre_window_admit(&window), CENTRE_NOBODY);
	assert_true(centre_window_enter(&window, 5));
	assert_true(centre_window_enter(&window, 3));
	assert_false(centre_window_enter(&window, 7));
	assert_false(centre_window_enter(&window, 1));
	assert_int_equal(centre_window_admit(&window), CENTRE_NOBODY);
	centre_window_leave(&window);
	assert_false(centre_window_enter(&window, 2)); /* others wait */
	assert_int_equal(centre_window_admit(&window), 7);
	assert_int_equal(centre_window_admit(&window), CENTRE_NOBODY);
	centre_window_leave(&window);
	centre_window_leave(&window);
	assert_int_equal(centre_window_admit(&window), 1);
	assert_int_equal(centre_window_admit(&window), 2);
	assert_int_equal(centre_window_admit(&window), CENTRE_NOBODY);
	centre_window_leave(&window);
	assert_true(centre_window_enter(&window, 7));
}

static void test_clear(void **state)
{
	(void)state;
	centre_window_init(&window, 1, next);
	assert_true(centre_window_enter(&window, 0));
	assert_false(centre_window_enter(&window, 1));
	centre_window_clear(&window);
	assert_int_equal(centre_window_admit(&window), CENTRE_NOBODY);
	assert_true(centre_window_enter(&window, 2));
}

int main(void)
{
	const struct CMUnitTest tests[] = {cmocka_unit_test(test_in_turn), cmocka_unit_test(test_clear)};

	return cmocka_run_group_tests(tests, NULL, NULL);
}
