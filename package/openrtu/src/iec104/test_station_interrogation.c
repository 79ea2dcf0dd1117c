/* SPDX-License-Identifier: GPL-3.0-or-later */
/* The process image on request: interrogation of stations, groups and counters, and read. */
#include "iec104/test_masters.h"

static void expect_station_3067(unsigned master, uint8_t originator)
{
	EXPECT(master, C_IC_NA, 1, ACT_CON, originator, CA_3067, IOA(0), 20);
	EXPECT(master, M_SP_NA, 0x84, INTERROGATED, originator, CA_3067, IOA(1), 0, 1, 0, 1);
	EXPECT(master, M_SP_NA, 0x83, INTERROGATED, originator, CA_3067, IOA(10001), 0, 1, 0);
	EXPECT(master, M_ME_NB, 0x83, INTERROGATED, originator, CA_3067, IOA(30001), 1, 0, 0, 0, 0, 0, 1, 0,
	       0);
	EXPECT(master, M_ME_NB, 0x83, INTERROGATED, originator, CA_3067, IOA(40001), 0, 0, 0, 1, 0, 0, 0, 0,
	       0);
	EXPECT(master, C_IC_NA, 1, ACT_TERM, originator, CA_3067, IOA(0), 20);
}

static void expect_station_4001(unsigned master)
{
	EXPECT(master, C_IC_NA, 1, ACT_CON, 0, CA_4001, IOA(0), 20);
	EXPECT(master, M_DP_NA, 2, INTERROGATED, 0, CA_4001, IOA(1), 1, 3, 0, 0, 1);
	EXPECT(master, M_ST_NA, 1, INTERROGATED, 0, CA_4001, IOA(5), 0, 0);
	EXPECT(master, M_BO_NA, 1, INTERROGATED, 0, CA_4001, IOA(7), 1, 0, 0, 0, 0);
	EXPECT(master, M_ME_NA, 1, INTERROGATED, 0, CA_4001, IOA(9), 0, 0, 0);
	EXPECT(master, M_ME_NC, 1, INTERROGATED, 0, CA_4001, IOA(11), 0, 0, 0xc0, 0x3f, 0);
	EXPECT(master, C_IC_NA, 1, ACT_TERM, 0, CA_4001, IOA(0), 20);
}

static void test_interrogation(void **state)
{
	(void)state;
	ASK(0, C_IC_NA, 1, ACT, 9, CA_3067, IOA(0), 20);
	expect_station_3067(0, 9);
	expect_nothing(0);
}

static void test_interrogation_of_all_stations(void **state)
{
	(void)state;
	ASK(0, C_IC_NA, 1, ACT, 0, CA_ALL, IOA(0), 20);
	expect_station_3067(0, 0);
	acknowledge(&masters[0]); /* 13 ASDUs are one more than k */
	expect_station_4001(0);
	expect_nothing(0);
}

static void test_interrogation_of_a_group(void **state)
{
	(void)state;
	ASK(0, C_IC_NA, 1, ACT, 0, CA_4001, IOA(0), 22);
	EXPECT(0, C_IC_NA, 1, ACT_CON, 0, CA_4001, IOA(0), 22);
	EXPECT(0, M_DP_NA, 1, INTERROGATED + 2, 0, CA_4001, IOA(1), 1);
	EXPECT(0, M_ME_NA, 1, INTERROGATED + 2, 0, CA_4001, IOA(9), 0, 0, 0);
	EXPECT(0, C_IC_NA, 1, ACT_TERM, 0, CA_4001, IOA(0), 22);
	ASK(0, C_IC_NA, 1, ACT, 0, CA_4001, IOA(0), 36);
	EXPECT(0, C_IC_NA, 1, ACT_CON, 0, CA_4001, IOA(0), 36);
	EXPECT(0, M_ST_NA, 1, INTERROGATED + 16, 0, CA_4001, IOA(5), 0, 0);
	EXPECT(0, C_IC_NA, 1, ACT_TERM, 0, CA_4001, IOA(0), 36);
	ASK(0, C_IC_NA, 1, ACT, 0, CA_4001, IOA(0), 37);
	EXPECT(0, C_IC_NA, 1, NEGATIVE | ACT_CON, 0, CA_4001, IOA(0), 37);
	expect_nothing(0);
}

static void test_interrogation_of_counters(void **state)
{
	(void)state;
	fake.samples[COUNTER].value.i = 0x01020304;
	ASK(0, C_CI_NA, 1, ACT, 0, CA_4001, IOA(0), 5);
	EXPECT(0, C_CI_NA, 1, ACT_CON, 0, CA_4001, IOA(0), 5);
	EXPECT(0, M_IT_NA, 1, COUNTERS_REQUESTED, 0, CA_4001, IOA(15), 4, 3, 2, 1, 0);
	EXPECT(0, C_CI_NA, 1, ACT_TERM, 0, CA_4001, IOA(0), 5);
	for (uint8_t request = 0; request < 64; request++) {
		if (request >= 1 && request <= 5)
			continue;
		ASK(0, C_CI_NA, 1, ACT, 0, CA_4001, IOA(0), request);
		EXPECT(0, C_CI_NA, 1, NEGATIVE | ACT_CON, 0, CA_4001, IOA(0), request);
	}
	expect_nothing(0);
}

/* Two masters' frames at once, k = 12, acknowledged one by one: nothing is lost, nothing comes twice. */
static void test_interrogation_is_resumed(void **state)
{
	(void)state;
	fake.settings.k = 1;
	iec104_station_init(&station, &fake, sent_ns, places);
	connect_master(0, true);
	start(0);
	ASK(0, C_IC_NA, 1, ACT, 0, CA_3067, IOA(0), 20);
	EXPECT(0, C_IC_NA, 1, ACT_CON, 0, CA_3067, IOA(0), 20);
	expect_nothing(0);
	acknowledge(&masters[0]);
	EXPECT(0, M_SP_NA, 0x84, INTERROGATED, 0, CA_3067, IOA(1), 0, 1, 0, 1);
	expect_nothing(0);
	acknowledge(&masters[0]);
	EXPECT(0, M_SP_NA, 0x83, INTERROGATED, 0, CA_3067, IOA(10001), 0, 1, 0);
	acknowledge(&masters[0]);
	EXPECT(0, M_ME_NB, 0x83, INTERROGATED, 0, CA_3067, IOA(30001), 1, 0, 0, 0, 0, 0, 1, 0, 0);
	acknowledge(&masters[0]);
	EXPECT(0, M_ME_NB, 0x83, INTERROGATED, 0, CA_3067, IOA(40001), 0, 0, 0, 1, 0, 0, 0, 0, 0);
	acknowledge(&masters[0]);
	EXPECT(0, C_IC_NA, 1, ACT_TERM, 0, CA_3067, IOA(0), 20);
	acknowledge(&masters[0]);
	expect_nothing(0);
}

static void test_second_interrogation(void **state)
{
	(void)state;
	hold_back(0);
	ASK(0, C_IC_NA, 1, ACT, 1, CA_3067, IOA(0), 20);
	ASK(0, C_IC_NA, 1, ACT, 2, CA_3067, IOA(0), 21); /* of the same station */
	ASK(0, C_IC_NA, 1, ACT, 0, CA_4001, IOA(0), 20); /* of another */
	acknowledge(&masters[0]);
	EXPECT(0, C_IC_NA, 1, NEGATIVE | ACT_CON, 2, CA_3067, IOA(0), 21);
	expect_station_3067(0, 1);
	acknowledge(&masters[0]);
	expect_station_4001(0);
	expect_nothing(0);
}

static void test_second_interrogation_of_all_stations(void **state)
{
	(void)state;
	ASK(0, C_IC_NA, 1, ACT, 0, CA_ALL, IOA(0), 20);
	expect_station_3067(0, 0);
	while (next_frame(&masters[0]) != NULL)
		; /* of the second station, up to k */
	masters[0].mute = true;
	ASK(0, C_IC_NA, 1, ACT, 2, CA_ALL, IOA(0), 20);
	ASK(0, C_IC_NA, 1, DEACT, 3, CA_ALL, IOA(0), 20);
	acknowledge(&masters[0]);
	EXPECT(0, C_IC_NA, 1, NEGATIVE | ACT_CON, 2, CA_ALL, IOA(0), 20);
	EXPECT(0, C_IC_NA, 1, DEACT_CON, 3, CA_ALL, IOA(0), 20);
	expect_nothing(0);
}

static void test_deactivated_interrogation(void **state)
{
	(void)state;
	hold_back(0);
	ASK(0, C_IC_NA, 1, ACT, 1, CA_3067, IOA(0), 20);
	ASK(0, C_IC_NA, 1, DEACT, 1, CA_3067, IOA(0), 20);
	ASK(0, C_IC_NA, 1, DEACT, 1, CA_3067, IOA(0), 20);
	acknowledge(&masters[0]);
	EXPECT(0, C_IC_NA, 1, DEACT_CON, 1, CA_3067, IOA(0), 20);
	EXPECT(0, C_IC_NA, 1, NEGATIVE | DEACT_CON, 1, CA_3067, IOA(0), 20);
	expect_nothing(0);
}

static void test_stop_ends_an_interrogation(void **state)
{
	static const uint8_t stopdt[] = {0x68, 4, 0x13, 0, 0, 0}, con[] = {0x68, 4, 0x23, 0, 0, 0};

	(void)state;
	hold_back(0);
	ASK(0, C_IC_NA, 1, ACT, 1, CA_3067, IOA(0), 20);
	put_bytes(&masters[0], stopdt, sizeof(stopdt));
	assert_null(next_frame(&masters[0]));
	acknowledge(&masters[0]);
	assert_memory_equal(next_frame(&masters[0]), con, sizeof(con));
	start(0);
	expect_nothing(0);
}

/* The connection is lost in the middle: the next one in its place begins with nothing under way. */
static void test_interrogation_ends_with_its_connection(void **state)
{
	(void)state;
	fake.settings.k = 2;
	iec104_station_init(&station, &fake, sent_ns, places);
	connect_master(0, true);
	start(0);
	masters[0].mute = true;
	ASK(0, C_IC_NA, 1, ACT, 1, CA_ALL, IOA(0), 20);
	EXPECT(0, C_IC_NA, 1, ACT_CON, 1, CA_3067, IOA(0), 20);
	EXPECT(0, M_SP_NA, 0x84, INTERROGATED, 1, CA_3067, IOA(1), 0, 1, 0, 1);
	iec104_session_close(&masters[0].connection->session, IEC104_CLOSED_BY_PEER);
	run();
	iec104_station_disconnect(&station, masters[0].connection);
	connect_master(0, true);
	start(0);
	expect_nothing(0);
	ASK(0, C_IC_NA, 1, ACT, 2, CA_3067, IOA(0), 20);
	EXPECT(0, C_IC_NA, 1, ACT_CON, 2, CA_3067, IOA(0), 20);
	EXPECT(0, M_SP_NA, 0x84, INTERROGATED, 2, CA_3067, IOA(1), 0, 1, 0, 1);
}

static void test_test_bit_of_an_interrogation(void **state)
{
	(void)state;
	ASK(0, C_IC_NA, 1, TEST_BIT | ACT, 1, CA_4001, IOA(0), 36);
	EXPECT(0, C_IC_NA, 1, TEST_BIT | ACT_CON, 1, CA_4001, IOA(0), 36);
	EXPECT(0, M_ST_NA, 1, TEST_BIT | (INTERROGATED + 16), 1, CA_4001, IOA(5), 0, 0);
	EXPECT(0, C_IC_NA, 1, TEST_BIT | ACT_TERM, 1, CA_4001, IOA(0), 36);
}

/* ---- read --------------------------------------------------------------------------------------- */

static void test_read(void **state)
{
	(void)state;
	ASK(0, C_RD_NA, 1, REQUEST, 7, CA_4001, IOA(11));
	EXPECT(0, M_ME_NC, 1, REQUEST, 7, CA_4001, IOA(11), 0, 0, 0xc0, 0x3f, 0);
	expect_nothing(0);
}

/* A P/N bit in the request means nothing: it is not taken for a refusal that waits. */
static void test_read_with_pn(void **state)
{
	(void)state;
	ASK(0, C_RD_NA, 1, NEGATIVE | REQUEST, 7, CA_4001, IOA(11));
	EXPECT(0, M_ME_NC, 1, REQUEST, 7, CA_4001, IOA(11), 0, 0, 0xc0, 0x3f, 0);
	expect_nothing(0);
}

static void test_point_that_cannot_be_read_now(void **state)
{
	(void)state;
	fake.unreadable = 1;
	ASK(0, C_RD_NA, 1, REQUEST, 7, CA_3067, IOA(4));
	assert_null(next_frame(&masters[0]));
	assert_true(iec104_station_deadline(&station) == now + MS);
	now += MS;
	run();
	EXPECT(0, M_SP_NA, 1, REQUEST, 7, CA_3067, IOA(4), 1);
	fake.unreadable = 1;
	ASK(0, C_IC_NA, 1, ACT, 0, CA_3067, IOA(0), 20);
	EXPECT(0, C_IC_NA, 1, ACT_CON, 0, CA_3067, IOA(0), 20);
	assert_null(next_frame(&masters[0]));
	now += MS;
	run();
	EXPECT(0, M_SP_NA, 0x84, INTERROGATED, 0, CA_3067, IOA(1), 0, 1, 0, 1);
}

int main(void)
{
	const struct CMUnitTest tests[] = {
	    TEST(test_interrogation),
	    TEST(test_interrogation_of_all_stations),
	    TEST(test_interrogation_of_a_group),
	    TEST(test_interrogation_of_counters),
	    TEST(test_interrogation_is_resumed),
	    TEST(test_second_interrogation),
	    TEST(test_second_interrogation_of_all_stations),
	    TEST(test_deactivated_interrogation),
	    TEST(test_stop_ends_an_interrogation),
	    TEST(test_interrogation_ends_with_its_connection),
	    TEST(test_test_bit_of_an_interrogation),
	    TEST(test_read),
	    TEST(test_read_with_pn),
	    TEST(test_point_that_cannot_be_read_now),
	};

	return cmocka_run_group_tests(tests, NULL, NULL);
}
