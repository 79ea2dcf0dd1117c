/* SPDX-License-Identifier: GPL-3.0-or-later */
/* The counters of latches and rings, which wrap after months. */
#include "map/test_stage.h"

static void test_a_latch_wraps(void **state)
{
	struct stage *stage = *state;
	struct map *owner = start(stage, FIRST);

	atomic_store(&owner->segments[owner->self].latches[0], UINT32_MAX - 3);
	owner = (map_detach(owner), start(stage, FIRST)); /* both copies are whole again */
	for (int32_t i = 1; i <= 6; i++) {
		struct map_update update = scaled(0, i, MAP_GOOD, i);

		map_publish(owner, &update, 1);
		assert_sample(stage->rtud, 0, i, MAP_GOOD);
	}
	map_detach(owner);
}

static void test_an_event_ring_wraps(void **state)
{
	struct stage *stage = *state;
	struct map *owner = start(stage, FIRST);
	struct map_cursor cursor;
	struct map_event event;

	atomic_store(owner->segments[owner->self].events.head, UINT32_MAX - 1);
	map_cursor_to_end(stage->rtud, &cursor);
	for (int32_t i = 1; i <= 100; i++) {
		struct map_update update = scaled(0, i, MAP_GOOD, i);

		map_publish(owner, &update, 1);
		if (i > 4) /* the others stay until they are overwritten */
			continue;
		assert_true(map_event_next(stage->rtud, &cursor, &event));
		assert_int_equal(event.sample.value.i, i);
	}
	for (int32_t i = 100 - 62; i <= 100; i++) {
		assert_true(map_event_next(stage->rtud, &cursor, &event));
		assert_int_equal(event.sample.value.i, i);
	}
	assert_int_equal(cursor.lost, 100 - 4 - 63);
	assert_false(map_event_next(stage->rtud, &cursor, &event));
	map_detach(owner);
}

static void test_requests_and_answers_wrap(void **state)
{
	struct stage *stage = *state;
	struct command_stage commands = start_commands(stage);
	struct map *owner = commands.owner, *requester = commands.requester;
	struct map_request taken;
	const uint32_t ids[] = {UINT32_MAX, 1, 2}; /* 0 is no id */

	requester->segments[requester->self].header->next_request = UINT32_MAX;
	atomic_store(requester->segments[requester->self].requests.head, UINT32_MAX);
	atomic_store(owner->segments[owner->self].answers.head, UINT32_MAX);
	owner->segments[owner->self].header->request_next[requester->self] = UINT32_MAX;
	requester->segments[requester->self].header->answer_next[owner->self] = UINT32_MAX;
	for (int i = 0; i < 3; i++) {
		assert_int_equal(map_request_post(requester, request(1, MAP_SELECT, 1, 5)), ids[i]);
		assert_true(map_request_next(owner, &taken));
		assert_int_equal(taken.id, ids[i]);
		assert_false(map_command_request(owner, &taken));
		assert_answer(&commands, MAP_ACCEPTED_SELECTION, MAP_RESULT_NONE);
	}
	end_commands(&commands);
}

int main(void)
{
	const struct CMUnitTest tests[] = {
	    TEST(test_a_latch_wraps),
	    TEST(test_an_event_ring_wraps),
	    TEST(test_requests_and_answers_wrap),
	};

	return cmocka_run_group_tests(tests, NULL, NULL);
}
