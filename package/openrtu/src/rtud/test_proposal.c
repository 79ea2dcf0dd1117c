/* SPDX-License-Identifier: GPL-3.0-or-later */
#include "rtud/proposal.h"

#include <setjmp.h>
#include <stdarg.h>
#include <stddef.h>
#include <string.h>

#include <cmocka.h>

#include "map/time_ns.h"

#define TEXT 7u

static struct proposal checked(void)
{
	struct proposal proposal = {.phase = PROPOSAL_NONE};

	assert_int_equal(proposal_ask(&proposal, SETUP_CHECK, "anna", 0, 0), PROPOSAL_CHECK);
	assert_int_equal(proposal_ended(&proposal, true, TEXT, 0), PROPOSAL_NOTHING);
	assert_int_equal(proposal.phase, PROPOSAL_CHECKED);
	return proposal;
}

/* Since now_ns. */
static struct proposal on_trial(int64_t now_ns)
{
	struct proposal proposal = checked();

	assert_int_equal(proposal_ask(&proposal, SETUP_APPLY, "anna", TEXT, 0), PROPOSAL_APPLY);
	assert_true(proposal_holds(&proposal));
	assert_int_equal(proposal_ended(&proposal, true, 0, now_ns), PROPOSAL_NOTHING);
	assert_int_equal(proposal.phase, PROPOSAL_TRIAL);
	return proposal;
}

static void test_what_was_confirmed_is_kept(void **state)
{
	struct proposal proposal = on_trial(100);

	(void)state;
	assert_int_equal(proposal_wait(&proposal, 100 + 60 * NS_PER_S - 1), PROPOSAL_NOTHING);
	assert_int_equal(proposal_ask(&proposal, SETUP_CONFIRM, "anna", TEXT, 100 + 60 * NS_PER_S - 1),
			 PROPOSAL_KEEP);
	/* The time that the disk takes is not the user's. */
	assert_int_equal(proposal_wait(&proposal, 900 * NS_PER_S), PROPOSAL_NOTHING);
	assert_int_equal(proposal_ended(&proposal, true, 0, 900 * NS_PER_S), PROPOSAL_NOTHING);
	assert_int_equal(proposal.phase, PROPOSAL_NONE);
	assert_false(proposal_holds(&proposal));
}

static void test_what_nobody_confirms_goes(void **state)
{
	struct proposal proposal = on_trial(0);

	(void)state;
	assert_int_equal(proposal_wait(&proposal, 60 * NS_PER_S), PROPOSAL_GO_BACK);
	assert_int_equal(proposal_wait(&proposal, 61 * NS_PER_S), PROPOSAL_NOTHING);
	assert_int_equal(proposal_ask(&proposal, SETUP_CONFIRM, "anna", TEXT, 61 * NS_PER_S),
			 PROPOSAL_REFUSE);
	assert_int_equal(proposal_ended(&proposal, true, 0, 62 * NS_PER_S), PROPOSAL_NOTHING);
	assert_int_equal(proposal.phase, PROPOSAL_NONE);
}

/* Also when rtud was busy in that moment. */
static void test_a_late_confirmation_is_none(void **state)
{
	struct proposal proposal = on_trial(0);

	(void)state;
	assert_int_equal(proposal_ask(&proposal, SETUP_CONFIRM, "anna", TEXT, 60 * NS_PER_S),
			 PROPOSAL_REFUSE);
	assert_int_equal(proposal_wait(&proposal, 60 * NS_PER_S), PROPOSAL_GO_BACK);
}

static void test_what_cannot_be_written_goes(void **state)
{
	struct proposal proposal = on_trial(0);

	(void)state;
	proposal_ask(&proposal, SETUP_CONFIRM, "anna", TEXT, 1);
	assert_int_equal(proposal_ended(&proposal, false, 0, 2), PROPOSAL_GO_BACK);
	assert_int_equal(proposal_ended(&proposal, true, 0, 3), PROPOSAL_NOTHING);
	assert_int_equal(proposal.phase, PROPOSAL_NONE);
}

static void test_a_way_back_that_fails_is_tried_again(void **state)
{
	struct proposal proposal = on_trial(0);

	(void)state;
	assert_int_equal(proposal_ask(&proposal, SETUP_RETURN, "bert", 0, 1), PROPOSAL_GO_BACK);
	assert_int_equal(proposal_ended(&proposal, false, 0, 0), PROPOSAL_NOTHING);
	/* Meanwhile somebody may reload a file that is right, but nobody proposes. */
	assert_false(proposal_holds(&proposal));
	assert_int_equal(proposal_ask(&proposal, SETUP_CONFIRM, "anna", TEXT, 1), PROPOSAL_REFUSE);
	assert_int_equal(proposal_ask(&proposal, SETUP_CHECK, "anna", 0, 1), PROPOSAL_REFUSE);
	assert_int_equal(proposal_wait(&proposal, PROPOSAL_AGAIN_S * NS_PER_S - 1), PROPOSAL_NOTHING);
	assert_int_equal(proposal_wait(&proposal, PROPOSAL_AGAIN_S * NS_PER_S), PROPOSAL_GO_BACK);
	assert_int_equal(proposal_ended(&proposal, true, 0, 0), PROPOSAL_NOTHING);
	assert_false(proposal_holds(&proposal));
}

static void test_what_does_not_come_into_force_is_no_trial(void **state)
{
	struct proposal proposal = checked();

	(void)state;
	assert_int_equal(proposal_ask(&proposal, SETUP_APPLY, "anna", TEXT, 0), PROPOSAL_APPLY);
	assert_int_equal(proposal_ended(&proposal, false, 0, 1), PROPOSAL_NOTHING);
	assert_int_equal(proposal.phase, PROPOSAL_NONE);
	assert_int_equal(proposal_wait(&proposal, INT64_MAX), PROPOSAL_NOTHING);
}

static void test_only_what_was_checked_is_applied_by_who_did(void **state)
{
	struct proposal proposal = checked();

	(void)state;
	assert_int_equal(proposal_ask(&proposal, SETUP_APPLY, "bert", TEXT, 0), PROPOSAL_REFUSE);
	assert_int_equal(proposal_ask(&proposal, SETUP_APPLY, "anna", TEXT + 1, 0), PROPOSAL_REFUSE);
	assert_int_equal(proposal_ask(&proposal, SETUP_CONFIRM, "anna", TEXT, 0), PROPOSAL_REFUSE);
	assert_int_equal(proposal_ask(&proposal, SETUP_RETURN, "anna", TEXT, 0), PROPOSAL_REFUSE);
	assert_int_equal(proposal.phase, PROPOSAL_CHECKED);
	/* Another one's proposal takes its place, and errors leave none. */
	assert_int_equal(proposal_ask(&proposal, SETUP_CHECK, "bert", 0, 0), PROPOSAL_CHECK);
	assert_int_equal(proposal_ask(&proposal, SETUP_CHECK, "anna", 0, 0), PROPOSAL_REFUSE);
	assert_int_equal(proposal_ended(&proposal, false, TEXT, 0), PROPOSAL_NOTHING);
	assert_int_equal(proposal_ask(&proposal, SETUP_APPLY, "bert", TEXT, 0), PROPOSAL_REFUSE);
}

static void test_one_trial_at_a_time_which_its_user_confirms(void **state)
{
	struct proposal proposal = on_trial(0);

	(void)state;
	assert_int_equal(proposal_ask(&proposal, SETUP_CHECK, "bert", 0, 1), PROPOSAL_REFUSE);
	assert_int_equal(proposal_ask(&proposal, SETUP_APPLY, "anna", TEXT, 1), PROPOSAL_REFUSE);
	assert_int_equal(proposal_ask(&proposal, SETUP_CONFIRM, "bert", TEXT, 1), PROPOSAL_REFUSE);
	assert_int_equal(proposal_ask(&proposal, SETUP_CONFIRM, "anna", TEXT + 1, 1), PROPOSAL_REFUSE);
	assert_int_equal(proposal.phase, PROPOSAL_TRIAL);
}

/* Whatever comes in whatever order: in the end the file on the disk is the one in force, or the proposal still holds or is stuck. */
static void test_any_order_of_wishes_ends(void **state)
{
	struct proposal proposal = {.phase = PROPOSAL_NONE};
	uint32_t random = 1;
	bool trial = false, busy = false; /* in force is what is not on the disk; a task is under way */
	int64_t now = 0;

	(void)state;
	for (unsigned i = 0; i < 100000; i++) {
		enum proposal_task task;
		bool good;

		random = random * 1664525u + 1013904223u;
		good = (random >> 28) != 0;
		now += (random >> 8) % (20 * NS_PER_S);
		if (busy && (random >> 20) % 2) {
			if (proposal.phase == PROPOSAL_APPLYING)
				trial = good;
			if ((proposal.phase == PROPOSAL_KEEPING || proposal.phase == PROPOSAL_RETURNING) &&
			    good)
				trial = false;
			task = proposal_ended(&proposal, good, TEXT, now);
			busy = false;
		} else if ((random >> 21) % 2) {
			task = proposal_wait(&proposal, now);
		} else {
			task = proposal_ask(&proposal, (enum setup_wish)((random >> 22) % SETUP_WISHES),
					    (random >> 25) % 4 ? "anna" : "bert", TEXT, now);
		}
		assert_false(busy && task != PROPOSAL_NOTHING && task != PROPOSAL_REFUSE);
		busy |= task != PROPOSAL_NOTHING && task != PROPOSAL_REFUSE;
		assert_true(!trial || proposal_holds(&proposal) || proposal.phase == PROPOSAL_STUCK);
		assert_true(proposal_phase_name(proposal.phase)[0] != '\0');
	}
}

static void test_one_that_never_rests_is_refused(void **state)
{
	struct proposal_pace pace = {.began_ns = 0};
	int64_t now = 1000 * NS_PER_S;

	(void)state;
	for (unsigned i = 0; i < PROPOSAL_AT_ONCE; i++)
		assert_true(proposal_begins(&pace, now));
	assert_false(proposal_begins(&pace, now));
	assert_true(proposal_begins(&pace, now += NS_PER_S));
	/* One that takes long is followed by a second of rest all the same. */
	proposal_rests(&pace, now += 5 * NS_PER_S);
	assert_false(proposal_begins(&pace, now));
	assert_true(proposal_begins(&pace, now += NS_PER_S));
	proposal_rests(&pace, now);
	now += 3600 * NS_PER_S;
	for (unsigned i = 0; i < PROPOSAL_AT_ONCE; i++)
		assert_true(proposal_begins(&pace, now));
	assert_false(proposal_begins(&pace, now));
}

int main(void)
{
	const struct CMUnitTest tests[] = {
	    cmocka_unit_test(test_what_was_confirmed_is_kept),
	    cmocka_unit_test(test_what_nobody_confirms_goes),
	    cmocka_unit_test(test_a_late_confirmation_is_none),
	    cmocka_unit_test(test_what_cannot_be_written_goes),
	    cmocka_unit_test(test_a_way_back_that_fails_is_tried_again),
	    cmocka_unit_test(test_what_does_not_come_into_force_is_no_trial),
	    cmocka_unit_test(test_only_what_was_checked_is_applied_by_who_did),
	    cmocka_unit_test(test_one_trial_at_a_time_which_its_user_confirms),
	    cmocka_unit_test(test_one_that_never_rests_is_refused),
	    cmocka_unit_test(test_any_order_of_wishes_ends),
	};

	return cmocka_run_group_tests(tests, NULL, NULL);
}
