/* SPDX-License-Identifier: GPL-3.0-or-later */
/* Octets derived by hand from IEC 60870-5-101, 7.2.6 and 7.3.1. */
#include <setjmp.h>
#include <stdarg.h>
#include <stddef.h>
#include <stdint.h>
#include <string.h>

#include <cmocka.h>

#include "iec104/information.h"
#include "map/time_ns.h"

#define NOW (1110965882 * NS_PER_S) /* 2005-03-16 09:38:02 */

static const struct map_zone utc;
static struct iec104_information out;

/* One object of IOA 0x010203. */
static bool decode(uint8_t type, const uint8_t *element, size_t size)
{
	uint8_t bytes[64] = {type, 1, 3, 0, 1, 0, 3, 2, 1};
	struct iec104_asdu asdu;

	memcpy(bytes + 9, element, size);
	return iec104_asdu_decode(bytes, 9 + size, &asdu) &&
	       iec104_information_decode(&asdu, 0, &utc, NOW, &out);
}

struct item {
	uint8_t type;
	uint8_t size;
	uint8_t octets[11];
	struct iec104_information expected; /* value by its bits */
};

static const struct item items[] = {
    {1, 1, {0x91}, {.content = IEC104_SINGLE, .value.u = 1, .quality = MAP_INVALID | MAP_BLOCKED}},
    {3, 1, {0x42}, {.content = IEC104_DOUBLE, .value.u = 2, .quality = MAP_NOT_TOPICAL}},
    {5, 2, {0xc0, 0x01}, {.content = IEC104_STEP, .value.i = -64, .detail = 1, .quality = MAP_OVERFLOW}},
    {5, 2, {0x3f, 0x00}, {.content = IEC104_STEP, .value.i = 63}},
    {7,
     5,
     {0x78, 0x56, 0x34, 0x92, 0x10},
     {.content = IEC104_BITS, .value.u = 0x92345678, .quality = MAP_BLOCKED}},
    {9, 3, {0x00, 0x80, 0x00}, {.content = IEC104_NORMALIZED, .value.i = -32768}},
    {11, 3, {0xd7, 0x05, 0x20}, {.content = IEC104_SCALED, .value.i = 1495, .quality = MAP_SUBSTITUTED}},
    {13, 5, {0x00, 0x00, 0xc0, 0x3f, 0x00}, {.content = IEC104_FLOAT, .value.f = 1.5f}},
    {15,
     5,
     {0xfe, 0xff, 0xff, 0xff, 0xa3},
     {.content = IEC104_TOTAL, .value.i = -2, .detail = 0x23, .quality = MAP_INVALID}},
    {20, 5, {0x01, 0x80, 0x00, 0x40, 0x00}, {.content = IEC104_PACKED_SINGLES, .value.u = 0x40008001}},
    {21, 2, {0xff, 0xff}, {.content = IEC104_NORMALIZED, .value.i = -1}},
    {70, 1, {0x02}, {.content = IEC104_INITIALISATION, .value.u = 2}},
    /* CP24Time2a: 02.250 s after minute 38; minute 10 is 28 before, minute 5 of the next hour 27 ahead */
    {2,
     4,
     {0x01, 0xca, 0x08, 38},
     {.content = IEC104_SINGLE, .value.u = 1, .tagged = true, .wall_ns = NOW + 250 * NS_PER_MS}},
    {4,
     4,
     {0x01, 0x00, 0x00, 10},
     {.content = IEC104_DOUBLE, .value.u = 1, .tagged = true, .wall_ns = NOW - (28 * 60 + 2) * NS_PER_S}},
    {6,
     5,
     {0x01, 0x00, 0x00, 0x00, 5},
     {.content = IEC104_STEP, .value.i = 1, .tagged = true, .wall_ns = NOW + (27 * 60 - 2) * NS_PER_S}},
    {10,
     6,
     {0x01, 0x00, 0x00, 0x00, 0x00, 0x80},
     {.content = IEC104_NORMALIZED, .value.i = 1, .tagged = true, .time_invalid = true}},
    {17,
     6,
     {0x8a, 0x10, 0x27, 0x00, 0x00, 38},
     {.content = IEC104_PROTECTION_EVENT,
      .value.u = 2,
      .quality = 0x88,
      .elapsed_ms = 10000,
      .tagged = true,
      .wall_ns = NOW - 2 * NS_PER_S}},
    {18,
     7,
     {0x3f, 0x08, 0x10, 0x27, 0x00, 0x00, 38},
     {.content = IEC104_PROTECTION_START,
      .value.u = 0x3f,
      .quality = 0x08,
      .elapsed_ms = 10000,
      .tagged = true,
      .wall_ns = NOW - 2 * NS_PER_S}},
    {19,
     7,
     {0x0f, 0x00, 0x01, 0x00, 0x00, 0x00, 38},
     {.content = IEC104_PROTECTION_OUTPUT,
      .value.u = 0x0f,
      .elapsed_ms = 1,
      .tagged = true,
      .wall_ns = NOW - 2 * NS_PER_S}},
    /* CP56Time2a */
    {30,
     8,
     {0x01, 0xd0, 0x07, 38, 9, 16, 3, 5},
     {.content = IEC104_SINGLE, .value.u = 1, .tagged = true, .wall_ns = NOW}},
    {38,
     10,
     {0x01, 0x02, 0x00, 0xd0, 0x07, 38, 9, 16, 3, 5},
     {.content = IEC104_PROTECTION_EVENT, .value.u = 1, .elapsed_ms = 2, .tagged = true, .wall_ns = NOW}},
    {39,
     11,
     {0x01, 0x00, 0x02, 0x00, 0xd0, 0x07, 38, 9, 16, 3, 5},
     {.content = IEC104_PROTECTION_START, .value.u = 1, .elapsed_ms = 2, .tagged = true, .wall_ns = NOW}},
    {40,
     11,
     {0x01, 0x00, 0x02, 0x00, 0xd0, 0x07, 38, 9, 16, 3, 5},
     {.content = IEC104_PROTECTION_OUTPUT, .value.u = 1, .elapsed_ms = 2, .tagged = true, .wall_ns = NOW}},
};

static void test_each_kind(void **state)
{
	(void)state;
	for (size_t i = 0; i < sizeof(items) / sizeof(items[0]); i++) {
		const struct item *item = &items[i];

		assert_int_equal(iec104_information_size(item->type), item->size);
		assert_true(decode(item->type, item->octets, item->size));
		assert_int_equal(out.ioa, 0x010203);
		assert_int_equal(out.content, item->expected.content);
		assert_int_equal(out.value.u, item->expected.value.u);
		assert_int_equal(out.quality, item->expected.quality);
		assert_int_equal(out.detail, item->expected.detail);
		assert_int_equal(out.elapsed_ms, item->expected.elapsed_ms);
		assert_int_equal(out.tagged, item->expected.tagged);
		assert_int_equal(out.time_invalid, item->expected.time_invalid);
		assert_int_equal(out.wall_ns, item->expected.wall_ns);
		assert_false(decode(item->type, item->octets, item->size - 1u));
	}
}

static void test_the_types_that_there_are(void **state)
{
	(void)state;
	for (int type = 0; type < 256; type++) {
		bool known = (type >= 1 && type <= 21) || (type >= 30 && type <= 40) || type == 70;

		assert_int_equal(iec104_information_size((uint8_t)type) > 0, known);
		if (!known)
			assert_false(decode((uint8_t)type, (const uint8_t[16]){0}, 16));
	}
}

/* What our own controlled station encodes. */
static void test_our_own_elements(void **state)
{
	static const struct map_sample sample = {.value.i = -5, .quality = MAP_INVALID | MAP_SUBSTITUTED};
	uint8_t element[IEC104_ELEMENT_MAX];

	(void)state;
	for (int type = 0; type < MAP_TYPES; type++) {
		const struct map_point point = {.type = (uint8_t)type};
		size_t size = iec104_element_encode(element, (enum map_type)type, &sample);

		iec104_time56_encode(element + size, NOW, false, &utc);
		assert_true(decode(iec104_monitor_type(&point, false), element, size));
		assert_int_equal(out.quality & MAP_INVALID, MAP_INVALID);
		assert_false(out.tagged);
		assert_true(decode(iec104_monitor_type(&point, true), element, size + IEC104_TIME56_SIZE));
		assert_int_equal(out.wall_ns, NOW);
		if (type == MAP_ANGLE)
			assert_int_equal(out.value.u, ((union map_value){.f = -5e-7f}).u);
		else if (type != MAP_SINGLE && type != MAP_DOUBLE)
			assert_int_equal(out.value.i, -5);
	}
}

int main(void)
{
	const struct CMUnitTest tests[] = {
	    cmocka_unit_test(test_each_kind),
	    cmocka_unit_test(test_the_types_that_there_are),
	    cmocka_unit_test(test_our_own_elements),
	};
	return cmocka_run_group_tests_name("iec104 information", tests, NULL, NULL);
}
