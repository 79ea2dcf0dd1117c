/* SPDX-License-Identifier: GPL-3.0-or-later */
/* What a module tells all others: samples of its points, events and its log. */
#include <string.h>

#include "map/test_stage.h"

static void test_points_are_found_by_address(void **state)
{
	struct stage *stage = *state;

	for (uint32_t i = 0; i < POINTS; i++)
		assert_int_equal(map_find(stage->rtud, i < 4 ? 1001 : 2001, 40001 + i % 4), i);
	assert_int_equal(map_find(stage->rtud, 1001, 40005), MAP_NONE);
	assert_int_equal(map_find(stage->rtud, 1002, 40001), MAP_NONE);
	assert_int_equal(map_find(stage->rtud, 0, 0), MAP_NONE);
}

static void test_published_samples_are_read_by_others(void **state)
{
	struct stage *stage = *state;
	struct map *owner = start(stage, FIRST), *reader = start(stage, "rtu-iec104");
	struct map_update updates[] = {scaled(1, 1500, MAP_GOOD, 10), scaled(2, -1, MAP_OVERFLOW, 10)};

	map_publish(owner, updates, 2);
	assert_sample(reader, 1, 1500, MAP_GOOD);
	assert_sample(reader, 2, -1, MAP_OVERFLOW);
	map_detach(owner);
	map_detach(reader);
}

static void test_what_was_not_published_since_is_not_read_again(void **state)
{
	struct stage *stage = *state;
	struct map *owner = start(stage, FIRST);
	struct map_update update = scaled(2, 7, MAP_GOOD, 10);
	const uint32_t points[] = {0, 2};
	struct map_seen seen = {.whole = false};
	struct map_sample samples[2];

	assert_true(map_read_changed(stage->rtud, points, 2, &seen, samples));
	assert_int_equal(samples[1].quality, MAP_INVALID);
	map_publish(owner, &update, 1);
	assert_true(map_read_changed(stage->rtud, points, 2, &seen, samples));
	assert_int_equal(samples[1].value.i, 7);
	assert_int_equal(samples[1].quality, MAP_GOOD);
	assert_false(map_read_changed(stage->rtud, points, 2, &seen, samples));
	assert_true(seen.whole);
	map_module_ended(stage->rtud, index_of(stage, FIRST), true);
	assert_true(map_read_changed(stage->rtud, points, 2, &seen, samples));
	assert_int_equal(samples[1].quality, MAP_INVALID);
	assert_false(map_read_changed(stage->rtud, points, 2, &seen, samples));
	map_detach(owner);
}

static void test_an_update_can_keep_the_value(void **state)
{
	struct stage *stage = *state;
	struct map *owner = start(stage, FIRST), *reader = start(stage, "rtu-iec104");
	struct map_update update = scaled(1, 1500, MAP_GOOD, 10);
	struct map_cursor cursor;
	struct map_event event;

	update.sample.detail = 1;
	map_publish(owner, &update, 1);
	map_cursor_to_end(reader, &cursor);
	update = (struct map_update){
	    .point = 1, .flags = MAP_UPDATE_KEEPS_VALUE, .sample = {.quality = MAP_BLOCKED, .time_ns = 11}};
	map_publish(owner, &update, 1);
	assert_sample(reader, 1, 1500, MAP_BLOCKED);
	assert_true(map_event_next(reader, &cursor, &event));
	assert_int_equal(event.sample.value.i, 1500);
	assert_int_equal(event.sample.detail, 1);
	assert_int_equal(event.sample.time_ns, 11);
	map_detach(owner);
	map_detach(reader);
}

/* A station's interrogation answered before its backlog was told. */
static void test_what_was_before_is_an_event_and_no_state(void **state)
{
	struct stage *stage = *state;
	struct map *owner = start(stage, FIRST), *reader = start(stage, "rtu-iec104");
	struct map_update update = scaled(1, 100, MAP_GOOD, 20);
	struct map_cursor cursor;
	struct map_event event;

	map_publish(owner, &update, 1);
	map_cursor_to_end(reader, &cursor);
	update = scaled(1, 50, MAP_GOOD, 10);
	update.flags = MAP_UPDATE_PAST;
	update.event_rule = MAP_EVENT_ALWAYS;
	map_publish(owner, &update, 1);
	assert_sample(reader, 1, 100, MAP_GOOD);
	assert_true(map_event_next(reader, &cursor, &event));
	assert_int_equal(event.sample.value.i, 50);
	assert_int_equal(event.sample.time_ns, 10);
	assert_true(event.past);
	/* Whoever keeps the last event has what was: so the state is news again. */
	update = scaled(1, 100, MAP_GOOD, 30);
	map_publish(owner, &update, 1);
	assert_true(map_event_next(reader, &cursor, &event));
	assert_int_equal(event.sample.value.i, 100);
	assert_false(event.past);
	map_detach(owner);
	map_detach(reader);
}

static void test_points_are_invalid_before_the_first_sample_and_after_the_end(void **state)
{
	struct stage *stage = *state;
	struct map *owner = start(stage, FIRST);
	struct map_update update = scaled(0, 7, MAP_GOOD, 10);
	uint32_t index = index_of(stage, FIRST);

	assert_sample(stage->rtud, 0, 0, MAP_INVALID);
	map_publish(owner, &update, 1);
	assert_sample(stage->rtud, 0, 7, MAP_GOOD);
	map_module_ended(stage->rtud, index, true);
	assert_sample(stage->rtud, 0, 7, MAP_INVALID);
	assert_false(map_may_run(owner));
	map_detach(owner);

	owner = start(stage, FIRST); /* the next generation has not read the device yet */
	assert_sample(stage->rtud, 0, 7, MAP_INVALID);
	map_detach(owner);
}

static void test_events_are_changes_beyond_the_deadband(void **state)
{
	struct stage *stage = *state;
	struct map *owner, *reader;
	struct map_cursor cursor;
	struct map_event event;
	const struct map_update updates[] = {scaled(0, 100, MAP_GOOD, 1), scaled(0, 105, MAP_GOOD, 2),
					     scaled(0, 94, MAP_GOOD, 3), scaled(0, 94, MAP_INVALID, 4),
					     scaled(0, 94, MAP_INVALID, 5)};
	const int64_t expected[] = {1, 3, 4};

	stage->rtud->config.points[0].deadband = 5;
	owner = start(stage, FIRST);
	reader = start(stage, "rtu-iec104");
	map_cursor_to_end(reader, &cursor);
	for (size_t i = 0; i < 5; i++)
		map_publish(owner, &updates[i], 1);
	for (size_t i = 0; i < 3; i++) {
		assert_true(map_event_next(reader, &cursor, &event));
		assert_int_equal(event.kind, MAP_EVENT_CHANGE);
		assert_int_equal(event.point, 0);
		assert_int_equal(event.sample.time_ns, expected[i]);
	}
	assert_false(map_event_next(reader, &cursor, &event));
	map_detach(owner);
	map_detach(reader);
}

/* An owner that judges its values together, as a position, says itself which of them is an event. */
static void test_owner_says_what_is_an_event(void **state)
{
	struct stage *stage = *state;
	struct map *owner = start(stage, FIRST), *reader = start(stage, "rtu-iec104");
	struct map_cursor cursor;
	struct map_event event;
	struct map_update updates[] = {scaled(0, 100, MAP_GOOD, 1), scaled(0, 900, MAP_GOOD, 2),
				       scaled(0, 900, MAP_GOOD, 3), scaled(0, 901, MAP_INVALID, 4)};
	const int64_t expected[] = {1, 3, 4};

	updates[1].event_rule = MAP_EVENT_BY_QUALITY;
	updates[2].event_rule = MAP_EVENT_ALWAYS;
	updates[3].event_rule = MAP_EVENT_BY_QUALITY;
	map_cursor_to_end(reader, &cursor);
	for (size_t i = 0; i < 4; i++)
		map_publish(owner, &updates[i], 1);
	for (size_t i = 0; i < 3; i++) {
		assert_true(map_event_next(reader, &cursor, &event));
		assert_int_equal(event.sample.time_ns, expected[i]);
	}
	assert_false(map_event_next(reader, &cursor, &event));
	map_detach(owner);
	map_detach(reader);
}

static void test_return_information_is_an_event_in_any_case(void **state)
{
	struct stage *stage = *state;
	struct map *owner = start(stage, FIRST), *reader = start(stage, "rtu-iec104");
	struct map_cursor cursor;
	struct map_event event;
	struct map_update updates[] = {scaled(1, 7, MAP_GOOD, 1), scaled(2, 7, MAP_GOOD, 1)};

	map_publish(owner, updates, 2);
	map_cursor_to_end(reader, &cursor);
	updates[1].cause = MAP_RETURN_REMOTE;
	map_publish(owner, updates, 2);
	assert_true(map_event_next(reader, &cursor, &event));
	assert_int_equal(event.point, 2);
	assert_int_equal(event.cause, MAP_RETURN_REMOTE);
	assert_false(map_event_next(reader, &cursor, &event));
	updates[0].sample.value.i = 8;
	map_publish(owner, updates, 1);
	assert_true(map_event_next(reader, &cursor, &event));
	assert_int_equal(event.cause, MAP_SPONTANEOUS);
	map_detach(owner);
	map_detach(reader);
}

static void test_events_of_several_modules_come_in_order_of_time(void **state)
{
	struct stage *stage = *state;
	struct map *first = start(stage, FIRST), *second = start(stage, SECOND);
	struct map_cursor cursor = {0};
	struct map_event event;
	const int64_t times[] = {10, 20, 30, 40};

	for (int i = 0; i < 4; i++) {
		struct map_update update = scaled(i % 2 ? 4 : 0, i + 1, MAP_GOOD, times[i]);

		map_publish(i % 2 ? second : first, &update, 1);
	}
	for (int i = 0; i < 4; i++) {
		assert_true(map_event_next(stage->rtud, &cursor, &event));
		assert_int_equal(event.sample.time_ns, times[i]);
	}
	map_detach(first);
	map_detach(second);
}

static void test_lost_events_are_counted(void **state)
{
	struct stage *stage = *state;
	struct map *owner = start(stage, FIRST);
	struct map_cursor cursor = {0};
	struct map_event event;
	uint32_t read = 0;

	for (int i = 1; i <= 100; i++) {
		struct map_update update = scaled(0, i, MAP_GOOD, i);

		map_publish(owner, &update, 1);
	}
	while (map_event_next(stage->rtud, &cursor, &event)) {
		read++;
		assert_int_equal(event.sample.value.i, 100 - 63 + read); /* the newest 63 of a ring of 64 */
	}
	assert_int_equal(read, 63);
	assert_int_equal(cursor.lost, 37);
	map_detach(owner);
}

static void test_the_log_is_read_line_by_line(void **state)
{
	struct stage *stage = *state;
	struct map *module = start(stage, FIRST);
	struct map_log_line line;
	uint32_t position = 0, lost = 0;

	map_log(module, MAP_LOG_WARNING, "device %d is dead", 67);
	assert_true(map_log_next(stage->rtud, index_of(stage, FIRST), &position, &line, &lost));
	assert_string_equal(line.text, "device 67 is dead");
	assert_int_equal(line.level, MAP_LOG_WARNING);
	assert_false(map_log_next(stage->rtud, index_of(stage, FIRST), &position, &line, &lost));
	map_log(module, MAP_LOG_ERROR, "x\n2026-01-01 rtud error: forged \x1b[2J\x7f \xc4\x8d");
	assert_true(map_log_next(stage->rtud, index_of(stage, FIRST), &position, &line, &lost));
	assert_string_equal(line.text, "x?2026-01-01 rtud error: forged ?[2J? \xc4\x8d");
	map_detach(module);
}

static uint32_t read_all(const struct map *rtud, uint32_t module, uint32_t *position, char *text)
{
	struct map_log_line line;
	uint32_t lines = 0, lost = 0;

	for (; map_log_next(rtud, module, position, &line, &lost); lines++)
		snprintf(text, MAP_LOG_TEXT_SIZE, "%s", line.text);
	assert_int_equal(lost, 0);
	return lines;
}

/* What a module leaves out of its log, it counts, and tells by itself when there is room again. */
static void test_a_flood_in_the_log_is_limited_and_counted(void **state)
{
	enum { FLOOD = 5000 };
	struct stage *stage = *state;
	struct map *module = start(stage, FIRST);
	const uint32_t index = index_of(stage, FIRST);
	const int64_t begun_ns = map_now_ns();
	uint32_t position = 0, lines = 0, told = 0, left_out = 0;
	char text[MAP_LOG_TEXT_SIZE] = "";

	for (int i = 0; i < FLOOD; i++) {
		map_log(module, MAP_LOG_INFO, "again");
		lines += read_all(stage->rtud, index, &position, text);
	}
	assert_in_range(lines, MAP_LOG_AT_ONCE - MAP_LOG_RESERVED,
			MAP_LOG_AT_ONCE + 2 + (map_now_ns() - begun_ns) / MAP_LOG_PERIOD_NS);
	map_log(module, MAP_LOG_ERROR, "a fault"); /* there is room for it */
	assert_in_range(read_all(stage->rtud, index, &position, text), 1, 2);
	assert_string_equal(text, "a fault");
	while (told == 0) { /* a busy host may have told of some of them before */
		map_heartbeat_at(module, begun_ns + S_PER_HOUR * NS_PER_S);
		told = read_all(stage->rtud, index, &position, text);
	}
	assert_int_equal(sscanf(text, "%u lines are left out", &left_out), 1);
	assert_in_range(left_out, 1, FLOOD);
	map_detach(module);
}

/* A reader that comes late, or a writer that keeps no pace: what was overwritten is counted. */
static void test_lost_lines_of_the_log_are_counted(void **state)
{
	struct stage *stage = *state;
	struct map *module = start(stage, FIRST);
	const uint32_t index = index_of(stage, FIRST);
	const struct ring *ring = &module->segments[module->self].log;
	struct map_log_line line = {.time_ns = map_now_ns(), .text = "wild"};
	uint32_t position = 0, lost = 0;

	for (uint32_t i = 0; i < 3 * ring->capacity; i++)
		ring_put(ring, &line);
	assert_true(map_log_next(stage->rtud, index, &position, &line, &lost));
	assert_int_equal(lost, 2 * ring->capacity + 1);
	assert_true(map_log_next(stage->rtud, index, &position, &line, &lost));
	assert_int_equal(lost, 2 * ring->capacity + 1);
	map_detach(module);
}

/* Whoever reads them knows nothing of the section. */
static void test_named_counters(void **state)
{
	struct stage *stage = *state;
	struct map *owner = start(stage, FIRST);
	uint32_t index = index_of(stage, FIRST);
	_Atomic uint32_t *own = map_section(owner, index, 3 * sizeof(*own));
	struct map_counter counter;

	assert_false(map_counter(stage->rtud, index, 0, &counter));
	assert_true(map_name_counter(owner, &own[2], "p%u.%s", 1u, "frames"));
	assert_true(map_name_counter(owner, &own[0], "%s", "a name that is longer than its place is"));
	assert_false(map_name_counter(owner, &own[1], "third")); /* two are planned */
	map_count(&own[2], 7);
	assert_true(map_counter(stage->rtud, index, 0, &counter));
	assert_string_equal(counter.name, "p1.frames");
	assert_int_equal(counter.value, 7);
	assert_true(map_counter(stage->rtud, index, 1, &counter));
	assert_int_equal(strlen(counter.name), MAP_COUNTER_SIZE - 1);
	assert_false(map_counter(stage->rtud, index, 2, &counter));
	assert_false(map_counter(stage->rtud, MAP_RTUD, 0, &counter));
	map_detach(owner);

	owner = start(stage, FIRST); /* the next process names them again */
	own = map_section(owner, index, 3 * sizeof(*own));
	assert_true(map_name_counter(owner, &own[1], "other"));
	assert_true(map_counter(stage->rtud, index, 0, &counter));
	assert_string_equal(counter.name, "other");
	map_detach(owner);
}

static void test_durations_are_counted(void **state)
{
	struct map_histogram histogram = {.longest_us = 0};

	(void)state;
	map_histogram_add(&histogram, 3000);
	map_histogram_add(&histogram, -5);
	assert_int_equal(histogram.longest_us, 3);
	map_histogram_add(&histogram, INT64_MAX);
	assert_int_equal(histogram.counts[2], 1);
	assert_int_equal(histogram.counts[0], 1);
	assert_int_equal(histogram.counts[MAP_BUCKETS - 1], 1);
	assert_int_equal(histogram.longest_us, UINT32_MAX);
}

/* Nor of one whose plan says that it has some, and has no room for them. */
static void test_a_module_without_scans(void **state)
{
	struct stage *stage = *state;
	const uint32_t index = index_of(stage, FIRST);
	struct map_module_plan *plan = &stage->rtud->modules[index].plan;

	assert_null(map_scans_of(stage->rtud, index));
	plan->flags |= MAP_SHOWS_SCANS;
	assert_null(map_scans_of(stage->rtud, index));
	plan->section_size = sizeof(struct map_scans);
	assert_non_null(map_scans_of(stage->rtud, index));
}

int main(void)
{
	const struct CMUnitTest tests[] = {
	    TEST(test_points_are_found_by_address),
	    TEST(test_published_samples_are_read_by_others),
	    TEST(test_what_was_not_published_since_is_not_read_again),
	    TEST(test_an_update_can_keep_the_value),
	    TEST(test_what_was_before_is_an_event_and_no_state),
	    TEST(test_points_are_invalid_before_the_first_sample_and_after_the_end),
	    TEST(test_events_are_changes_beyond_the_deadband),
	    TEST(test_owner_says_what_is_an_event),
	    TEST(test_return_information_is_an_event_in_any_case),
	    TEST(test_events_of_several_modules_come_in_order_of_time),
	    TEST(test_lost_events_are_counted),
	    TEST(test_named_counters),
	    cmocka_unit_test(test_durations_are_counted),
	    TEST(test_a_module_without_scans),
	    TEST(test_the_log_is_read_line_by_line),
	    TEST(test_a_flood_in_the_log_is_limited_and_counted),
	    TEST(test_lost_lines_of_the_log_are_counted),
	};

	return cmocka_run_group_tests(tests, NULL, NULL);
}
