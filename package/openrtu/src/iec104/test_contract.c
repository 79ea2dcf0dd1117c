/* SPDX-License-Identifier: GPL-3.0-or-later */
/*
 * What the controlled station relies on of a map. It is built twice, with the map that tests hold in their hand (fake_map.c) and
 * with the real one (test_contract_map.c): what holds of one and not of the other is a mistake of the first.
 */
#include "iec104/test_contract.h"

#include <string.h>

static struct map *map; /* as the station has it */

static int begin(void **state)
{
	(void)state;
	map = contract_begin();
	return 0;
}

static int end(void **state)
{
	(void)state;
	contract_end();
	return 0;
}

#define CONTRACT(name) cmocka_unit_test_setup_teardown(name, begin, end)

static struct map_sample read_sample(uint32_t point)
{
	struct map_sample sample = {0};

	assert_true(map_read(map, point, &sample));
	return sample;
}

static void test_points_are_found_by_address(void **state)
{
	const struct map_config *config = map_config(map);

	(void)state;
	for (uint32_t i = 0; i < config->point_count; i++)
		assert_int_equal(map_find(map, config->sets[config->points[i].set].ca, config->points[i].ioa),
				 i);
	assert_int_equal(map_find(map, 3067, 777), MAP_NONE);
	assert_int_equal(map_find(map, 1, 1), MAP_NONE);
}

static void test_a_value_is_invalid_while_its_owner_is_down(void **state)
{
	(void)state;
	contract_publish(CONTRACT_POINT, 7, MAP_OVERFLOW);
	assert_int_equal(read_sample(CONTRACT_POINT).value.i, 7);
	assert_int_equal(read_sample(CONTRACT_POINT).quality, MAP_OVERFLOW);
	assert_true(map_alive(map, map_owner(map, CONTRACT_POINT)));
	contract_end_owner();
	assert_int_equal(read_sample(CONTRACT_POINT).value.i, 7);
	assert_int_equal(read_sample(CONTRACT_POINT).quality, MAP_OVERFLOW | MAP_INVALID);
	assert_false(map_alive(map, map_owner(map, CONTRACT_POINT)));
}

static void test_events_come_in_order_to_each_cursor(void **state)
{
	struct map_cursor cursor, ahead;
	struct map_event event;

	(void)state;
	contract_publish(CONTRACT_POINT, 1, MAP_GOOD);
	map_cursor_to_end(map, &cursor);
	assert_int_equal(map_events_behind(map, &cursor), 0);
	assert_false(map_event_next(map, &cursor, &event));
	contract_publish(CONTRACT_POINT, 2, MAP_GOOD);
	contract_publish(CONTRACT_POINT, 3, MAP_INVALID);
	assert_int_equal(map_events_behind(map, &cursor), 2);
	ahead = cursor; /* a copy looks ahead */
	for (int32_t value = 2; value <= 3; value++) {
		assert_true(map_event_next(map, &ahead, &event));
		assert_int_equal(event.kind, MAP_EVENT_CHANGE);
		assert_int_equal(event.cause, MAP_SPONTANEOUS);
		assert_int_equal(event.time, MAP_TIME_MONOTONIC);
		assert_int_equal(event.point, CONTRACT_POINT);
		assert_int_equal(event.sample.value.i, value);
		assert_int_equal(event.sample.quality, value == 3 ? MAP_INVALID : MAP_GOOD);
	}
	assert_false(map_event_next(map, &ahead, &event));
	assert_int_equal(map_events_behind(map, &cursor), 2);
	assert_int_equal(ahead.lost, 0);
}

static void test_the_same_again_is_no_event(void **state)
{
	struct map_cursor cursor;

	(void)state;
	contract_publish(CONTRACT_POINT, 7, MAP_INVALID);
	map_cursor_to_end(map, &cursor);
	contract_publish(CONTRACT_POINT, 7, MAP_INVALID);
	assert_int_equal(map_events_behind(map, &cursor), 0);
	contract_publish(CONTRACT_POINT, 7, MAP_GOOD);
	contract_publish(CONTRACT_POINT, 7, MAP_GOOD);
	assert_int_equal(map_events_behind(map, &cursor), 1);
}

static void test_what_is_overwritten_is_counted(void **state)
{
	const uint32_t made = map_config(map)->settings.event_ring * 2;
	struct map_cursor cursor;
	struct map_event event;
	uint32_t taken = 0;

	(void)state;
	map_cursor_to_end(map, &cursor);
	for (uint32_t i = 0; i < made; i++)
		contract_publish(CONTRACT_POINT, (int32_t)(i % 30000) + 1, MAP_GOOD);
	while (map_event_next(map, &cursor, &event))
		taken++;
	assert_int_equal(taken + cursor.lost, made);
	assert_true(cursor.lost > 0 && taken > 0);
	assert_int_equal(event.sample.value.i, (int32_t)((made - 1) % 30000) + 1); /* the newest is there */
}

static struct map_request wish(void)
{
	return (struct map_request){.point = CONTRACT_POINT,
				    .action = MAP_EXECUTE,
				    .value.i = 5,
				    .time_ns = contract_now(),
				    .deadline_ns = contract_now() + 1000000000};
}

static void test_a_request_has_a_number_and_its_answer_too(void **state)
{
	struct map_answer answer;
	uint32_t first, second;

	(void)state;
	assert_false(map_answer_next(map, &answer));
	first = map_request_post(map, wish());
	second = map_request_post(map, wish());
	assert_true(first != 0 && second != 0 && first != second);
	contract_answer(first);
	assert_true(map_answer_next(map, &answer));
	assert_int_equal(answer.id, first);
	assert_int_equal(answer.point, CONTRACT_POINT);
	assert_int_equal(answer.action, MAP_EXECUTE);
	assert_int_equal(answer.state, MAP_EXECUTING);
	assert_false(map_answer_next(map, &answer));
	contract_end_owner();
	assert_int_equal(map_request_post(map, wish()), 0);
}

static void test_what_was_never_frozen_is_as_it_is(void **state)
{
	struct map_sample total;

	(void)state;
	contract_publish(CONTRACT_COUNTER, 77, MAP_GOOD);
	assert_true(map_total_read(map, CONTRACT_COUNTER, &total));
	assert_int_equal(total.value.i, 77);
	assert_int_equal(total.detail, 0);
}

static void test_nothing_is_loaded_at_first(void **state)
{
	const struct map_config *config = map_config(map);
	struct map_parameters parameters;
	struct map_command command;

	(void)state;
	for (uint32_t i = 0; i < config->point_count; i++) {
		map_parameters_read(map, i, &parameters);
		assert_int_equal(parameters.loaded, 0);
		assert_true(parameters.cyclic == (config->points[i].send_period_ms != 0));
	}
	assert_true(map_command_read(map, CONTRACT_POINT, &command));
	assert_int_equal(command.state, MAP_INACTIVE);
}

static void test_a_queue_is_a_place_with_a_name_and_counts(void **state)
{
	struct map_queue_place place = {.refresh_all = true}, read;
	const unsigned slot = MAP_NAMED_QUEUES_MAX, other = slot + 1;
	struct map_queue queue;

	(void)state;
	map_cursor_to_end(map, &place.cursor);
	map_queue(map, slot, &queue);
	assert_string_equal(queue.name, "");
	map_queue_assign(map, slot, "192.0.2.1", &place);
	contract_publish(CONTRACT_POINT, 2, MAP_GOOD);
	contract_publish(CONTRACT_POINT, 3, MAP_GOOD);
	map_queue_count_lost(map, slot, 4);
	map_queue_set_unacknowledged(map, slot, 1);
	map_queue_use(map, slot);
	map_queue(map, slot, &queue);
	assert_string_equal(queue.name, "192.0.2.1");
	assert_int_equal(queue.waiting, 2);
	assert_int_equal(queue.lost, 4);
	assert_int_equal(queue.unacknowledged, 1);
	assert_int_equal(queue.limit, map_config(map)->settings.event_ring - 1);
	map_queue_place(map, slot, &read);
	assert_memory_equal(&read, &place, sizeof(place));

	map_queue_use(map, other);
	map_queue(map, other, &queue);
	assert_true(queue.used > 1);
	map_cursor_to_end(map, &place.cursor);
	place.refresh_all = false;
	map_queue_move(map, slot, &place);
	map_queue(map, slot, &queue);
	assert_int_equal(queue.waiting, 0);
	map_queue_free(map, slot);
	map_queue(map, slot, &queue);
	assert_string_equal(queue.name, "");
	assert_int_equal(queue.used, 0);
}

static void test_a_number_is_kept(void **state)
{
	(void)state;
	assert_int_equal(*map_kept_number(map), 0);
	*map_kept_number(map) = 9;
	assert_int_equal(*map_kept_number(map), 9);
}

int main(void)
{
	const struct CMUnitTest tests[] = {
	    CONTRACT(test_points_are_found_by_address),
	    CONTRACT(test_a_value_is_invalid_while_its_owner_is_down),
	    CONTRACT(test_events_come_in_order_to_each_cursor),
	    CONTRACT(test_the_same_again_is_no_event),
	    CONTRACT(test_what_is_overwritten_is_counted),
	    CONTRACT(test_a_request_has_a_number_and_its_answer_too),
	    CONTRACT(test_what_was_never_frozen_is_as_it_is),
	    CONTRACT(test_nothing_is_loaded_at_first),
	    CONTRACT(test_a_queue_is_a_place_with_a_name_and_counts),
	    CONTRACT(test_a_number_is_kept),
	};

	return cmocka_run_group_tests(tests, NULL, NULL);
}
