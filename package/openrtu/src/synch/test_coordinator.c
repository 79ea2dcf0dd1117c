/* SPDX-License-Identifier: GPL-3.0-or-later */
/* Who is let go when, in virtual time: modules that die, hang and wake, and a coordinator that does. */
#include "map/time_ns.h"
#include "synch/coordinator.h"
#include "synch/test_nets.h"

#define MODULES 2

static struct synch_coordinator coordinator;
static struct synch_seen seen[SYNCH_PARTICIPANTS_MAX];
static int64_t now_ns;

static void begin(void)
{
	const struct synch_state none = {.begun = 0};

	memset(seen, 0, sizeof(seen));
	now_ns = NS_PER_S;
	synch_begin(&coordinator, &made.net, &none);
	for (uint32_t i = 0; i < made.net.participant_count; i++)
		seen[i].alive = true;
}

static void turn(void)
{
	now_ns += NS_PER_MS;
	synch_turn(&coordinator, seen, now_ns);
}

static void say(uint32_t number, enum synch_wish wish, uint8_t transition, uint32_t flags)
{
	seen[number].word = synch_word((uint16_t)((seen[number].word >> 16) + 1), wish, transition) | flags;
}

static enum synch_result answer_of(uint32_t number)
{
	const uint32_t answer = coordinator.state.answers[number];

	return synch_is_answered(seen[number].word, answer) ? (enum synch_result)(answer & 0xff) : SYNCH_OPEN;
}

static enum synch_result tell(uint32_t number, enum synch_wish wish, uint8_t transition)
{
	say(number, wish, transition, 0);
	turn();
	return answer_of(number);
}

static void start_again(uint32_t number)
{
	seen[number].alive = true;
	say(number, SYNCH_HELLO, SYNCH_NOTHING, SYNCH_NEW);
	turn();
}

/* A token goes round between two modules; a has it. Places are to_a, to_b. */
enum { A_BEGINS, A_ENDS, B_BEGINS, B_ENDS };
static void ring_of_two(enum synch_death on_death)
{
	begin_net();
	add_place("to_a", 1, 0);
	add_place("to_b", 0, 0);
	for (int i = 0; i < 4; i++)
		add_transition((const char *[]){"a.begin", "a.end", "b.begin", "b.end"}[i]);
	add_arc(SYNCH_TAKES, 0, A_BEGINS, 1);
	add_arc(SYNCH_GIVES, 1, A_ENDS, 1);
	add_arc(SYNCH_TAKES, 1, B_BEGINS, 1);
	add_arc(SYNCH_GIVES, 0, B_ENDS, 1);
	add_participant("a", A_BEGINS, A_ENDS, on_death);
	add_participant("b", B_BEGINS, B_ENDS, on_death);
	end_net();
	begin();
}

static void assert_tokens(uint16_t to_a, uint16_t to_b)
{
	assert_int_equal(coordinator.state.tokens[0], to_a);
	assert_int_equal(coordinator.state.tokens[1], to_b);
}

static void test_two_take_turns(void **state)
{
	(void)state;
	ring_of_two(SYNCH_RETURN);
	assert_int_equal(tell(1, SYNCH_ASK, B_BEGINS), SYNCH_OPEN);
	for (int round = 0; round < 3; round++) {
		assert_int_equal(tell(0, SYNCH_ASK, A_BEGINS), SYNCH_FIRED);
		assert_int_equal(answer_of(1), SYNCH_OPEN);
		assert_int_equal(tell(0, SYNCH_END, SYNCH_NOTHING), SYNCH_FIRED);
		assert_int_equal(answer_of(1), SYNCH_FIRED);
		assert_int_equal(coordinator.rung, 3);
		assert_int_equal(tell(1, SYNCH_END, SYNCH_NOTHING), SYNCH_FIRED);
		assert_int_equal(tell(1, SYNCH_ASK, B_BEGINS), SYNCH_OPEN);
	}
	assert_tokens(1, 0);
	assert_int_equal(coordinator.counts.firings[A_BEGINS], 3);
}

static void test_word_is_answered_once(void **state)
{
	(void)state;
	ring_of_two(SYNCH_RETURN);
	tell(0, SYNCH_ASK, A_BEGINS);
	turn();
	assert_int_equal(coordinator.rung, 0);
	assert_false(synch_turn(&coordinator, seen, now_ns));
	assert_int_equal(coordinator.counts.firings[A_BEGINS], 1);
}

static void test_try_is_answered_at_once(void **state)
{
	(void)state;
	ring_of_two(SYNCH_RETURN);
	assert_int_equal(tell(1, SYNCH_TRY, B_BEGINS), SYNCH_NOT_NOW);
	assert_int_equal(tell(0, SYNCH_TRY, A_BEGINS), SYNCH_FIRED);
}

static void test_scan_begins_and_ends_in_turn(void **state)
{
	(void)state;
	ring_of_two(SYNCH_RETURN);
	assert_int_equal(tell(0, SYNCH_END, SYNCH_NOTHING), SYNCH_REFUSED); /* of no scan */
	assert_int_equal(tell(0, SYNCH_ASK, A_BEGINS), SYNCH_FIRED);
	assert_int_equal(tell(0, SYNCH_ASK, A_BEGINS), SYNCH_REFUSED);
	assert_int_equal(tell(0, SYNCH_END, SYNCH_NOTHING), SYNCH_FIRED);
	assert_int_equal(tell(0, SYNCH_END, SYNCH_NOTHING), SYNCH_REFUSED);
	assert_tokens(0, 1);
}

static void test_nobody_fires_for_another(void **state)
{
	(void)state;
	ring_of_two(SYNCH_RETURN);
	assert_int_equal(tell(1, SYNCH_ASK, A_BEGINS), SYNCH_REFUSED);
	assert_int_equal(tell(1, SYNCH_ASK, 200), SYNCH_REFUSED);
	assert_int_equal(tell(1, SYNCH_ASK, B_ENDS), SYNCH_REFUSED); /* an end is SYNCH_END */
	assert_tokens(1, 0);
	assert_int_equal(coordinator.counts.refused, 3);
}

/* ---- death ------------------------------------------------------------------------------- */

static void die_in_scan(enum synch_death on_death)
{
	ring_of_two(on_death);
	tell(0, SYNCH_ASK, A_BEGINS);
	say(1, SYNCH_ASK, B_BEGINS, 0);
	assert_tokens(0, 0);
	seen[0].alive = false;
	turn();
}

static void test_dead_module_returns_its_tokens(void **state)
{
	(void)state;
	die_in_scan(SYNCH_RETURN);
	assert_tokens(1, 0);
	start_again(0);
	assert_int_equal(tell(0, SYNCH_ASK, A_BEGINS), SYNCH_FIRED);
	assert_int_equal(tell(0, SYNCH_END, SYNCH_NOTHING), SYNCH_FIRED);
	assert_int_equal(answer_of(1), SYNCH_FIRED);
}

/* A restart between two looks: only the new process's word tells. */
static void test_new_process_returns_the_tokens_of_the_old(void **state)
{
	(void)state;
	ring_of_two(SYNCH_RETURN);
	tell(0, SYNCH_ASK, A_BEGINS);
	start_again(0);
	assert_tokens(1, 0);
	assert_int_equal(coordinator.counts.deaths[0], 1);
	/* The same when its first word is a wish already. */
	tell(0, SYNCH_ASK, A_BEGINS);
	say(0, SYNCH_ASK, A_BEGINS, SYNCH_NEW);
	turn();
	assert_int_equal(answer_of(0), SYNCH_FIRED);
	assert_int_equal(coordinator.counts.deaths[0], 2);
	assert_tokens(0, 0);
}

static void test_hung_module_that_wakes_is_late(void **state)
{
	(void)state;
	die_in_scan(SYNCH_RETURN);
	seen[0].alive = true;
	assert_int_equal(tell(0, SYNCH_END, SYNCH_NOTHING), SYNCH_LATE);
	assert_tokens(1, 0);
	assert_int_equal(tell(0, SYNCH_ASK, A_BEGINS), SYNCH_FIRED);
	assert_int_equal(tell(0, SYNCH_END, SYNCH_NOTHING), SYNCH_FIRED);
}

static void test_held_tokens_are_the_next_process_s(void **state)
{
	(void)state;
	die_in_scan(SYNCH_HOLD);
	assert_tokens(0, 0);
	assert_int_equal(answer_of(1), SYNCH_OPEN);
	start_again(0);
	assert_int_equal(answer_of(1), SYNCH_OPEN);
	assert_int_equal(tell(0, SYNCH_ASK, A_BEGINS), SYNCH_FIRED); /* the tokens that it has */
	assert_int_equal(tell(0, SYNCH_END, SYNCH_NOTHING), SYNCH_FIRED);
	assert_int_equal(answer_of(1), SYNCH_FIRED);
	assert_int_equal(coordinator.counts.firings[A_BEGINS], 1);
}

static void test_scan_of_a_dead_module_ends_in_its_stead(void **state)
{
	(void)state;
	die_in_scan(SYNCH_FIRE);
	turn();
	assert_int_equal(answer_of(1), SYNCH_FIRED);
	/* b goes on alone: a's scans fire for it. */
	for (int round = 0; round < 5; round++) {
		assert_int_equal(tell(1, SYNCH_END, SYNCH_NOTHING), SYNCH_FIRED);
		say(1, SYNCH_ASK, B_BEGINS, 0);
		turn();
		assert_int_equal(answer_of(1), SYNCH_FIRED);
	}
	assert_int_equal(coordinator.counts.stood_in[0], 5);
	/* It wakes: its old end is late, and it is one of two again. */
	seen[0].alive = true;
	assert_int_equal(tell(0, SYNCH_END, SYNCH_NOTHING), SYNCH_LATE);
	assert_int_equal(tell(0, SYNCH_ASK, A_BEGINS), SYNCH_OPEN);
	assert_int_equal(tell(1, SYNCH_END, SYNCH_NOTHING), SYNCH_FIRED);
	assert_int_equal(answer_of(0), SYNCH_FIRED);
}

/* Both dead: their scans fire in turn, but not as fast as the processor can. */
static void test_dead_modules_do_not_run_wild(void **state)
{
	(void)state;
	ring_of_two(SYNCH_FIRE);
	start_again(0);
	start_again(1);
	seen[0].alive = seen[1].alive = false;
	for (int ms = 0; ms < 100; ms++)
		turn();
	assert_in_range(coordinator.counts.stood_in[0], 5, 12);
	assert_true(coordinator.stands_in);
}

static void test_nobody_stands_in_for_who_never_lived(void **state)
{
	(void)state;
	ring_of_two(SYNCH_FIRE);
	seen[0].alive = seen[1].alive = false;
	turn();
	assert_int_equal(coordinator.counts.stood_in[0], 0);
}

/* ---- points and lines -------------------------------------------------------------------- */

/* A mutex that is taken by a point: it is given back by the death of who has it, not of who had it. */
static void test_mutex_comes_back(void **state)
{
	(void)state;
	begin_net();
	add_place("free", 1, 0);
	for (int i = 0; i < 4; i++)
		add_transition((const char *[]){"a.lock", "a.unlock", "b.lock", "b.unlock"}[i]);
	for (uint8_t i = 0; i < MODULES; i++) {
		const uint32_t number =
		    add_participant(i == 0 ? "a" : "b", SYNCH_NOTHING, SYNCH_NOTHING, SYNCH_RETURN);

		add_point(number, "lock", (uint8_t)(2 * i));
		add_point(number, "unlock", (uint8_t)(2 * i + 1));
		add_arc(SYNCH_TAKES, 0, (uint8_t)(2 * i), 1);
		add_arc(SYNCH_GIVES, 0, (uint8_t)(2 * i + 1), 1);
	}
	end_net();
	begin();
	assert_int_equal(tell(0, SYNCH_ASK, 0), SYNCH_FIRED);
	assert_int_equal(tell(1, SYNCH_ASK, 2), SYNCH_OPEN);
	start_again(0);
	assert_int_equal(answer_of(1), SYNCH_FIRED);
	assert_int_equal(tell(1, SYNCH_ASK, 3), SYNCH_FIRED);
	start_again(1); /* it has given it back itself */
	assert_int_equal(coordinator.state.tokens[0], 1);
	/* Nor does a scan that has ended. */
	assert_int_equal(tell(0, SYNCH_ASK, 0), SYNCH_FIRED);
	assert_int_equal(tell(0, SYNCH_END, SYNCH_NOTHING), SYNCH_FIRED);
	start_again(0);
	assert_int_equal(coordinator.state.tokens[0], 0);
}

static void test_line_never_waits(void **state)
{
	(void)state;
	begin_net();
	add_place("line1 -> m", 0, 1);
	add_transition("line1.scan_end");
	add_transition("m.scan_begin");
	add_arc(SYNCH_GIVES, 0, 0, 1);
	add_arc(SYNCH_TAKES, 0, 1, 1);
	made.tables.participants[add_participant("line1", SYNCH_NOTHING, 0, SYNCH_RETURN)].waits = false;
	add_participant("m", 1, SYNCH_NOTHING, SYNCH_RETURN);
	end_net();
	begin();
	assert_int_equal(tell(1, SYNCH_ASK, 1), SYNCH_OPEN);
	seen[0].word = 3; /* three scans since the last look */
	turn();
	assert_int_equal(answer_of(1), SYNCH_FIRED);
	assert_int_equal(coordinator.state.tokens[0], 0);
	assert_int_equal(coordinator.counts.lost[0], 2);
	turn();
	assert_int_equal(coordinator.counts.firings[0], 3);
	seen[0].word += 1000000; /* the coordinator was away for long */
	turn();
	assert_int_equal(coordinator.state.tokens[0], 1);
	assert_in_range(coordinator.counts.firings[0] + coordinator.counts.left_out[0], 1000003, 1000003);
}

/* ---- the coordinator --------------------------------------------------------------------- */

static void start_coordinator_again(void)
{
	const struct synch_state left = coordinator.state;

	synch_begin(&coordinator, &made.net, &left);
}

static void test_next_coordinator_goes_on(void **state)
{
	struct synch_state left;

	(void)state;
	ring_of_two(SYNCH_RETURN);
	tell(0, SYNCH_ASK, A_BEGINS);
	say(1, SYNCH_ASK, B_BEGINS, 0);
	say(0, SYNCH_END, SYNCH_NOTHING, 0);
	left = coordinator.state; /* of a process that has not seen these words */
	synch_begin(&coordinator, &made.net, &left);
	turn();
	assert_int_equal(answer_of(0), SYNCH_FIRED);
	assert_int_equal(answer_of(1), SYNCH_FIRED);
	assert_tokens(0, 0);
	/* One that has: nothing fires twice. */
	start_coordinator_again();
	turn();
	assert_int_equal(coordinator.rung, 0);
	assert_int_equal(tell(1, SYNCH_END, SYNCH_NOTHING), SYNCH_FIRED);
	assert_tokens(1, 0);
}

/* In a scan, or owed for one. */
static int tokens_held(void)
{
	int held = 0;

	for (int i = 0; i < MODULES; i++)
		held +=
		    coordinator.state.phases[i] != SYNCH_IDLE && coordinator.state.phases[i] != SYNCH_LOST;
	return held;
}

/*
 * Any words, deaths and coordinators that stop between two turns: there is one token all the time, in a place or with who scans.
 */
static void wander(enum synch_death on_death, uint32_t seed)
{
	ring_of_two(on_death);
	for (int step = 0; step < 5000; step++) {
		uint32_t number;

		seed = seed * 1664525u + 1013904223u;
		number = seed >> 24 & 1;
		if ((seed >> 25 & 15) == 0)
			seen[number].alive = !seen[number].alive;
		else if ((seed >> 25 & 15) == 1)
			start_coordinator_again();
		else if (seen[number].alive && (seed >> 25 & 15) == 2)
			say(number, SYNCH_HELLO, SYNCH_NOTHING, SYNCH_NEW);
		else if (seen[number].alive && answer_of(number) != SYNCH_OPEN)
			say(number, seed >> 29 & 1 ? SYNCH_END : SYNCH_ASK, number == 0 ? A_BEGINS : B_BEGINS,
			    seed >> 30 & 1 ? SYNCH_NEW : 0);
		turn();
		assert_int_equal(coordinator.state.tokens[0] + coordinator.state.tokens[1] + tokens_held(),
				 1);
	}
}

static void test_tokens_do_not_multiply(void **state)
{
	(void)state;
	for (uint32_t seed = 1; seed < 20; seed++) {
		wander(SYNCH_RETURN, seed);
		wander(SYNCH_HOLD, seed);
		wander(SYNCH_FIRE, seed);
	}
}

int main(void)
{
	const struct CMUnitTest tests[] = {
	    cmocka_unit_test(test_two_take_turns),
	    cmocka_unit_test(test_word_is_answered_once),
	    cmocka_unit_test(test_try_is_answered_at_once),
	    cmocka_unit_test(test_scan_begins_and_ends_in_turn),
	    cmocka_unit_test(test_nobody_fires_for_another),
	    cmocka_unit_test(test_dead_module_returns_its_tokens),
	    cmocka_unit_test(test_new_process_returns_the_tokens_of_the_old),
	    cmocka_unit_test(test_hung_module_that_wakes_is_late),
	    cmocka_unit_test(test_held_tokens_are_the_next_process_s),
	    cmocka_unit_test(test_scan_of_a_dead_module_ends_in_its_stead),
	    cmocka_unit_test(test_dead_modules_do_not_run_wild),
	    cmocka_unit_test(test_nobody_stands_in_for_who_never_lived),
	    cmocka_unit_test(test_mutex_comes_back),
	    cmocka_unit_test(test_line_never_waits),
	    cmocka_unit_test(test_next_coordinator_goes_on),
	    cmocka_unit_test(test_tokens_do_not_multiply),
	};

	return cmocka_run_group_tests(tests, NULL, NULL);
}
