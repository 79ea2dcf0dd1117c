/* SPDX-License-Identifier: GPL-3.0-or-later */
/* Octets derived by hand from IEC 60870-5-101, clause 7. */
#include <setjmp.h>
#include <stdarg.h>
#include <stddef.h>
#include <stdint.h>
#include <string.h>

#include <cmocka.h>

#include "iec104/asdu.h"

/*
 * The single command of the project report's figure 5.6, CA 3067, IOA 4, originator 1. The figure prints the length octet as
 * 06; the frame has 16 octets, so it was 0e. It prints SCO 81, which is select; the text and figure 5.5 say execute, 01.
 */
static const uint8_t figure_5_6[] = {0x2d, 0x01, 0x06, 0x01, 0xfb, 0x0b, 0x04, 0x00, 0x00, 0x81};

static void test_figure_5_6(void **state)
{
	struct iec104_command command;
	struct iec104_asdu asdu;

	(void)state;
	assert_true(iec104_asdu_decode(figure_5_6, sizeof(figure_5_6), &asdu));
	assert_int_equal(asdu.type, IEC104_C_SC_NA_1);
	assert_false(asdu.sequence);
	assert_int_equal(asdu.count, 1);
	assert_int_equal(asdu.cause, IEC104_ACTIVATION);
	assert_false(asdu.negative);
	assert_false(asdu.test);
	assert_int_equal(asdu.originator, 1);
	assert_int_equal(asdu.ca, 3067);
	assert_int_equal(asdu.objects_size, iec104_control_object_size(asdu.type));
	assert_true(iec104_command_decode(asdu.type, asdu.objects, &command));
	assert_int_equal(command.ioa, 4);
	assert_int_equal(command.type, MAP_SINGLE);
	assert_int_equal(command.value.u, 1);
	assert_int_equal(command.qualifier, 0);
	assert_true(command.select);
	assert_false(command.tagged);
}

static void test_header_too_short(void **state)
{
	struct iec104_asdu asdu;

	(void)state;
	for (size_t size = 0; size < 6; size++)
		assert_false(iec104_asdu_decode(figure_5_6, size, &asdu));
}

static void test_header_bits(void **state)
{
	const uint8_t bytes[] = {0x01, 0xff, 0xc0 | 20, 0x05, 0xff, 0xff};
	struct iec104_asdu asdu;

	(void)state;
	assert_true(iec104_asdu_decode(bytes, sizeof(bytes), &asdu));
	assert_true(asdu.sequence);
	assert_int_equal(asdu.count, 127);
	assert_int_equal(asdu.cause, 20);
	assert_true(asdu.negative);
	assert_true(asdu.test);
	assert_int_equal(asdu.ca, IEC104_CA_BROADCAST);
}

static void test_mirror(void **state)
{
	uint8_t bytes[sizeof(figure_5_6)];

	(void)state;
	memcpy(bytes, figure_5_6, sizeof(bytes));
	bytes[2] |= 0x80;
	iec104_asdu_mirror(bytes, IEC104_ACTIVATION_CON, true);
	assert_int_equal(bytes[2], 0x80 | 0x40 | 7);
	iec104_asdu_mirror(bytes, IEC104_ACTIVATION_TERM, false);
	assert_int_equal(bytes[2], 0x80 | 10);
	assert_int_equal(bytes[3], 1);
}

struct command_case {
	uint8_t type;
	uint8_t object[15];
	size_t size;
	struct iec104_command expected;
};

static const struct command_case command_cases[] = {
    {46, {1, 0, 0, 0x82 | 3 << 2}, 4, {1, MAP_DOUBLE, {.u = 2}, true, 3, false, NULL, 0}},
    {47, {1, 0, 0, 0x81}, 4, {1, MAP_STEP, {.u = 0}, true, 0, false, NULL, -1}},
    {47, {1, 0, 0, 0x02 | 2 << 2}, 4, {1, MAP_STEP, {.u = 0}, false, 2, false, NULL, 1}},
    {60, {1, 0, 0, 0x03, 0, 0, 0, 0, 1, 1, 25}, 11, {1, MAP_STEP, {.u = 0}, false, 0, true, NULL, 0}},
    {48, {1, 0, 0, 0xff, 0xff, 0}, 6, {1, MAP_NORMALIZED, {.i = -1}, false, 0, false, NULL, 0}},
    {48, {1, 0, 0, 0x00, 0x80, 0}, 6, {1, MAP_NORMALIZED, {.i = -32768}, false, 0, false, NULL, 0}},
    {49, {0x43, 0x9c, 0, 0xff, 0, 0}, 6, {40003, MAP_SCALED, {.i = 255}, false, 0, false, NULL, 0}},
    {49,
     {0xff, 0xff, 0xff, 0, 0x80, 0x81},
     6,
     {16777215, MAP_SCALED, {.i = -32768}, true, 1, false, NULL, 0}},
    {50, {1, 0, 0, 0, 0, 0xc0, 0x3f, 0}, 8, {1, MAP_FLOAT, {.f = 1.5f}, false, 0, false, NULL, 0}},
    {51,
     {1, 0, 0, 0x78, 0x56, 0x34, 0x92},
     7,
     {1, MAP_BITSTRING, {.u = 0x92345678}, false, 0, false, NULL, 0}},
    {58, {4, 0, 0, 0x01, 0, 0, 0, 0, 1, 1, 25}, 11, {4, MAP_SINGLE, {.u = 1}, false, 0, true, NULL, 0}},
    {59, {4, 0, 0, 0x01, 0, 0, 0, 0, 1, 1, 25}, 11, {4, MAP_DOUBLE, {.u = 1}, false, 0, true, NULL, 0}},
    {61,
     {4, 0, 0, 0, 64, 0, 0, 0, 0, 0, 1, 1, 25},
     13,
     {4, MAP_NORMALIZED, {.i = 16384}, false, 0, true, NULL, 0}},
    {62,
     {4, 0, 0, 0xff, 0, 0, 0, 0, 0, 0, 1, 1, 25},
     13,
     {4, MAP_SCALED, {.i = 255}, false, 0, true, NULL, 0}},
    {63,
     {4, 0, 0, 0, 0, 0x80, 0xbf, 0x80, 0, 0, 0, 0, 1, 1, 25},
     15,
     {4, MAP_FLOAT, {.f = -1}, true, 0, true, NULL, 0}},
    {64,
     {4, 0, 0, 1, 0, 0, 0x80, 0, 0, 0, 0, 1, 1, 25},
     14,
     {4, MAP_BITSTRING, {.u = 0x80000001}, false, 0, true, NULL, 0}},
};

static void test_commands(void **state)
{
	(void)state;
	for (size_t i = 0; i < sizeof(command_cases) / sizeof(command_cases[0]); i++) {
		const struct command_case *item = &command_cases[i];
		struct iec104_command command;

		assert_int_equal(iec104_control_object_size(item->type), item->size);
		assert_true(iec104_command_decode(item->type, item->object, &command));
		assert_int_equal(command.ioa, item->expected.ioa);
		assert_int_equal(command.type, item->expected.type);
		assert_int_equal(command.value.u, item->expected.value.u);
		assert_int_equal(command.select, item->expected.select);
		assert_int_equal(command.qualifier, item->expected.qualifier);
		assert_int_equal(command.tagged, item->expected.tagged);
		if (command.tagged)
			assert_ptr_equal(command.time, item->object + item->size - 7);
	}
}

static void test_sizes_of_system_commands(void **state)
{
	(void)state;
	for (int type = 0; type < 256; type++) {
		size_t size = iec104_control_object_size((uint8_t)type);
		bool command = (type >= 45 && type <= 51) || (type >= 58 && type <= 64);

		assert_int_equal(size > 0, command || (type >= 100 && type <= 103) || type == 105 ||
					       type == 107 || (type >= 110 && type <= 113));
	}
	assert_int_equal(iec104_control_object_size(100), 4);
	assert_int_equal(iec104_control_object_size(101), 4);
	assert_int_equal(iec104_control_object_size(102), 3);
	assert_int_equal(iec104_control_object_size(103), 10);
	assert_int_equal(iec104_control_object_size(105), 4);
	assert_int_equal(iec104_control_object_size(107), 12);
	assert_int_equal(iec104_control_object_size(110), 6);
	assert_int_equal(iec104_control_object_size(111), 6);
	assert_int_equal(iec104_control_object_size(112), 8);
	assert_int_equal(iec104_control_object_size(113), 4);
}

struct element_case {
	enum map_type type;
	struct map_sample sample;
	uint8_t plain, tagged; /* types */
	size_t size;
	uint8_t octets[5];
};

static const struct element_case element_cases[] = {
    {MAP_SINGLE, {.value.u = 1}, 1, 30, 1, {0x01}},
    {MAP_SINGLE, {.value.u = 0, .quality = 0xf0}, 1, 30, 1, {0xf0}},
    {MAP_SINGLE, {.value.u = 1, .quality = MAP_OVERFLOW | MAP_INVALID}, 1, 30, 1, {0x81}},
    {MAP_DOUBLE, {.value.u = 2, .quality = MAP_NOT_TOPICAL}, 3, 31, 1, {0x42}},
    {MAP_STEP, {.value.i = -64, .detail = 1}, 5, 32, 2, {0xc0, 0x00}},
    {MAP_STEP, {.value.i = 63, .quality = MAP_OVERFLOW}, 5, 32, 2, {0x3f, 0x01}},
    {MAP_STEP, {.value.i = -1}, 5, 32, 2, {0x7f, 0x00}},
    {MAP_BITSTRING,
     {.value.u = 0x92345678, .quality = MAP_BLOCKED},
     7,
     33,
     5,
     {0x78, 0x56, 0x34, 0x92, 0x10}},
    {MAP_NORMALIZED, {.value.i = -1}, 9, 34, 3, {0xff, 0xff, 0x00}},
    {MAP_NORMALIZED, {.value.i = -32768}, 9, 34, 3, {0x00, 0x80, 0x00}}, /* -1.0 */
    {MAP_NORMALIZED, {.value.i = 16384}, 9, 34, 3, {0x00, 0x40, 0x00}},
    {MAP_NORMALIZED, {.value.i = 32767}, 9, 34, 3, {0xff, 0x7f, 0x00}},
    {MAP_SCALED, {.value.i = 1495}, 11, 35, 3, {0xd7, 0x05, 0x00}},
    {MAP_SCALED, {.value.i = -32768, .quality = MAP_OVERFLOW}, 11, 35, 3, {0x00, 0x80, 0x01}},
    {MAP_FLOAT, {.value.f = 1.5f, .quality = MAP_SUBSTITUTED}, 13, 36, 5, {0x00, 0x00, 0xc0, 0x3f, 0x20}},
    {MAP_COUNTER, {.value.i = -2}, 15, 37, 5, {0xfe, 0xff, 0xff, 0xff, 0x00}},
    {MAP_COUNTER, {.value.i = 1, .quality = 0xf1}, 15, 37, 5, {0x01, 0x00, 0x00, 0x00, 0x80}},
};

static void test_elements(void **state)
{
	(void)state;
	for (size_t i = 0; i < sizeof(element_cases) / sizeof(element_cases[0]); i++) {
		const struct element_case *item = &element_cases[i];
		const struct map_point point = {.type = (uint8_t)item->type};
		uint8_t octets[IEC104_ELEMENT_MAX];

		assert_int_equal(iec104_monitor_type(&point, false), item->plain);
		assert_int_equal(iec104_monitor_type(&point, true), item->tagged);
		assert_int_equal(iec104_element_encode(octets, item->type, &item->sample), item->size);
		assert_memory_equal(octets, item->octets, item->size);
	}
}

static void test_type_without_quality(void **state)
{
	const struct map_point point = {.type = MAP_NORMALIZED, .flags = MAP_POINT_NO_QUALITY};

	(void)state;
	assert_int_equal(iec104_monitor_type(&point, false), 21);
	assert_int_equal(iec104_monitor_type(&point, true), 21);
}

static void test_objects_with_addresses(void **state)
{
	static const uint8_t expected[] = {1, 2, 3, 0, 0xfb, 0x0b, 0x01, 0, 0, 0xaa, 0x11, 0x27, 0, 0xbb};
	const struct iec104_asdu header = {.type = 1, .cause = IEC104_SPONTANEOUS, .ca = 3067};
	struct iec104_builder builder;

	(void)state;
	iec104_asdu_begin(&builder, &header);
	assert_true(iec104_asdu_add(&builder, 1, (const uint8_t[]){0xaa}, 1));
	assert_true(iec104_asdu_add(&builder, 10001, (const uint8_t[]){0xbb}, 1));
	assert_int_equal(builder.size, sizeof(expected));
	assert_memory_equal(builder.bytes, expected, sizeof(expected));
}

static void test_sequence(void **state)
{
	static const uint8_t expected[] = {11, 0x82, 20, 3, 0xfb, 0x0b, 0x31, 0x75, 0, 1, 2, 3, 4, 5, 6};
	const struct iec104_asdu header = {
	    .type = 11, .sequence = true, .cause = 20, .originator = 3, .ca = 3067};
	struct iec104_builder builder;

	(void)state;
	iec104_asdu_begin(&builder, &header);
	assert_true(iec104_asdu_add(&builder, 30001, (const uint8_t[]){1, 2, 3}, 3));
	assert_false(iec104_asdu_add(&builder, 30003, (const uint8_t[]){1, 2, 3}, 3));
	assert_false(iec104_asdu_add(&builder, 30001, (const uint8_t[]){1, 2, 3}, 3));
	assert_true(iec104_asdu_add(&builder, 30002, (const uint8_t[]){4, 5, 6}, 3));
	assert_int_equal(builder.size, sizeof(expected));
	assert_memory_equal(builder.bytes, expected, sizeof(expected));
	assert_int_equal(iec104_asdu_count(&builder), 2);
}

static size_t fill(struct iec104_builder *builder, bool sequence, size_t element_size)
{
	static const uint8_t element[IEC104_ELEMENT_MAX];
	uint32_t ioa = 1;

	iec104_asdu_begin(builder, &(struct iec104_asdu){.sequence = sequence});
	while (iec104_asdu_add(builder, ioa, element, element_size))
		ioa++;
	return ioa - 1;
}

static void test_limits(void **state)
{
	struct iec104_builder builder;

	(void)state;
	assert_int_equal(fill(&builder, true, 1), 127);
	assert_int_equal(builder.size, 6 + 3 + 127);
	assert_int_equal(fill(&builder, false, 1), 60); /* 6 + 60 * 4 = 246 */
	assert_int_equal(fill(&builder, true, 3), 80);  /* 9 + 80 * 3 = 249 */
	assert_int_equal(builder.size, IEC104_ASDU_MAX);
	assert_int_equal(fill(&builder, false, 3), 40);
	assert_int_equal(fill(&builder, true, 5), 48); /* 9 + 48 * 5 = 249 */
	assert_int_equal(fill(&builder, false, 12), 16);
}

int main(void)
{
	const struct CMUnitTest tests[] = {
	    cmocka_unit_test(test_figure_5_6),
	    cmocka_unit_test(test_header_too_short),
	    cmocka_unit_test(test_header_bits),
	    cmocka_unit_test(test_mirror),
	    cmocka_unit_test(test_commands),
	    cmocka_unit_test(test_sizes_of_system_commands),
	    cmocka_unit_test(test_elements),
	    cmocka_unit_test(test_objects_with_addresses),
	    cmocka_unit_test(test_sequence),
	    cmocka_unit_test(test_limits),
	    cmocka_unit_test(test_type_without_quality),
	};

	return cmocka_run_group_tests(tests, NULL, NULL);
}
