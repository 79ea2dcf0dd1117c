/* SPDX-License-Identifier: GPL-3.0-or-later */
#include <setjmp.h>
#include <stdarg.h>
#include <stddef.h>
#include <stdint.h>
#include <string.h>

#include <cmocka.h>

#include "goose/message.h"

#define TEXT(text)                                                                                           \
	{                                                                                                    \
		text, sizeof(text) - 1                                                                       \
	}

static const struct goose_item items[] = {
    {.kind = GOOSE_BOOLEAN, .bits = 1},
    {.kind = GOOSE_BITS, .size = 13, .bits = 0x0800},
    {.kind = GOOSE_BITS, .size = 2, .bits = 2},
    {.kind = GOOSE_INTEGER, .integer = -129},
    {.kind = GOOSE_UNSIGNED, .bits = 0xffffffff},
    {.kind = GOOSE_FLOAT, .real = 1.5f},
    {.kind = GOOSE_TIME, .time = {1764000000500000000, GOOSE_TIME_UNSET}},
    {.kind = GOOSE_INTEGER, .integer = INT32_MIN},
};
#define COUNT (sizeof(items) / sizeof(items[0]))

static const struct goose_message sent = {
    .address = {.destination = {1, 0x0c, 0xcd, 1, 0, 5},
		.source = {2, 0, 0, 0, 0, 1},
		.app_id = 0x1005,
		.tagged = true,
		.vlan = 100,
		.vlan_priority = 4},
    .control = TEXT("GW1LD0/LLN0$GO$bay1"),
    .data_set = TEXT("GW1LD0/LLN0$bay1"),
    .id = TEXT("bay1"),
    .alive_ms = 2000,
    .time = {1764000000250000000, 0},
    .state = 7,
    .sequence = 0x80000000,
    .conf_rev = 3,
    .entries = COUNT,
    .item_count = COUNT,
    .items = items,
};

static uint8_t frame[GOOSE_FRAME_MAX];
static struct goose_item read_items[GOOSE_ITEMS_MAX];
static struct goose_message read;

static void assert_text(struct goose_text text, const char *wanted)
{
	assert_int_equal(text.size, strlen(wanted));
	assert_memory_equal(text.at, wanted, text.size);
}

static void test_a_message_there_and_back(void **state)
{
	const size_t size = goose_encode(&sent, frame);

	(void)state;
	assert_true(goose_decode(frame, size, &read, read_items));
	assert_memory_equal(&read.address, &sent.address, sizeof(sent.address));
	assert_text(read.control, "GW1LD0/LLN0$GO$bay1");
	assert_text(read.data_set, "GW1LD0/LLN0$bay1");
	assert_text(read.id, "bay1");
	assert_int_equal(read.alive_ms, 2000);
	assert_int_equal(read.state, 7);
	assert_int_equal(read.sequence, 0x80000000);
	assert_int_equal(read.conf_rev, 3);
	assert_int_equal(read.time.utc_ns, sent.time.utc_ns);
	assert_int_equal(read.entries, COUNT);
	assert_int_equal(read.item_count, COUNT);
	for (size_t i = 0; i < COUNT; i++) {
		assert_int_equal(read_items[i].kind, items[i].kind);
		if (items[i].kind == GOOSE_TIME)
			assert_int_equal(read_items[i].time.utc_ns, items[i].time.utc_ns);
		else
			assert_int_equal(read_items[i].bits, items[i].bits);
	}
}

/* The message that annex A of the standard would have of one BOOLEAN, octet by octet. */
static void test_octets_of_the_smallest(void **state)
{
	const struct goose_message message = {
	    .address = {.destination = {1, 0x0c, 0xcd, 1, 0, 1}, .app_id = 1},
	    .control = TEXT("A"),
	    .data_set = TEXT("B"),
	    .id = TEXT("C"),
	    .alive_ms = 200,
	    .state = 1,
	    .conf_rev = 1,
	    .simulation = true,
	    .entries = 1,
	    .item_count = 1,
	    .items = items};
	static const uint8_t wanted[] = {
	    1,    0x0c, 0xcd, 1, 0,    1,    0,    0, 0,    0,    0, 0,    0x88, 0xb8, 0,    1,   0,    56,
	    0x80, 0,    0,    0, 0x61, 46,   0x80, 1, 'A',  0x81, 2, 0,    200,  0x82, 1,    'B', 0x83, 1,
	    'C',  0x84, 8,    0, 0,    0,    0,    0, 0,    0,    0, 0x85, 1,    1,    0x86, 1,   0,    0x87,
	    1,    0xff, 0x88, 1, 1,    0x89, 1,    0, 0x8a, 1,    1, 0xab, 3,    0x83, 1,    0xff};

	(void)state;
	assert_int_equal(goose_encode(&message, frame), sizeof(wanted));
	assert_memory_equal(frame, wanted, sizeof(wanted));
}

/* Of a later edition, beside ours; never instead of one. */
static void test_another_tag_is_no_control_block(void **state)
{
	const size_t size = goose_encode(&sent, frame);
	uint8_t *control = memmem(frame, size, sent.control.at, sent.control.size);

	(void)state;
	assert_non_null(control);
	assert_int_equal(control[-2], 0x80);
	control[-2] = 0xa0;
	assert_false(goose_decode(frame, size, &read, read_items));
}

static void test_every_cut_is_refused(void **state)
{
	const size_t size = goose_encode(&sent, frame);

	(void)state;
	for (size_t cut = 0; cut < size; cut++)
		assert_false(goose_decode(frame, cut, &read, read_items));
}

static void test_octets_behind_the_message_are_the_mediums(void **state)
{
	const size_t size = goose_encode(&sent, frame);

	(void)state;
	memset(frame + size, 0xa5, 20);
	assert_true(goose_decode(frame, size + 20, &read, read_items));
}

/* {stVal, q}, in a structure, is one entry and two leaves. */
static void test_a_structure_is_its_leaves(void **state)
{
	const struct goose_message message = {
	    .control = TEXT("A"), .data_set = TEXT("B"), .entries = 1, .item_count = 2, .items = items};
	size_t size = goose_encode(&message, frame);
	uint8_t *data = frame + size - 10; /* ab 08 83 01 ff 84 03 03 40 00 */

	(void)state;
	assert_int_equal(data[0], 0xab);
	memmove(data + 4, data + 2, 8);
	memcpy(data, (const uint8_t[]){0xab, 10, 0xa2, 8}, 4);
	frame[23] = (uint8_t)(frame[23] + 2);
	frame[17] = (uint8_t)(frame[17] + 2);
	assert_true(goose_decode(frame, size + 2, &read, read_items));
	assert_int_equal(read.entries, 1);
	assert_int_equal(read.item_count, 2);
	assert_int_equal(read_items[1].kind, GOOSE_BITS);
}

static void test_structures_too_deep_are_refused(void **state)
{
	const struct goose_message message = {
	    .control = TEXT("A"), .data_set = TEXT("B"), .entries = 1, .item_count = 1, .items = items};
	size_t size = goose_encode(&message, frame);
	uint8_t *data = frame + size - 5;

	(void)state;
	memcpy(data, (const uint8_t[]){0xab, 9, 0xa2, 7, 0xa2, 5, 0xa2, 3, 0x83, 1, 0xff}, 11);
	frame[23] = (uint8_t)(frame[23] + 6);
	frame[17] = (uint8_t)(frame[17] + 6);
	assert_true(goose_decode(frame, size + 6, &read, read_items));
	memcpy(data, (const uint8_t[]){0xab, 11, 0xa2, 9, 0xa2, 7, 0xa2, 5, 0xa2, 3, 0x83, 1, 0xff}, 13);
	frame[23] = (uint8_t)(frame[23] + 2);
	frame[17] = (uint8_t)(frame[17] + 2);
	assert_false(goose_decode(frame, size + 8, &read, read_items));
}

static void test_more_than_a_frame_holds(void **state)
{
	struct goose_item many[GOOSE_ITEMS_MAX];
	struct goose_message message = sent;

	(void)state;
	for (size_t i = 0; i < GOOSE_ITEMS_MAX; i++)
		many[i] = (struct goose_item){.kind = GOOSE_TIME};
	message.items = many;
	message.item_count = message.entries = GOOSE_ITEMS_MAX;
	assert_true(goose_encode(&message, frame) > 0);
	message.id.at = message.control.at = (const char *)many;
	message.id.size = message.control.size = 129;
	assert_int_equal(goose_encode(&message, frame), 0);
}

int main(void)
{
	const struct CMUnitTest tests[] = {
	    cmocka_unit_test(test_a_message_there_and_back),
	    cmocka_unit_test(test_octets_of_the_smallest),
	    cmocka_unit_test(test_another_tag_is_no_control_block),
	    cmocka_unit_test(test_every_cut_is_refused),
	    cmocka_unit_test(test_octets_behind_the_message_are_the_mediums),
	    cmocka_unit_test(test_a_structure_is_its_leaves),
	    cmocka_unit_test(test_structures_too_deep_are_refused),
	    cmocka_unit_test(test_more_than_a_frame_holds),
	};

	return cmocka_run_group_tests_name("goose message", tests, NULL, NULL);
}
