/* SPDX-License-Identifier: GPL-3.0-or-later */
#include <setjmp.h>
#include <stdarg.h>
#include <stddef.h>
#include <stdint.h>
#include <string.h>

#include <cmocka.h>

#include "goose/subscriber.h"
#include "map/time_ns.h"

#define MS NS_PER_MS

static const struct goose_subscription subscription = {
    .stream = {.control = "L/LLN0$GO$a", .destination = {1, 0x0c, 0xcd, 1, 0, 1}, .app_id = 9, .conf_rev = 2},
    .leaf_count = 3,
};
static struct goose_subscriber subscriber;
static struct goose_message message;

static int begin(void **state)
{
	(void)state;
	goose_subscriber_init(&subscriber, &subscription, 0);
	message = (struct goose_message){
	    .address = {.destination = {1, 0x0c, 0xcd, 1, 0, 1}, .app_id = 9},
	    .control = {"L/LLN0$GO$a", 11},
	    .alive_ms = 100,
	    .state = 5,
	    .sequence = 3,
	    .conf_rev = 2,
	    .entries = 3,
	    .item_count = 3,
	};
	return 0;
}

static enum goose_verdict take(uint32_t state, uint32_t sequence, int64_t now_ns)
{
	message.state = state;
	message.sequence = sequence;
	return goose_subscriber_take(&subscriber, &message, now_ns);
}

static void test_states_and_their_repetitions(void **state)
{
	(void)state;
	assert_int_equal(take(5, 3, 0), GOOSE_TAKEN);
	assert_int_equal(take(5, 4, 1 * MS), GOOSE_REPEATED);
	assert_int_equal(take(6, 0, 2 * MS), GOOSE_TAKEN);
	assert_int_equal(subscriber.missed, 0);
	assert_int_equal(take(6, 3, 3 * MS), GOOSE_REPEATED);
	assert_int_equal(subscriber.missed, 2);
	assert_int_equal(take(8, 1, 4 * MS), GOOSE_TAKEN);
	assert_int_equal(subscriber.missed, 4);
}

static void test_a_state_holds_for_its_time(void **state)
{
	(void)state;
	assert_false(goose_subscriber_expires(&subscriber, INT64_MAX - 1));
	take(5, 3, 0);
	assert_false(goose_subscriber_expires(&subscriber, 100 * MS - 1));
	take(5, 4, 50 * MS);
	assert_false(goose_subscriber_expires(&subscriber, 150 * MS - 1));
	assert_true(goose_subscriber_expires(&subscriber, 150 * MS));
	assert_false(goose_subscriber_expires(&subscriber, 151 * MS));
	assert_int_equal(take(5, 5, 200 * MS), GOOSE_TAKEN);
}

static void test_what_is_older_is_not_believed(void **state)
{
	(void)state;
	take(5, 3, 0);
	assert_int_equal(take(5, 3, 1 * MS), GOOSE_OUT_OF_ORDER);
	assert_int_equal(take(5, 2, 1 * MS), GOOSE_OUT_OF_ORDER);
	assert_int_equal(take(4, 9, 1 * MS), GOOSE_OUT_OF_ORDER);
	assert_true(goose_subscriber_expires(&subscriber, 100 * MS));
	assert_int_equal(take(1, 0, 101 * MS), GOOSE_TAKEN);
}

static void test_numbers_go_round(void **state)
{
	(void)state;
	take(UINT32_MAX, UINT32_MAX, 0);
	assert_int_equal(take(UINT32_MAX, 1, 1), GOOSE_REPEATED);
	assert_int_equal(take(1, 0, 2), GOOSE_TAKEN);
}

static void test_another_revision_ends_what_holds(void **state)
{
	(void)state;
	take(5, 3, 0);
	message.conf_rev = 3;
	assert_int_equal(take(6, 0, 10 * MS), GOOSE_MISMATCHED);
	assert_true(goose_subscriber_expires(&subscriber, 10 * MS));
	begin(NULL);
	message.item_count = 2;
	assert_int_equal(take(5, 3, 0), GOOSE_MISMATCHED);
	begin(NULL);
	message.needs_commissioning = true;
	assert_int_equal(take(5, 3, 0), GOOSE_MISMATCHED);
	assert_false(goose_subscriber_expires(&subscriber, 0));
}

static void test_messages_of_others(void **state)
{
	(void)state;
	message.address.app_id = 10;
	assert_int_equal(take(5, 3, 0), GOOSE_NOT_MINE);
	begin(NULL);
	message.control.size--;
	assert_int_equal(take(5, 3, 0), GOOSE_NOT_MINE);
	begin(NULL);
	message.address.destination[5] = 2;
	assert_int_equal(take(5, 3, 0), GOOSE_NOT_MINE);
	begin(NULL);
	message.simulation = true;
	assert_int_equal(take(5, 3, 0), GOOSE_SIMULATED);
}

static void test_a_time_without_end_ends(void **state)
{
	(void)state;
	message.alive_ms = UINT32_MAX;
	take(5, 3, 0);
	assert_true(goose_subscriber_expires(&subscriber, 600 * NS_PER_S));
}

/* Of a former process: until its own first message, or the end of the time. */
static void test_what_another_process_took_ends(void **state)
{
	(void)state;
	goose_subscriber_init(&subscriber, &subscription, 50 * MS);
	assert_true(goose_subscriber_expires(&subscriber, 50 * MS));
	goose_subscriber_init(&subscriber, &subscription, 50 * MS);
	assert_int_equal(take(UINT32_MAX, 9, 1 * MS), GOOSE_TAKEN);
	assert_int_equal(subscriber.missed, 0);
	assert_false(goose_subscriber_expires(&subscriber, 100 * MS));
	goose_subscriber_init(&subscriber, &subscription, 50 * MS);
	message.conf_rev = 3;
	assert_int_equal(take(1, 0, 2 * MS), GOOSE_MISMATCHED);
	assert_true(goose_subscriber_expires(&subscriber, 2 * MS));
}

int main(void)
{
	const struct CMUnitTest tests[] = {
	    cmocka_unit_test_setup(test_states_and_their_repetitions, begin),
	    cmocka_unit_test_setup(test_a_state_holds_for_its_time, begin),
	    cmocka_unit_test_setup(test_what_is_older_is_not_believed, begin),
	    cmocka_unit_test_setup(test_numbers_go_round, begin),
	    cmocka_unit_test_setup(test_another_revision_ends_what_holds, begin),
	    cmocka_unit_test_setup(test_messages_of_others, begin),
	    cmocka_unit_test_setup(test_a_time_without_end_ends, begin),
	    cmocka_unit_test_setup(test_what_another_process_took_ends, begin),
	};

	return cmocka_run_group_tests_name("goose subscriber", tests, NULL, NULL);
}
