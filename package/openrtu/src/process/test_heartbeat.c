/* SPDX-License-Identifier: GPL-3.0-or-later */
#include "map/test_stage.h"

#include <fcntl.h>
#include <string.h>
#include <unistd.h>

#include "process/heartbeat.h"

#define MS 1000000LL

static void assert_words(const char *expected, int64_t silent_ms, int64_t waited_ms, unsigned unsaid)
{
	char words[MAP_LOG_TEXT_SIZE];

	heartbeat_words(words, sizeof(words), silent_ms, 100, waited_ms, unsaid);
	assert_string_equal(words, expected);
}

static void test_the_words_say_what_was_measured(void **state)
{
	(void)state;
	assert_words("silent for 165 ms (limit 100): the host gave this process no time for 140 ms", 165, 140,
		     0);
	assert_words("silent for 300 ms (limit 100): this process was stopped or busy all the time", 300, 2,
		     0);
	assert_words(
	    "silent for 300 ms (limit 100): the host gave this process no time, or somebody stopped it", 300,
	    HEARTBEAT_UNKNOWN, 0);
	assert_words("silent for 165 ms (limit 100): the host gave this process no time for 140 ms; "
		     "7 times more",
		     165, 140, 7);
}

static void test_the_longest_words_fit_into_a_line_of_the_log(void **state)
{
	char words[2 * MAP_LOG_TEXT_SIZE];

	(void)state;
	heartbeat_words(words, sizeof(words), 10000, 5000, 10000, UINT32_MAX);
	assert_in_range(strlen(words), 1, MAP_LOG_TEXT_SIZE - 1);
}

/* ---- a process of the map, its scheduler's figures in a file of the test's --------------------------------- */

struct late {
	struct map *map;
	struct heartbeat heartbeat;
	uint32_t position; /* in the log */
	int64_t now_ns;
};

static void waited(const struct late *late, const char *figures)
{
	assert_int_equal(pwrite(late->heartbeat.schedstat_fd, figures, strlen(figures), 0), strlen(figures));
}

static struct late late_of(struct stage *stage)
{
	struct late late = {.map = start(stage, FIRST)};

	set_heartbeat_limit(late.map, map_self(late.map), MAP_HEARTBEAT_LIMIT_MS);
	heartbeat_begin(&late.heartbeat, late.map);
	if (late.heartbeat.schedstat_fd >= 0)
		close(late.heartbeat.schedstat_fd);
	late.heartbeat.schedstat_fd = open("/dev/shm", O_TMPFILE | O_RDWR | O_CLOEXEC, 0600);
	assert_true(late.heartbeat.schedstat_fd >= 0);
	waited(&late, "7000000 1000000 12\n");
	late.now_ns = late.heartbeat.beaten_ns;
	return late;
}

static void beat_after(struct late *late, int64_t ms)
{
	late->now_ns += ms * MS;
	heartbeat_beat(&late->heartbeat, late->map, late->now_ns);
}

static void assert_said(struct late *late, const char *expected)
{
	struct map_log_line line;
	uint32_t lost = 0;

	assert_true(map_log_next(late->map, map_self(late->map), &late->position, &line, &lost));
	assert_int_equal(line.level, MAP_LOG_WARNING);
	assert_string_equal(line.text, expected);
}

static void assert_said_nothing(struct late *late)
{
	struct map_log_line line;
	uint32_t lost = 0;

	assert_false(map_log_next(late->map, map_self(late->map), &late->position, &line, &lost));
}

static void end(struct late *late)
{
	close(late->heartbeat.schedstat_fd);
	map_detach(late->map);
}

static void test_a_beat_in_time_says_nothing(void **state)
{
	struct late late = late_of(*state);

	for (int i = 0; i < 10; i++)
		beat_after(&late, 100);
	assert_said_nothing(&late);
	end(&late);
}

static void test_a_late_beat_says_how_long_it_waited_for_the_processor(void **state)
{
	struct late late = late_of(*state);

	beat_after(&late, 25);
	waited(&late, "7000000 141000000 13\n");
	beat_after(&late, 165);
	assert_said(&late, "silent for 165 ms (limit 100): the host gave this process no time for 140 ms");
	end(&late);
}

/* The kernel is asked later than the clock: a process waits in between, too. */
static void test_what_it_waited_after_a_beat_is_of_the_next_silence(void **state)
{
	struct late late = late_of(*state);

	beat_after(&late, 25);
	waited(&late, "7000000 501000000 13\n");
	beat_after(&late, 200);
	assert_said(&late, "silent for 200 ms (limit 100): the host gave this process no time for 200 ms");
	late.heartbeat.said_ns = 0;
	beat_after(&late, 310);
	assert_said(&late, "silent for 310 ms (limit 100): the host gave this process no time for 300 ms");
	end(&late);
}

static void test_flapping_fills_no_log(void **state)
{
	struct late late = late_of(*state);

	beat_after(&late, 25);
	for (int i = 0; i < 20; i++)
		beat_after(&late, 500);
	assert_said(&late, "silent for 500 ms (limit 100): this process was stopped or busy all the time");
	assert_said_nothing(&late);
	beat_after(&late, 500);
	assert_said(&late, "silent for 500 ms (limit 100): this process was stopped or busy all the "
			   "time; 19 times more");
	end(&late);
}

static void test_the_configured_limit_counts(void **state)
{
	struct late late = late_of(*state);

	set_heartbeat_limit(late.map, map_self(late.map), 400);
	beat_after(&late, 400);
	assert_said_nothing(&late);
	beat_after(&late, 401);
	assert_said(&late, "silent for 401 ms (limit 400): this process was stopped or busy all the time");
	end(&late);
}

int main(void)
{
	const struct CMUnitTest tests[] = {
	    cmocka_unit_test(test_the_words_say_what_was_measured),
	    cmocka_unit_test(test_the_longest_words_fit_into_a_line_of_the_log),
	    TEST(test_a_beat_in_time_says_nothing),
	    TEST(test_a_late_beat_says_how_long_it_waited_for_the_processor),
	    TEST(test_what_it_waited_after_a_beat_is_of_the_next_silence),
	    TEST(test_flapping_fills_no_log),
	    TEST(test_the_configured_limit_counts),
	};

	return cmocka_run_group_tests_name("heartbeat", tests, NULL, NULL);
}
