/* SPDX-License-Identifier: GPL-3.0-or-later */
#include <setjmp.h>
#include <stdarg.h>
#include <stddef.h>
#include <stdint.h>

#include <cmocka.h>

#include "map/time_ns.h"
#include "modules/snmp/bucket.h"

#define RATE 500

/* Far enough behind what a test before has left. */
static int64_t now_ns = NS_PER_S;

static int begin(void **state)
{
	(void)state;
	now_ns += 10 * NS_PER_S;
	return 0;
}

static struct in6_addr address(unsigned number)
{
	return (struct in6_addr){.s6_addr = {0xfd, [14] = (uint8_t)(number >> 8), [15] = (uint8_t)number}};
}

static unsigned discoveries(unsigned number, unsigned tries)
{
	const struct in6_addr of = address(number);
	unsigned taken = 0;

	for (unsigned i = 0; i < tries; i++)
		taken += bucket_discovers(&of, RATE, now_ns);
	return taken;
}

static void test_one_address_has_all_of_it(void **state)
{
	(void)state;
	assert_int_equal(discoveries(1, 2 * RATE), RATE);
	now_ns += NS_PER_S;
	assert_int_equal(discoveries(1, 2 * RATE), RATE);
}

/* In the second second, since nobody knows in the first one how many there will be. */
static void test_many_share_it_and_nobody_goes_without(void **state)
{
	unsigned all = 0;

	(void)state;
	for (unsigned i = 0; i < 40; i++)
		discoveries(i, 1000);
	now_ns += NS_PER_S;
	for (unsigned i = 0; i < 40; i++) {
		const unsigned taken = discoveries(i, 1000);

		assert_int_equal(taken, RATE / 40);
		all += taken;
	}
	assert_in_range(all, 1, RATE);
	assert_int_equal(discoveries(1000, 1), 1);
}

static void test_a_first_one_is_good_behind_a_flood(void **state)
{
	(void)state;
	assert_int_equal(discoveries(1, 2 * RATE), RATE);
	assert_int_equal(discoveries(2, 100), 1);
	assert_int_equal(discoveries(1, 100), 0);
}

/* What is authentic has its own number, whatever else its address sends. */
static void test_discoveries_take_nothing_from_the_rest(void **state)
{
	const struct in6_addr of = address(1);
	unsigned taken = 0;

	(void)state;
	discoveries(1, 2 * RATE);
	for (unsigned i = 0; i < 2 * RATE; i++)
		taken += bucket_takes(&of, RATE, now_ns);
	assert_int_equal(taken, RATE);
}

int main(void)
{
	const struct CMUnitTest tests[] = {
	    cmocka_unit_test_setup(test_one_address_has_all_of_it, begin),
	    cmocka_unit_test_setup(test_many_share_it_and_nobody_goes_without, begin),
	    cmocka_unit_test_setup(test_a_first_one_is_good_behind_a_flood, begin),
	    cmocka_unit_test_setup(test_discoveries_take_nothing_from_the_rest, begin),
	};

	return cmocka_run_group_tests_name("snmp bucket", tests, NULL, NULL);
}
