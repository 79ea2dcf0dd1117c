/* SPDX-License-Identifier: GPL-3.0-or-later */
#include <setjmp.h>
#include <stdarg.h>
#include <stddef.h>
#include <stdint.h>
#include <string.h>

#include <cmocka.h>

#include "centre/batches.h"

#define SLOTS     4
#define RECORDS   3
#define IN_FLIGHT 2

static struct centre_batches batches;
static uint32_t released[64];
static unsigned released_count;

static void on_released(void *context, const struct centre_record *record)
{
	(void)context;
	released[released_count++] = record->ioa;
}

static int set_up(void **state)
{
	(void)state;
	released_count = 0;
	return centre_batches_init(&batches, SLOTS, RECORDS, IN_FLIGHT) ? 0 : -1;
}

static int tear_down(void **state)
{
	(void)state;
	centre_batches_free(&batches);
	return 0;
}

static void add(uint32_t ioa)
{
	struct centre_record *record = centre_batches_add(&batches);

	assert_int_equal(record->flags, 0);
	record->ioa = ioa;
	record->flags = CENTRE_LAST;
}

/* The next batch's sequence and how many records it has, 0: there is none. */
static unsigned send_next(uint64_t sequence)
{
	size_t size;
	const struct centre_batch *batch = centre_batches_next(&batches, &size);

	if (batch == NULL)
		return 0;
	assert_int_equal(batch->magic, CENTRE_MAGIC);
	assert_int_equal(batch->record_size, 48);
	assert_int_equal(batch->sequence, sequence);
	assert_int_equal(size, 16 + batch->count * 48u);
	centre_batches_sent(&batches);
	return batch->count;
}

static bool acknowledge(uint64_t sequence)
{
	return centre_batches_acknowledge(&batches, sequence, on_released, NULL);
}

static void test_what_is_there_is_sent_at_once(void **state)
{
	(void)state;
	assert_int_equal(send_next(1), 0);
	add(7);
	assert_int_equal(send_next(1), 1);
	assert_int_equal(send_next(2), 0);
	add(8);
	assert_int_equal(send_next(2), 1);
}

static void test_in_flight_is_bounded_and_batches_fill_meanwhile(void **state)
{
	(void)state;
	for (uint32_t i = 0; i < IN_FLIGHT; i++) {
		add(i);
		assert_int_equal(send_next(i + 1), 1);
	}
	for (uint32_t i = 0; i < RECORDS; i++)
		add(10 + i);
	assert_int_equal(send_next(3), 0);
	assert_true(acknowledge(1));
	assert_int_equal(send_next(3), RECORDS);
}

static void test_room_is_what_can_be_added(void **state)
{
	size_t room = centre_batches_room(&batches);

	(void)state;
	assert_int_equal(room, SLOTS * RECORDS);
	for (uint32_t i = 0; i < SLOTS * RECORDS; i++) {
		assert_int_equal(centre_batches_room(&batches), room - i);
		add(i);
	}
	assert_int_equal(centre_batches_room(&batches), 0);
	assert_int_equal(centre_batches_open(&batches), SLOTS * RECORDS);
	assert_int_equal(send_next(1), RECORDS);
	assert_int_equal(centre_batches_room(&batches), 0);
	assert_true(acknowledge(1));
	assert_int_equal(centre_batches_room(&batches), RECORDS);
}

/* Any order of adding, sending and acknowledging: all records come once, in order. */
static void test_many_turns(void **state)
{
	uint32_t added = 0, seed = 104;

	(void)state;
	for (unsigned i = 0; i < 10000; i++) {
		seed = seed * 1664525u + 1013904223u;
		if (seed >> 30 == 0 && batches.sent > batches.acknowledged) {
			released_count = 0;
			assert_true(acknowledge(batches.acknowledged + 1));
			for (unsigned j = 1; j < released_count; j++)
				assert_int_equal(released[j], released[j - 1] + 1);
		} else if (seed >> 30 == 1) {
			send_next(batches.sent + 1);
		} else if (centre_batches_room(&batches) > 0) {
			add(added++);
		}
	}
	assert_true(added > 1000);
}

static void test_what_is_not_open_cannot_be_acknowledged(void **state)
{
	(void)state;
	assert_false(acknowledge(1));
	add(1);
	assert_false(acknowledge(1)); /* it was not sent */
	send_next(1);
	assert_false(acknowledge(2));
	assert_false(acknowledge(0));
	assert_true(acknowledge(1));
	assert_false(acknowledge(1));
	assert_int_equal(released_count, 1);
}

static void test_only_last_records_are_released(void **state)
{
	(void)state;
	centre_batches_add(&batches)->ioa = 1;
	add(2);
	send_next(1);
	assert_true(acknowledge(1));
	assert_int_equal(released_count, 1);
	assert_int_equal(released[0], 2);
}

static void test_reset(void **state)
{
	(void)state;
	add(1);
	send_next(1);
	add(2);
	centre_batches_reset(&batches);
	assert_int_equal(centre_batches_room(&batches), SLOTS * RECORDS);
	assert_int_equal(send_next(1), 0);
	add(3);
	assert_int_equal(send_next(1), 1);
}

int main(void)
{
	const struct CMUnitTest tests[] = {
	    cmocka_unit_test_setup_teardown(test_what_is_there_is_sent_at_once, set_up, tear_down),
	    cmocka_unit_test_setup_teardown(test_in_flight_is_bounded_and_batches_fill_meanwhile, set_up,
					    tear_down),
	    cmocka_unit_test_setup_teardown(test_room_is_what_can_be_added, set_up, tear_down),
	    cmocka_unit_test_setup_teardown(test_many_turns, set_up, tear_down),
	    cmocka_unit_test_setup_teardown(test_what_is_not_open_cannot_be_acknowledged, set_up, tear_down),
	    cmocka_unit_test_setup_teardown(test_only_last_records_are_released, set_up, tear_down),
	    cmocka_unit_test_setup_teardown(test_reset, set_up, tear_down),
	};

	return cmocka_run_group_tests(tests, NULL, NULL);
}
