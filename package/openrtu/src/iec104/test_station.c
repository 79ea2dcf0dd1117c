/* SPDX-License-Identifier: GPL-3.0-or-later */
/* What the station bears: any request, well-formed or not, on any connection. */
#include "iec104/test_masters.h"

#include <string.h>

/* ---- requests ----------------------------------------------------------------------------------- */

static void test_test_command(void **state)
{
	(void)state;
	ASK(0, C_TS_TA, 1, ACT, 3, CA_3067, IOA(0), 0x34, 0x12, TIME);
	EXPECT(0, C_TS_TA, 1, ACT_CON, 3, CA_3067, IOA(0), 0x34, 0x12, TIME);
	expect_nothing(0);
}

static void test_refusals(void **state)
{
	(void)state;
	ASK(0, 44, 1, ACT, 5, CA_3067, IOA(1), 1, 2, 3);
	EXPECT(0, 44, 1, NEGATIVE | UNKNOWN_TYPE, 5, CA_3067, IOA(1), 1, 2, 3);
	ASK(0, 52, 1, ACT, 5, CA_3067, IOA(1), 1);
	EXPECT(0, 52, 1, NEGATIVE | UNKNOWN_TYPE, 5, CA_3067, IOA(1), 1);
	ASK(0, 201, 0xff, 0x86, 5, 1, 0);
	EXPECT(0, 201, 0xff, 0xc0 | 44, 5, 1, 0);
	ASK(0, C_SC_NA, 1, REQUEST, 5, CA_3067, IOA(4), 1);
	EXPECT(0, C_SC_NA, 1, NEGATIVE | UNKNOWN_CAUSE, 5, CA_3067, IOA(4), 1);
	ASK(0, C_RD_NA, 1, ACT, 5, CA_3067, IOA(4));
	EXPECT(0, C_RD_NA, 1, NEGATIVE | UNKNOWN_CAUSE, 5, CA_3067, IOA(4));
	ASK(0, C_CS_NA, 1, DEACT, 5, CA_3067, IOA(0), TIME);
	EXPECT(0, C_CS_NA, 1, NEGATIVE | UNKNOWN_CAUSE, 5, CA_3067, IOA(0), TIME);
	ASK(0, C_SC_NA, 1, ACT, 5, CA_UNKNOWN, IOA(4), 1);
	EXPECT(0, C_SC_NA, 1, NEGATIVE | UNKNOWN_CA, 5, CA_UNKNOWN, IOA(4), 1);
	ASK(0, C_SC_NA, 1, ACT, 5, CA_ALL, IOA(4), 1);
	EXPECT(0, C_SC_NA, 1, NEGATIVE | UNKNOWN_CA, 5, CA_ALL, IOA(4), 1);
	acknowledge(&masters[0]);
	ASK(0, C_RD_NA, 1, REQUEST, 5, CA_ALL, IOA(4));
	EXPECT(0, C_RD_NA, 1, NEGATIVE | UNKNOWN_CA, 5, CA_ALL, IOA(4));
	ASK(0, C_SC_NA, 1, ACT, 5, CA_3067, IOA(5), 1);
	EXPECT(0, C_SC_NA, 1, NEGATIVE | UNKNOWN_IOA, 5, CA_3067, IOA(5), 1);
	ASK(0, C_SC_NA, 1, ACT, 5, CA_3067, IOA(10001), 1); /* a discrete input */
	EXPECT(0, C_SC_NA, 1, NEGATIVE | UNKNOWN_IOA, 5, CA_3067, IOA(10001), 1);
	ASK(0, C_SE_NB, 1, ACT, 5, CA_3067, IOA(4), 1, 0, 0); /* of another type */
	EXPECT(0, C_SE_NB, 1, NEGATIVE | UNKNOWN_IOA, 5, CA_3067, IOA(4), 1, 0, 0);
	ASK(0, C_IC_NA, 1, ACT, 5, CA_3067, IOA(1), 20);
	EXPECT(0, C_IC_NA, 1, NEGATIVE | UNKNOWN_IOA, 5, CA_3067, IOA(1), 20);
	ASK(0, C_CS_NA, 1, ACT, 5, CA_3067, IOA(1), TIME);
	EXPECT(0, C_CS_NA, 1, NEGATIVE | UNKNOWN_IOA, 5, CA_3067, IOA(1), TIME);
	ASK(0, C_RD_NA, 1, REQUEST, 5, CA_3067, IOA(99));
	EXPECT(0, C_RD_NA, 1, NEGATIVE | UNKNOWN_IOA, 5, CA_3067, IOA(99));
	expect_nothing(0);
	assert_int_equal(fake.request_count, 0);
}

/* 101, 7.3.4 and 7.3.5: the address of a system command is 0, and a test command is for one station. */
static void test_addresses_of_system_commands(void **state)
{
	(void)state;
	ASK(0, C_CI_NA, 1, ACT, 5, CA_4001, IOA(65536), 5);
	EXPECT(0, C_CI_NA, 1, NEGATIVE | UNKNOWN_IOA, 5, CA_4001, IOA(65536), 5);
	ASK(0, C_TS_TA, 1, ACT, 5, CA_3067, IOA(256), 1, 0, TIME);
	EXPECT(0, C_TS_TA, 1, NEGATIVE | UNKNOWN_IOA, 5, CA_3067, IOA(256), 1, 0, TIME);
	ASK(0, C_TS_TA, 1, ACT, 5, CA_ALL, IOA(0), 1, 0, TIME);
	EXPECT(0, C_TS_TA, 1, NEGATIVE | UNKNOWN_CA, 5, CA_ALL, IOA(0), 1, 0, TIME);
	expect_nothing(0);
	assert_int_equal(fake.request_count, 0);
}

/* Nothing is in them that an answer could be about. */
static void test_too_short_closes(void **state)
{
	static const struct {
		uint8_t bytes[16];
		size_t size;
	} wrong[] = {
	    {{45}, 1},
	    {{45, 1, 6, 0, 0xfb}, 5},
	    {{45, 1, 6, 0, 0xfb, 0x0b}, 6},
	    {{45, 1, 6, 0, 0xfb, 0x0b, 4, 0, 0}, 9},
	    {{45, 0, 6, 0, 0xfb, 0x0b, 4, 0, 0, 1}, 10},
	    {{45, 0x80, 6, 0, 0xfb, 0x0b, 4, 0, 0, 1}, 10},
	    {{45, 2, 6, 0, 0xfb, 0x0b, 4, 0, 0, 1, 4, 0, 0}, 13},
	    {{45, 0x83, 6, 0, 0xfb, 0x0b, 4, 0, 0, 1, 1}, 11},
	    {{100, 1, 6, 0, 0xfb, 0x0b, 0, 0, 0}, 9},
	};

	(void)state;
	for (size_t i = 0; i < sizeof(wrong) / sizeof(wrong[0]); i++) {
		connect_master(1, true);
		start(1);
		ask(&masters[1], wrong[i].bytes, wrong[i].size);
		assert_int_equal(masters[1].connection->session.closing, IEC104_BAD_ASDU);
		iec104_station_disconnect(&station, masters[1].connection);
	}
	assert_int_equal(fake.request_count, 0);
}

/* A request has one object, SQ = 0. What is behind the objects is not mirrored. */
static void test_other_than_one_object_is_refused(void **state)
{
	(void)state;
	ASK(0, C_SC_NA, 0x81, ACT, 5, CA_3067, IOA(4), 1);
	EXPECT(0, C_SC_NA, 0x81, NEGATIVE | ACT_CON, 5, CA_3067, IOA(4), 1);
	ASK(0, C_SC_NA, 2, ACT, 5, CA_3067, IOA(4), 1, 4, 0, 0, 0);
	EXPECT(0, C_SC_NA, 2, NEGATIVE | ACT_CON, 5, CA_3067, IOA(4), 1, 4, 0, 0, 0);
	ASK(0, C_SC_NA, 0x82, DEACT, 5, CA_3067, IOA(4), 1, 0);
	EXPECT(0, C_SC_NA, 0x82, NEGATIVE | DEACT_CON, 5, CA_3067, IOA(4), 1, 0);
	ASK(0, C_SC_NA, 1, ACT, 5, CA_3067, IOA(4), 1, 0xaa);
	EXPECT(0, C_SC_NA, 1, NEGATIVE | ACT_CON, 5, CA_3067, IOA(4), 1);
	ASK(0, C_SC_NA, 1, REQUEST, 5, CA_3067, IOA(4), 1, 0xaa);
	EXPECT(0, C_SC_NA, 1, NEGATIVE | UNKNOWN_CAUSE, 5, CA_3067, IOA(4), 1);
	ASK(0, C_SC_NA, 2, ACT, 5, CA_UNKNOWN, IOA(4), 1, 4, 0, 0, 0);
	EXPECT(0, C_SC_NA, 2, NEGATIVE | UNKNOWN_CA, 5, CA_UNKNOWN, IOA(4), 1, 4, 0, 0, 0);
	ASK(0, C_RD_NA, 2, REQUEST, 5, CA_3067, IOA(4), 4, 0, 0);
	EXPECT(0, C_RD_NA, 2, NEGATIVE | REQUEST, 5, CA_3067, IOA(4), 4, 0, 0);
	ASK(0, C_RD_NA, 0x8f, REQUEST, 5, CA_3067, IOA(4));
	EXPECT(0, C_RD_NA, 0x8f, NEGATIVE | REQUEST, 5, CA_3067, IOA(4));
	acknowledge(&masters[0]);
	ASK(0, C_IC_NA, 1, ACT, 5, CA_ALL, IOA(0), 20, 0, 0);
	EXPECT(0, C_IC_NA, 1, NEGATIVE | ACT_CON, 5, CA_ALL, IOA(0), 20);
	expect_nothing(0);
	assert_int_equal(fake.request_count, 0);
	assert_int_equal(fake.stats.counters[IEC104_COUNT_NEGATIVE], 7);
}

static void test_station_without_devices(void **state)
{
	(void)state;
	fake.config.set_count = fake.config.point_count = 0;
	put_event(MAP_EVENT_MODULE_UP, 1, (struct map_sample){.time_ns = now});
	put_event(MAP_EVENT_MODULE_DOWN, 1, (struct map_sample){.time_ns = now});
	now += 2 * S;
	ASK(0, C_IC_NA, 1, ACT, 0, CA_ALL, IOA(0), 20);
	EXPECT(0, C_IC_NA, 1, NEGATIVE | UNKNOWN_CA, 0, CA_ALL, IOA(0), 20);
	expect_nothing(0);
}

/* ---- connections -------------------------------------------------------------------------------- */

static void test_number_of_connections(void **state)
{
	(void)state;
	connect_master(1, true);
	connect_master(2, true);
	assert_null(iec104_station_connect(
	    &station, &(struct iec104_peer){"one too many", "10.0.0.9", MAP_NONE, true}, now));
	iec104_station_disconnect(&station, masters[1].connection);
	connect_master(1, true);
}

/* Requests without end and no acknowledgement: the answers are bounded, and the connection ends. */
static void test_master_that_only_asks(void **state)
{
	unsigned asked = 0;

	(void)state;
	masters[0].mute = true;
	while (masters[0].connection->session.closing == IEC104_OPEN && asked < 2000) {
		ASK(0, C_TS_TA, 1, ACT, 0, CA_3067, IOA(0), 1, 0, TIME);
		while (next_frame(&masters[0]) != NULL)
			;
		asked++;
	}
	assert_int_equal(masters[0].connection->session.closing, IEC104_UNREAD_ANSWERS);
	assert_true(asked > 400);
}

static void test_log_is_not_flooded(void **state)
{
	(void)state;
	now += 100 * S;
	for (int i = 0; i < 1000; i++) {
		iec104_station_disconnect(&station, masters[0].connection);
		connect_master(0, true);
	}
	assert_in_range(fake.log_count, 10, 100);
	fake.log_count = 0;
	now += 250 * MS;
	start(0);
	assert_int_equal(fake.log_count, 2); /* how many were left out, and this one */
}

/* ---- random ------------------------------------------------------------------------------------- */

static uint32_t random_state = 1;

static uint32_t random_below(uint32_t limit)
{
	random_state ^= random_state << 13;
	random_state ^= random_state >> 17;
	random_state ^= random_state << 5;
	return random_state % limit;
}

static size_t random_asdu(uint8_t asdu[20])
{
	static const uint8_t types[] = {45, 46, 48, 49,  50,  51,  58,  59, 61,
					62, 63, 64, 100, 101, 102, 103, 107};
	static const uint8_t cas[][2] = {{0xfb, 0x0b}, {0xa1, 0x0f}, {0xff, 0xff}, {0, 0}};
	uint8_t type = types[random_below(sizeof(types))];
	size_t size = 6 + iec104_control_object_size(type);

	for (size_t i = 0; i < 20; i++)
		asdu[i] = (uint8_t)random_below(256);
	asdu[0] = type;
	asdu[1] = 1;
	asdu[2] = (uint8_t)(random_below(4) ? 6 : random_below(256));
	memcpy(asdu + 4, cas[random_below(4)], 2);
	asdu[6] = (uint8_t)random_below(16);
	asdu[7] = asdu[8] = 0;
	if (random_below(100) == 0)
		size = 1 + random_below(20);
	return size;
}

static void test_random_requests(void **state)
{
	uint8_t asdu[21] = {0};

	(void)state;
	for (int i = 0; i < 30000; i++) {
		if (masters[0].connection->session.closing != IEC104_OPEN) {
			iec104_station_disconnect(&station, masters[0].connection);
			connect_master(0, true);
			start(0);
		}
		if (random_below(3) == 0)
			put_event((enum map_event_kind)random_below(4), 1 + random_below(2),
				  (struct map_sample){.time_ns = now});
		ask(&masters[0], asdu, random_asdu(asdu));
		if (fake.request_count > 12) {
			fake.request_count = 0;
			fake.answer_count = fake.answers_read = 0;
			for (uint32_t id = 1; id <= 12; id++)
				answer(id, (enum map_command_state)random_below(10), MAP_RESULT_NONE);
			fake.answer_count = 12;
		}
		now += random_below(100) * MS;
		while (next_frame(&masters[0]) != NULL)
			;
	}
}

int main(void)
{
	const struct CMUnitTest tests[] = {
	    TEST(test_test_command),
	    TEST(test_refusals),
	    TEST(test_addresses_of_system_commands),
	    TEST(test_too_short_closes),
	    TEST(test_other_than_one_object_is_refused),
	    TEST(test_station_without_devices),
	    TEST(test_number_of_connections),
	    TEST(test_master_that_only_asks),
	    TEST(test_log_is_not_flooded),
	    TEST(test_random_requests),
	};

	return cmocka_run_group_tests(tests, NULL, NULL);
}
