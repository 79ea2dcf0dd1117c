/* SPDX-License-Identifier: GPL-3.0-or-later */
#include "iec104/test_masters.h"

#include <stdio.h>
#include <string.h>

struct iec104_station station;
int64_t sent_ns[MASTERS * 12];
struct map_queue_place places[MASTERS * 12];
struct master masters[MASTERS];

static uint16_t nr_of(struct master *master)
{
	if (!master->mute)
		master->acknowledged = master->nr;
	return master->acknowledged;
}

void run(void)
{
	iec104_station_run(&station, now);
}

void put_bytes(struct master *master, const uint8_t *bytes, size_t size)
{
	size_t room;
	uint8_t *place = iec104_session_space(&master->connection->session, &room);

	assert_true(room >= size);
	memcpy(place, bytes, size);
	iec104_session_received(&master->connection->session, size);
	run();
}

void ask(struct master *master, const uint8_t *asdu, size_t size)
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

void acknowledge(struct master *master)
{
	uint16_t nr;

	master->mute = false;
	nr = nr_of(master);
	put_bytes(master, (const uint8_t[]){0x68, 4, 1, 0, (uint8_t)(nr << 1), (uint8_t)(nr >> 7)}, 6);
}

const uint8_t *next_frame(struct master *master)
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

void expect_asdu(unsigned master, const uint8_t *asdu, size_t size)
{
	const uint8_t *frame = next_frame(&masters[master]);

	assert_non_null(frame);
	assert_int_equal(frame[1], size + 4);
	assert_memory_equal(frame + 6, asdu, size);
}

void expect_nothing(unsigned master)
{
	run();
	assert_null(next_frame(&masters[master]));
}

void connect_master(unsigned master, bool clock_master)
{
	char address[MAP_ADDRESS_SIZE];

	snprintf(address, sizeof(address), "10.0.0.%u", master);
	connect_from(master, address, MAP_NONE);
	masters[master].connection->clock_master = clock_master;
}

void connect_from(unsigned master, const char *address, uint32_t group)
{
	struct iec104_peer peer = {.name = "master", .party = group};

	snprintf(peer.address, sizeof(peer.address), "%s", address);
	masters[master] = (struct master){.connection = iec104_station_connect(&station, &peer, now)};
	assert_non_null(masters[master].connection);
}

void reconnect(unsigned master)
{
	char address[MAP_ADDRESS_SIZE];
	uint32_t group = masters[master].connection->group;

	snprintf(address, sizeof(address), "%s", masters[master].connection->address);
	iec104_station_disconnect(&station, masters[master].connection);
	connect_from(master, address, group);
}

void start(unsigned master)
{
	static const uint8_t startdt[] = {0x68, 4, 0x07, 0, 0, 0}, con[] = {0x68, 4, 0x0b, 0, 0, 0};

	put_bytes(&masters[master], startdt, sizeof(startdt));
	assert_memory_equal(next_frame(&masters[master]), con, sizeof(con));
}

void hold_back(unsigned master)
{
	masters[master].mute = true;
	for (unsigned i = 0; i < station.times.k; i++)
		ASK(master, C_TS_TA, 1, ACT, 0, CA_3067, IOA(0), 1, 0, TIME);
	while (next_frame(&masters[master]) != NULL)
		;
}

int set_up(void **state)
{
	(void)state;
	fake_begin();
	iec104_station_init(&station, &fake, sent_ns, places);
	connect_master(0, true);
	start(0);
	return 0;
}
