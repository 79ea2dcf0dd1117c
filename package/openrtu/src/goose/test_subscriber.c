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

#define NOW (1800000000 * NS_PER_S) /* UTC, of the tests' begin */

static struct goose_subscription subscription;
static struct goose_subscriber subscriber;
static struct goose_message message;

/* Without clocks, but for tests that set them. */
static int begin(void **state)
{
	(void)state;
	subscription = (struct goose_subscription){
	    .stream = {.control = "L/LLN0$GO$a",
		       .destination = {1, 0x0c, 0xcd, 1, 0, 1},
		       .app_id = 9,
		       .conf_rev = 2},
	    .alive_most_ms = 60000,
	};
	goose_subscriber_init(&subscriber, &subscription, 0);
	message = (struct goose_message){
	    .address = {.destination = {1, 0x0c, 0xcd, 1, 0, 1}, .app_id = 9},
	    .control = {"L/LLN0$GO$a", 11},
	    .alive_ms = 100,
	    .time = {.quality = GOOSE_TIME_UNSET},
	    .conf_rev = 2,
	};
	return 0;
}

static enum goose_verdict take(uint32_t state, uint32_t sequence, int64_t now_ns)
{
	message.state = state;
	message.sequence = sequence;
	return goose_subscriber_take(&subscriber, &message, true,
				     &(struct goose_arrival){now_ns, now_ns, NOW + now_ns});
}

/* ... of a state whose time is known. */
static enum goose_verdict take_of(uint32_t state, uint32_t sequence, int64_t now_ns, int64_t utc_ns)
{
	message.time = (struct goose_time){.utc_ns = utc_ns};
	return take(state, sequence, now_ns);
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

/* It was stopped from 10 to 150 ms, and did not see when the messages came that it reads then. */
static void test_what_waited_holds_no_longer_than_if_it_had_come_at_once(void **state)
{
	const struct goose_arrival old = {150 * MS, 10 * MS, NOW + 150 * MS};

	(void)state;
	take(5, 3, 0);
	message.state = 6;
	message.sequence = 0;
	assert_int_equal(goose_subscriber_take(&subscriber, &message, true, &old), GOOSE_TAKEN);
	assert_false(goose_subscriber_holds(&subscriber, 150 * MS));
	assert_true(goose_subscriber_expires(&subscriber, 150 * MS));
	assert_int_equal(take(6, 1, 151 * MS), GOOSE_TAKEN);
	assert_true(goose_subscriber_holds(&subscriber, 151 * MS));
	message.alive_ms = 200;
	message.sequence = 2;
	assert_int_equal(goose_subscriber_take(&subscriber, &message, true, &old), GOOSE_REPEATED);
	assert_true(goose_subscriber_holds(&subscriber, 210 * MS - 1));
	assert_true(goose_subscriber_expires(&subscriber, 210 * MS));
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
	assert_int_equal(take(1, 0, 1 * MS), GOOSE_OUT_OF_ORDER);
}

/* Silence does not make a recorded message true: only the first state of a publisher that starts is another beginning. */
static void test_silence_forgets_no_number(void **state)
{
	(void)state;
	take(100, 3, 0);
	assert_true(goose_subscriber_expires(&subscriber, 100 * MS));
	assert_int_equal(take(5, 0, 101 * MS), GOOSE_JUMPED);
	assert_int_equal(take(100, 3, 101 * MS), GOOSE_JUMPED);
	assert_int_equal(goose_subscriber_deadline(&subscriber), INT64_MAX);
	assert_int_equal(take(1, 7, 102 * MS), GOOSE_TAKEN);
	assert_int_equal(subscriber.restarts, 1);
	assert_int_equal(take(2, 0, 103 * MS), GOOSE_TAKEN);
}

static void test_where_clocks_are_set_a_restart_is_later(void **state)
{
	(void)state;
	take_of(100, 3, 0, NOW - 60 * NS_PER_S);
	assert_int_equal(take_of(1, 0, 101 * MS, NOW - 61 * NS_PER_S), GOOSE_JUMPED); /* recorded */
	assert_int_equal(take_of(1, 0, 101 * MS, NOW - 60 * NS_PER_S), GOOSE_JUMPED);
	assert_int_equal(take_of(5, 0, 101 * MS, NOW + 90 * MS),
			 GOOSE_TAKEN); /* its first states were not heard */
	assert_int_equal(subscriber.restarts, 1);
	/* A clock that counts from 1970 or 2000 is none. */
	assert_int_equal(take_of(1, 0, 300 * MS, 5 * NS_PER_S), GOOSE_TAKEN);
}

/* A time of 2100 does not rule out what comes before that. */
static void test_a_time_ahead_is_no_later_than_now(void **state)
{
	(void)state;
	take_of(100, 3, 0, NOW + 1000 * S_PER_DAY * NS_PER_S);
	assert_int_equal(take_of(1, 0, 200 * MS, NOW + 150 * MS), GOOSE_TAKEN);
}

static void test_a_jump_is_not_believed(void **state)
{
	(void)state;
	take(2, 0, 0);
	message.alive_ms = 600000;
	assert_int_equal(take(INT32_MAX - 5, 0, 1 * MS), GOOSE_JUMPED);
	assert_int_equal(take(2, INT32_MAX - 5, 1 * MS), GOOSE_JUMPED);
	assert_int_equal(take(3, INT32_MAX - 5, 1 * MS), GOOSE_JUMPED);
	assert_int_equal(subscriber.missed, 0);
	message.alive_ms = 100;
	assert_int_equal(take(2, 1, 2 * MS), GOOSE_REPEATED);
	assert_int_equal(take(34, 0, 3 * MS), GOOSE_TAKEN); /* 32 at once */
	assert_int_equal(take(1034, 0, 1003 * MS),
			 GOOSE_TAKEN); /* 1 000 in a second, of which none was heard */
}

static void test_numbers_go_round(void **state)
{
	(void)state;
	take(UINT32_MAX, UINT32_MAX, 0);
	assert_int_equal(take(UINT32_MAX, 1, 1), GOOSE_REPEATED);
	assert_int_equal(subscriber.missed, 0); /* there is no 0 behind the last number */
	assert_int_equal(take(1, 0, 2), GOOSE_TAKEN);
	assert_int_equal(subscriber.missed, 0);
}

static void test_numbers_may_go_round_to_0(void **state)
{
	(void)state;
	take(5, UINT32_MAX, 0);
	assert_int_equal(take(5, 0, 1), GOOSE_REPEATED);
	assert_int_equal(take(5, 1, 2), GOOSE_REPEATED);
	assert_int_equal(subscriber.missed, 0);
}

/* One message that does not fit invalidates what holds. Of what was taken, nothing is forgotten. */
static void test_another_revision_ends_what_holds_and_forgets_no_number(void **state)
{
	(void)state;
	take(100, 3, 0);
	message.conf_rev = 3;
	assert_int_equal(take(101, 0, 10 * MS), GOOSE_MISMATCHED);
	assert_true(goose_subscriber_expires(&subscriber, 10 * MS));
	message.conf_rev = 2;
	assert_int_equal(take(5, 0, 11 * MS), GOOSE_OUT_OF_ORDER);
	assert_int_equal(take(1, 0, 11 * MS), GOOSE_OUT_OF_ORDER);
	assert_int_equal(take(100, 4, 12 * MS), GOOSE_TAKEN);
	assert_int_equal(
	    goose_subscriber_take(&subscriber, &message, false, &(struct goose_arrival){13 * MS, 13 * MS, 0}),
	    GOOSE_MISMATCHED);
	begin(NULL);
	message.needs_commissioning = true;
	assert_int_equal(take(5, 3, 0), GOOSE_MISMATCHED);
	assert_false(goose_subscriber_expires(&subscriber, 0));
}

static bool is_heard(void)
{
	return goose_subscriber_hears(&subscriber, &message);
}

static void test_messages_of_others(void **state)
{
	(void)state;
	assert_true(is_heard());
	message.address.app_id = 10;
	assert_false(is_heard());
	begin(NULL);
	message.control.size--;
	assert_false(is_heard());
	begin(NULL);
	message.address.destination[5] = 2;
	assert_false(is_heard());
}

/* As LPHD.Sim of IEC 61850-7-4. */
static void test_from_the_first_simulated_message_on_only_such_count(void **state)
{
	(void)state;
	message.simulation = true;
	assert_int_equal(take(5, 3, 0), GOOSE_SIMULATED);
	subscription.stream.simulation = true;
	message.simulation = false;
	assert_int_equal(take(100, 3, 0), GOOSE_TAKEN);
	message.simulation = true;
	assert_int_equal(take(7, 3, 1 * MS), GOOSE_TAKEN);
	message.simulation = false;
	assert_int_equal(take(100, 4, 2 * MS), GOOSE_REAL);
	assert_true(goose_subscriber_expires(&subscriber, 101 * MS));
	assert_int_equal(take(100, 5, 102 * MS), GOOSE_REAL);
	message.simulation = true;
	assert_int_equal(take(7, 4, 103 * MS), GOOSE_TAKEN);
}

static void test_a_time_longer_than_agreed_is_cut(void **state)
{
	(void)state;
	message.alive_ms = UINT32_MAX;
	take(5, 3, 0);
	assert_false(goose_subscriber_expires(&subscriber, 60 * NS_PER_S - 1));
	assert_true(goose_subscriber_expires(&subscriber, 60 * NS_PER_S));
	assert_int_equal(take(1, 0, 60 * NS_PER_S), GOOSE_TAKEN);
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
	    cmocka_unit_test_setup(test_what_waited_holds_no_longer_than_if_it_had_come_at_once, begin),
	    cmocka_unit_test_setup(test_a_state_holds_for_its_time, begin),
	    cmocka_unit_test_setup(test_what_is_older_is_not_believed, begin),
	    cmocka_unit_test_setup(test_silence_forgets_no_number, begin),
	    cmocka_unit_test_setup(test_where_clocks_are_set_a_restart_is_later, begin),
	    cmocka_unit_test_setup(test_a_time_ahead_is_no_later_than_now, begin),
	    cmocka_unit_test_setup(test_a_jump_is_not_believed, begin),
	    cmocka_unit_test_setup(test_numbers_go_round, begin),
	    cmocka_unit_test_setup(test_numbers_may_go_round_to_0, begin),
	    cmocka_unit_test_setup(test_another_revision_ends_what_holds_and_forgets_no_number, begin),
	    cmocka_unit_test_setup(test_messages_of_others, begin),
	    cmocka_unit_test_setup(test_from_the_first_simulated_message_on_only_such_count, begin),
	    cmocka_unit_test_setup(test_a_time_longer_than_agreed_is_cut, begin),
	    cmocka_unit_test_setup(test_what_another_process_took_ends, begin),
	};

	return cmocka_run_group_tests_name("goose subscriber", tests, NULL, NULL);
}
