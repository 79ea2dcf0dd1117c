/* SPDX-License-Identifier: GPL-3.0-or-later */
/* How often a peer is tried, and how often the log tells of it, in virtual time. */
#include <setjmp.h>
#include <stdarg.h>
#include <stddef.h>
#include <stdio.h>

#include <cmocka.h>

#include "channel/attempts.h"

#define S      NS_PER_S
#define MINUTE (60 * S)
#define HOUR   (60 * MINUTE)
#define NEVER  INT64_MAX

/* What a peer does: it lets each connection live for so long, in which it is of use or not. */
struct peer {
	int64_t lives_ns; /* 0: it takes none */
	bool useful;
};

struct course {
	struct attempts attempts;
	int64_t now_ns;
	unsigned connections, failures, successes; /* the last two: lines */
	char line[ATTEMPTS_TEXT_SIZE];
};

static struct course begin(void)
{
	return (struct course){.attempts = attempts_begin(ATTEMPTS_FIRST_NS, ATTEMPTS_MOST_NS), .now_ns = S};
}

static void use(struct course *course)
{
	retry_was_useful(&course->attempts.retry);
	if (!map_trouble_well(&course->attempts.trouble, course->now_ns))
		return;
	course->successes++;
	map_trouble_ended(&course->attempts.trouble, course->now_ns, course->line);
}

static void live(struct course *course, const struct peer *peer, int64_t until_ns)
{
	const int64_t end_ns = peer->lives_ns == NEVER ? until_ns : course->now_ns + peer->lives_ns;

	retry_opened(&course->attempts.retry, course->now_ns);
	course->connections++;
	while (course->now_ns < end_ns) {
		if (peer->useful)
			use(course);
		course->now_ns = earlier(course->now_ns + S / 2, end_ns);
	}
}

static void run(struct course *course, const struct peer *peer, int64_t for_ns)
{
	const int64_t until_ns = course->now_ns + for_ns;

	while (course->now_ns < until_ns) {
		if (peer->lives_ns > 0)
			live(course, peer, until_ns);
		if (course->now_ns >= until_ns)
			return;
		if (attempts_failed(&course->attempts, "hung up", course->now_ns)) {
			course->failures++;
			attempts_failure(&course->attempts, course->now_ns, course->line);
		}
		course->now_ns += course->attempts.pause_ns;
	}
}

static const struct peer takes_and_hangs_up = {.lives_ns = S / 100};
static const struct peer answers_once = {.lives_ns = S / 100, .useful = true};
static const struct peer refuses = {.lives_ns = 0};
static const struct peer good = {.lives_ns = NEVER, .useful = true};

static void test_a_peer_that_hangs_up_is_tried_less_and_less_often(void **state)
{
	struct course course = begin();

	(void)state;
	run(&course, &takes_and_hangs_up, MINUTE);
	assert_in_range(course.connections, 8, 9); /* behind 1, 2, 4, 8, and then each 10 s */
	assert_in_range(course.failures, 2, 3);
	assert_int_equal(course.successes, 0);
	run(&course, &takes_and_hangs_up, HOUR);
	assert_in_range(course.failures, 9, 10);
	run(&course, &takes_and_hangs_up, 24 * HOUR);
	assert_in_range(course.failures, 30, 36);
}

static void test_what_became_of_it_is_said_with_the_count(void **state)
{
	struct course course = begin();

	(void)state;
	run(&course, &refuses, S);
	assert_string_equal(course.line, "; trying again in 1 s");
	run(&course, &refuses, 20 * S);
	assert_string_equal(course.line, "; 5 times in 15 s; trying again in 10 s");
	run(&course, &good, S);
	assert_string_equal(course.line, ", again after 5 failures in 25 s");
	assert_int_equal(course.successes, 1);
	run(&course, &good, HOUR);
	assert_int_equal(course.successes, 1);
	assert_int_equal(course.failures, 2);
}

/* One answer shows that it is of use: it is asked as soon as before, and the log is quiet all the same. */
static void test_a_peer_that_comes_and_goes_is_no_flood(void **state)
{
	struct course course = begin();

	(void)state;
	run(&course, &good, HOUR);
	run(&course, &answers_once, HOUR);
	assert_true(course.connections > 3000);
	assert_in_range(course.failures, 8, 10);
	assert_int_equal(course.successes, 1);
	assert_true(course.attempts.trouble.said); /* the last line says so */
	run(&course, &good, 2 * HOUR);
	assert_int_equal(course.successes, 2);
	assert_false(course.attempts.trouble.said);
}

/* Lost now and then: each is said, since the one before is long ago. */
static void test_a_connection_lost_each_two_hours_is_said_each_time(void **state)
{
	struct course course = begin();

	(void)state;
	for (int i = 0; i < 5; i++) {
		run(&course, &good, 2 * HOUR);
		run(&course, &refuses, 5 * S);
	}
	run(&course, &good, S);
	assert_int_equal(course.failures, 5);
	assert_int_equal(course.successes, 5);
	assert_string_equal(course.line, ", again after 3 failures in 7 s");
}

/* It says that it is lost within 10 s, although the last line said that it was there. */
static void test_the_last_line_is_true_soon(void **state)
{
	struct course course = begin();

	(void)state;
	run(&course, &refuses, S);
	run(&course, &good, S);
	assert_false(course.attempts.trouble.said);
	run(&course, &refuses, 16 * S);
	assert_true(course.attempts.trouble.said);
	assert_int_equal(course.failures, 2);
}

/* What it is now is said at once; two that take turns are not said each time. */
static void test_another_reason_is_said_once(void **state)
{
	static const char *const reasons[] = {"refused", "hung up"};
	struct attempts attempts = attempts_begin(ATTEMPTS_FIRST_NS, ATTEMPTS_MOST_NS);
	unsigned lines = 0;

	(void)state;
	assert_true(attempts_failed(&attempts, reasons[0], S));
	assert_false(attempts_failed(&attempts, reasons[0], 2 * S));
	assert_true(attempts_failed(&attempts, reasons[1], 4 * S));
	assert_false(attempts_failed(&attempts, reasons[0], 8 * S));
	for (int64_t i = 0; i < 3600; i++)
		lines += attempts_failed(&attempts, reasons[i % 2], 10 * S + i * S);
	assert_in_range(lines, 9, 18);
}

int main(void)
{
	const struct CMUnitTest tests[] = {
	    cmocka_unit_test(test_a_peer_that_hangs_up_is_tried_less_and_less_often),
	    cmocka_unit_test(test_what_became_of_it_is_said_with_the_count),
	    cmocka_unit_test(test_a_peer_that_comes_and_goes_is_no_flood),
	    cmocka_unit_test(test_a_connection_lost_each_two_hours_is_said_each_time),
	    cmocka_unit_test(test_the_last_line_is_true_soon),
	    cmocka_unit_test(test_another_reason_is_said_once),
	};
	return cmocka_run_group_tests_name("attempts", tests, NULL, NULL);
}
