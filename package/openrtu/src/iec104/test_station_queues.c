/* SPDX-License-Identifier: GPL-3.0-or-later */
/* Event queues: what is sent again, to whom, and what becomes of events that are too many. */
#include "iec104/test_masters.h"

#include <stdio.h>
#include <string.h>

#define GROUP 0

static const uint8_t stopdt[] = {0x68, 4, 0x13, 0, 0, 0};

/* HOLDING3 with this value, as an event. */
#define EXPECT_EVENT(master, value)                                                                          \
	EXPECT(master, M_ME_TE, 1, SPONTANEOUS, 0, CA_3067, IOA(40003), value, 0, 0, TIME)

/* One redundancy group, which has been there since before the first event. */
static int set_up_group(void **state)
{
	(void)state;
	fake_begin();
	fake.config.settings.queue_count = 1;
	fake.config.settings.queues[GROUP] = (struct map_queue_plan){.name = "centre", .limit = 1000};
	iec104_station_init(&station, &fake, sent_ns, places);
	return 0;
}

#define GROUP_TEST(name) cmocka_unit_test_setup(name, set_up_group)

/* One event in a frame of its own, which the master takes and does not acknowledge. */
static void send_event(unsigned master, int32_t value)
{
	publish(HOLDING3, value);
	run();
	EXPECT_EVENT(master, (uint8_t)value);
}

/* An S frame with this N(R). */
static void acknowledge_up_to(unsigned master, uint16_t nr)
{
	put_bytes(&masters[master], (const uint8_t[]){0x68, 4, 1, 0, (uint8_t)(nr << 1), (uint8_t)(nr >> 7)},
		  6);
}

static void restart_station(void)
{
	memset(&station, 0x5a, sizeof(station)); /* nothing of the former process is there */
	memset(places, 0x5a, sizeof(places));
	iec104_station_init(&station, &fake, sent_ns, places);
}

/* ---- what is said of losses ---------------------------------------------------------------- */

static int set_up_own_station(void **state)
{
	set_up_group(state);
	fake_own_station();
	fake.config.settings.queues[GROUP].limit = 6;
	iec104_station_init(&station, &fake, sent_ns, places);
	run();
	return 0;
}

#define OWN_TEST(name) cmocka_unit_test_setup(name, set_up_own_station)

/* Its own events are not among those that are lost again and again, and tell of each episode twice. */
static void test_losses_are_points(void **state)
{
	uint32_t events;

	(void)state;
	connect_from(0, "10.0.0.1", GROUP);
	start(0);
	EXPECT(0, M_SP_TB, 2, SPONTANEOUS, 0, CA_900, IOA(1), 0, TIME, 9, 0, 0, 0, TIME);
	EXPECT(0, M_BO_TB, 2, SPONTANEOUS, 0, CA_900, IOA(101), 0, 0, 0, 0, 0, TIME, 109, 0, 0, 0, 0, 0, 0, 0,
	       TIME);
	acknowledge(&masters[0]);
	put_bytes(&masters[0], stopdt, sizeof(stopdt));
	assert_non_null(next_frame(&masters[0]));
	events = fake.event_count;
	for (int32_t value = 1; value <= 10; value++)
		publish(HOLDING3, value);
	run();
	assert_int_equal(fake.event_count, events + 10 + 2); /* that it loses, and how many by now */
	assert_int_equal(fake.samples[POINTS].value.u, 1);
	assert_int_equal(fake.samples[POINTS + 1].value.u, 0);
	assert_int_equal(fake.samples[POINTS + 2].value.u, 4);
	for (int i = 0; i < 20; i++)
		run();
	assert_int_equal(fake.event_count, events + 10 + 2);
	assert_int_equal(fake.queues[GROUP].lost, 6); /* these two took the place of two others */
	start(0);
	EXPECT(0, M_ME_TE, 4, SPONTANEOUS, 0, CA_3067, IOA(40003), 7, 0, 0, TIME, 0x43, 0x9c, 0, 8, 0, 0,
	       TIME, 0x43, 0x9c, 0, 9, 0, 0, TIME, 0x43, 0x9c, 0, 10, 0, 0, TIME);
	EXPECT(0, M_SP_TB, 1, SPONTANEOUS, 0, CA_900, IOA(1), 1, TIME);
	EXPECT(0, M_BO_TB, 1, SPONTANEOUS, 0, CA_900, IOA(101), 4, 0, 0, 0, 0, TIME);
	for (const uint8_t *frame = NULL; fake.samples[POINTS].value.u == 1; frame = next_frame(&masters[0]))
		if (frame == NULL)
			acknowledge(&masters[0]); /* the values of all points follow */
	acknowledge(&masters[0]);
	run();
	while (next_frame(&masters[0]) != NULL)
		acknowledge(&masters[0]);
	assert_int_equal(fake.samples[POINTS + 2].value.u, 6);
	ASK(0, C_IC_NA, 1, ACT, 0, CA_900, IOA(0), 20);
	EXPECT(0, C_IC_NA, 1, ACT_CON, 0, CA_900, IOA(0), 20);
	EXPECT(0, M_SP_NA, 2, INTERROGATED, 0, CA_900, IOA(1), 0, 9, 0, 0, 0);
	EXPECT(0, M_BO_NA, 2, INTERROGATED, 0, CA_900, IOA(101), 6, 0, 0, 0, 0, 109, 0, 0, 0, 0, 0, 0, 0);
	EXPECT(0, C_IC_NA, 1, ACT_TERM, 0, CA_900, IOA(0), 20);
	expect_nothing(0);
}

static void test_losses_of_addresses_without_a_group(void **state)
{
	(void)state;
	fake.config.settings.event_ring = 8;
	connect_master(0, false);
	start(0);
	put_bytes(&masters[0], stopdt, sizeof(stopdt));
	assert_non_null(next_frame(&masters[0]));
	for (int32_t value = 1; value <= 9; value++)
		publish(HOLDING3, value);
	run();
	assert_int_equal(fake.samples[POINTS + 1].value.u, 1);
	assert_int_equal(fake.samples[POINTS + 3].value.u, 2);
}

/* ---- what is sent again ------------------------------------------------------------------- */

static void test_unacknowledged_events_are_sent_again(void **state)
{
	(void)state;
	for (int32_t value = 1; value <= 4; value++)
		send_event(0, value);
	acknowledge_up_to(0, 2);
	reconnect(0);
	publish(HOLDING3, 5);
	expect_nothing(0); /* not before STARTDT */
	start(0);
	EXPECT(0, M_ME_TE, 3, SPONTANEOUS, 0, CA_3067, IOA(40003), 3, 0, 0, TIME, 0x43, 0x9c, 0, 4, 0, 0,
	       TIME, 0x43, 0x9c, 0, 5, 0, 0, TIME);
	acknowledge(&masters[0]);
	reconnect(0);
	start(0);
	expect_nothing(0);
}

static void test_acknowledged_events_are_not_repeated_by_a_new_process(void **state)
{
	(void)state;
	for (int32_t value = 1; value <= 3; value++)
		send_event(0, value);
	acknowledge_up_to(0, 1);
	restart_station();
	connect_master(0, false);
	start(0);
	EXPECT(0, M_ME_TE, 2, SPONTANEOUS, 0, CA_3067, IOA(40003), 2, 0, 0, TIME, 0x43, 0x9c, 0, 3, 0, 0,
	       TIME);
	expect_nothing(0);
}

/* Other frames between those of events: each acknowledgement frees the events before it, and no others. */
static void test_events_among_answers(void **state)
{
	(void)state;
	masters[0].mute = true;
	ASK(0, C_TS_TA, 1, ACT, 0, CA_3067, IOA(0), 1, 0, TIME);
	assert_non_null(next_frame(&masters[0]));
	send_event(0, 1);
	ASK(0, C_TS_TA, 1, ACT, 0, CA_3067, IOA(0), 1, 0, TIME);
	assert_non_null(next_frame(&masters[0]));
	send_event(0, 2);
	acknowledge_up_to(0, 1);
	reconnect(0);
	start(0);
	EXPECT(0, M_ME_TE, 2, SPONTANEOUS, 0, CA_3067, IOA(40003), 1, 0, 0, TIME, 0x43, 0x9c, 0, 2, 0, 0,
	       TIME);
	acknowledge(&masters[0]);
	masters[0].mute = true;
	send_event(0, 3);
	ASK(0, C_TS_TA, 1, ACT, 0, CA_3067, IOA(0), 1, 0, TIME);
	assert_non_null(next_frame(&masters[0]));
	send_event(0, 4);
	acknowledge_up_to(0, 3);
	reconnect(0);
	start(0);
	EXPECT_EVENT(0, 4);
}

/* Over the whole ring of k places, and the end of the 15-bit numbers. */
static void test_many_disconnections(void **state)
{
	unsigned taken = 0; /* acknowledged values: the next one is expected */

	(void)state;
	masters[0].connection->session.next_ns = masters[0].nr = masters[0].connection->first_open = 32760;
	for (int32_t value = 0; value < 250; value++) {
		publish(HOLDING3, value);
		run();
		if (value % 3 == 0)
			while (next_frame(&masters[0]) != NULL) {
				acknowledge(&masters[0]);
				taken = (unsigned)value + 1;
			}
		if (value % 7 == 0) {
			const uint8_t *frame;

			reconnect(0);
			start(0);
			frame = next_frame(&masters[0]);
			if (taken > (unsigned)value) {
				assert_null(frame);
				continue;
			}
			assert_non_null(frame);
			assert_int_equal(frame[15], taken);
			acknowledge(&masters[0]);
			while (next_frame(&masters[0]) != NULL)
				acknowledge(&masters[0]);
			taken = (unsigned)value + 1;
		}
	}
}

/* A module's end is one event and many frames: it has left the queue when the last one is acknowledged. */
static void test_module_down_is_reported_whole(void **state)
{
	(void)state;
	fake.dead[2] = true;
	put_event(MAP_EVENT_MODULE_DOWN, 2, (struct map_sample){.time_ns = now});
	run();
	for (int i = 0; i < 6; i++)
		assert_non_null(next_frame(&masters[0]));
	acknowledge_up_to(0, 5);
	reconnect(0);
	start(0);
	EXPECT(0, M_DP_TB, 2, SPONTANEOUS, 0, CA_4001, IOA(1), 0x81, TIME, 3, 0, 0, 0x81, TIME);
	for (int i = 0; i < 5; i++)
		assert_non_null(next_frame(&masters[0]));
	acknowledge(&masters[0]);
	reconnect(0);
	start(0);
	expect_nothing(0);
}

/* What is owed of a module that came back is still owed to the next connection. */
static void test_refresh_outlives_the_connection(void **state)
{
	(void)state;
	put_event(MAP_EVENT_MODULE_UP, 2, (struct map_sample){.time_ns = now});
	for (uint32_t i = DOUBLE1; i < POINTS; i++)
		fake.samples[i] = (struct map_sample){.quality = i == BITS ? 0 : MAP_INVALID, .time_ns = now};
	run();
	EXPECT(0, M_BO_TB, 1, SPONTANEOUS, 0, CA_4001, IOA(7), 0, 0, 0, 0, 0, TIME);
	restart_station();
	connect_master(0, false);
	start(0);
	EXPECT(0, M_BO_TB, 1, SPONTANEOUS, 0, CA_4001, IOA(7), 0, 0, 0, 0, 0, TIME);
	acknowledge(&masters[0]);
	reconnect(0);
	start(0);
	expect_nothing(0);
}

/* ---- redundancy groups ---------------------------------------------------------------------- */

static void test_group_has_events_from_before_its_first_connection(void **state)
{
	(void)state;
	publish(HOLDING3, 1);
	run();
	connect_from(0, "10.0.0.1", GROUP);
	start(0);
	EXPECT_EVENT(0, 1);
}

static void test_switch_over_after_a_silent_failure(void **state)
{
	(void)state;
	connect_from(0, "10.0.0.1", GROUP);
	connect_from(1, "10.0.0.2", GROUP);
	start(0);
	send_event(0, 1);
	send_event(0, 2);
	acknowledge_up_to(0, 1);
	expect_nothing(1); /* in waiting */
	start(1);
	assert_int_equal(masters[0].connection->session.closing, IEC104_TAKEN_OVER);
	EXPECT_EVENT(1, 2);
	iec104_station_disconnect(&station, masters[0].connection);
	publish(HOLDING3, 3);
	run();
	EXPECT_EVENT(1, 3);
	acknowledge(&masters[1]);
	connect_from(0, "10.0.0.1", GROUP); /* and back */
	start(0);
	assert_int_equal(masters[1].connection->session.closing, IEC104_TAKEN_OVER);
	expect_nothing(0);
	send_event(0, 4);
	assert_int_equal(fake.stats.counters[IEC104_COUNT_TAKEN_OVER], 1); /* the second is not gone yet */
}

/* As clause 10 has it: STOPDT here, STARTDT there. Nobody is closed. */
static void test_orderly_switch_over(void **state)
{
	(void)state;
	connect_from(0, "10.0.0.1", GROUP);
	connect_from(1, "10.0.0.2", GROUP);
	for (unsigned i = 0; i < 4; i++) {
		unsigned on = i % 2;

		start(on);
		expect_nothing(on);
		send_event(on, (int32_t)i);
		put_bytes(&masters[on], stopdt, sizeof(stopdt));
		acknowledge(&masters[on]);
		assert_non_null(next_frame(&masters[on])); /* STOPDT con */
		publish(HOLDING3, (int32_t)i + 100);
		expect_nothing(on);
		start(!on);
		EXPECT_EVENT(!on, (uint8_t)(i + 100));
		acknowledge(&masters[!on]);
		put_bytes(&masters[!on], stopdt, sizeof(stopdt));
		assert_non_null(next_frame(&masters[!on]));
	}
	assert_int_equal(masters[0].connection->session.closing, IEC104_OPEN);
	assert_int_equal(masters[1].connection->session.closing, IEC104_OPEN);
}

/* The acknowledgement came with the second connection's STARTDT: it counts first, whichever place they have. */
static void test_acknowledgement_beside_the_take_over(void **state)
{
	static const uint8_t s_frame[] = {0x68, 4, 1, 0, 2, 0}, startdt[] = {0x68, 4, 7, 0, 0, 0};
	size_t room;

	(void)state;
	connect_from(1, "10.0.0.2", GROUP); /* the first place */
	connect_from(0, "10.0.0.1", GROUP);
	start(0);
	send_event(0, 1);
	memcpy(iec104_session_space(&masters[0].connection->session, &room), s_frame, sizeof(s_frame));
	iec104_session_received(&masters[0].connection->session, sizeof(s_frame));
	put_bytes(&masters[1], startdt, sizeof(startdt));
	assert_int_equal(next_frame(&masters[1])[2], 0x0b);
	expect_nothing(1);
}

static void test_groups_are_apart(void **state)
{
	(void)state;
	fake.config.settings.queue_count = 2;
	fake.config.settings.queues[1] = (struct map_queue_plan){.name = "reserve", .limit = 1000, .slot = 1};
	iec104_station_init(&station, &fake, sent_ns, places);
	connect_from(0, "10.0.0.1", 0);
	connect_from(1, "10.0.0.2", 1);
	connect_from(2, "10.0.0.3", MAP_NONE);
	for (unsigned i = 0; i < 3; i++)
		start(i);
	publish(HOLDING3, 1);
	run();
	for (unsigned i = 0; i < 3; i++)
		EXPECT_EVENT(i, 1);
	acknowledge(&masters[1]);
	for (unsigned i = 0; i < 3; i++) {
		reconnect(i);
		start(i);
	}
	EXPECT_EVENT(0, 1);
	expect_nothing(1);
	EXPECT_EVENT(2, 1);
}

/* ---- controlling stations without a group ---------------------------------------------------- */

static void test_one_address_may_be_several_controlling_stations(void **state)
{
	(void)state;
	connect_from(1, "10.0.0.0", MAP_NONE); /* as the first */
	start(1);
	assert_int_equal(masters[0].connection->session.closing, IEC104_OPEN);
	publish(HOLDING3, 1);
	run();
	EXPECT_EVENT(0, 1);
	EXPECT_EVENT(1, 1);
	acknowledge(&masters[0]);
	reconnect(1);
	start(1);
	EXPECT_EVENT(1, 1);
	expect_nothing(0);
}

/* The controlling station is back before its former connection is found to be dead. */
static void test_silent_failure_without_a_group(void **state)
{
	(void)state;
	send_event(0, 1);
	send_event(0, 2);
	acknowledge_up_to(0, 1);
	now += S;
	connect_from(1, "10.0.0.0", MAP_NONE);
	start(1);
	EXPECT_EVENT(1, 2);
	publish(HOLDING3, 3);
	run();
	assert_int_equal(next_frame(&masters[1])[15], 3);
	acknowledge(&masters[1]);
	now += 14 * S;
	run();
	assert_int_equal(masters[0].connection->session.closing, IEC104_T1_I_FRAME);
	iec104_station_disconnect(&station, masters[0].connection);
	reconnect(1);
	start(1); /* the dead connection's queue is gone with it */
	expect_nothing(1);
	connect_from(0, "10.0.0.0", MAP_NONE);
	start(0);
	expect_nothing(0);
}

/* Two controlling stations at one address: one that was heard since has a queue of its own. */
static void test_one_address_keeps_the_queue_of_who_is_heard(void **state)
{
	static const uint8_t testfr[] = {0x68, 4, 0x43, 0, 0, 0};

	(void)state;
	send_event(0, 1);
	now += S;
	connect_from(1, "10.0.0.0", MAP_NONE);
	start(1);
	EXPECT_EVENT(1, 1);
	acknowledge(&masters[1]);
	now += S;
	put_bytes(&masters[0], testfr, sizeof(testfr));
	reconnect(0);
	start(0);
	EXPECT_EVENT(0, 1);
	expect_nothing(1);
}

/* The end of the first connection is seen in the same turn as the second one's STARTDT. */
static void test_reconnection_at_once(void **state)
{
	(void)state;
	send_event(0, 1);
	connect_from(1, "10.0.0.0", MAP_NONE);
	iec104_session_close(&masters[0].connection->session, IEC104_CLOSED_BY_PEER);
	start(1);
	EXPECT_EVENT(1, 1);
}

static void test_queue_unused_longest_is_given_up(void **state)
{
	char address[MAP_ADDRESS_SIZE];

	(void)state;
	send_event(0, 1);
	iec104_station_disconnect(&station, masters[0].connection);
	for (unsigned i = 1; i < MAP_QUEUES - MAP_NAMED_QUEUES_MAX; i++) {
		snprintf(address, sizeof(address), "10.1.0.%u", i);
		connect_from(0, address, MAP_NONE);
		start(0);
		iec104_station_disconnect(&station, masters[0].connection);
	}
	connect_from(0, "10.0.0.0", MAP_NONE); /* the first one's is still there: used again */
	start(0);
	EXPECT_EVENT(0, 1);
	iec104_station_disconnect(&station, masters[0].connection);
	connect_from(0, "10.2.0.1", MAP_NONE);
	start(0);
	expect_nothing(0);
	iec104_station_disconnect(&station, masters[0].connection);
	publish(HOLDING3, 2);
	connect_from(0, "10.1.0.1", MAP_NONE); /* that was unused longest: it begins anew */
	start(0);
	expect_nothing(0);
	iec104_station_disconnect(&station, masters[0].connection);
	connect_from(0, "10.0.0.0", MAP_NONE);
	start(0);
	EXPECT(0, M_ME_TE, 2, SPONTANEOUS, 0, CA_3067, IOA(40003), 1, 0, 0, TIME, 0x43, 0x9c, 0, 2, 0, 0,
	       TIME);
}

/* ---- too many events ------------------------------------------------------------------------- */

/* All points of both stations as they are now, in frames of spontaneous values. Returns how many there were. */
static unsigned count_refreshed(unsigned master)
{
	const uint8_t *frame;
	unsigned points_seen = 0;

	while (acknowledge(&masters[master]), (frame = next_frame(&masters[master])) != NULL) {
		assert_in_range(frame[6], 30, 37);
		assert_int_equal(frame[8], 3);
		points_seen += frame[7];
	}
	return points_seen;
}

static void test_overflow_of_a_waiting_queue(void **state)
{
	unsigned lines;

	(void)state;
	connect_from(0, "10.0.0.1", GROUP);
	start(0);
	iec104_station_disconnect(&station, masters[0].connection);
	lines = fake.log_count;
	for (int32_t i = 0; i < 1003; i++) {
		publish(HOLDING3, i % 200);
		run();
	}
	assert_int_equal(fake.queues[GROUP].lost, 3);
	assert_int_equal(fake.stats.counters[IEC104_COUNT_EVENTS_LOST], 3);
	assert_int_equal(fake.log_count, lines + 1);
	connect_from(0, "10.0.0.1", GROUP);
	start(0);
	assert_int_equal(next_frame(&masters[0])[15], 3);
	assert_true(count_refreshed(0) >= 1000 - 40 + POINTS);
	expect_nothing(0);
	assert_int_equal(fake.queues[GROUP].lost, 3);
	reconnect(0);
	start(0);
	expect_nothing(0); /* nothing is owed any more */
}

static void test_overflow_while_nothing_is_acknowledged(void **state)
{
	unsigned lines;

	(void)state;
	fake.config.settings.queues[GROUP].limit = 100;
	connect_from(0, "10.0.0.1", GROUP);
	start(0);
	for (int32_t i = 0; i < 12; i++)
		send_event(0, i); /* k */
	lines = fake.log_count;
	for (int32_t i = 0; i < 105; i++) {
		publish(HOLDING3, 12 + i);
		run();
	}
	assert_int_equal(fake.queues[GROUP].lost, 5);
	assert_int_equal(fake.log_count, lines + 1);
	acknowledge_up_to(0, 1); /* its place is behind the lost ones: the queue does not go back */
	assert_int_equal(next_frame(&masters[0])[15], 17);
	reconnect(0);
	start(0);
	assert_int_equal(next_frame(&masters[0])[15], 17);
	assert_true(count_refreshed(0) >= POINTS);
	assert_int_equal(fake.queues[GROUP].lost, 5);
}

/* The refresh after lost events, when the connection ends in the middle of it. */
static void test_refresh_of_all_is_owed_to_the_next_connection(void **state)
{
	(void)state;
	fake.config.settings.queues[GROUP].limit = 100;
	for (int32_t i = 0; i < 101; i++) {
		publish(HOLDING3, i);
		run();
	}
	connect_from(0, "10.0.0.1", GROUP);
	start(0);
	masters[0].mute = true;
	for (unsigned values = 0; values < 100;) {
		const uint8_t *frame = next_frame(&masters[0]);

		values += frame[7];
		acknowledge_up_to(0, masters[0].nr);
	}
	assert_non_null(next_frame(&masters[0])); /* the refresh has begun */
	restart_station();
	connect_from(0, "10.0.0.1", GROUP);
	start(0);
	assert_int_equal(count_refreshed(0), POINTS);
	reconnect(0);
	start(0);
	expect_nothing(0);
}

/* ---- what is counted, and who may command ------------------------------------------------------ */

static void test_counters(void **state)
{
	static const uint8_t testfr[] = {0x68, 4, 0x43, 0, 0, 0};
	_Atomic uint32_t *counters = fake.stats.counters;
	const struct iec104_connection_stats *stats = &fake.stats.connections[0];

	(void)state;
	send_event(0, 1);
	ASK(0, C_SC_NA, 1, ACT, 0, CA_3067, IOA(99), 1);
	put_bytes(&masters[0], testfr, sizeof(testfr));
	assert_non_null(next_frame(&masters[0]));
	assert_non_null(next_frame(&masters[0]));
	send_event(0, 2);
	assert_int_equal(counters[IEC104_COUNT_STARTDT_ACT_IN], 1);
	assert_int_equal(counters[IEC104_COUNT_STARTDT_CON_OUT], 1);
	assert_int_equal(counters[IEC104_COUNT_TESTFR_ACT_IN], 1);
	assert_int_equal(counters[IEC104_COUNT_TESTFR_CON_OUT], 1);
	assert_int_equal(counters[IEC104_COUNT_I_IN], 1);
	assert_int_equal(counters[IEC104_COUNT_I_OUT], 3);
	assert_int_equal(counters[IEC104_COUNT_EVENTS_SENT], 2);
	assert_int_equal(counters[IEC104_COUNT_UNKNOWN_IOA], 1);
	assert_int_equal(counters[IEC104_COUNT_ACCEPTED], 1);
	assert_string_equal(stats->peer, "master");
	assert_int_equal(stats->open, 1);
	assert_int_equal(stats->started, 1);
	assert_int_equal(stats->next_ns, 3);
	assert_int_equal(stats->next_nr, 1);
	assert_int_equal(stats->unacknowledged, 2);
	assert_int_equal(stats->since_s, 500);
	assert_int_equal(fake.queues[stats->queue].unacknowledged, 1);
	iec104_session_close(&masters[0].connection->session, IEC104_CLOSED_BY_PEER);
	iec104_station_disconnect(&station, masters[0].connection);
	assert_int_equal(stats->open, 0);
	assert_int_equal(counters[IEC104_COUNT_CLOSED_BY_PEER], 1);
}

static void test_originators(void **state)
{
	(void)state;
	memset(fake.settings.originators_refused, 0xff, sizeof(fake.settings.originators_refused));
	fake.settings.originators_refused[200 / 32] &= ~(1u << 200 % 32);
	ASK(0, C_SC_NA, 1, ACT, 7, CA_3067, IOA(4), 1);
	EXPECT(0, C_SC_NA, 1, NEGATIVE | ACT_CON, 7, CA_3067, IOA(4), 1);
	ASK(0, C_SC_NA, 1, DEACT, 7, CA_3067, IOA(4), 1);
	EXPECT(0, C_SC_NA, 1, NEGATIVE | DEACT_CON, 7, CA_3067, IOA(4), 1);
	ASK(0, C_IC_NA, 1, ACT, 0, CA_3067, IOA(0), 20);
	EXPECT(0, C_IC_NA, 1, NEGATIVE | ACT_CON, 0, CA_3067, IOA(0), 20);
	ASK(0, C_RD_NA, 1, REQUEST, 201, CA_3067, IOA(4));
	EXPECT(0, C_RD_NA, 1, NEGATIVE | REQUEST, 201, CA_3067, IOA(4));
	assert_int_equal(fake.request_count, 0);
	assert_int_equal(fake.stats.counters[IEC104_COUNT_ORIGINATOR], 4);
	ASK(0, C_SC_NA, 1, ACT, 200, CA_3067, IOA(4), 1);
	assert_int_equal(fake.request_count, 1);
}

int main(void)
{
	const struct CMUnitTest tests[] = {
	    TEST(test_unacknowledged_events_are_sent_again),
	    TEST(test_acknowledged_events_are_not_repeated_by_a_new_process),
	    TEST(test_events_among_answers),
	    TEST(test_many_disconnections),
	    TEST(test_module_down_is_reported_whole),
	    TEST(test_refresh_outlives_the_connection),
	    OWN_TEST(test_losses_are_points),
	    OWN_TEST(test_losses_of_addresses_without_a_group),
	    GROUP_TEST(test_group_has_events_from_before_its_first_connection),
	    GROUP_TEST(test_switch_over_after_a_silent_failure),
	    GROUP_TEST(test_orderly_switch_over),
	    GROUP_TEST(test_acknowledgement_beside_the_take_over),
	    GROUP_TEST(test_groups_are_apart),
	    TEST(test_one_address_may_be_several_controlling_stations),
	    TEST(test_silent_failure_without_a_group),
	    TEST(test_one_address_keeps_the_queue_of_who_is_heard),
	    TEST(test_reconnection_at_once),
	    TEST(test_queue_unused_longest_is_given_up),
	    GROUP_TEST(test_overflow_of_a_waiting_queue),
	    GROUP_TEST(test_overflow_while_nothing_is_acknowledged),
	    GROUP_TEST(test_refresh_of_all_is_owed_to_the_next_connection),
	    TEST(test_counters),
	    TEST(test_originators),
	};

	points[NORMALIZED].send_period_ms = points[POINTS - 1].send_period_ms = 0; /* nothing but events */
	return cmocka_run_group_tests(tests, NULL, NULL);
}
