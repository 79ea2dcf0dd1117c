/* SPDX-License-Identifier: GPL-3.0-or-later */
/* Octets derived by hand from the figure of docs/positioning.md. */
#include <setjmp.h>
#include <stdarg.h>
#include <stddef.h>
#include <stdint.h>
#include <string.h>

#include <cmocka.h>

#include "iec104/geoposition.h"

/* 52.2190650 N, 21.0108517 E, 137.2 m, differential, 10 satellites, 2005-03-16 09:38:02.250, on a read of IOA 1 of CA 3067 */
static const uint8_t apdu[] = {0x68, 33,   0,    0,    0,    0,        /* APCI: I frame 0 */
			       201,  1,    5,    0,    0xfb, 0x0b,     /* data unit identifier */
			       1,    0,    0,                          /* IOA */
			       0x3a, 0xff, 0x1f, 0x1f,                 /* latitude 522190650 */
			       0x65, 0x00, 0x86, 0x0c,                 /* longitude 210108517 */
			       0x5c, 0x05, 0x00,                       /* altitude 1372 */
			       0xa2,                                   /* fix 2, 10 satellites */
			       0x00,                                   /* QDS */
			       0xca, 0x08, 38,   9,    16,   3,    5}; /* CP56Time2a */
static const struct map_zone utc;
static const struct iec104_geoposition place = {.latitude = 522190650,
						.longitude = 210108517,
						.altitude_dm = 1372,
						.fix = 2,
						.satellites = 10,
						.wall_ns = 1110965882250000000};

#define ELEMENT (apdu + 15)

static void test_an_apdu_of_35_octets(void **state)
{
	const struct iec104_asdu header = {.type = IEC104_GEOPOSITION, .cause = IEC104_REQUEST, .ca = 3067};
	uint8_t element[IEC104_GEOPOSITION_SIZE];
	struct iec104_builder builder;

	(void)state;
	assert_int_equal(sizeof(apdu), 35);
	iec104_geoposition_encode(element, &place, &utc);
	iec104_asdu_begin(&builder, &header);
	assert_true(iec104_asdu_add(&builder, 1, element, sizeof(element)));
	assert_int_equal(builder.size, 29);
	assert_memory_equal(builder.bytes, apdu + 6, 29);
}

static void test_back(void **state)
{
	struct iec104_geoposition out;
	struct iec104_asdu asdu;
	struct iec104_apdu frame;
	const uint8_t *element;
	uint32_t ioa;

	(void)state;
	assert_true(iec104_apdu_decode(apdu, sizeof(apdu), &frame));
	assert_true(iec104_asdu_decode(frame.asdu, frame.asdu_size, &asdu));
	assert_true(iec104_is_private(asdu.type));
	element = iec104_object(&asdu, IEC104_GEOPOSITION_SIZE, 0, &ioa);
	assert_ptr_equal(element, ELEMENT);
	assert_int_equal(ioa, 1);
	assert_true(iec104_geoposition_decode(element, &utc, &out));
	assert_int_equal(out.latitude, place.latitude);
	assert_int_equal(out.longitude, place.longitude);
	assert_int_equal(out.altitude_dm, place.altitude_dm);
	assert_int_equal(out.fix, place.fix);
	assert_int_equal(out.satellites, place.satellites);
	assert_int_equal(out.quality, 0);
	assert_false(out.time_invalid);
	assert_int_equal(out.wall_ns, place.wall_ns);
}

struct edge {
	struct iec104_geoposition position;
	uint8_t octets[13]; /* without the time */
};

static const struct edge edges[] = {
    {{.latitude = -900000000, .longitude = -1800000000, .altitude_dm = -1},
     {0x00, 0x17, 0x5b, 0xca, 0x00, 0x2e, 0xb6, 0x94, 0xff, 0xff, 0xff, 0x00, 0x00}},
    {{.latitude = 900000000, .longitude = 1800000000, .altitude_dm = 8388607, .fix = 15, .satellites = 15},
     {0x00, 0xe9, 0xa4, 0x35, 0x00, 0xd2, 0x49, 0x6b, 0xff, 0xff, 0x7f, 0xff, 0x00}},
    {{.altitude_dm = -8388608, .quality = MAP_INVALID | MAP_NOT_TOPICAL | MAP_SUBSTITUTED | MAP_BLOCKED},
     {0, 0, 0, 0, 0, 0, 0, 0, 0x00, 0x00, 0x80, 0x00, 0xf0}},
};

static void test_edges_both_ways(void **state)
{
	(void)state;
	for (size_t i = 0; i < sizeof(edges) / sizeof(edges[0]); i++) {
		uint8_t element[IEC104_GEOPOSITION_SIZE];
		struct iec104_geoposition out;

		iec104_geoposition_encode(element, &edges[i].position, &utc);
		assert_memory_equal(element, edges[i].octets, sizeof(edges[i].octets));
		assert_true(iec104_geoposition_decode(element, &utc, &out));
		assert_int_equal(out.latitude, edges[i].position.latitude);
		assert_int_equal(out.longitude, edges[i].position.longitude);
		assert_int_equal(out.altitude_dm, edges[i].position.altitude_dm);
		assert_int_equal(out.fix, edges[i].position.fix);
		assert_int_equal(out.quality, edges[i].position.quality);
		assert_true(out.time_invalid); /* 1970 is before CP56Time2a begins */
	}
}

static void test_what_does_not_fit(void **state)
{
	struct iec104_geoposition position = {.altitude_dm = 8388608, .satellites = 255}, out;
	uint8_t element[IEC104_GEOPOSITION_SIZE];

	(void)state;
	iec104_geoposition_encode(element, &position, &utc);
	assert_true(iec104_geoposition_decode(element, &utc, &out));
	assert_int_equal(out.altitude_dm, 8388607);
	assert_int_equal(out.quality, MAP_OVERFLOW);
	assert_int_equal(out.satellites, 15);
	position.altitude_dm = INT32_MIN;
	iec104_geoposition_encode(element, &position, &utc);
	assert_true(iec104_geoposition_decode(element, &utc, &out));
	assert_int_equal(out.altitude_dm, -8388608);
	assert_int_equal(out.quality, MAP_OVERFLOW);
}

static void test_no_place_on_the_earth(void **state)
{
	static const int32_t places[][2] = {
	    {900000001, 0}, {-900000001, 0}, {0, 1800000001}, {0, -1800000001}, {INT32_MIN, 0}};
	uint8_t element[IEC104_GEOPOSITION_SIZE];
	struct iec104_geoposition out;

	(void)state;
	for (size_t i = 0; i < sizeof(places) / sizeof(places[0]); i++) {
		const struct iec104_geoposition position = {.latitude = places[i][0],
							    .longitude = places[i][1]};

		iec104_geoposition_encode(element, &position, &utc);
		assert_false(iec104_geoposition_decode(element, &utc, &out));
	}
}

static void test_the_private_range(void **state)
{
	(void)state;
	assert_false(iec104_is_private(135));
	assert_true(iec104_is_private(136));
	assert_true(iec104_is_private(201));
	assert_true(iec104_is_private(255));
	assert_false(iec104_is_private(256));
}

static void test_objects_of_an_asdu(void **state)
{
	static const uint8_t two[] = {201, 2, 3, 0, 1, 0, 7, 0, 0, 0xaa, 9, 1, 0, 0xbb},
			     sequence[] = {201, 0x82, 3, 0, 1, 0, 7, 0, 0, 0xaa, 0xbb};
	struct iec104_asdu asdu;
	uint32_t ioa;

	(void)state;
	assert_true(iec104_asdu_decode(two, sizeof(two), &asdu));
	assert_ptr_equal(iec104_object(&asdu, 1, 0, &ioa), two + 9);
	assert_int_equal(ioa, 7);
	assert_ptr_equal(iec104_object(&asdu, 1, 1, &ioa), two + 13);
	assert_int_equal(ioa, 265);
	assert_null(iec104_object(&asdu, 1, 2, &ioa));
	assert_null(iec104_object(&asdu, 2, 0, &ioa));
	assert_true(iec104_asdu_decode(sequence, sizeof(sequence), &asdu));
	assert_ptr_equal(iec104_object(&asdu, 1, 1, &ioa), sequence + 10);
	assert_int_equal(ioa, 8);
	assert_true(iec104_asdu_decode(sequence, sizeof(sequence) - 1, &asdu));
	assert_null(iec104_object(&asdu, 1, 0, &ioa));
	assert_true(iec104_asdu_decode(sequence, IEC104_ASDU_HEADER, &asdu));
	assert_null(iec104_object(&asdu, 1, 0, &ioa));
}

int main(void)
{
	const struct CMUnitTest tests[] = {
	    cmocka_unit_test(test_an_apdu_of_35_octets),  cmocka_unit_test(test_back),
	    cmocka_unit_test(test_edges_both_ways),       cmocka_unit_test(test_what_does_not_fit),
	    cmocka_unit_test(test_no_place_on_the_earth), cmocka_unit_test(test_the_private_range),
	    cmocka_unit_test(test_objects_of_an_asdu),
	};
	return cmocka_run_group_tests_name("iec104 geoposition", tests, NULL, NULL);
}
