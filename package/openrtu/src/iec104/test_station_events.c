/* SPDX-License-Identifier: GPL-3.0-or-later */
/* What the station sends unasked: events, and values that have a period. */
#include "iec104/test_masters.h"

static void test_events(void **state)
{
	(void)state;
	publish(COIL4, 0);
	publish(0, 1);
	publish(HOLDING3, 255);
	fake.clock.set = false;
	run();
	EXPECT(0, M_SP_TB, 2, SPONTANEOUS, 0, CA_3067, IOA(4), 0, 0x18, 0xbc, 0x98, 13, 19, 2, 25, 1, 0, 0, 1,
	       0x18, 0xbc, 0x98, 13, 19, 2, 25);
	EXPECT(0, M_ME_TE, 1, SPONTANEOUS, 0, CA_3067, IOA(40003), 255, 0, 0, 0x18, 0xbc, 0x98, 13, 19, 2,
	       25);
	fake.clock.set = true;
	publish(COUNTER, 7);
	run();
	EXPECT(0, M_IT_TB, 1, SPONTANEOUS, 0, CA_4001, IOA(15), 7, 0, 0, 0, 0, TIME);
	expect_nothing(0);
}

static void test_every_master_has_its_own_events(void **state)
{
	static const uint8_t stopdt[] = {0x68, 4, 0x13, 0, 0, 0};

	(void)state;
	publish(COIL4, 0); /* before the first STARTDT of the second */
	connect_master(1, false);
	publish(COIL4, 1);
	run();
	EXPECT(0, M_SP_TB, 2, SPONTANEOUS, 0, CA_3067, IOA(4), 0, TIME, 4, 0, 0, 1, TIME);
	start(1);
	expect_nothing(1);
	publish(COIL4, 0);
	run();
	EXPECT(0, M_SP_TB, 1, SPONTANEOUS, 0, CA_3067, IOA(4), 0, TIME);
	EXPECT(1, M_SP_TB, 1, SPONTANEOUS, 0, CA_3067, IOA(4), 0, TIME);
	acknowledge(&masters[1]);
	put_bytes(&masters[1], stopdt, sizeof(stopdt));
	assert_non_null(next_frame(&masters[1]));
	publish(COIL4, 1);
	expect_nothing(1);
	start(1); /* what happened between STOPDT and STARTDT is not lost */
	EXPECT(1, M_SP_TB, 1, SPONTANEOUS, 0, CA_3067, IOA(4), 1, TIME);
}

static void test_many_events(void **state)
{
	unsigned received = 0;

	(void)state;
	for (int i = 0; i < 1000; i++)
		publish(HOLDING3, i);
	run();
	while (received < 1000) {
		const uint8_t *frame = next_frame(&masters[0]);

		if (frame == NULL) {
			acknowledge(&masters[0]);
			continue;
		}
		assert_int_equal(frame[6], 35);
		for (unsigned i = 0; i < frame[7]; i++, received++)
			assert_int_equal(frame[15 + 13 * i] | frame[16 + 13 * i] << 8, received);
	}
	expect_nothing(0);
}

static void change_while_read(uint32_t point)
{
	if (point != 5)
		return;
	fake.on_read = NULL;
	publish(COIL4, 0);
	publish(COIL4, 1);
	publish(COIL4, 0);
}

/* The events come first; the interrogation then reports what was true after them. */
static void test_event_is_not_overtaken_by_an_interrogation(void **state)
{
	(void)state;
	fake.on_read = change_while_read;
	ASK(0, C_IC_NA, 1, ACT, 0, CA_3067, IOA(0), 20);
	EXPECT(0, C_IC_NA, 1, ACT_CON, 0, CA_3067, IOA(0), 20);
	EXPECT(0, M_SP_NA, 0x84, INTERROGATED, 0, CA_3067, IOA(1), 0, 1, 0, 1);
	EXPECT(0, M_SP_TB, 3, SPONTANEOUS, 0, CA_3067, IOA(4), 0, TIME, 4, 0, 0, 1, TIME, 4, 0, 0, 0, TIME);
	EXPECT(0, M_SP_NA, 0x83, INTERROGATED, 0, CA_3067, IOA(10001), 0, 1, 0);
}

static void change_coil4_while_read(uint32_t point)
{
	if (point != COIL4)
		return;
	fake.on_read = NULL;
	publish(COIL4, 0);
	publish(COIL4, 1);
	publish(COIL4, 0);
}

static void test_read_value_is_not_followed_by_an_older_event(void **state)
{
	(void)state;
	fake.on_read = change_coil4_while_read;
	ASK(0, C_RD_NA, 1, REQUEST, 7, CA_3067, IOA(4));
	EXPECT(0, M_SP_TB, 3, SPONTANEOUS, 0, CA_3067, IOA(4), 0, TIME, 4, 0, 0, 1, TIME, 4, 0, 0, 0, TIME);
	EXPECT(0, M_SP_NA, 1, REQUEST, 7, CA_3067, IOA(4), 0);
	expect_nothing(0);
}

static void test_module_down_and_up(void **state)
{
	(void)state;
	publish(DOUBLE1, 2);
	fake.dead[2] = true;
	put_event(MAP_EVENT_MODULE_DOWN, 2, (struct map_sample){.time_ns = now});
	now += 100 * MS;
	run();
	EXPECT(0, M_DP_TB, 1, SPONTANEOUS, 0, CA_4001, IOA(1), 2, TIME);
	EXPECT(0, M_DP_TB, 2, SPONTANEOUS, 0, CA_4001, IOA(1), 0x82, TIME, 3, 0, 0, 0x81, TIME);
	EXPECT(0, M_ST_TB, 1, SPONTANEOUS, 0, CA_4001, IOA(5), 0, 0x80, TIME);
	EXPECT(0, M_BO_TB, 1, SPONTANEOUS, 0, CA_4001, IOA(7), 1, 0, 0, 0, 0x80, TIME);
	EXPECT(0, M_ME_TD, 1, SPONTANEOUS, 0, CA_4001, IOA(9), 0, 0, 0x80, TIME);
	EXPECT(0, M_ME_TF, 1, SPONTANEOUS, 0, CA_4001, IOA(11), 0, 0, 0xc0, 0x3f, 0x80, TIME);
	EXPECT(0, M_IT_TB, 1, SPONTANEOUS, 0, CA_4001, IOA(15), 0, 0, 0, 0, 0x80, TIME);
	acknowledge(&masters[0]);
	expect_nothing(0);
	fake.dead[2] = false;
	for (uint32_t i = DOUBLE1; i < POINTS; i++)
		fake.samples[i].quality = MAP_INVALID;
	fake.samples[BITS] = (struct map_sample){.value.u = 5, .time_ns = now - 100 * MS};
	put_event(MAP_EVENT_MODULE_UP, 2, (struct map_sample){.time_ns = now});
	run();
	EXPECT(0, M_BO_TB, 1, SPONTANEOUS, 0, CA_4001, IOA(7), 5, 0, 0, 0, 0, TIME_OF_RETURN);
	expect_nothing(0);
}

/* Nothing that came later is told as of the time at which the module was lost, and what an event tells is told once. */
static void test_module_down_and_up_are_told_late(void **state)
{
	(void)state;
	hold_back(0);
	put_event(MAP_EVENT_MODULE_DOWN, 2, (struct map_sample){.time_ns = now});
	now += 100 * MS;
	publish(DOUBLE1, 2);
	put_event(MAP_EVENT_MODULE_UP, 2, (struct map_sample){.time_ns = now});
	publish(NORMALIZED, 7);
	for (uint32_t i = DOUBLE1; i < POINTS; i++)
		fake.samples[i].time_ns = now;
	acknowledge(&masters[0]);
	EXPECT(0, M_DP_TB, 2, SPONTANEOUS, 0, CA_4001, IOA(1), 0x80, TIME, 3, 0, 0, 0x81, TIME);
	EXPECT(0, M_ST_TB, 1, SPONTANEOUS, 0, CA_4001, IOA(5), 0, 0x80, TIME);
	EXPECT(0, M_BO_TB, 1, SPONTANEOUS, 0, CA_4001, IOA(7), 1, 0, 0, 0, 0x80, TIME);
	EXPECT(0, M_ME_TD, 1, SPONTANEOUS, 0, CA_4001, IOA(9), 0, 0, 0x80, TIME);
	EXPECT(0, M_ME_TF, 1, SPONTANEOUS, 0, CA_4001, IOA(11), 0, 0, 0xc0, 0x3f, 0x80, TIME);
	EXPECT(0, M_IT_TB, 1, SPONTANEOUS, 0, CA_4001, IOA(15), 0, 0, 0, 0, 0x80, TIME);
	acknowledge(&masters[0]);
	EXPECT(0, M_DP_TB, 1, SPONTANEOUS, 0, CA_4001, IOA(1), 2, TIME_OF_RETURN);
	EXPECT(0, M_ME_TD, 1, SPONTANEOUS, 0, CA_4001, IOA(9), 7, 0, 0, TIME_OF_RETURN);
	EXPECT(0, M_DP_TB, 1, SPONTANEOUS, 0, CA_4001, IOA(3), 1, TIME_OF_RETURN);
	EXPECT(0, M_ST_TB, 1, SPONTANEOUS, 0, CA_4001, IOA(5), 0, 0, TIME_OF_RETURN);
	EXPECT(0, M_BO_TB, 1, SPONTANEOUS, 0, CA_4001, IOA(7), 1, 0, 0, 0, 0, TIME_OF_RETURN);
	EXPECT(0, M_ME_TF, 1, SPONTANEOUS, 0, CA_4001, IOA(11), 0, 0, 0xc0, 0x3f, 0, TIME_OF_RETURN);
	EXPECT(0, M_IT_TB, 1, SPONTANEOUS, 0, CA_4001, IOA(15), 0, 0, 0, 0, 0, TIME_OF_RETURN);
	acknowledge(&masters[0]);
	expect_nothing(0);
}

/* rtud noticed it, and was stopped before it told it: the module was back meanwhile. */
static void test_module_down_is_told_behind_what_came_later(void **state)
{
	const struct map_sample lost = {.time_ns = now};

	(void)state;
	now += 100 * MS;
	publish(DOUBLE1, 2);
	run();
	EXPECT(0, M_DP_TB, 1, SPONTANEOUS, 0, CA_4001, IOA(1), 2, TIME_OF_RETURN);
	put_event(MAP_EVENT_MODULE_DOWN, 2, lost);
	run();
	EXPECT(0, M_DP_TB, 2, SPONTANEOUS, 0, CA_4001, IOA(1), 0x82, TIME_OF_RETURN, 3, 0, 0, 0x81,
	       TIME_OF_RETURN);
}

/* What was sent as invalid meanwhile is sent again. */
static void test_heartbeat_is_missing_for_a_moment(void **state)
{
	(void)state;
	fake.samples[FLOAT].time_ns = now;
	fake.silent[2] = true;
	ASK(0, C_RD_NA, 1, REQUEST, 0, CA_4001, IOA(11));
	EXPECT(0, M_ME_NC, 1, REQUEST, 0, CA_4001, IOA(11), 0, 0, 0xc0, 0x3f, 0x80);
	expect_nothing(0);
	assert_true(iec104_station_deadline(&station) <= now + 100 * MS);
	for (uint32_t i = DOUBLE1; i < POINTS; i++)
		if (i != FLOAT)
			fake.samples[i].quality = MAP_INVALID; /* at their device */
	fake.silent[2] = false;
	run();
	EXPECT(0, M_ME_TF, 1, SPONTANEOUS, 0, CA_4001, IOA(11), 0, 0, 0xc0, 0x3f, 0, TIME);
	expect_nothing(0);
}

/* An interrogation has seen what rtud's event tells too. */
static void test_return_is_told_once(void **state)
{
	(void)state;
	for (uint32_t i = DOUBLE1; i < POINTS; i++)
		if (i != FLOAT)
			fake.samples[i].quality = MAP_INVALID;
	fake.silent[2] = true;
	put_event(MAP_EVENT_MODULE_DOWN, 2, (struct map_sample){.time_ns = now});
	run();
	while (next_frame(&masters[0]) != NULL)
		acknowledge(&masters[0]);
	ASK(0, C_RD_NA, 1, REQUEST, 0, CA_4001, IOA(11));
	EXPECT(0, M_ME_NC, 1, REQUEST, 0, CA_4001, IOA(11), 0, 0, 0xc0, 0x3f, 0x80);
	now += 100 * MS;
	publish(NORMALIZED, 7); /* before its heartbeat */
	run();
	EXPECT(0, M_ME_TD, 1, SPONTANEOUS, 0, CA_4001, IOA(9), 7, 0, 0, TIME_OF_RETURN);
	fake.silent[2] = false;
	run();
	EXPECT(0, M_ME_TF, 1, SPONTANEOUS, 0, CA_4001, IOA(11), 0, 0, 0xc0, 0x3f, 0, TIME_OF_RETURN);
	put_event(MAP_EVENT_MODULE_UP, 2, (struct map_sample){.time_ns = now});
	expect_nothing(0);
}

/* A module that stood between reading and publishing: its value is from before the loss, so the return is told as well. */
static void test_what_comes_late_from_before_a_loss_is_no_return(void **state)
{
	const struct map_sample read = {.value.i = 7, .time_ns = now};

	(void)state;
	now += 100 * MS;
	put_event(MAP_EVENT_MODULE_DOWN, 2, (struct map_sample){.time_ns = now});
	run();
	while (next_frame(&masters[0]) != NULL)
		acknowledge(&masters[0]);
	for (uint32_t i = DOUBLE1; i < POINTS; i++)
		fake.samples[i].quality = MAP_INVALID;
	fake.samples[NORMALIZED] = read;
	put_event(MAP_EVENT_CHANGE, NORMALIZED, read);
	run();
	EXPECT(0, M_ME_TD, 1, SPONTANEOUS, 0, CA_4001, IOA(9), 7, 0, 0, TIME);
	put_event(MAP_EVENT_MODULE_UP, 2, (struct map_sample){.time_ns = now});
	run();
	EXPECT(0, M_ME_TD, 1, SPONTANEOUS, 0, CA_4001, IOA(9), 7, 0, 0, TIME_OF_RETURN);
	expect_nothing(0);
}

static void test_lost_events(void **state)
{
	(void)state;
	hold_back(0);
	masters[0].connection->cursor.lost += 3;
	for (uint32_t i = 0; i < 13; i++)
		fake.samples[i].time_ns = now;
	publish(COIL4, 1);
	fake.samples[0].quality = MAP_INVALID;
	acknowledge(&masters[0]);
	EXPECT(0, M_SP_TB, 1, SPONTANEOUS, 0, CA_3067, IOA(4), 1, TIME);
	EXPECT(0, M_SP_TB, 7, SPONTANEOUS, 0, CA_3067, IOA(1), 0x80, TIME, 2, 0, 0, 1, TIME, 3, 0, 0, 0, TIME,
	       4, 0, 0, 1, TIME, 0x11, 0x27, 0, 0, TIME, 0x12, 0x27, 0, 1, TIME, 0x13, 0x27, 0, 0, TIME);
	assert_int_equal(next_frame(&masters[0])[7], 6); /* scaled */
	assert_int_equal(next_frame(&masters[0])[6], 31);
}

/* A clock that is set a year on or back dates events and moves no deadline: t1..t3 are CLOCK_MONOTONIC. */
static void test_steps_of_the_clock_fire_no_timer(void **state)
{
	const int64_t year_ns = 366 * 86400 * S;

	(void)state;
	publish(COIL4, 0);
	run();
	EXPECT(0, M_SP_TB, 1, SPONTANEOUS, 0, CA_3067, IOA(4), 0, TIME);
	for (int direction = -1; direction <= 1; direction += 2) {
		int64_t deadline_ns = iec104_session_deadline(&masters[0].connection->session);

		fake.clock.offset_ns += direction * year_ns;
		now += MS;
		expect_nothing(0);
		assert_true(iec104_session_deadline(&masters[0].connection->session) == deadline_ns);
		fake.clock.offset_ns -= direction * year_ns;
	}
	now += 15 * S - 2 * MS - 1;
	run();
	assert_int_equal(masters[0].connection->session.closing, IEC104_OPEN);
	now += 1;
	run();
	assert_int_equal(masters[0].connection->session.closing, IEC104_T1_I_FRAME);
}

/* ---- periodic values ---------------------------------------------------------------------------- */

static void test_periodic(void **state)
{
	(void)state;
	assert_true(iec104_station_deadline(&station) == 501 * S);
	now = 501 * S - 1;
	expect_nothing(0);
	now = 501 * S;
	run();
	EXPECT(0, M_ME_NA, 1, CYCLIC, 0, CA_4001, IOA(9), 0, 0, 0);
	assert_true(iec104_station_deadline(&station) == 502 * S);
	now = 505 * S + 3 * MS; /* late: once, not four times */
	run();
	EXPECT(0, M_DP_NA, 1, BACKGROUND, 0, CA_4001, IOA(3), 1); /* not a measured value: background scan */
	EXPECT(0, M_ME_NA, 1, CYCLIC, 0, CA_4001, IOA(9), 0, 0, 0);
	expect_nothing(0);
	assert_true(iec104_station_deadline(&station) == 506 * S);
}

/* One type, two stations: never in one ASDU. */
static void test_stations_are_kept_apart(void **state)
{
	(void)state;
	points[HOLDING3].send_period_ms = 1000;
	points[NORMALIZED].type = MAP_SCALED;
	publish(HOLDING3, 1);
	publish(NORMALIZED, 2);
	run();
	EXPECT(0, M_ME_TE, 1, SPONTANEOUS, 0, CA_3067, IOA(40003), 1, 0, 0, TIME);
	EXPECT(0, M_ME_TE, 1, SPONTANEOUS, 0, CA_4001, IOA(9), 2, 0, 0, TIME);
	now = 501 * S;
	run();
	EXPECT(0, M_ME_NB, 1, CYCLIC, 0, CA_3067, IOA(40003), 1, 0, 0);
	EXPECT(0, M_ME_NB, 1, CYCLIC, 0, CA_4001, IOA(9), 2, 0, 0);
	points[HOLDING3].send_period_ms = 0;
	points[NORMALIZED].type = MAP_NORMALIZED;
}

/* While k holds the values back, their time does not come again and again. */
static void test_periodic_while_nothing_is_acknowledged(void **state)
{
	(void)state;
	hold_back(0);
	now = 502 * S;
	expect_nothing(0);
	assert_true(iec104_station_deadline(&station) > now);
	acknowledge(&masters[0]);
	EXPECT(0, M_ME_NA, 1, CYCLIC, 0, CA_4001, IOA(9), 0, 0, 0);
	expect_nothing(0);
	run();
	assert_true(iec104_station_deadline(&station) == 503 * S);
}

int main(void)
{
	const struct CMUnitTest tests[] = {
	    TEST(test_events),
	    TEST(test_every_master_has_its_own_events),
	    TEST(test_many_events),
	    TEST(test_event_is_not_overtaken_by_an_interrogation),
	    TEST(test_read_value_is_not_followed_by_an_older_event),
	    TEST(test_module_down_and_up),
	    TEST(test_module_down_and_up_are_told_late),
	    TEST(test_module_down_is_told_behind_what_came_later),
	    TEST(test_heartbeat_is_missing_for_a_moment),
	    TEST(test_return_is_told_once),
	    TEST(test_what_comes_late_from_before_a_loss_is_no_return),
	    TEST(test_lost_events),
	    TEST(test_steps_of_the_clock_fire_no_timer),
	    TEST(test_periodic),
	    TEST(test_stations_are_kept_apart),
	    TEST(test_periodic_while_nothing_is_acknowledged),
	};

	return cmocka_run_group_tests(tests, NULL, NULL);
}
