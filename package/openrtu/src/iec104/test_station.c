/* SPDX-License-Identifier: GPL-3.0-or-later */
/*
 * The controlled station on a map that the test holds in its hand. Frames are written out as octets, after IEC 60870-5-101 and -104 and report 003's chapter 5.
 */
#include <setjmp.h>
#include <stdarg.h>
#include <stddef.h>
#include <stdint.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

#include <cmocka.h>

#include "iec104/fake_map.h"
#include "iec104/station.h"

/* CP56Time2a of WALL_NS */
#define TIME 0x18, 0xbc, 24, 13, 19, 2, 25

/* ---- the controlling stations -------------------------------------------------------------- */

static struct iec104_station station;
static int64_t sent_ns[4 * 12];

static struct master {
	struct iec104_connection *connection;
	uint16_t ns, nr;       /* V(S), V(R) */
	uint16_t acknowledged; /* N(R) of its frames */
	bool mute;             /* does not acknowledge for a while */
} masters[4];

static uint16_t nr_of(struct master *master)
{
	if (!master->mute)
		master->acknowledged = master->nr;
	return master->acknowledged;
}

static void run(void)
{
	iec104_station_run(&station, now);
}

static void put_bytes(struct master *master, const uint8_t *bytes, size_t size)
{
	size_t room;
	uint8_t *place = iec104_session_space(&master->connection->session, &room);

	assert_true(room >= size);
	memcpy(place, bytes, size);
	iec104_session_received(&master->connection->session, size);
	run();
}

static void ask(struct master *master, const uint8_t *asdu, size_t size)
{
	uint16_t nr = nr_of(master);
	uint8_t frame[IEC104_APDU_MAX] = {0x68,
					  (uint8_t)(size + 4),
					  (uint8_t)(master->ns << 1),
					  (uint8_t)(master->ns >> 7),
					  (uint8_t)(nr << 1),
					  (uint8_t)(nr >> 7)};

	memcpy(frame + 6, asdu, size);
	master->ns++;
	put_bytes(master, frame, size + 6);
}

static void acknowledge(struct master *master)
{
	uint16_t nr;

	master->mute = false;
	nr = nr_of(master);
	put_bytes(master, (const uint8_t[]){0x68, 4, 1, 0, (uint8_t)(nr << 1), (uint8_t)(nr >> 7)}, 6);
}

#define ASK(master, ...)                                                                                     \
	ask(&masters[master], (const uint8_t[]){__VA_ARGS__}, sizeof((const uint8_t[]){__VA_ARGS__}))

/* The next frame of the station; S frames are passed over. NULL: there is none. */
static const uint8_t *next_frame(struct master *master)
{
	static uint8_t frame[IEC104_APDU_MAX];
	struct iec104_session *session = &master->connection->session;
	const uint8_t *output;
	size_t size, length;

	do {
		output = iec104_session_output(session, &size);
		if (size == 0)
			return NULL;
		length = (size_t)output[1] + 2;
		assert_true(size >= length);
		memcpy(frame, output, length);
		iec104_session_written(session, length);
	} while (frame[2] == 0x01);
	if ((frame[2] & 1) == 0) {
		assert_int_equal(frame[2] | frame[3] << 8, master->nr << 1);
		master->nr++;
	}
	return frame;
}

static void expect_asdu(unsigned master, const uint8_t *asdu, size_t size)
{
	const uint8_t *frame = next_frame(&masters[master]);

	assert_non_null(frame);
	assert_int_equal(frame[1], size + 4);
	assert_memory_equal(frame + 6, asdu, size);
}

#define EXPECT(master, ...)                                                                                  \
	expect_asdu(master, (const uint8_t[]){__VA_ARGS__}, sizeof((const uint8_t[]){__VA_ARGS__}))

static void expect_nothing(unsigned master)
{
	run();
	assert_null(next_frame(&masters[master]));
}

static void connect_master(unsigned master, bool clock_master)
{
	masters[master] =
	    (struct master){.connection = iec104_station_connect(&station, "master", clock_master, now)};
	assert_non_null(masters[master].connection);
}

static void start(unsigned master)
{
	static const uint8_t startdt[] = {0x68, 4, 0x07, 0, 0, 0}, con[] = {0x68, 4, 0x0b, 0, 0, 0};

	put_bytes(&masters[master], startdt, sizeof(startdt));
	assert_memory_equal(next_frame(&masters[master]), con, sizeof(con));
}

static int set_up(void **state)
{
	(void)state;
	fake_begin();
	iec104_station_init(&station, &fake, sent_ns);
	connect_master(0, true);
	start(0);
	return 0;
}

/* ---- interrogation ------------------------------------------------------------------------- */

static void expect_station_3067(unsigned master, uint8_t originator)
{
	EXPECT(master, 100, 1, 7, originator, 0xfb, 0x0b, 0, 0, 0, 20);
	EXPECT(master, 1, 0x84, 20, originator, 0xfb, 0x0b, 1, 0, 0, 0, 1, 0, 1);
	EXPECT(master, 1, 0x83, 20, originator, 0xfb, 0x0b, 0x11, 0x27, 0, 0, 1, 0);
	EXPECT(master, 11, 0x83, 20, originator, 0xfb, 0x0b, 0x31, 0x75, 0, 1, 0, 0, 0, 0, 0, 1, 0, 0);
	EXPECT(master, 11, 0x83, 20, originator, 0xfb, 0x0b, 0x41, 0x9c, 0, 0, 0, 0, 1, 0, 0, 0, 0, 0);
	EXPECT(master, 100, 1, 10, originator, 0xfb, 0x0b, 0, 0, 0, 20);
}

static void expect_station_4001(unsigned master)
{
	EXPECT(master, 100, 1, 7, 0, 0xa1, 0x0f, 0, 0, 0, 20);
	EXPECT(master, 3, 2, 20, 0, 0xa1, 0x0f, 1, 0, 0, 1, 3, 0, 0, 1);
	EXPECT(master, 5, 1, 20, 0, 0xa1, 0x0f, 5, 0, 0, 0, 0);
	EXPECT(master, 7, 1, 20, 0, 0xa1, 0x0f, 7, 0, 0, 1, 0, 0, 0, 0);
	EXPECT(master, 9, 1, 20, 0, 0xa1, 0x0f, 9, 0, 0, 0, 0, 0);
	EXPECT(master, 13, 1, 20, 0, 0xa1, 0x0f, 11, 0, 0, 0, 0, 0xc0, 0x3f, 0);
	EXPECT(master, 100, 1, 10, 0, 0xa1, 0x0f, 0, 0, 0, 20);
}

static void test_interrogation(void **state)
{
	(void)state;
	ASK(0, 100, 1, 6, 9, 0xfb, 0x0b, 0, 0, 0, 20);
	expect_station_3067(0, 9);
	expect_nothing(0);
}

static void test_interrogation_of_all_stations(void **state)
{
	(void)state;
	ASK(0, 100, 1, 6, 0, 0xff, 0xff, 0, 0, 0, 20);
	expect_station_3067(0, 0);
	acknowledge(&masters[0]); /* 13 ASDUs are one more than k */
	expect_station_4001(0);
	expect_nothing(0);
}

static void test_interrogation_of_a_group(void **state)
{
	(void)state;
	ASK(0, 100, 1, 6, 0, 0xa1, 0x0f, 0, 0, 0, 22);
	EXPECT(0, 100, 1, 7, 0, 0xa1, 0x0f, 0, 0, 0, 22);
	EXPECT(0, 3, 1, 22, 0, 0xa1, 0x0f, 1, 0, 0, 1);
	EXPECT(0, 9, 1, 22, 0, 0xa1, 0x0f, 9, 0, 0, 0, 0, 0);
	EXPECT(0, 100, 1, 10, 0, 0xa1, 0x0f, 0, 0, 0, 22);
	ASK(0, 100, 1, 6, 0, 0xa1, 0x0f, 0, 0, 0, 36);
	EXPECT(0, 100, 1, 7, 0, 0xa1, 0x0f, 0, 0, 0, 36);
	EXPECT(0, 5, 1, 36, 0, 0xa1, 0x0f, 5, 0, 0, 0, 0);
	EXPECT(0, 100, 1, 10, 0, 0xa1, 0x0f, 0, 0, 0, 36);
	ASK(0, 100, 1, 6, 0, 0xa1, 0x0f, 0, 0, 0, 37);
	EXPECT(0, 100, 1, 0x47, 0, 0xa1, 0x0f, 0, 0, 0, 37);
	expect_nothing(0);
}

static void test_interrogation_of_counters(void **state)
{
	(void)state;
	fake.samples[COUNTER].value.i = 0x01020304;
	ASK(0, 101, 1, 6, 0, 0xa1, 0x0f, 0, 0, 0, 5);
	EXPECT(0, 101, 1, 7, 0, 0xa1, 0x0f, 0, 0, 0, 5);
	EXPECT(0, 15, 1, 37, 0, 0xa1, 0x0f, 15, 0, 0, 4, 3, 2, 1, 0);
	EXPECT(0, 101, 1, 10, 0, 0xa1, 0x0f, 0, 0, 0, 5);
	ASK(0, 101, 1, 6, 0, 0xa1, 0x0f, 0, 0, 0, 0x45); /* freeze */
	EXPECT(0, 101, 1, 0x47, 0, 0xa1, 0x0f, 0, 0, 0, 0x45);
	expect_nothing(0);
}

/* Two masters' frames at once, k = 12, acknowledged one by one: nothing is lost, nothing comes twice. */
static void test_interrogation_is_resumed(void **state)
{
	(void)state;
	fake.config.settings.k = 1;
	iec104_station_init(&station, &fake, sent_ns);
	connect_master(0, true);
	start(0);
	ASK(0, 100, 1, 6, 0, 0xfb, 0x0b, 0, 0, 0, 20);
	EXPECT(0, 100, 1, 7, 0, 0xfb, 0x0b, 0, 0, 0, 20);
	expect_nothing(0);
	acknowledge(&masters[0]);
	EXPECT(0, 1, 0x84, 20, 0, 0xfb, 0x0b, 1, 0, 0, 0, 1, 0, 1);
	expect_nothing(0);
	acknowledge(&masters[0]);
	EXPECT(0, 1, 0x83, 20, 0, 0xfb, 0x0b, 0x11, 0x27, 0, 0, 1, 0);
	acknowledge(&masters[0]);
	EXPECT(0, 11, 0x83, 20, 0, 0xfb, 0x0b, 0x31, 0x75, 0, 1, 0, 0, 0, 0, 0, 1, 0, 0);
	acknowledge(&masters[0]);
	EXPECT(0, 11, 0x83, 20, 0, 0xfb, 0x0b, 0x41, 0x9c, 0, 0, 0, 0, 1, 0, 0, 0, 0, 0);
	acknowledge(&masters[0]);
	EXPECT(0, 100, 1, 10, 0, 0xfb, 0x0b, 0, 0, 0, 20);
	acknowledge(&masters[0]);
	expect_nothing(0);
}

/* Makes the station send k frames, which stay unacknowledged. */
static void hold_back(unsigned master)
{
	masters[master].mute = true;
	for (unsigned i = 0; i < station.times.k; i++)
		ASK(master, 107, 1, 6, 0, 0xfb, 0x0b, 0, 0, 0, 1, 0, TIME);
	while (next_frame(&masters[master]) != NULL)
		;
}

static void test_second_interrogation(void **state)
{
	(void)state;
	hold_back(0);
	ASK(0, 100, 1, 6, 1, 0xfb, 0x0b, 0, 0, 0, 20);
	ASK(0, 100, 1, 6, 2, 0xfb, 0x0b, 0, 0, 0, 21); /* of the same station */
	ASK(0, 100, 1, 6, 0, 0xa1, 0x0f, 0, 0, 0, 20); /* of another */
	acknowledge(&masters[0]);
	EXPECT(0, 100, 1, 0x47, 2, 0xfb, 0x0b, 0, 0, 0, 21);
	expect_station_3067(0, 1);
	acknowledge(&masters[0]);
	expect_station_4001(0);
	expect_nothing(0);
}

static void test_second_interrogation_of_all_stations(void **state)
{
	(void)state;
	ASK(0, 100, 1, 6, 0, 0xff, 0xff, 0, 0, 0, 20);
	expect_station_3067(0, 0);
	while (next_frame(&masters[0]) != NULL)
		; /* of the second station, up to k */
	masters[0].mute = true;
	ASK(0, 100, 1, 6, 2, 0xff, 0xff, 0, 0, 0, 20);
	ASK(0, 100, 1, 8, 3, 0xff, 0xff, 0, 0, 0, 20);
	acknowledge(&masters[0]);
	EXPECT(0, 100, 1, 0x47, 2, 0xff, 0xff, 0, 0, 0, 20);
	EXPECT(0, 100, 1, 9, 3, 0xff, 0xff, 0, 0, 0, 20);
	expect_nothing(0);
}

static void test_deactivated_interrogation(void **state)
{
	(void)state;
	hold_back(0);
	ASK(0, 100, 1, 6, 1, 0xfb, 0x0b, 0, 0, 0, 20);
	ASK(0, 100, 1, 8, 1, 0xfb, 0x0b, 0, 0, 0, 20);
	ASK(0, 100, 1, 8, 1, 0xfb, 0x0b, 0, 0, 0, 20);
	acknowledge(&masters[0]);
	EXPECT(0, 100, 1, 9, 1, 0xfb, 0x0b, 0, 0, 0, 20);
	EXPECT(0, 100, 1, 0x49, 1, 0xfb, 0x0b, 0, 0, 0, 20);
	expect_nothing(0);
}

static void test_stop_ends_an_interrogation(void **state)
{
	static const uint8_t stopdt[] = {0x68, 4, 0x13, 0, 0, 0}, con[] = {0x68, 4, 0x23, 0, 0, 0};

	(void)state;
	hold_back(0);
	ASK(0, 100, 1, 6, 1, 0xfb, 0x0b, 0, 0, 0, 20);
	put_bytes(&masters[0], stopdt, sizeof(stopdt));
	assert_null(next_frame(&masters[0]));
	acknowledge(&masters[0]);
	assert_memory_equal(next_frame(&masters[0]), con, sizeof(con));
	start(0);
	expect_nothing(0);
}

static void test_test_bit_of_an_interrogation(void **state)
{
	(void)state;
	ASK(0, 100, 1, 0x86, 1, 0xa1, 0x0f, 0, 0, 0, 36);
	EXPECT(0, 100, 1, 0x87, 1, 0xa1, 0x0f, 0, 0, 0, 36);
	EXPECT(0, 5, 1, 0x80 | 36, 1, 0xa1, 0x0f, 5, 0, 0, 0, 0);
	EXPECT(0, 100, 1, 0x8a, 1, 0xa1, 0x0f, 0, 0, 0, 36);
}

/* ---- events -------------------------------------------------------------------------------- */

static void test_events(void **state)
{
	(void)state;
	publish(COIL4, 0);
	publish(0, 1);
	publish(HOLDING3, 255);
	fake.clock.set = false;
	run();
	EXPECT(0, 30, 2, 3, 0, 0xfb, 0x0b, 4, 0, 0, 0, 0x18, 0xbc, 0x98, 13, 19, 2, 25, 1, 0, 0, 1, 0x18,
	       0xbc, 0x98, 13, 19, 2, 25);
	EXPECT(0, 35, 1, 3, 0, 0xfb, 0x0b, 0x43, 0x9c, 0, 255, 0, 0, 0x18, 0xbc, 0x98, 13, 19, 2, 25);
	fake.clock.set = true;
	publish(COUNTER, 7);
	run();
	EXPECT(0, 37, 1, 3, 0, 0xa1, 0x0f, 15, 0, 0, 7, 0, 0, 0, 0, TIME);
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
	EXPECT(0, 30, 2, 3, 0, 0xfb, 0x0b, 4, 0, 0, 0, TIME, 4, 0, 0, 1, TIME);
	start(1);
	expect_nothing(1);
	publish(COIL4, 0);
	run();
	EXPECT(0, 30, 1, 3, 0, 0xfb, 0x0b, 4, 0, 0, 0, TIME);
	EXPECT(1, 30, 1, 3, 0, 0xfb, 0x0b, 4, 0, 0, 0, TIME);
	acknowledge(&masters[1]);
	put_bytes(&masters[1], stopdt, sizeof(stopdt));
	assert_non_null(next_frame(&masters[1]));
	publish(COIL4, 1);
	expect_nothing(1);
	start(1); /* what happened between STOPDT and STARTDT is not lost */
	EXPECT(1, 30, 1, 3, 0, 0xfb, 0x0b, 4, 0, 0, 1, TIME);
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
	ASK(0, 100, 1, 6, 0, 0xfb, 0x0b, 0, 0, 0, 20);
	EXPECT(0, 100, 1, 7, 0, 0xfb, 0x0b, 0, 0, 0, 20);
	EXPECT(0, 1, 0x84, 20, 0, 0xfb, 0x0b, 1, 0, 0, 0, 1, 0, 1);
	EXPECT(0, 30, 3, 3, 0, 0xfb, 0x0b, 4, 0, 0, 0, TIME, 4, 0, 0, 1, TIME, 4, 0, 0, 0, TIME);
	EXPECT(0, 1, 0x83, 20, 0, 0xfb, 0x0b, 0x11, 0x27, 0, 0, 1, 0);
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
	ASK(0, 102, 1, 5, 7, 0xfb, 0x0b, 4, 0, 0);
	EXPECT(0, 30, 3, 3, 0, 0xfb, 0x0b, 4, 0, 0, 0, TIME, 4, 0, 0, 1, TIME, 4, 0, 0, 0, TIME);
	EXPECT(0, 1, 1, 5, 7, 0xfb, 0x0b, 4, 0, 0, 0);
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
	EXPECT(0, 31, 1, 3, 0, 0xa1, 0x0f, 1, 0, 0, 2, TIME);
	EXPECT(0, 31, 2, 3, 0, 0xa1, 0x0f, 1, 0, 0, 0x82, TIME, 3, 0, 0, 0x81, TIME);
	EXPECT(0, 32, 1, 3, 0, 0xa1, 0x0f, 5, 0, 0, 0, 0x80, TIME);
	EXPECT(0, 33, 1, 3, 0, 0xa1, 0x0f, 7, 0, 0, 1, 0, 0, 0, 0x80, TIME);
	EXPECT(0, 34, 1, 3, 0, 0xa1, 0x0f, 9, 0, 0, 0, 0, 0x80, TIME);
	EXPECT(0, 36, 1, 3, 0, 0xa1, 0x0f, 11, 0, 0, 0, 0, 0xc0, 0x3f, 0x80, TIME);
	EXPECT(0, 37, 1, 3, 0, 0xa1, 0x0f, 15, 0, 0, 0, 0, 0, 0, 0x80, TIME);
	acknowledge(&masters[0]);
	expect_nothing(0);
	fake.dead[2] = false;
	for (uint32_t i = DOUBLE1; i < POINTS; i++)
		fake.samples[i].quality = MAP_INVALID;
	fake.samples[BITS] = (struct map_sample){.value.u = 5, .time_ns = now - 100 * MS};
	put_event(MAP_EVENT_MODULE_UP, 2, (struct map_sample){.time_ns = now});
	run();
	EXPECT(0, 33, 1, 3, 0, 0xa1, 0x0f, 7, 0, 0, 5, 0, 0, 0, 0, TIME);
	expect_nothing(0);
}

/* What was sent as invalid meanwhile is sent again. */
static void test_heartbeat_is_missing_for_a_moment(void **state)
{
	(void)state;
	fake.samples[FLOAT].time_ns = now;
	fake.silent[2] = true;
	ASK(0, 102, 1, 5, 0, 0xa1, 0x0f, 11, 0, 0);
	EXPECT(0, 13, 1, 5, 0, 0xa1, 0x0f, 11, 0, 0, 0, 0, 0xc0, 0x3f, 0x80);
	expect_nothing(0);
	assert_true(iec104_station_deadline(&station) <= now + 100 * MS);
	for (uint32_t i = DOUBLE1; i < POINTS; i++)
		if (i != FLOAT)
			fake.samples[i].quality = MAP_INVALID; /* at their device */
	fake.silent[2] = false;
	run();
	EXPECT(0, 36, 1, 3, 0, 0xa1, 0x0f, 11, 0, 0, 0, 0, 0xc0, 0x3f, 0, TIME);
	expect_nothing(0);
}

static void test_lost_events(void **state)
{
	(void)state;
	hold_back(0);
	fake.cursors[0].lost += 3;
	for (uint32_t i = 0; i < 13; i++)
		fake.samples[i].time_ns = now;
	publish(COIL4, 1);
	fake.samples[0].quality = MAP_INVALID;
	acknowledge(&masters[0]);
	EXPECT(0, 30, 1, 3, 0, 0xfb, 0x0b, 4, 0, 0, 1, TIME);
	EXPECT(0, 30, 7, 3, 0, 0xfb, 0x0b, 1, 0, 0, 0x80, TIME, 2, 0, 0, 1, TIME, 3, 0, 0, 0, TIME, 4, 0, 0,
	       1, TIME, 0x11, 0x27, 0, 0, TIME, 0x12, 0x27, 0, 1, TIME, 0x13, 0x27, 0, 0, TIME);
	assert_int_equal(next_frame(&masters[0])[7], 6); /* scaled */
	assert_int_equal(next_frame(&masters[0])[6], 31);
}

static void test_point_that_cannot_be_read_now(void **state)
{
	(void)state;
	fake.unreadable = 1;
	ASK(0, 102, 1, 5, 7, 0xfb, 0x0b, 4, 0, 0);
	assert_null(next_frame(&masters[0]));
	assert_true(iec104_station_deadline(&station) == now + MS);
	now += MS;
	run();
	EXPECT(0, 1, 1, 5, 7, 0xfb, 0x0b, 4, 0, 0, 1);
	fake.unreadable = 1;
	ASK(0, 100, 1, 6, 0, 0xfb, 0x0b, 0, 0, 0, 20);
	EXPECT(0, 100, 1, 7, 0, 0xfb, 0x0b, 0, 0, 0, 20);
	assert_null(next_frame(&masters[0]));
	now += MS;
	run();
	EXPECT(0, 1, 0x84, 20, 0, 0xfb, 0x0b, 1, 0, 0, 0, 1, 0, 1);
}

static void test_periodic(void **state)
{
	(void)state;
	assert_true(iec104_station_deadline(&station) == 501 * S);
	now = 501 * S - 1;
	expect_nothing(0);
	now = 501 * S;
	run();
	EXPECT(0, 9, 1, 1, 0, 0xa1, 0x0f, 9, 0, 0, 0, 0, 0);
	assert_true(iec104_station_deadline(&station) == 502 * S);
	now = 505 * S + 3 * MS; /* late: once, not four times */
	run();
	EXPECT(0, 3, 1, 2, 0, 0xa1, 0x0f, 3, 0, 0, 1); /* not a measured value: background scan */
	EXPECT(0, 9, 1, 1, 0, 0xa1, 0x0f, 9, 0, 0, 0, 0, 0);
	expect_nothing(0);
	assert_true(iec104_station_deadline(&station) == 506 * S);
}

/* One type, two stations: never in one ASDU. */
static void test_stations_are_kept_apart(void **state)
{
	(void)state;
	points[HOLDING3].cyclic_ms = 1000;
	points[NORMALIZED].type = MAP_SCALED;
	publish(HOLDING3, 1);
	publish(NORMALIZED, 2);
	run();
	EXPECT(0, 35, 1, 3, 0, 0xfb, 0x0b, 0x43, 0x9c, 0, 1, 0, 0, TIME);
	EXPECT(0, 35, 1, 3, 0, 0xa1, 0x0f, 9, 0, 0, 2, 0, 0, TIME);
	now = 501 * S;
	run();
	EXPECT(0, 11, 1, 1, 0, 0xfb, 0x0b, 0x43, 0x9c, 0, 1, 0, 0);
	EXPECT(0, 11, 1, 1, 0, 0xa1, 0x0f, 9, 0, 0, 2, 0, 0);
	points[HOLDING3].cyclic_ms = 0;
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
	EXPECT(0, 9, 1, 1, 0, 0xa1, 0x0f, 9, 0, 0, 0, 0, 0);
	expect_nothing(0);
	run();
	assert_true(iec104_station_deadline(&station) == 503 * S);
}

/* ---- refusals ------------------------------------------------------------------------------ */

static void test_refusals(void **state)
{
	(void)state;
	ASK(0, 44, 1, 6, 5, 0xfb, 0x0b, 1, 0, 0, 1, 2, 3);
	EXPECT(0, 44, 1, 0x40 | 44, 5, 0xfb, 0x0b, 1, 0, 0, 1, 2, 3);
	ASK(0, 47, 1, 6, 5, 0xfb, 0x0b, 1, 0, 0, 1);
	EXPECT(0, 47, 1, 0x40 | 44, 5, 0xfb, 0x0b, 1, 0, 0, 1);
	ASK(0, 201, 0xff, 0x86, 5, 1, 0);
	EXPECT(0, 201, 0xff, 0xc0 | 44, 5, 1, 0);
	ASK(0, 45, 1, 5, 5, 0xfb, 0x0b, 4, 0, 0, 1);
	EXPECT(0, 45, 1, 0x40 | 45, 5, 0xfb, 0x0b, 4, 0, 0, 1);
	ASK(0, 102, 1, 6, 5, 0xfb, 0x0b, 4, 0, 0);
	EXPECT(0, 102, 1, 0x40 | 45, 5, 0xfb, 0x0b, 4, 0, 0);
	ASK(0, 103, 1, 8, 5, 0xfb, 0x0b, 0, 0, 0, TIME);
	EXPECT(0, 103, 1, 0x40 | 45, 5, 0xfb, 0x0b, 0, 0, 0, TIME);
	ASK(0, 45, 1, 6, 5, 0xfc, 0x0b, 4, 0, 0, 1);
	EXPECT(0, 45, 1, 0x40 | 46, 5, 0xfc, 0x0b, 4, 0, 0, 1);
	ASK(0, 45, 1, 6, 5, 0xff, 0xff, 4, 0, 0, 1);
	EXPECT(0, 45, 1, 0x40 | 46, 5, 0xff, 0xff, 4, 0, 0, 1);
	acknowledge(&masters[0]);
	ASK(0, 102, 1, 5, 5, 0xff, 0xff, 4, 0, 0);
	EXPECT(0, 102, 1, 0x40 | 46, 5, 0xff, 0xff, 4, 0, 0);
	ASK(0, 45, 1, 6, 5, 0xfb, 0x0b, 5, 0, 0, 1);
	EXPECT(0, 45, 1, 0x40 | 47, 5, 0xfb, 0x0b, 5, 0, 0, 1);
	ASK(0, 45, 1, 6, 5, 0xfb, 0x0b, 0x11, 0x27, 0, 1); /* a discrete input */
	EXPECT(0, 45, 1, 0x40 | 47, 5, 0xfb, 0x0b, 0x11, 0x27, 0, 1);
	ASK(0, 49, 1, 6, 5, 0xfb, 0x0b, 4, 0, 0, 1, 0, 0); /* of another type */
	EXPECT(0, 49, 1, 0x40 | 47, 5, 0xfb, 0x0b, 4, 0, 0, 1, 0, 0);
	ASK(0, 100, 1, 6, 5, 0xfb, 0x0b, 1, 0, 0, 20);
	EXPECT(0, 100, 1, 0x40 | 47, 5, 0xfb, 0x0b, 1, 0, 0, 20);
	ASK(0, 103, 1, 6, 5, 0xfb, 0x0b, 1, 0, 0, TIME);
	EXPECT(0, 103, 1, 0x40 | 47, 5, 0xfb, 0x0b, 1, 0, 0, TIME);
	ASK(0, 102, 1, 5, 5, 0xfb, 0x0b, 99, 0, 0);
	EXPECT(0, 102, 1, 0x40 | 47, 5, 0xfb, 0x0b, 99, 0, 0);
	expect_nothing(0);
	assert_int_equal(fake.request_count, 0);
}

static void test_wrong_sizes_close(void **state)
{
	static const struct {
		uint8_t bytes[16];
		size_t size;
	} wrong[] = {
	    {{45}, 1},
	    {{45, 1, 6, 0, 0xfb}, 5},
	    {{45, 1, 6, 0, 0xfb, 0x0b}, 6},
	    {{45, 1, 6, 0, 0xfb, 0x0b, 4, 0, 0}, 9},
	    {{45, 1, 6, 0, 0xfb, 0x0b, 4, 0, 0, 1, 0}, 11},
	    {{45, 0, 6, 0, 0xfb, 0x0b, 4, 0, 0, 1}, 10},
	    {{45, 0x81, 6, 0, 0xfb, 0x0b, 4, 0, 0, 1}, 10},
	    {{45, 2, 6, 0, 0xfb, 0x0b, 4, 0, 0, 1, 4, 0, 0, 1}, 14},
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

static void test_test_command(void **state)
{
	(void)state;
	ASK(0, 107, 1, 6, 3, 0xfb, 0x0b, 0, 0, 0, 0x34, 0x12, TIME);
	EXPECT(0, 107, 1, 7, 3, 0xfb, 0x0b, 0, 0, 0, 0x34, 0x12, TIME);
	expect_nothing(0);
}

static void test_read(void **state)
{
	(void)state;
	ASK(0, 102, 1, 5, 7, 0xa1, 0x0f, 11, 0, 0);
	EXPECT(0, 13, 1, 5, 7, 0xa1, 0x0f, 11, 0, 0, 0, 0, 0xc0, 0x3f, 0);
	expect_nothing(0);
}

/* A P/N bit in the request means nothing: it is not taken for a refusal that waits. */
static void test_read_with_pn(void **state)
{
	(void)state;
	ASK(0, 102, 1, 0x45, 7, 0xa1, 0x0f, 11, 0, 0);
	EXPECT(0, 13, 1, 5, 7, 0xa1, 0x0f, 11, 0, 0, 0, 0, 0xc0, 0x3f, 0);
	expect_nothing(0);
}

static void test_station_without_devices(void **state)
{
	(void)state;
	fake.config.device_count = fake.config.point_count = 0;
	put_event(MAP_EVENT_MODULE_UP, 1, (struct map_sample){.time_ns = now});
	put_event(MAP_EVENT_MODULE_DOWN, 1, (struct map_sample){.time_ns = now});
	now += 2 * S;
	ASK(0, 100, 1, 6, 0, 0xff, 0xff, 0, 0, 0, 20);
	EXPECT(0, 100, 1, 0x40 | 46, 0, 0xff, 0xff, 0, 0, 0, 20);
	expect_nothing(0);
}

/* ---- commands ------------------------------------------------------------------------------ */

static void test_single_command_of_figure_5_6(void **state)
{
	const struct map_request *request = &fake.requests[0];

	(void)state;
	ASK(0, 0x2d, 0x01, 0x06, 0x01, 0xfb, 0x0b, 0x04, 0x00, 0x00, 0x01);
	expect_nothing(0); /* not before the device has answered */
	assert_int_equal(fake.request_count, 1);
	assert_int_equal(request->point, COIL4);
	assert_int_equal(request->action, MAP_EXECUTE);
	assert_int_equal(request->value.u, 1);
	assert_true(request->deadline_ns == now + 10 * S);
	answer(1, MAP_EXECUTING, MAP_RESULT_NONE);
	ASK(0, 102, 1, 5, 0, 0xfb, 0x0b, 1, 0, 0); /* the session goes on */
	EXPECT(0, 1, 1, 5, 0, 0xfb, 0x0b, 1, 0, 0, 0);
	expect_nothing(0);
	answer(1, MAP_EXECUTED_COMMAND, MAP_RESULT_DONE);
	run();
	EXPECT(0, 0x2d, 0x01, 0x07, 0x01, 0xfb, 0x0b, 0x04, 0x00, 0x00, 0x01);
	EXPECT(0, 0x2d, 0x01, 0x0a, 0x01, 0xfb, 0x0b, 0x04, 0x00, 0x00, 0x01);
	expect_nothing(0);
	assert_int_equal(fake.request_count, 2);
	assert_int_equal(fake.requests[1].action, MAP_RELEASE);
	assert_int_equal(fake.requests[1].session, request->session);
}

static void test_refused_command(void **state)
{
	(void)state;
	ASK(0, 45, 1, 6, 1, 0xfb, 0x0b, 4, 0, 0, 1);
	answer(1, MAP_EXECUTING, MAP_RESULT_NONE);
	answer(1, MAP_REFUSED_COMMAND, MAP_RESULT_TIMEOUT);
	run();
	EXPECT(0, 45, 1, 0x47, 1, 0xfb, 0x0b, 4, 0, 0, 1);
	expect_nothing(0);
	assert_int_equal(fake.requests[1].action, MAP_RELEASE);
}

static void test_select_execute_cancel(void **state)
{
	(void)state;
	ASK(0, 45, 1, 6, 1, 0xfb, 0x0b, 4, 0, 0, 0x81);
	assert_int_equal(fake.requests[0].action, MAP_SELECT);
	answer(1, MAP_ACCEPTED_SELECTION, MAP_RESULT_NONE);
	run();
	EXPECT(0, 45, 1, 7, 1, 0xfb, 0x0b, 4, 0, 0, 0x81);
	expect_nothing(0); /* a selection has no termination and is not released */
	assert_int_equal(fake.request_count, 1);
	ASK(0, 45, 1, 8, 1, 0xfb, 0x0b, 4, 0, 0, 0x81);
	assert_int_equal(fake.requests[1].action, MAP_CANCEL);
	assert_int_equal(fake.requests[1].session, fake.requests[0].session);
	answer(2, MAP_INTERRUPTED_SELECTION, MAP_RESULT_DONE);
	run();
	EXPECT(0, 45, 1, 9, 1, 0xfb, 0x0b, 4, 0, 0, 0x81);
	ASK(0, 45, 1, 8, 1, 0xfb, 0x0b, 4, 0, 0, 0x01);
	answer(4, MAP_REFUSED_SELECTION, MAP_RESULT_NOT_SELECTED);
	run();
	EXPECT(0, 45, 1, 0x49, 1, 0xfb, 0x0b, 4, 0, 0, 0x01);
	expect_nothing(0);
}

static void select_coil4(uint32_t id)
{
	const struct map_request *request = &fake.requests[id - 1];

	ASK(0, 45, 1, 6, 1, 0xfb, 0x0b, 4, 0, 0, 0x81);
	answer(id, MAP_ACCEPTED_SELECTION, MAP_RESULT_NONE);
	fake.commands[COIL4] =
	    (struct map_command){.state = MAP_ACCEPTED_SELECTION, .session = request->session};
}

static void test_selection_ends_with_its_connection(void **state)
{
	(void)state;
	connect_master(1, true);
	start(1);
	select_coil4(1);
	run();
	EXPECT(0, 45, 1, 7, 1, 0xfb, 0x0b, 4, 0, 0, 0x81);
	iec104_station_disconnect(&station, masters[1].connection);
	assert_int_equal(fake.request_count, 1);
	iec104_station_disconnect(&station, masters[0].connection);
	assert_int_equal(fake.request_count, 2);
	assert_int_equal(fake.requests[1].action, MAP_RELEASE);
	assert_int_equal(fake.requests[1].point, COIL4);
	assert_int_equal(fake.requests[1].session, fake.requests[0].session);
}

static void test_selection_is_granted_after_its_connection_has_gone(void **state)
{
	(void)state;
	select_coil4(1);
	iec104_station_disconnect(&station, masters[0].connection);
	connect_master(0, true); /* takes the same place */
	start(0);
	assert_int_equal(fake.requests[1].action, MAP_RELEASE);
	assert_int_equal(fake.requests[1].session, fake.requests[0].session);
	expect_nothing(0);
}

/* A selection of a former process of this station: its owner tells the generations apart, this side does not ask. */
static void test_only_own_selections_are_ended(void **state)
{
	(void)state;
	select_coil4(1);
	run();
	fake.commands[COIL4].session += 1u << 8; /* another connection's */
	iec104_station_disconnect(&station, masters[0].connection);
	fake.commands[COIL4].session -= 1u << 8;
	fake.commands[COIL4].requester = 1; /* another module's */
	iec104_station_disconnect(&station, masters[0].connection);
	assert_int_equal(fake.request_count, 1);
}

static void test_selections_are_told_apart(void **state)
{
	(void)state;
	connect_master(1, true);
	start(1);
	ASK(0, 45, 1, 6, 1, 0xfb, 0x0b, 4, 0, 0, 0x81);
	ASK(0, 45, 1, 6, 2, 0xfb, 0x0b, 4, 0, 0, 0x01);
	ASK(1, 45, 1, 6, 1, 0xfb, 0x0b, 4, 0, 0, 0x01);
	assert_int_not_equal(fake.requests[0].session, fake.requests[1].session);
	assert_int_not_equal(fake.requests[0].session, fake.requests[2].session);
}

struct value_case {
	uint8_t asdu[21];
	size_t size;
	uint32_t point;
	union map_value value;
};

static void test_values(void **state)
{
	static const struct value_case cases[] = {
	    {{49, 1, 6, 0, 0xfb, 0x0b, 0x43, 0x9c, 0, 255, 0, 0}, 12, HOLDING3, {.i = 255}},
	    {{62, 1, 6, 0, 0xfb, 0x0b, 0x43, 0x9c, 0, 255, 0, 0, TIME}, 19, HOLDING3, {.i = 255}},
	    {{46, 1, 6, 0, 0xa1, 0x0f, 1, 0, 0, 2}, 10, DOUBLE1, {.u = 2}},
	    {{48, 1, 6, 0, 0xa1, 0x0f, 9, 0, 0, 0xff, 0xff, 0}, 12, NORMALIZED, {.i = -1}},
	    {{50, 1, 6, 0, 0xa1, 0x0f, 11, 0, 0, 0, 0, 0xc0, 0xbf, 0}, 14, FLOAT, {.f = -1.5f}},
	    {{51, 1, 6, 0, 0xa1, 0x0f, 7, 0, 0, 1, 0, 0, 0x80}, 13, BITS, {.u = 0x80000001}},
	    {{64, 1, 6, 0, 0xa1, 0x0f, 7, 0, 0, 1, 0, 0, 0x80, TIME}, 20, BITS, {.u = 0x80000001}},
	};

	(void)state;
	for (unsigned i = 0; i < sizeof(cases) / sizeof(cases[0]); i++) {
		ask(&masters[0], cases[i].asdu, cases[i].size);
		assert_int_equal(fake.request_count, i + 1);
		assert_int_equal(fake.requests[i].point, cases[i].point);
		assert_int_equal(fake.requests[i].value.u, cases[i].value.u);
	}
}

static void test_values_that_cannot_be_carried_out(void **state)
{
	static const struct value_case cases[] = {
	    {{45, 1, 6, 0, 0xfb, 0x0b, 4, 0, 0, 1 << 2 | 1}, 10, 0, {0}}, /* short pulse */
	    {{45, 1, 6, 0, 0xfb, 0x0b, 4, 0, 0, 2 << 2 | 1}, 10, 0, {0}}, /* long pulse */
	    {{46, 1, 6, 0, 0xa1, 0x0f, 1, 0, 0, 0}, 10, 0, {0}},
	    {{46, 1, 6, 0, 0xa1, 0x0f, 1, 0, 0, 3}, 10, 0, {0}},
	    {{49, 1, 6, 0, 0xfb, 0x0b, 0x43, 0x9c, 0, 255, 0, 1}, 12, 0, {0}},
	    {{50, 1, 6, 0, 0xa1, 0x0f, 11, 0, 0, 0, 0, 0xc0, 0x7f, 0}, 14, 0, {0}}, /* not a number */
	    {{50, 1, 6, 0, 0xa1, 0x0f, 11, 0, 0, 0, 0, 0x80, 0xff, 0}, 14, 0, {0}}, /* minus infinity */
	};

	(void)state;
	for (unsigned i = 0; i < sizeof(cases) / sizeof(cases[0]); i++) {
		uint8_t expected[21];

		memcpy(expected, cases[i].asdu, sizeof(expected));
		expected[2] = 0x47;
		ask(&masters[0], cases[i].asdu, cases[i].size);
		expect_asdu(0, expected, cases[i].size);
	}
	assert_int_equal(fake.request_count, 0);
}

static void test_time_tags(void **state)
{
	(void)state;
	fake.clock.offset_ns += 10 * S;
	ASK(0, 58, 1, 6, 0, 0xfb, 0x0b, 4, 0, 0, 1, TIME);
	assert_int_equal(fake.request_count, 1);
	fake.clock.offset_ns += 1 * MS; /* too old */
	ASK(0, 58, 1, 6, 0, 0xfb, 0x0b, 4, 0, 0, 1, TIME);
	EXPECT(0, 58, 1, 0x47, 0, 0xfb, 0x0b, 4, 0, 0, 1, TIME);
	fake.clock.offset_ns -= 20 * S + 2 * MS; /* from the future */
	ASK(0, 58, 1, 6, 0, 0xfb, 0x0b, 4, 0, 0, 1, TIME);
	EXPECT(0, 58, 1, 0x47, 0, 0xfb, 0x0b, 4, 0, 0, 1, TIME);
	assert_int_equal(fake.request_count, 1);
	fake.clock.set = false; /* its age cannot be known */
	ASK(0, 58, 1, 6, 0, 0xfb, 0x0b, 4, 0, 0, 1, TIME);
	assert_int_equal(fake.request_count, 2);
	ASK(0, 58, 1, 6, 0, 0xfb, 0x0b, 4, 0, 0, 1, 0, 0, 0x80, 0, 1, 1, 25);
	EXPECT(0, 58, 1, 0x47, 0, 0xfb, 0x0b, 4, 0, 0, 1, 0, 0, 0x80, 0, 1, 1, 25);
	assert_int_equal(fake.request_count, 2);
}

static void test_test_bit_of_a_command(void **state)
{
	(void)state;
	ASK(0, 45, 1, 0x86, 1, 0xfb, 0x0b, 4, 0, 0, 1);
	EXPECT(0, 45, 1, 0x87, 1, 0xfb, 0x0b, 4, 0, 0, 1);
	ASK(0, 103, 1, 0x86, 1, 0xfb, 0x0b, 0, 0, 0, 0, 0, 0, 0, 1, 1, 30);
	EXPECT(0, 103, 1, 0x87, 1, 0xfb, 0x0b, 0, 0, 0, TIME);
	expect_nothing(0);
	assert_int_equal(fake.request_count, 0);
}

static void test_owner_dies(void **state)
{
	(void)state;
	ASK(0, 45, 1, 6, 1, 0xfb, 0x0b, 4, 0, 0, 1);
	answer(1, MAP_EXECUTING, MAP_RESULT_NONE);
	expect_nothing(0);
	fake.dead[1] = true;
	run();
	EXPECT(0, 45, 1, 0x47, 1, 0xfb, 0x0b, 4, 0, 0, 1);
	ASK(0, 45, 1, 6, 1, 0xfb, 0x0b, 4, 0, 0, 1);
	EXPECT(0, 45, 1, 0x47, 1, 0xfb, 0x0b, 4, 0, 0, 1);
	fake.dead[1] = false;
	ASK(0, 45, 1, 6, 1, 0xfb, 0x0b, 4, 0, 0, 1);
	expect_nothing(0);
	fake.generation[1]++; /* died and came back between two looks */
	run();
	EXPECT(0, 45, 1, 0x47, 1, 0xfb, 0x0b, 4, 0, 0, 1);
	expect_nothing(0);
}

/* rtud has not looked yet at a module that is back; what it is asked, it carries out. */
static void test_owner_is_starting(void **state)
{
	(void)state;
	fake.generation[1]++;
	fake.starting[1] = true;
	ASK(0, 45, 1, 6, 1, 0xfb, 0x0b, 4, 0, 0, 1);
	expect_nothing(0);
	fake.starting[1] = false;
	answer(1, MAP_EXECUTED_COMMAND, MAP_RESULT_DONE);
	run();
	EXPECT(0, 45, 1, 7, 1, 0xfb, 0x0b, 4, 0, 0, 1);
	EXPECT(0, 45, 1, 10, 1, 0xfb, 0x0b, 4, 0, 0, 1);
}

/* Reads on over values that have a period of their own. */
static void expect_no_answer_to_a_command(unsigned master)
{
	const uint8_t *frame;

	acknowledge(&masters[master]);
	while ((frame = next_frame(&masters[master])) != NULL)
		assert_int_not_equal(frame[6], 45);
}

static void test_answer_is_lost(void **state)
{
	(void)state;
	ASK(0, 45, 1, 6, 1, 0xfb, 0x0b, 4, 0, 0, 1);
	for (int i = 0; i < 39; i++) {
		now += S;
		expect_no_answer_to_a_command(0);
	}
	assert_true(iec104_station_deadline(&station) <= now + S);
	now += S; /* command_timeout, and the longest time-out of a device that was asked at its end */
	run();
	EXPECT(0, 45, 1, 0x47, 1, 0xfb, 0x0b, 4, 0, 0, 1);
	answer(1, MAP_EXECUTED_COMMAND, MAP_RESULT_DONE);
	expect_no_answer_to_a_command(0);
}

static void test_answer_after_the_master_has_gone(void **state)
{
	(void)state;
	ASK(0, 45, 1, 6, 1, 0xfb, 0x0b, 4, 0, 0, 1);
	iec104_station_disconnect(&station, masters[0].connection);
	connect_master(0, true); /* takes the same place */
	start(0);
	answer(1, MAP_EXECUTED_COMMAND, MAP_RESULT_DONE);
	expect_nothing(0);
	assert_int_equal(fake.requests[1].action, MAP_RELEASE);
}

/* ---- clock --------------------------------------------------------------------------------- */

static void test_clock(void **state)
{
	(void)state;
	ASK(0, 103, 1, 6, 1, 0xfb, 0x0b, 0, 0, 0, TIME);
	expect_nothing(0);
	assert_int_equal(fake.requests[0].action, MAP_SET_CLOCK);
	assert_int_equal(fake.requests[0].point, MAP_NONE);
	assert_true(fake.requests[0].wall_ns == WALL_NS);
	assert_true(fake.requests[0].time_ns == now);
	now += 3 * MS;
	answer(1, MAP_EXECUTED_COMMAND, MAP_RESULT_DONE);
	run();
	EXPECT(0, 103, 1, 7, 1, 0xfb, 0x0b, 0, 0, 0, 0x1b, 0xbc, 24, 13, 19, 2, 25);
	ASK(0, 103, 1, 6, 1, 0xff, 0xff, 0, 0, 0, TIME);
	answer(2, MAP_EXECUTED_COMMAND, MAP_RESULT_DONE);
	run();
	EXPECT(0, 103, 1, 7, 1, 0xfb, 0x0b, 0, 0, 0, 0x1b, 0xbc, 24, 13, 19, 2, 25);
	EXPECT(0, 103, 1, 7, 1, 0xa1, 0x0f, 0, 0, 0, 0x1b, 0xbc, 24, 13, 19, 2, 25);
	ASK(0, 103, 1, 6, 1, 0xfb, 0x0b, 0, 0, 0, 0, 0, 0, 0, 1, 13, 25);
	EXPECT(0, 103, 1, 0x47, 1, 0xfb, 0x0b, 0, 0, 0, 0, 0, 0, 0, 1, 13, 25);
	assert_int_equal(fake.request_count, 2);
}

static void test_clock_masters(void **state)
{
	(void)state;
	connect_master(1, false);
	start(1);
	ASK(1, 103, 1, 6, 1, 0xfb, 0x0b, 0, 0, 0, TIME);
	EXPECT(1, 103, 1, 0x47, 1, 0xfb, 0x0b, 0, 0, 0, TIME);
	assert_int_equal(fake.request_count, 0);
}

/* ---- connections --------------------------------------------------------------------------- */

static void test_number_of_connections(void **state)
{
	(void)state;
	connect_master(1, true);
	connect_master(2, true);
	assert_null(iec104_station_connect(&station, "one too many", true, now));
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
		ASK(0, 107, 1, 6, 0, 0xfb, 0x0b, 0, 0, 0, 1, 0, TIME);
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

#define TEST(name) cmocka_unit_test_setup(name, set_up)

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
	    TEST(test_test_bit_of_an_interrogation),
	    TEST(test_events),
	    TEST(test_every_master_has_its_own_events),
	    TEST(test_many_events),
	    TEST(test_event_is_not_overtaken_by_an_interrogation),
	    TEST(test_read_value_is_not_followed_by_an_older_event),
	    TEST(test_module_down_and_up),
	    TEST(test_heartbeat_is_missing_for_a_moment),
	    TEST(test_lost_events),
	    TEST(test_point_that_cannot_be_read_now),
	    TEST(test_periodic),
	    TEST(test_stations_are_kept_apart),
	    TEST(test_periodic_while_nothing_is_acknowledged),
	    TEST(test_refusals),
	    TEST(test_wrong_sizes_close),
	    TEST(test_test_command),
	    TEST(test_read),
	    TEST(test_read_with_pn),
	    TEST(test_station_without_devices),
	    TEST(test_single_command_of_figure_5_6),
	    TEST(test_refused_command),
	    TEST(test_select_execute_cancel),
	    TEST(test_selection_ends_with_its_connection),
	    TEST(test_selection_is_granted_after_its_connection_has_gone),
	    TEST(test_only_own_selections_are_ended),
	    TEST(test_selections_are_told_apart),
	    TEST(test_values),
	    TEST(test_values_that_cannot_be_carried_out),
	    TEST(test_time_tags),
	    TEST(test_test_bit_of_a_command),
	    TEST(test_owner_dies),
	    TEST(test_owner_is_starting),
	    TEST(test_answer_is_lost),
	    TEST(test_answer_after_the_master_has_gone),
	    TEST(test_clock),
	    TEST(test_clock_masters),
	    TEST(test_number_of_connections),
	    TEST(test_master_that_only_asks),
	    TEST(test_log_is_not_flooded),
	    TEST(test_random_requests),
	};

	return cmocka_run_group_tests(tests, NULL, NULL);
}
