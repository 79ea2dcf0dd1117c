/* SPDX-License-Identifier: GPL-3.0-or-later */
/* The marking, and what a net is found to do. */
#include "synch/analysis.h"
#include "synch/arrow.h"
#include "synch/test_nets.h"

static struct synch_findings findings;

static void analyse(uint32_t limit)
{
	assert_true(synch_analyse(&made.net, limit, &findings));
}

/* A sequence in words, as rtud --check prints it. */
static void assert_sequence(const struct synch_sequence *sequence, const char *expected)
{
	char words[512] = "", name[SYNCH_LABEL_SIZE];

	assert_true(sequence->found);
	for (uint32_t i = 0; i < sequence->length; i++) {
		synch_fired_name(&made.net, sequence->fired[i], name);
		strcat(strcat(words, i == 0 ? "" : ", "), name);
	}
	assert_string_equal(words, expected);
}

static void test_firing_moves_tokens(void **state)
{
	uint16_t tokens[] = {3, 0, 0};
	int16_t changes[SYNCH_PLACES_MAX] = {0};
	uint32_t lost[SYNCH_PLACES_MAX] = {0};

	(void)state;
	begin_net();
	add_place("in", 3, 0);
	add_place("out", 0, 2);
	add_place("unless", 0, 0);
	add_transition("t");
	add_arc(SYNCH_TAKES, 0, 0, 2);
	add_arc(SYNCH_GIVES, 1, 0, 3);
	add_arc(SYNCH_UNLESS, 2, 0, 0);
	end_net();
	assert_true(synch_enabled(&made.net, tokens, 0));
	synch_fire(&made.net, tokens, 0, changes, lost);
	assert_int_equal(tokens[0], 1);
	assert_int_equal(tokens[1], 2); /* its capacity */
	assert_int_equal(lost[1], 1);
	assert_int_equal(changes[0], -2);
	assert_int_equal(changes[1], 2);
	assert_false(synch_enabled(&made.net, tokens, 0)); /* one is not two */
	tokens[0] = 2;
	tokens[2] = 1;
	assert_false(synch_enabled(&made.net, tokens, 0)); /* the inhibitor */
}

static void test_undone_firing_takes_back_what_is_there(void **state)
{
	uint16_t tokens[] = {0, 1};
	const int16_t changes[] = {-2, 3};

	(void)state;
	begin_net();
	add_place("taken", 0, 0);
	add_place("given", 0, 0);
	end_net();
	synch_undo(&made.net, tokens, changes);
	assert_int_equal(tokens[0], 2);
	assert_int_equal(tokens[1], 0);
}

/* Module 1 always runs, and its end lets 2 and 3 begin: MatPLC's example of the full form. */
static void matplc_launch(uint16_t capacity)
{
	begin_net();
	add_place("P_2", 0, capacity);
	add_place("P_3", 0, capacity);
	add_transition("T_launch");
	add_transition("T_2");
	add_transition("T_3");
	add_arc(SYNCH_GIVES, 0, 0, 1);
	add_arc(SYNCH_GIVES, 1, 0, 1);
	add_arc(SYNCH_TAKES, 0, 1, 1);
	add_arc(SYNCH_TAKES, 1, 2, 1);
	add_participant("one", SYNCH_NOTHING, 0, SYNCH_RETURN);
	add_participant("two", 1, SYNCH_NOTHING, SYNCH_RETURN);
	add_participant("three", 2, SYNCH_NOTHING, SYNCH_RETURN);
	end_net();
}

static void test_matplc_launch_is_not_bounded(void **state)
{
	(void)state;
	matplc_launch(0);
	analyse(1000);
	assert_false(findings.complete);
	assert_int_equal(findings.bounded, SYNCH_NO);
	assert_int_equal(findings.most[0], SYNCH_NO_BOUND);
	assert_int_equal(findings.most[1], SYNCH_NO_BOUND);
	for (int i = 0; i < 3; i++)
		assert_int_equal(findings.fires[i], SYNCH_YES);
	assert_false(findings.deadlock.found);
	synch_free_findings(&findings);
}

static void test_matplc_launch_with_capacity_is_bounded(void **state)
{
	(void)state;
	matplc_launch(2);
	analyse(1000);
	assert_true(findings.complete);
	assert_int_equal(findings.markings, 9);
	assert_int_equal(findings.bounded, SYNCH_YES);
	assert_int_equal(findings.most[0], 2);
	assert_false(findings.stuck[1].found);
	synch_free_findings(&findings);
}

/* Three in a ring, one of which starts: MatPLC's simple form. broken: the third waits for two scans. */
static void ring(uint8_t weight)
{
	static const char *const names[] = {"a", "b", "c"};

	begin_net();
	for (uint8_t i = 0; i < 3; i++) {
		char name[8];

		snprintf(name, sizeof(name), "p%u", i);
		add_place(name, i == 0, 0);
		snprintf(name, sizeof(name), "%s.begin", names[i]);
		add_transition(name);
		snprintf(name, sizeof(name), "%s.end", names[i]);
		add_transition(name);
		add_arc(SYNCH_TAKES, i, (uint8_t)(2 * i), i == 2 ? weight : 1);
		add_participant(names[i], (uint8_t)(2 * i), (uint8_t)(2 * i + 1), SYNCH_RETURN);
	}
	for (uint8_t i = 0; i < 3; i++)
		add_arc(SYNCH_GIVES, (uint8_t)((i + 1) % 3), (uint8_t)(2 * i + 1), 1);
	end_net();
}

static void test_ring_is_bounded_and_live(void **state)
{
	(void)state;
	ring(1);
	analyse(1000);
	assert_true(findings.complete);
	assert_int_equal(findings.markings, 6);
	assert_int_equal(findings.most[0], 1);
	assert_false(findings.deadlock.found);
	for (int i = 0; i < 3; i++)
		assert_false(findings.stuck[i].found);
	synch_free_findings(&findings);
}

static void test_broken_ring_has_shortest_way_to_its_deadlock(void **state)
{
	(void)state;
	ring(2);
	analyse(1000);
	assert_sequence(&findings.deadlock, "a.begin, a.end, b.begin, b.end");
	assert_sequence(&findings.stuck[0], "a.begin");
	assert_int_equal(findings.fires[4], SYNCH_NO); /* c never begins */
	assert_sequence(&findings.stuck[2], "");
	synch_free_findings(&findings);
}

/* A module that stands for good while others go on is no deadlock of the net, and is found all the same. */
static void test_module_that_stops_beside_others_is_found(void **state)
{
	(void)state;
	begin_net();
	add_place("once", 1, 0);
	add_transition("tick");
	add_transition("begin");
	add_arc(SYNCH_TAKES, 0, 1, 1);
	add_participant("clock", SYNCH_NOTHING, 0, SYNCH_RETURN);
	add_participant("one-shot", 1, SYNCH_NOTHING, SYNCH_RETURN);
	end_net();
	analyse(1000);
	assert_true(findings.complete);
	assert_false(findings.deadlock.found);
	assert_sequence(&findings.stuck[1], "begin");
	synch_free_findings(&findings);
}

static void test_points_fire_within_the_scan_only(void **state)
{
	(void)state;
	begin_net();
	add_place("go", 1, 0);
	add_place("half", 0, 1);
	add_transition("begin");
	add_transition("point");
	add_arc(SYNCH_TAKES, 0, 0, 1);
	add_arc(SYNCH_GIVES, 1, 1, 1);
	add_point(add_participant("m", 0, SYNCH_NOTHING, SYNCH_RETURN), "half", 1);
	end_net();
	analyse(1000);
	assert_sequence(&findings.deadlock, "begin, m ends its scan");
	synch_free_findings(&findings);
}

static void test_inhibitor_leaves_the_bound_open(void **state)
{
	(void)state;
	begin_net();
	add_place("grows", 0, 0);
	add_place("never", 0, 0);
	add_transition("t");
	add_arc(SYNCH_GIVES, 0, 0, 1);
	add_arc(SYNCH_UNLESS, 1, 0, 0);
	add_participant("m", SYNCH_NOTHING, 0, SYNCH_RETURN);
	end_net();
	analyse(100);
	assert_false(findings.complete);
	assert_int_equal(findings.markings, 100);
	assert_int_equal(findings.bounded, SYNCH_UNKNOWN);
	synch_free_findings(&findings);
}

static void test_arrows_are_read(void **state)
{
	static const char *const wrong[] = {"",
					    "a",
					    "a ->",
					    "-> b",
					    "a -> b c",
					    "a->b",
					    "a - > b",
					    "a -()-> b",
					    "a -(256)-> b",
					    "a -(1-> b",
					    "a -(-1)-> b",
					    "a -(1)- > b",
					    "a\t-> b",
					    "a/ -> b",
					    "a => b",
					    "a123456789012345678901234567890123456789 -> b"};
	struct synch_arrow arrow;

	(void)state;
	assert_true(synch_read_arrow("line1 -> filter", &arrow));
	assert_string_equal(arrow.from, "line1");
	assert_string_equal(arrow.to, "filter");
	assert_int_equal(arrow.weight, 1);
	assert_true(synch_read_arrow("  a-b.c -(255)->  d_1 ", &arrow));
	assert_string_equal(arrow.from, "a-b.c");
	assert_string_equal(arrow.to, "d_1");
	assert_int_equal(arrow.weight, 255);
	for (size_t i = 0; i < sizeof(wrong) / sizeof(wrong[0]); i++)
		assert_false(synch_read_arrow(wrong[i], &arrow));
}

int main(void)
{
	const struct CMUnitTest tests[] = {
	    cmocka_unit_test(test_firing_moves_tokens),
	    cmocka_unit_test(test_undone_firing_takes_back_what_is_there),
	    cmocka_unit_test(test_matplc_launch_is_not_bounded),
	    cmocka_unit_test(test_matplc_launch_with_capacity_is_bounded),
	    cmocka_unit_test(test_ring_is_bounded_and_live),
	    cmocka_unit_test(test_broken_ring_has_shortest_way_to_its_deadlock),
	    cmocka_unit_test(test_module_that_stops_beside_others_is_found),
	    cmocka_unit_test(test_points_fire_within_the_scan_only),
	    cmocka_unit_test(test_inhibitor_leaves_the_bound_open),
	    cmocka_unit_test(test_arrows_are_read),
	};

	return cmocka_run_group_tests(tests, NULL, NULL);
}
