/* SPDX-License-Identifier: GPL-3.0-or-later */
/* Forced points: what readers see, what lies below, and what is left of it after every death. */
#include "map/test_stage.h"

#define S 1000000000LL

enum { LEVEL = 1, OTHER = 2 };

static void force(struct stage *stage, uint32_t point, int32_t value)
{
	const struct map_force force = {
	    .point = point, .value.i = value, .since_ns = map_now_ns(), .until_ns = map_now_ns() + S};

	assert_true(map_force(stage->rtud, &force));
}

static void publish(struct map *owner, int32_t value, uint8_t quality)
{
	const struct map_update update = scaled(LEVEL, value, quality, map_now_ns());

	map_publish(owner, &update, 1);
}

static void assert_below(const struct map *map, int32_t value, uint8_t quality)
{
	struct map_sample sample;

	assert_true(map_read_below(map, LEVEL, &sample));
	assert_int_equal(sample.value.i, value);
	assert_int_equal(sample.quality, quality);
}

/* The next event, which is one of the level. */
static void assert_event(const struct map *map, struct map_cursor *cursor, int32_t value, uint8_t quality)
{
	struct map_event event;

	assert_true(map_event_next(map, cursor, &event));
	assert_int_equal(event.point, LEVEL);
	assert_int_equal(event.sample.value.i, value);
	assert_int_equal(event.sample.quality, quality);
}

static void assert_no_event(const struct map *map, struct map_cursor *cursor)
{
	struct map_event event;

	assert_false(map_event_next(map, cursor, &event));
}

static void test_readers_see_it_and_the_owner_goes_on_below(void **state)
{
	struct stage *stage = *state;
	struct map *owner = start(stage, FIRST);
	struct map_cursor cursor;

	publish(owner, 5, MAP_GOOD);
	map_cursor_to_end(stage->rtud, &cursor);
	force(stage, LEVEL, 77);
	assert_sample(stage->rtud, LEVEL, 5, MAP_GOOD); /* not before the owner has looked */
	map_heartbeat(owner);
	assert_sample(stage->rtud, LEVEL, 77, MAP_SUBSTITUTED);
	assert_event(stage->rtud, &cursor, 77, MAP_SUBSTITUTED);
	publish(owner, 6, MAP_GOOD);
	publish(owner, 7, MAP_INVALID);
	assert_sample(stage->rtud, LEVEL, 77, MAP_SUBSTITUTED);
	assert_below(stage->rtud, 7, MAP_INVALID);
	assert_no_event(stage->rtud, &cursor);
	publish(owner, 8, MAP_GOOD);
	assert_true(map_unforce(stage->rtud, LEVEL));
	map_heartbeat(owner);
	assert_sample(stage->rtud, LEVEL, 8, MAP_GOOD);
	assert_event(stage->rtud, &cursor, 8, MAP_GOOD);
	assert_false(map_unforce(stage->rtud, LEVEL));
	map_detach(owner);
}

static void test_an_update_that_keeps_the_value_keeps_what_is_below(void **state)
{
	struct stage *stage = *state;
	struct map *owner = start(stage, FIRST);
	struct map_update update = scaled(LEVEL, 0, MAP_NOT_TOPICAL, map_now_ns());

	publish(owner, 5, MAP_GOOD);
	force(stage, LEVEL, 77);
	map_heartbeat(owner);
	update.flags = MAP_UPDATE_KEEPS_VALUE;
	map_publish(owner, &update, 1);
	assert_below(stage->rtud, 5, MAP_NOT_TOPICAL);
	assert_int_equal(map_own_sample(owner, LEVEL).value.i, 5);
	map_detach(owner);
}

static void test_return_information_tells_what_is_shown(void **state)
{
	struct stage *stage = *state;
	struct map *owner = start(stage, FIRST);
	struct map_update update = scaled(LEVEL, 9, MAP_GOOD, map_now_ns());
	struct map_cursor cursor;

	force(stage, LEVEL, 77);
	map_heartbeat(owner);
	map_cursor_to_end(stage->rtud, &cursor);
	update.cause = MAP_RETURN_REMOTE;
	map_publish(owner, &update, 1);
	assert_event(stage->rtud, &cursor, 77, MAP_SUBSTITUTED);
	assert_below(stage->rtud, 9, MAP_GOOD);
	update.cause = MAP_SPONTANEOUS;
	update.event_rule = MAP_EVENT_ALWAYS;
	map_publish(owner, &update, 1);
	assert_no_event(stage->rtud, &cursor);
	map_detach(owner);
}

static void test_it_survives_the_owner(void **state)
{
	struct stage *stage = *state;
	struct map *owner = start(stage, FIRST);

	publish(owner, 5, MAP_GOOD);
	force(stage, LEVEL, 77);
	map_heartbeat(owner);
	map_detach(owner);
	owner = start(stage, FIRST);
	assert_sample(stage->rtud, LEVEL, 77, MAP_SUBSTITUTED);
	assert_below(stage->rtud, 5, MAP_INVALID); /* until this process has read the device */
	map_detach(owner);
}

static void test_what_ends_while_the_owner_is_dead_is_over(void **state)
{
	struct stage *stage = *state;
	struct map *owner;

	stage->points[LEVEL].flags |= MAP_POINT_RETAIN;
	make_again(stage);
	owner = start(stage, FIRST);
	publish(owner, 5, MAP_GOOD);
	force(stage, LEVEL, 77);
	map_heartbeat(owner);
	map_detach(owner);
	assert_true(map_unforce(stage->rtud, LEVEL));
	owner = start(stage, FIRST);
	assert_sample(stage->rtud, LEVEL, 5,
		      MAP_GOOD); /* what was retained is the owner's, not the force's */
	map_detach(owner);
}

/* Whatever the owner has done of it when it is killed, the next one finds what was below. */
static void test_an_owner_killed_anywhere_leaves_no_force(void **state)
{
	struct stage *stage = *state;

	stage->points[LEVEL].flags |= MAP_POINT_RETAIN;
	make_again(stage);
	for (unsigned phase = 0; phase < 3; phase++) {
		struct map *owner = start(stage, FIRST);
		struct cover *cover;

		publish(owner, 5, MAP_GOOD);
		force(stage, LEVEL, 77);
		map_heartbeat(owner);
		assert_true(map_unforce(stage->rtud, LEVEL));
		cover = cover_in(&owner->segments[owner->self], slot_of(owner, LEVEL));
		if (phase >= 1) /* of uncovering: the cover shows what is below */
			cover->shown = map_own_sample(owner, LEVEL);
		if (phase >= 2) /* killed in a publishing, between its two copies */
			latch_flip(latch_of(owner, LEVEL));
		map_detach(owner);
		owner = start(stage, FIRST);
		assert_sample(stage->rtud, LEVEL, 5, MAP_GOOD);
		assert_int_equal(owner->covers, 0);
		map_detach(owner);
	}
}

static void test_another_value_replaces_it(void **state)
{
	struct stage *stage = *state;
	struct map *owner = start(stage, FIRST);
	struct map_force forces[MAP_FORCES_MAX];

	publish(owner, 5, MAP_GOOD);
	force(stage, LEVEL, 77);
	map_heartbeat(owner);
	force(stage, LEVEL, 78);
	force(stage, OTHER, 79);
	map_heartbeat(owner);
	assert_sample(stage->rtud, LEVEL, 78, MAP_SUBSTITUTED);
	assert_sample(stage->rtud, OTHER, 79, MAP_SUBSTITUTED);
	assert_below(stage->rtud, 5, MAP_GOOD);
	assert_int_equal(map_forces(stage->rtud, forces), 2);
	assert_true(forces[0].point == LEVEL && forces[0].value.i == 78);
	map_detach(owner);
}

/* What ends is one point's; another of the same line, and those of the same number on another line, are what they were. */
static void test_it_is_one_points(void **state)
{
	struct stage *stage = *state;
	struct map *owner = start(stage, FIRST), *neighbour = start(stage, SECOND);
	const struct map_update update = scaled(4 + LEVEL, 6, MAP_GOOD, map_now_ns());

	publish(owner, 5, MAP_GOOD);
	map_publish(neighbour, &update, 1);
	force(stage, LEVEL, 77);
	force(stage, OTHER, 79);
	map_heartbeat(owner);
	map_heartbeat(neighbour);
	assert_sample(stage->rtud, 4 + LEVEL, 6, MAP_GOOD);
	assert_true(map_unforce(stage->rtud, LEVEL));
	map_heartbeat(owner);
	assert_sample(stage->rtud, LEVEL, 5, MAP_GOOD);
	assert_sample(stage->rtud, OTHER, 79, MAP_SUBSTITUTED);
	assert_int_equal(owner->covers, 1);
	map_detach(neighbour);
	map_detach(owner);
}

static void test_the_table_is_bounded(void **state)
{
	struct stage *stage = *state;
	struct map_force force = {.until_ns = S};

	for (uint32_t i = 0; i < MAP_FORCES_MAX; i++)
		stage->rtud->directory->forces[0][i] = stage->rtud->directory->forces[1][i] =
		    (struct force_entry){.module = 1, .slot = i, .until_ns = S};
	force.point = LEVEL;
	assert_false(map_force(stage->rtud, &force));
}

static void test_what_could_not_be_told_is_not_forced(void **state)
{
	struct stage *stage = *state;

	assert_null(map_unforceable(&stage->config, LEVEL));
	stage->points[4].flags = MAP_POINT_POSITION;
	assert_non_null(map_unforceable(&stage->config, 4));
	assert_non_null(map_unforceable(&stage->config, 7));
	assert_null(map_unforceable(&stage->config, 3));
	stage->points[LEVEL].type = MAP_COUNTER;
	assert_non_null(map_unforceable(&stage->config, LEVEL));
	stage->points[OTHER].flags |= MAP_POINT_NO_QUALITY;
	assert_non_null(map_unforceable(&stage->config, OTHER));
}

int main(void)
{
	const struct CMUnitTest tests[] = {
	    TEST(test_readers_see_it_and_the_owner_goes_on_below),
	    TEST(test_an_update_that_keeps_the_value_keeps_what_is_below),
	    TEST(test_return_information_tells_what_is_shown),
	    TEST(test_it_survives_the_owner),
	    TEST(test_what_ends_while_the_owner_is_dead_is_over),
	    TEST(test_an_owner_killed_anywhere_leaves_no_force),
	    TEST(test_another_value_replaces_it),
	    TEST(test_it_is_one_points),
	    TEST(test_the_table_is_bounded),
	    TEST(test_what_could_not_be_told_is_not_forced),
	};

	return cmocka_run_group_tests(tests, NULL, NULL);
}
