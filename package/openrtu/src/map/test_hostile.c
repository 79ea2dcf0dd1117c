/* SPDX-License-Identifier: GPL-3.0-or-later */
/* A module gone wild: what it forges, floods and overwrites harms nobody else. */
#include "map/test_stage.h"

#include <poll.h>
#include <stdlib.h>
#include <string.h>

static void test_a_forged_event_is_not_believed(void **state)
{
	struct stage *stage = *state;
	struct map *owner = start(stage, FIRST);
	struct map_cursor cursor = {0};
	struct map_event event;
	const struct map_event forged[] = {
	    {.point = 4, .kind = MAP_EVENT_CHANGE}, /* another module's point */
	    {.point = 4000000, .kind = MAP_EVENT_CHANGE},
	    {.point = 0, .kind = MAP_EVENT_MODULE_DOWN}, /* rtud's to say */
	    {.point = 0, .kind = 99},
	    {.point = 0, .kind = MAP_EVENT_CHANGE, .cause = MAP_RETURN_LOCAL + 1},
	    /* after its writer's end, and good */
	    {.point = 0, .kind = MAP_EVENT_CHANGE, .sample.time_ns = map_now_ns() + 1000000000},
	    {.point = 0, .kind = MAP_EVENT_CHANGE, .sample.time_ns = INT64_MIN},
	};

	for (size_t i = 0; i < sizeof(forged) / sizeof(forged[0]); i++)
		ring_put(&owner->segments[owner->self].events, &forged[i]);
	assert_false(map_event_next(stage->rtud, &cursor, &event));
	map_detach(owner);
}

static bool bell_is_ringing(const struct map *map)
{
	struct pollfd bell = {.fd = map_bell_fd(map), .events = POLLIN};

	return poll(&bell, 1, 0) == 1;
}

static void test_a_flood_of_requests_holds_nobody_up(void **state)
{
	struct stage *stage = *state;
	struct command_stage commands = start_commands(stage);
	struct map_request taken;
	unsigned count = 0;

	for (int turn = 1; turn <= 3; turn++) {
		map_bell_clear(commands.owner);
		do
			map_request_post(commands.requester, request(1, MAP_SELECT, 1, 1));
		while (map_request_next(commands.owner, &taken) && ++count < 10000);
		assert_int_equal(count, turn * 256);
		assert_true(bell_is_ringing(commands.owner)); /* the rest is not forgotten */
	}
	end_commands(&commands);
}

static void test_a_flooded_bell_is_cleared_in_one_go(void **state)
{
	struct stage *stage = *state;
	struct map *map = start(stage, FIRST);

	for (int i = 0; i < 100000; i++)
		bell_ring(stage->rtud, map->self);
	map_bell_clear(map);
	assert_true(bell_is_ringing(map)); /* it did not stay to empty the pipe */
	for (int i = 0; i < 100; i++)
		map_bell_clear(map);
	assert_false(bell_is_ringing(map));
	map_detach(map);
}

/* One turn of a loop at a line's priority, if the bell calls it. True: it did, and there was a request. */
static bool turn(struct map *map, unsigned *wake_ups)
{
	struct map_request taken;
	bool any = false;

	if (map_bell_is_wild(map) || !bell_is_ringing(map))
		return false;
	(*wake_ups)++;
	map_bell_clear(map);
	while (map_request_next(map, &taken))
		any = true;
	return any;
}

static void test_a_flooded_bell_wakes_a_few_times_a_period(void **state)
{
	struct stage *stage = *state;
	struct map *map = start(stage, FIRST);

	for (int period = 0; period < 3; period++) {
		unsigned wake_ups = 0;

		for (int i = 0; i < 10000; i++) {
			bell_ring(stage->rtud, map->self);
			turn(map, &wake_ups);
		}
		assert_int_equal(wake_ups, 16);
		map_bell_new_period(map);
	}
	map_detach(map);
}

static void test_commands_are_seen_at_once(void **state)
{
	struct command_stage commands = start_commands(*state);
	unsigned wake_ups = 0;

	for (int i = 1; i <= 15; i++) {
		map_heartbeat(commands.owner);
		map_request_post(commands.requester, request(1, MAP_SELECT, 1, 1));
		assert_true(turn(commands.owner, &wake_ups));
	}
	end_commands(&commands);
}

static void test_a_command_in_a_flood_waits_for_the_next_period(void **state)
{
	struct stage *stage = *state;
	struct command_stage commands = start_commands(stage);
	unsigned wake_ups = 0;

	for (int i = 0; i < 10000; i++) {
		bell_ring(stage->rtud, commands.owner->self);
		turn(commands.owner, &wake_ups);
	}
	map_heartbeat(commands.owner);
	map_request_post(commands.requester, request(1, MAP_SELECT, 1, 1));
	assert_false(turn(commands.owner, &wake_ups));
	map_bell_new_period(commands.owner);
	assert_true(turn(commands.owner, &wake_ups));
	end_commands(&commands);
}

/* Each of them wakes the owner: twice as much as it takes in one turn is the most of a period. */
static void test_a_flood_of_requests_is_bounded_by_the_period(void **state)
{
	struct command_stage commands = start_commands(*state);

	for (int period = 0; period < 3; period++) {
		struct map_request taken;
		unsigned count = 0;

		for (int i = 0; i < 10000; i++) {
			map_heartbeat(commands.owner);
			map_request_post(commands.requester, request(1, MAP_SELECT, 1, 1));
			if (map_bell_is_wild(commands.owner))
				continue;
			map_bell_clear(commands.owner);
			while (map_request_next(commands.owner, &taken))
				count++;
		}
		assert_in_range(count, 15, 512);
		map_bell_new_period(commands.owner);
	}
	end_commands(&commands);
}

static void test_a_line_process_commands_nobody(void **state)
{
	struct stage *stage = *state;
	struct map *wild = start(stage, FIRST), *owner = start(stage, SECOND);
	struct map_request taken, clock = {.action = MAP_SET_CLOCK};

	map_heartbeat(stage->rtud);
	assert_int_not_equal(map_request_post(wild, request(5, MAP_EXECUTE, 1, 1)), 0);
	assert_int_not_equal(map_request_post(wild, clock), 0);
	assert_false(map_request_next(owner, &taken));
	assert_false(map_request_next(stage->rtud, &taken));
	map_detach(wild);
	map_detach(owner);
}

static struct map *start_listed(struct stage *stage, const char *name)
{
	stage->with_listed = true;
	make_again(stage);
	return start(stage, name);
}

enum taker { BY_NOBODY, BY_FIRST, BY_RTUD };

/* Each action at each point, known or not. */
static void assert_all_that_is_taken(struct stage *stage, struct map *wild,
				     enum taker (*expected)(uint32_t point, unsigned action))
{
	struct map *first = start(stage, FIRST), *second = start(stage, SECOND);
	struct map_request taken;

	map_heartbeat(stage->rtud);
	for (uint32_t point = 0; point < POINTS; point++)
		for (unsigned action = 0; action < 256; action++) {
			struct map_request wish = request(point, (enum map_action)action, 1, 1);
			const enum taker taker = expected(point, action);

			wish.value.u = MAP_FREEZE_ALL_DEVICES;
			map_bell_clear(first);
			map_bell_clear(second);
			map_bell_clear(stage->rtud);
			map_request_post(wild, wish);
			assert_int_equal(map_request_next(first, &taken), taker == BY_FIRST);
			assert_false(map_request_next(second, &taken));
			assert_int_equal(map_request_next(stage->rtud, &taken), taker == BY_RTUD);
		}
	map_detach(first);
	map_detach(second);
}

static enum taker points_1_and_3(uint32_t point, unsigned action)
{
	return (point == 1 || point == 3) && action <= MAP_RELEASE ? BY_FIRST : BY_NOBODY;
}

static void test_a_listed_module_commands_its_list_alone(void **state)
{
	struct stage *stage = *state;
	struct map *wild = start_listed(stage, "others");

	assert_all_that_is_taken(stage, wild, points_1_and_3);
	map_detach(wild);
}

static enum taker of_rtud(uint32_t point, unsigned action)
{
	(void)point;
	return action == MAP_SETUP ? BY_RTUD : BY_NOBODY;
}

/* The gateway's page with set-up and without commands, when somebody has taken it over. */
static void test_a_page_without_commands_asks_rtud_alone(void **state)
{
	struct stage *stage = *state;
	struct map *wild = start_listed(stage, "page");

	assert_all_that_is_taken(stage, wild, of_rtud);
	map_detach(wild);
}

/* Its answers would overwrite those to the control centre. */
static void test_a_listed_module_floods_its_share_alone(void **state)
{
	struct stage *stage = *state;
	struct map *wild = start_listed(stage, "others");
	struct command_stage commands = start_commands(stage);

	for (int turn = 0; turn < 20; turn++) {
		struct map_request taken;
		unsigned count = 0;

		for (int i = 0; i < 64; i++)
			map_request_post(wild, request(3, MAP_SELECT, 1, 1));
		map_bell_clear(commands.owner);
		while (map_request_next(commands.owner, &taken)) {
			map_command_request(commands.owner, &taken);
			count++;
		}
		assert_int_equal(count, 16);
		assert_true(bell_is_ringing(commands.owner)); /* the rest is not forgotten */
		map_bell_clear(commands.owner);
		map_bell_clear(commands.requester);
		map_heartbeat(commands.owner);
		assert_false(post(&commands, request(1, MAP_SELECT, 1, 1)));
		assert_answer(&commands, MAP_ACCEPTED_SELECTION, MAP_RESULT_NONE);
		assert_false(post(&commands, request(1, MAP_CANCEL, 1, 1)));
		assert_answer(&commands, MAP_INTERRUPTED_SELECTION, MAP_RESULT_DONE);
	}
	end_commands(&commands);
	map_detach(wild);
}

/* Everything that others read of a module. Each loop ends, and nothing is read beyond the segment. */
static void read_all(struct map *map)
{
	struct map_cursor cursor = {0};
	struct map_event event;
	struct map_answer answer;
	struct map_request taken;
	struct map_sample sample;
	struct map_command command;

	map_bell_clear(map);
	while (map_event_next(map, &cursor, &event))
		assert_true(is_past(map, event.sample.time_ns));
	while (map_request_next(map, &taken))
		map_command_request(map, &taken);
	while (map_answer_next(map, &answer))
		;
	for (uint32_t i = 0; i < POINTS; i++) {
		assert_true(map_read(map, i, &sample) && is_past(map, sample.time_ns));
		assert_true(map_command_read(map, i, &command) && is_past(map, command.time_ns));
	}
	for (uint32_t i = 0; i < map_module_count(map); i++) {
		struct map_module module;
		struct map_log_line line;
		uint32_t position = 0, lost = 0;

		map_module(map, i, &module);
		while (map_log_next(map, i, &position, &line, &lost))
			assert_true(memchr(line.text, 0, sizeof(line.text)) && is_past(map, line.time_ns));
	}
}

static void fill_with_noise(struct map *map, unsigned seed)
{
	struct segment *own = &map->segments[map->self];
	uint8_t *bytes = (uint8_t *)own->header;

	srandom(seed);
	for (size_t i = 0; i < own->size; i++)
		bytes[i] = (uint8_t)random();
}

static void test_noise_in_a_segment_harms_nobody_else(void **state)
{
	struct stage *stage = *state;
	const char *const wild[] = {FIRST, "rtu-iec104"};

	for (unsigned seed = 0; seed < 20; seed++) {
		struct map *noisy = start(stage, wild[seed % 2]), *other = start(stage, SECOND), *observer;
		struct map_update update = scaled(4, (int32_t)seed, MAP_GOOD, 1);
		struct map_sample sample;
		char error[MAP_ERROR_SIZE];

		fill_with_noise(noisy, seed);
		map_publish(other, &update, 1);
		read_all(other);
		map_heartbeat(other); /* the noise took its time */
		assert_sample(stage->rtud, 4, (int32_t)seed, MAP_GOOD);
		assert_int_equal(map_attach(&observer, stage->dir, NULL, error), 0);
		map_detach(observer);
		map_module_ended(stage->rtud, noisy->self, true);
		map_detach(noisy);

		noisy = start(stage, wild[seed % 2]); /* and its next generation is well */
		read_all(noisy);
		if (seed % 2 == 0) {
			update = scaled(0, 9, MAP_GOOD, 1);
			map_publish(noisy, &update, 1);
			assert_sample(stage->rtud, 0, 9, MAP_GOOD);
			assert_true(map_read(stage->rtud, 1, &sample));
			assert_true(sample.quality & MAP_INVALID);
		}
		map_detach(noisy);
		map_detach(other);
	}
}

static void test_a_counter_beyond_the_section_is_none(void **state)
{
	struct stage *stage = *state;
	struct map *wild = start(stage, FIRST);
	uint32_t index = index_of(stage, FIRST);
	struct counter_entry *entry = wild->segments[wild->self].counters;
	static const uint32_t places[] = {4, 5, 0x40000000, UINT32_MAX};
	struct map_counter counter;

	memset(entry->name, 0x1b, sizeof(entry->name)); /* speaks to a terminal, and has no end */
	for (size_t i = 0; i < sizeof(places) / sizeof(places[0]); i++) {
		atomic_store(&entry->place, places[i]);
		assert_false(map_counter(stage->rtud, index, 0, &counter));
	}
	atomic_store(&entry->place, 3);
	assert_true(map_counter(stage->rtud, index, 0, &counter));
	assert_int_equal(strspn(counter.name, "?"), MAP_COUNTER_SIZE - 1);
	map_detach(wild);
}

int main(void)
{
	const struct CMUnitTest tests[] = {
	    TEST(test_a_forged_event_is_not_believed),
	    TEST(test_a_flood_of_requests_holds_nobody_up),
	    TEST(test_a_flooded_bell_is_cleared_in_one_go),
	    TEST(test_a_flooded_bell_wakes_a_few_times_a_period),
	    TEST(test_commands_are_seen_at_once),
	    TEST(test_a_command_in_a_flood_waits_for_the_next_period),
	    TEST(test_a_flood_of_requests_is_bounded_by_the_period),
	    TEST(test_a_line_process_commands_nobody),
	    TEST(test_a_listed_module_commands_its_list_alone),
	    TEST(test_a_page_without_commands_asks_rtud_alone),
	    TEST(test_a_listed_module_floods_its_share_alone),
	    TEST(test_noise_in_a_segment_harms_nobody_else),
	    TEST(test_a_counter_beyond_the_section_is_none),
	};

	return cmocka_run_group_tests(tests, NULL, NULL);
}
