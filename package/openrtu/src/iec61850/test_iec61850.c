/* SPDX-License-Identifier: GPL-3.0-or-later */
#include <setjmp.h>
#include <stdarg.h>
#include <stddef.h>
#include <stdint.h>
#include <string.h>

#include <cmocka.h>

#include "ber/ber.h"
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

int main(void)
{
	const struct CMUnitTest tests[] = {
	    cmocka_unit_test(test_integers_take_as_few_octets_as_they_need),
	    cmocka_unit_test(test_lengths_have_every_form),
	    cmocka_unit_test(test_what_has_no_room_is_full),
	    cmocka_unit_test(test_quality_says_why),
	    cmocka_unit_test(test_time_says_how_good_the_clock_is),
	};

	return cmocka_run_group_tests(tests, NULL, NULL);
}
