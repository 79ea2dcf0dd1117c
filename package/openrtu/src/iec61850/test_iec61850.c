/* SPDX-License-Identifier: GPL-3.0-or-later */
#include <setjmp.h>
#include <stdarg.h>
#include <stddef.h>
#include <stdint.h>
#include <string.h>

#include <cmocka.h>

#include "ber/ber.h"
#include "iec61850/association.h"
#include "iec61850/kept.h"
#include "iec61850/unit.h"
#include "iec61850/value.h"
#include "quality/quality.h"

static void test_integers_take_as_few_octets_as_they_need(void **state)
{
	static const struct {
		int64_t value;
		size_t size;
	} cases[] = {{0, 1},      {127, 1},    {128, 2},       {-128, 1},      {-129, 2}, {255, 2},
		     {0x7fff, 2}, {0x8000, 3}, {INT32_MAX, 4}, {INT32_MIN, 4}, {-1, 1},   {UINT32_MAX, 5}};

	(void)state;
	for (size_t i = 0; i < sizeof(cases) / sizeof(cases[0]); i++) {
		uint8_t octets[16];
		struct ber_writer writer = {.octets = octets, .at = sizeof(octets)};
		struct ber_reader reader;
		struct ber_element element;
		int64_t value;

		ber_put_integer(&writer, BER_INTEGER, cases[i].value);
		reader = (struct ber_reader){octets + writer.at, octets + sizeof(octets)};
		assert_true(ber_expect(&reader, BER_INTEGER, &element));
		assert_int_equal(element.size, cases[i].size);
		assert_true(ber_integer(&element, &value));
		assert_int_equal(value, cases[i].value);
	}
}

static void test_lengths_have_every_form(void **state)
{
	static const size_t sizes[] = {0, 127, 128, 255, 256, 65535, 65536};
	static uint8_t octets[65536 + 8];

	(void)state;
	for (size_t i = 0; i < sizeof(sizes) / sizeof(sizes[0]); i++) {
		struct ber_writer writer = {.octets = octets, .at = sizeof(octets)};
		struct ber_reader reader;
		struct ber_element element;

		writer.at -= sizes[i];
		ber_close(&writer, 0xa0, sizeof(octets));
		assert_false(writer.full);
		reader = (struct ber_reader){octets + writer.at, octets + sizeof(octets)};
		assert_true(ber_expect(&reader, 0xa0, &element));
		assert_int_equal(element.size, sizes[i]);
		assert_ptr_equal(reader.at, reader.end);
		reader = (struct ber_reader){octets + writer.at, octets + sizeof(octets) - 1};
		assert_false(ber_next(&reader, &element)); /* an octet is missing */
	}
}

static void test_what_has_no_room_is_full(void **state)
{
	uint8_t octets[8] = {0};
	struct ber_writer writer = {.octets = octets, .at = sizeof(octets), .floor = 4};

	(void)state;
	ber_put_text(&writer, BER_VISIBLE_STRING, "ab");
	assert_false(writer.full);
	ber_put(&writer, BER_VISIBLE_STRING, NULL, 0);
	assert_true(writer.full);
	assert_int_equal(writer.at, 4);
}

static void test_quality_says_why(void **state)
{
	(void)state;
	assert_int_equal(quality_of_map(MAP_GOOD), 0);
	assert_int_equal(quality_of_map(MAP_INVALID), QUALITY_INVALID | QUALITY_FAILURE);
	assert_int_equal(quality_of_map(MAP_NOT_TOPICAL), QUALITY_QUESTIONABLE | QUALITY_OLD_DATA);
	assert_int_equal(quality_of_map(MAP_OVERFLOW), QUALITY_QUESTIONABLE | QUALITY_OVERFLOW);
	assert_int_equal(quality_of_map(MAP_SUBSTITUTED), QUALITY_SUBSTITUTED);
	assert_int_equal(quality_of_map(MAP_BLOCKED), QUALITY_OPERATOR_BLOCKED);
	assert_int_equal(quality_of_map(MAP_INVALID | MAP_NOT_TOPICAL),
			 QUALITY_INVALID | QUALITY_FAILURE | QUALITY_OLD_DATA);
}

static void test_time_says_how_good_the_clock_is(void **state)
{
	static const uint8_t half[] = {0x65, 0x00, 0x00, 0x01, 0x80, 0x00, 0x00};
	const int64_t moment_ns = 0x65000001LL * NS_PER_S + NS_PER_S / 2;
	struct map_clock clock = {.set = true, .source = MAP_CLOCK_SYNCHRONISED, .error_us = 900};
	uint8_t out[8];

	(void)state;
	iec61850_time_of(moment_ns, &clock, out);
	assert_memory_equal(out, half, sizeof(half));
	assert_int_equal(out[7], 0x80 | 10); /* 2^-10 s is the next above 900 us */
	clock.source = MAP_CLOCK_HELD;
	iec61850_time_of(moment_ns, &clock, out);
	assert_int_equal(out[7], 0x20 | 31);
	clock = (struct map_clock){.source = MAP_CLOCK_UNSET};
	iec61850_time_of(0, &clock, out);
	assert_memory_equal(out, ((const uint8_t[]){0, 0, 0, 0, 0, 0, 0, 0x20 | 31}), sizeof(out));
}

static void test_units_are_numbers_and_powers_of_ten(void **state)
{
	static const struct {
		const char *text;
		struct iec61850_unit unit;
	} cases[] = {{"W", {38, 0}},  {"MW", {38, 6}},  {"mW", {38, -3}}, {"kvarh", {73, 3}}, {"%", {1, -2}},
		     {"h", {84, 0}},  {"hPa", {39, 2}}, {"min", {85, 0}}, {"m", {2, 0}},      {"mm", {2, -3}},
		     {"Pa", {39, 0}}, {"dB", {79, 0}},  {"µA", {5, -6}},  {"uA", {5, -6}},    {"kg", {3, 0}},
		     {"g", {3, -3}},  {"t", {0, 0}},    {"mm²", {0, 0}},  {"km3", {0, 0}},    {"", {0, 0}},
		     {"k", {0, 0}},   {"kkg", {0, 0}},  {"k%", {0, 0}},   {"dag", {3, -2}},   {"cg", {0, 0}}};

	(void)state;
	for (size_t i = 0; i < sizeof(cases) / sizeof(cases[0]); i++) {
		const struct iec61850_unit unit = iec61850_unit_parse(cases[i].text);

		assert_int_equal(unit.si, cases[i].unit.si);
		assert_int_equal(unit.exponent, cases[i].unit.exponent);
	}
}

/* A connection at the time 0, which nothing has come from. */
static struct iec61850_association new_connection(void)
{
	static uint8_t input[IEC61850_INPUT_SIZE], message[IEC61850_MESSAGE_SIZE(1000)],
	    output[IEC61850_OUTPUT_SIZE(1000)];
	struct iec61850_association association = {.transport = {.input = input,
								 .message = message,
								 .output = output,
								 .message_size = sizeof(message),
								 .output_size = sizeof(output)}};

	iec61850_association_open(&association, 1000, 0);
	return association;
}

static void test_who_does_not_associate_has_ten_seconds(void **state)
{
	static struct iec61850_server server;
	struct iec61850_association association = new_connection();

	(void)state;
	assert_int_equal(iec61850_association_run(&association, &server, NULL, 10 * NS_PER_S - 1),
			 IEC61850_STAYS);
	assert_int_equal(iec61850_association_run(&association, &server, NULL, 10 * NS_PER_S),
			 IEC61850_SILENT_START);
}

static void test_who_sleeps_gives_way_after_a_minute(void **state)
{
	struct iec61850_association association = new_connection();

	(void)state;
	assert_int_equal(iec61850_association_idle_ns(&association, NS_PER_S), NS_PER_S);
	association.associated = true;
	assert_int_equal(iec61850_association_idle_ns(&association, 60 * NS_PER_S - 1), 0);
	assert_int_equal(iec61850_association_idle_ns(&association, 60 * NS_PER_S), 60 * NS_PER_S);
}

static void test_who_takes_nothing_has_half_a_minute(void **state)
{
	static struct iec61850_server server;
	struct iec61850_association association = new_connection();

	(void)state;
	association.associated = true;
	association.transport.output_end = 2;
	assert_int_equal(iec61850_association_run(&association, &server, NULL, 30 * NS_PER_S - 1),
			 IEC61850_STAYS);
	assert_int_equal(iec61850_association_run(&association, &server, NULL, 30 * NS_PER_S),
			 IEC61850_STUCK);
	iec61850_association_written(&association, 1, 30 * NS_PER_S); /* an octet is enough */
	assert_int_equal(iec61850_association_run(&association, &server, NULL, 59 * NS_PER_S),
			 IEC61850_STAYS);
}

/* The journal wrote one after it had been told entries for which the record had no room; the other one waits too long. */
static void test_a_block_whose_entries_are_lost_tells_it(void **state)
{
	enum { ENTRIES = 16, REVISION = 7, START = 3 };
	static _Alignas(8)
	    uint8_t section[IEC61850_HISTORY_AT + MAP_HISTORY_ALIGNED(sizeof(struct map_history_head)) +
			    IEC61850_KEPT_ALL * sizeof(struct map_history_reader) +
			    ENTRIES * sizeof(struct map_history_entry)];
	static struct iec61850_settings settings = {.report_buffer = ENTRIES};
	static const struct map_config config = {
	    .sections = {{IEC61850_SETTINGS, sizeof(settings), 1, &settings}}, .section_count = 1};
	const struct map_history kept =
	    map_history_at(section + IEC61850_HISTORY_AT, IEC61850_KEPT_ALL, ENTRIES);
	struct iec61850_kept_block *ahead = (void *)kept.readers[0].octets,
				   *level = (void *)kept.readers[1].octets;
	static const struct map_sample sample;
	struct iec61850_buffer buffer;
	bool lost;

	(void)state;
	assert_int_equal(iec61850_section_size(&config), sizeof(section));
	kept.head->former = START;
	kept.head->revision = REVISION;
	kept.head->places[0].next = 10;
	kept.readers[0].used = kept.readers[1].used = 1;
	*ahead = (struct iec61850_kept_block){.next = 15, .floor = 12};
	*level = (struct iec61850_kept_block){.next = 10, .floor = 1};
	assert_int_equal(iec61850_buffer_begin(&buffer, section, &config, 2, REVISION, START + 1),
			 IEC61850_GOES_ON_LATER);
	assert_int_equal(ahead->next, 10);
	assert_int_equal(ahead->floor, 10);
	assert_true(ahead->overflow);
	assert_int_equal(level->next, 10);
	assert_int_equal(level->floor, 1);
	assert_false(level->overflow);
	assert_int_equal(iec61850_buffer_first(&buffer, ahead, &lost), 10);
	assert_true(lost);
	assert_int_equal(iec61850_buffer_first(&buffer, level, &lost), 10);
	assert_false(lost);
	for (uint32_t i = 0; i < ENTRIES; i++)
		iec61850_buffer_add(&buffer, 0, 0, &sample, sample.time_ns);
	assert_int_equal(iec61850_buffer_first(&buffer, level, &lost), 10);
	assert_false(lost);
	iec61850_buffer_add(&buffer, 0, 0, &sample, sample.time_ns);
	assert_int_equal(iec61850_buffer_first(&buffer, level, &lost), 11);
	assert_true(lost);
}

int main(void)
{
	const struct CMUnitTest tests[] = {
	    cmocka_unit_test(test_integers_take_as_few_octets_as_they_need),
	    cmocka_unit_test(test_lengths_have_every_form),
	    cmocka_unit_test(test_what_has_no_room_is_full),
	    cmocka_unit_test(test_quality_says_why),
	    cmocka_unit_test(test_time_says_how_good_the_clock_is),
	    cmocka_unit_test(test_units_are_numbers_and_powers_of_ten),
	    cmocka_unit_test(test_who_does_not_associate_has_ten_seconds),
	    cmocka_unit_test(test_who_sleeps_gives_way_after_a_minute),
	    cmocka_unit_test(test_who_takes_nothing_has_half_a_minute),
	    cmocka_unit_test(test_a_block_whose_entries_are_lost_tells_it),
	};

	return cmocka_run_group_tests(tests, NULL, NULL);
}
