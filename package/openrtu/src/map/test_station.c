/* SPDX-License-Identifier: GPL-3.0-or-later */
/* Event queues: what a controlled station's process finds of them after its predecessor's end. */
#include "map/test_stage.h"

#include <signal.h>
#include <string.h>
#include <sys/wait.h>
#include <unistd.h>

#include "map/station.h"

#define STATION "rtu-iec104"
#define OWN     (MAP_NAMED_QUEUES_MAX + 1) /* a queue of an address */

static void publish(struct map *owner, int32_t value)
{
	struct map_update update = scaled(0, value, MAP_GOOD, value);

	map_publish(owner, &update, 1);
}

static void test_a_group_begins_with_the_gateway(void **state)
{
	struct stage *stage = *state;
	struct map *owner = start(stage, FIRST), *station;
	struct map_queue_place place;
	struct map_event event;

	publish(owner, 1);
	station = start(stage, STATION);
	map_queue_place(station, 0, &place);
	assert_int_equal(map_events_behind(station, &place.cursor), 1);
	assert_true(map_event_next(station, &place.cursor, &event));
	assert_int_equal(event.sample.value.i, 1);
	map_detach(station);
	map_detach(owner);
}

static void test_a_queue_outlives_its_process(void **state)
{
	struct stage *stage = *state;
	struct map *owner = start(stage, FIRST), *station = start(stage, STATION);
	struct map_queue_place place = {.refresh_modules = 4}, found;
	struct map_queue queue;

	publish(owner, 1);
	map_cursor_to_end(station, &place.cursor);
	map_queue_assign(station, OWN, "2001:db8::1", &place);
	map_queue_use(station, OWN);
	map_queue_use(station, 0);
	map_queue_count_lost(station, OWN, 7);
	for (int32_t value = 2; value < 5; value++)
		publish(owner, value);
	map_queue_set_unacknowledged(station, OWN, 2);
	map_detach(station);

	station = start(stage, STATION);
	map_queue_place(station, OWN, &found);
	assert_memory_equal(&found, &place, sizeof(place));
	map_queue(stage->rtud, OWN, &queue);
	assert_string_equal(queue.name, "2001:db8::1");
	assert_int_equal(queue.limit, 63);
	assert_int_equal(queue.waiting, 3);
	assert_int_equal(queue.unacknowledged, 2);
	assert_int_equal(queue.lost, 7);
	assert_int_equal(queue.used, 1);
	map_queue(stage->rtud, 0, &queue);
	assert_int_equal(queue.used, 2);
	map_queue_free(station, OWN);
	map_queue(stage->rtud, OWN, &queue);
	assert_string_equal(queue.name, "");
	assert_int_equal(queue.used, 0);
	map_detach(station);
	map_detach(owner);
}

/* As a crash of the memory, or another's write, would leave it: nothing is waited for that will never come. */
static void test_a_place_in_the_future_is_the_end(void **state)
{
	struct stage *stage = *state;
	struct map *owner = start(stage, FIRST), *station = start(stage, STATION);
	struct map_queue_place place = {.cursor.lost = 9}, end;
	struct map_event event;

	publish(owner, 1);
	map_cursor_to_end(station, &end.cursor);
	place.cursor.next[owner->self] = end.cursor.next[owner->self] + 5;
	map_queue_move(station, OWN, &place);
	map_queue_place(station, OWN, &place);
	assert_int_equal(place.cursor.next[owner->self], end.cursor.next[owner->self]);
	assert_true(place.refresh_all);
	assert_int_equal(place.cursor.lost, 0);
	assert_false(map_event_next(station, &place.cursor, &event) && event.kind == MAP_EVENT_CHANGE);
	map_detach(station);
	map_detach(owner);
}

static void test_a_forged_name_is_not_shown(void **state)
{
	struct stage *stage = *state;
	struct map *station = start(stage, STATION);
	struct map_queue queue;

	memset(station->segments[station->self].queues[OWN].name, '1', MAP_ADDRESS_SIZE);
	map_queue(stage->rtud, OWN, &queue);
	assert_int_equal(strlen(queue.name), MAP_ADDRESS_SIZE - 1);
	strcpy(station->segments[station->self].queues[OWN].name, "10.0.0.1\x1b[2J");
	map_queue(stage->rtud, OWN, &queue);
	assert_string_equal(queue.name, "");
	map_detach(station);
}

/* All numbers of its places are one, so that a torn place shows. */
__attribute__((noreturn)) static void move_for_ever(struct map *station)
{
	for (uint32_t i = 0;; i++) {
		struct map_queue_place place = {.refresh_all = i};

		for (unsigned module = 0; module < MAP_MODULES_MAX; module++)
			place.cursor.next[module] = i;
		map_queue_move(station, OWN, &place);
	}
}

static void test_a_process_killed_anywhere_leaves_a_whole_place(void **state)
{
	struct stage *stage = *state;
	struct map *station = start(stage, STATION);
	struct queue_cell *cell = &station->segments[station->self].queues[OWN];
	uint32_t reached = 0;

	for (int round = 0; round < 50; round++) {
		pid_t writer = fork();
		const struct map_queue_place *whole;
		uint32_t before = atomic_load(&cell->latch);
		int64_t until;

		if (writer == 0)
			move_for_ever(station);
		while (atomic_load(&cell->latch) == before)
			;
		until = map_now_ns() + (round * 37 % 100) * 10000;
		while (map_now_ns() < until)
			;
		kill(writer, SIGKILL);
		waitpid(writer, NULL, 0);
		whole = &cell->places[latch_whole_copy(&cell->latch)];
		for (unsigned module = 0; module < MAP_MODULES_MAX; module++)
			assert_int_equal(whole->cursor.next[module], whole->refresh_all);
		reached += whole->refresh_all;
	}
	assert_true(reached > 1000);
	map_detach(station);
}

int main(void)
{
	const struct CMUnitTest tests[] = {
	    TEST(test_a_group_begins_with_the_gateway),
	    TEST(test_a_queue_outlives_its_process),
	    TEST(test_a_place_in_the_future_is_the_end),
	    TEST(test_a_forged_name_is_not_shown),
	    TEST(test_a_process_killed_anywhere_leaves_a_whole_place),
	};

	return cmocka_run_group_tests(tests, NULL, NULL);
}
