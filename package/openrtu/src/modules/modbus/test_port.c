/* SPDX-License-Identifier: GPL-3.0-or-later */
#include <setjmp.h>
#include <stdarg.h>
#include <stddef.h>
#include <stdint.h>

#include <cmocka.h>

#include "modules/modbus/port.h"

#define NOW_NS 5000000000LL
#define NEVER  INT64_MAX

static int64_t due_ns(int64_t first_ns, int64_t second_ns, int64_t third_ns)
{
	const struct port ports[] = {
	    {.deadline_ns = first_ns}, {.deadline_ns = second_ns}, {.deadline_ns = third_ns}};

	return ports_due_ns(ports, 3);
}

static void test_a_port_without_a_neighbour_is_due_at_its_time(void **state)
{
	(void)state;
	assert_int_equal(due_ns(NOW_NS, NOW_NS + PORT_GATHER_NS + 1, NEVER), NOW_NS);
	assert_int_equal(due_ns(NEVER, NOW_NS, NEVER), NOW_NS);
	assert_int_equal(due_ns(NOW_NS, 0, NOW_NS + 1), 0);
}

static void test_a_port_waits_for_the_last_of_its_neighbours(void **state)
{
	(void)state;
	assert_int_equal(due_ns(NOW_NS + PORT_GATHER_NS, NOW_NS, NOW_NS + 7), NOW_NS + PORT_GATHER_NS);
	assert_int_equal(due_ns(NEVER, NOW_NS + 7, NOW_NS), NOW_NS + 7);
}

/* Each neighbour has one of its own: the first is not kept waiting for them all. */
static void test_a_port_waits_for_no_neighbour_s_neighbour(void **state)
{
	(void)state;
	assert_int_equal(due_ns(NOW_NS + 2 * PORT_GATHER_NS, NOW_NS + PORT_GATHER_NS, NOW_NS),
			 NOW_NS + PORT_GATHER_NS);
}

static void test_without_ports_or_deadlines_nothing_is_due(void **state)
{
	(void)state;
	assert_int_equal(due_ns(NEVER, NEVER, NEVER), NEVER);
	assert_int_equal(ports_due_ns(NULL, 0), NEVER);
}

int main(void)
{
	const struct CMUnitTest tests[] = {
	    cmocka_unit_test(test_a_port_without_a_neighbour_is_due_at_its_time),
	    cmocka_unit_test(test_a_port_waits_for_the_last_of_its_neighbours),
	    cmocka_unit_test(test_a_port_waits_for_no_neighbour_s_neighbour),
	    cmocka_unit_test(test_without_ports_or_deadlines_nothing_is_due),
	};
	return cmocka_run_group_tests_name("port", tests, NULL, NULL);
}
