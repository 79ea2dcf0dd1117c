/* SPDX-License-Identifier: GPL-3.0-or-later */
/* A configuration that follows another: what passes over, what stays where it is, what is gone. */
#include "map/test_stage.h"

#include <stdlib.h>
#include <string.h>
#include <unistd.h>

#define KEPT_LINES (~(1u << 3)) /* all modules but the first line's */

/* The first line's points are 0..3, the second's 4..7. */
struct change {
	struct stage *stage;
	struct map_set sets[4];
	struct map_point points[POINTS + 4];
	struct map_config config;
	struct map *next;
};

/* The second line first; of the first line, point 1 is gone and another comes before the rest. */
static void plan_change(struct change *change)
{
	const struct stage *stage = change->stage;
	struct map_point *points = change->points;

	change->sets[0] = stage->sets[1];
	change->sets[0].first_point = 0;
	change->sets[1] = stage->sets[0];
	change->sets[1].first_point = 4;
	memcpy(points, &stage->points[4], 4 * sizeof(*points));
	for (int i = 0; i < 4; i++)
		points[i].set = 0;
	points[4] = (struct map_point){.set = 1, .type = MAP_SCALED, .ioa = 40100};
	points[5] = stage->points[0];
	points[6] = stage->points[2];
	points[7] = stage->points[3];
	for (int i = 4; i < 8; i++)
		points[i].set = 1;
	change->sets[2] = stage->sets[0]; /* what is gone */
	change->sets[2].first_point = 8;
	change->sets[2].point_count = 1;
	points[8] = stage->points[1];
	points[8].set = 2;
	change->config = stage->config;
	change->config.sets = change->sets;
	change->config.points = points;
	change->config.gone_set_count = change->config.gone_point_count = 1;
}

static void prepare(struct change *change)
{
	char error[MAP_ERROR_SIZE];

	plan_change(change);
	if (map_prepare(change->stage->rtud, &change->config, KEPT_LINES, 0, error) < 0 ||
	    map_attach_again(&change->next, change->stage->rtud, 1, error) < 0)
		fail_msg("%s", error);
}

static void put_into_force(const struct change *change, bool seamless)
{
	const uint32_t first = 1u << index_of(change->stage, FIRST);
	char error[MAP_ERROR_SIZE];
	struct map_config before;

	const struct map_switching how = {.valid = first, .seamless = seamless ? first : 0};

	assert_int_equal(map_switch(change->stage->rtud, change->next, &how, error), 0);
	map_unlink_former(change->stage->rtud, change->next);
	map_detach(change->next);
	assert_true(map_is_changed(change->stage->rtud));
	assert_int_equal(map_renew(change->stage->rtud, &before, error), 0);
	assert_false(map_is_changed(change->stage->rtud));
	map_forget(change->stage->rtud);
}

static struct map *attach(const struct stage *stage, const char *name)
{
	char error[MAP_ERROR_SIZE];
	struct map *map;

	if (map_attach(&map, stage->dir, name, error) < 0)
		fail_msg("%s", error);
	return map;
}

static void renew(struct map *map)
{
	char error[MAP_ERROR_SIZE];
	struct map_config before;

	assert_int_equal(map_renew(map, &before, error), 0);
	map_forget(map);
}

static void assert_event(const struct map *map, struct map_cursor *cursor, uint32_t point, int32_t value,
			 uint8_t quality)
{
	struct map_event event;

	assert_true(map_event_next(map, cursor, &event));
	assert_int_equal(event.kind, MAP_EVENT_CHANGE);
	assert_int_equal(event.point, point);
	assert_int_equal(event.sample.value.i, value);
	assert_int_equal(event.sample.quality, quality);
}

static void publish(struct map *owner, uint32_t point, int32_t value)
{
	const struct map_update update = scaled(point, value, MAP_GOOD, map_now_ns());

	map_publish(owner, &update, 1);
	map_heartbeat(owner);
}

static void test_what_was_told_and_asked_passes_over(void **state)
{
	struct change change = {.stage = *state};
	struct command_stage commands = start_commands(change.stage);
	struct map_cursor cursor;
	struct map_event event;
	struct map_command command;

	map_cursor_to_end(commands.requester, &cursor);
	publish(commands.owner, 0, 10);
	publish(commands.owner, 1, 11);
	publish(commands.owner, 3, 13);
	assert_false(post(&commands, request(3, MAP_SELECT, 1, 9)));
	assert_answer(&commands, MAP_ACCEPTED_SELECTION, MAP_RESULT_NONE);
	prepare(&change);
	map_request_post(commands.requester, request(3, MAP_EXECUTE, 1, 9)); /* nobody has taken it */
	map_detach(commands.owner);
	put_into_force(&change, true);
	renew(commands.requester);
	commands.owner = attach(change.stage, FIRST);
	assert_event(commands.requester, &cursor, 5, 10, MAP_GOOD);
	assert_event(commands.requester, &cursor, 8, 11, MAP_GOOD);
	assert_event(commands.requester, &cursor, 7, 13, MAP_GOOD);
	assert_event(commands.requester, &cursor, 8, 11, MAP_INVALID); /* before it is unknown */
	publish(commands.owner, 5, 10);
	assert_false(map_event_next(commands.requester, &cursor, &event)); /* it was told */
	publish(commands.owner, 4, 14);
	assert_event(commands.requester, &cursor, 4, 14, MAP_GOOD);
	assert_sample(commands.requester, 7, 13, MAP_GOOD);
	assert_sample(commands.requester, 6, 0, MAP_INVALID);
	assert_int_equal(map_find(commands.requester, change.sets[1].ca, change.points[8].ioa), MAP_NONE);
	assert_true(map_command_read(commands.requester, 7, &command));
	assert_int_equal(command.state, MAP_ACCEPTED_SELECTION);
	{
		struct map_request taken;

		assert_true(map_request_next(commands.owner, &taken));
		assert_int_equal(taken.point, 7);
		assert_true(map_command_request(commands.owner, &taken));
	}
	map_command_finish(commands.owner, 7, MAP_RESULT_DONE, 0);
	end_commands(&commands);
}

/* Asked by the numbers of the former configuration, in which slot 0 was another point's. */
static void test_request_means_the_point_that_it_named(void **state)
{
	struct change change = {.stage = *state};
	struct command_stage commands = start_commands(change.stage);
	struct map_request taken;
	struct map_answer answer;

	publish(commands.owner, 0, 10);
	prepare(&change);
	map_request_post(commands.requester, request(0, MAP_EXECUTE, 1, 7));
	map_request_post(commands.requester, request(1, MAP_EXECUTE, 1, 7));
	map_detach(commands.owner);
	put_into_force(&change, true);
	commands.owner = attach(change.stage, FIRST);
	assert_true(map_request_next(commands.owner, &taken));
	assert_int_equal(taken.point, 5);
	assert_false(map_request_next(commands.owner, &taken)); /* the other one is gone */
	renew(commands.requester);
	assert_true(map_answer_next(commands.requester, &answer));
	assert_int_equal(answer.state, MAP_REFUSED_COMMAND);
	assert_int_equal(answer.result, MAP_RESULT_NOT_COMMANDABLE);
	end_commands(&commands);
}

static void test_who_did_not_change_goes_on_with_what_he_has(void **state)
{
	struct change change = {.stage = *state};
	struct map *owner = start(change.stage, SECOND), *reader = start(change.stage, "rtu-iec104");
	struct map_cursor cursor;
	struct map_request taken;

	map_cursor_to_end(reader, &cursor);
	publish(owner, 4, 1);
	prepare(&change);
	publish(owner, 5, 2);
	put_into_force(&change, true);
	publish(owner, 6, 3); /* by the number that it had */
	renew(reader);
	assert_event(reader, &cursor, 0, 1, MAP_GOOD);
	assert_event(reader, &cursor, 1, 2, MAP_GOOD);
	assert_event(reader, &cursor, 8, 0, MAP_INVALID); /* the first line's */
	assert_event(reader, &cursor, 2, 3, MAP_GOOD);
	assert_sample(reader, 1, 2, MAP_GOOD);
	assert_int_not_equal(map_request_post(reader, request(1, MAP_EXECUTE, 1, 7)), 0);
	assert_true(map_request_next(owner, &taken));
	assert_int_equal(taken.point, 5);
	assert_true(map_command_request(owner, &taken));
	map_command_finish(owner, 5, MAP_RESULT_DONE, 0);
	{
		struct map_answer answer;

		assert_true(map_answer_next(reader, &answer));
		assert_int_equal(answer.point, 1);
	}
	map_detach(owner);
	map_detach(reader);
}

/* In another order, and at other places of its section. */
static void test_counters_go_on_by_their_names(void **state)
{
	struct change change = {.stage = *state};
	const uint32_t index = index_of(change.stage, FIRST);
	struct map *owner = start(change.stage, FIRST);
	_Atomic uint32_t *own = map_section(owner, index, 3 * sizeof(*own));
	struct map_counter counter;

	assert_true(map_name_counter(owner, &own[0], "frames"));
	assert_true(map_name_counter(owner, &own[1], "errors"));
	map_count(&own[0], 7);
	map_count(&own[1], 2);
	publish(owner, 0, 10);
	prepare(&change);
	map_detach(owner);
	put_into_force(&change, true);
	owner = attach(change.stage, FIRST);
	own = map_section(owner, index, 3 * sizeof(*own));
	assert_false(map_counter(change.stage->rtud, index, 0, &counter));
	assert_true(map_name_counter(owner, &own[2], "errors"));
	assert_true(map_name_counter(owner, &own[1], "frames"));
	map_count(&own[1], 1);
	assert_true(map_counter(change.stage->rtud, index, 0, &counter));
	assert_string_equal(counter.name, "errors");
	assert_int_equal(counter.value, 2);
	assert_true(map_counter(change.stage->rtud, index, 1, &counter));
	assert_int_equal(counter.value, 8);
	map_detach(owner);
}

static void test_another_generation_begins_as_after_a_crash(void **state)
{
	struct change change = {.stage = *state};
	struct map *owner = start(change.stage, FIRST);

	publish(owner, 0, 10);
	prepare(&change);
	map_detach(owner);
	map_module_starting(change.stage->rtud, index_of(change.stage, FIRST));
	put_into_force(&change, false);
	assert_sample(change.stage->rtud, 5, 10, MAP_INVALID);
	owner = attach(change.stage, FIRST);
	assert_sample(change.stage->rtud, 5, 10, MAP_INVALID);
	publish(owner, 5, 10);
	assert_sample(change.stage->rtud, 5, 10, MAP_GOOD);
	map_detach(owner);
}

/* With so many events in the first line's ring. Returns the cursor of a reader who has read none of them. */
static struct map_cursor resize_ring(struct change *change, int32_t events, uint32_t size)
{
	struct map_module_plan modules[MAP_MODULES_MAX];
	struct map *owner = start(change->stage, FIRST);
	struct map_cursor cursor;
	char error[MAP_ERROR_SIZE];

	map_cursor_to_end(change->stage->rtud, &cursor);
	for (int32_t value = 1; value <= events; value++)
		publish(owner, 0, value);
	plan_change(change);
	memcpy(modules, change->config.modules, sizeof(modules));
	modules[index_of(change->stage, FIRST)].rings.events = size;
	change->config.modules = modules;
	if (map_prepare(change->stage->rtud, &change->config, KEPT_LINES, 0, error) < 0 ||
	    map_attach_again(&change->next, change->stage->rtud, 1, error) < 0)
		fail_msg("%s", error);
	map_detach(owner);
	put_into_force(change, true);
	return cursor;
}

/* Whatever the reader is told is of these events, in order, up to the last one; the rest he has lost. */
static void assert_told(const struct change *change, struct map_cursor *cursor, int32_t events, int32_t told)
{
	struct map *owner = attach(change->stage, FIRST);
	struct map_event event;

	for (int32_t value = events - told + 1; value <= events; value++)
		assert_event(change->stage->rtud, cursor, 5, value, MAP_GOOD);
	assert_int_equal(cursor->lost, events - told);
	while (map_event_next(change->stage->rtud, cursor, &event)) /* the point that is gone */
		assert_int_equal(event.point, 8);
	publish(owner, 5, events + 1);
	assert_event(change->stage->rtud, cursor, 5, events + 1, MAP_GOOD);
	assert_int_equal(cursor->lost, events - told);
	map_detach(owner);
}

static void test_a_ring_that_grows(void **state)
{
	struct change change = {.stage = *state};
	struct map_cursor cursor = resize_ring(&change, 40, 256);

	assert_told(&change, &cursor, 40, 40);
}

/* A ring of 64 keeps 63: who was too late before is told no more and no less for it. */
static void test_a_ring_that_grows_around_what_was_overwritten(void **state)
{
	struct change change = {.stage = *state};
	struct map_cursor cursor = resize_ring(&change, 100, 256);

	assert_told(&change, &cursor, 100, 63);
}

static void test_a_ring_that_shrinks(void **state)
{
	struct change change = {.stage = *state};
	struct map_cursor cursor = resize_ring(&change, 60, 16);

	assert_told(&change, &cursor, 60, 14); /* and the point that is gone */
}

static void test_what_was_prepared_can_be_dropped(void **state)
{
	struct change change = {.stage = *state};
	struct map *owner = start(change.stage, FIRST);

	prepare(&change);
	map_detach(change.next);
	map_abandon(change.stage->rtud);
	publish(owner, 1, 11);
	assert_false(map_is_changed(change.stage->rtud));
	assert_sample(change.stage->rtud, 1, 11, MAP_GOOD);
	map_detach(owner);
}

static void force(const struct change *change, uint32_t point, int32_t value)
{
	const struct map_force force = {
	    .point = point, .value.i = value, .since_ns = map_now_ns(), .until_ns = INT64_MAX};

	assert_true(map_force(change->stage->rtud, &force));
}

static void test_what_is_forced_stays_so(void **state)
{
	struct change change = {.stage = *state};
	struct map *owner = start(change.stage, FIRST), *other = start(change.stage, SECOND);
	struct map_force forces[MAP_FORCES_MAX];
	struct map_sample below;

	publish(owner, 1, 11); /* is gone afterwards */
	publish(owner, 2, 12);
	publish(other, 5, 15);
	force(&change, 1, 71);
	force(&change, 2, 72);
	force(&change, 5, 75);
	map_heartbeat(owner);
	map_heartbeat(other);
	prepare(&change);
	map_detach(owner);
	put_into_force(&change, true);
	owner = attach(change.stage, FIRST);
	map_heartbeat(other);
	assert_sample(change.stage->rtud, 6, 72, MAP_SUBSTITUTED);
	assert_sample(change.stage->rtud, 1, 75, MAP_SUBSTITUTED);
	assert_sample(change.stage->rtud, 8, 11, MAP_INVALID);
	assert_int_equal(map_forces(change.stage->rtud, forces), 2);
	publish(owner, 6, 13);
	assert_true(map_read_below(change.stage->rtud, 6, &below));
	assert_int_equal(below.value.i, 13);
	assert_true(map_unforce(change.stage->rtud, 6));
	assert_true(map_unforce(change.stage->rtud, 1));
	map_heartbeat(owner);
	map_heartbeat(other);
	assert_sample(change.stage->rtud, 6, 13, MAP_GOOD);
	assert_sample(change.stage->rtud, 1, 15, MAP_GOOD);
	map_detach(owner);
	map_detach(other);
}

int main(void)
{
	const struct CMUnitTest tests[] = {
	    TEST(test_what_was_told_and_asked_passes_over),
	    TEST(test_request_means_the_point_that_it_named),
	    TEST(test_who_did_not_change_goes_on_with_what_he_has),
	    TEST(test_counters_go_on_by_their_names),
	    TEST(test_another_generation_begins_as_after_a_crash),
	    TEST(test_what_is_forced_stays_so),
	    TEST(test_a_ring_that_grows),
	    TEST(test_a_ring_that_grows_around_what_was_overwritten),
	    TEST(test_a_ring_that_shrinks),
	    TEST(test_what_was_prepared_can_be_dropped),
	};

	return cmocka_run_group_tests(tests, NULL, NULL);
}
