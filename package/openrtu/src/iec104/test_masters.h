/* SPDX-License-Identifier: GPL-3.0-or-later */
/*
 * A controlled station on the map that the test holds in its hand, and the controlling stations that are
 * connected to it. Frames are written out as octets, after IEC 60870-5-101 and -104 and the project report's chapter 5.
 */
#ifndef OPENRTU_IEC104_TEST_MASTERS_H
#define OPENRTU_IEC104_TEST_MASTERS_H

#include <setjmp.h>
#include <stdarg.h>
#include <stddef.h>
#include <stdint.h>

#include <cmocka.h>

#include "iec104/fake_map.h"
#include "iec104/station.h"

/* CP56Time2a of WALL_NS */
#define TIME 0x18, 0xbc, 24, 13, 19, 2, 25

#define MASTERS 4

struct master {
	struct iec104_connection *connection;
	uint16_t ns, nr;       /* V(S), V(R) */
	uint16_t acknowledged; /* N(R) of its frames */
	bool mute;             /* does not acknowledge for a while */
};

extern struct iec104_station station;
extern int64_t sent_ns[MASTERS * 12];
extern struct map_queue_place places[MASTERS * 12];
extern struct master masters[MASTERS];

#define TEST(name) cmocka_unit_test_setup(name, set_up)

/* A station on a map begun anew; the first master is connected and has started. */
int set_up(void **state);

/* From an address of its own, 10.0.0.⟨master⟩, in no redundancy group. */
void connect_master(unsigned master, bool clock_master);
/* Its former connection is gone. */
void reconnect(unsigned master);
void connect_from(unsigned master, const char *address, uint32_t group);
/* STARTDT */
void start(unsigned master);
/* The station's turn, at this moment. */
void run(void);

/* What the master writes to its connection. */
void put_bytes(struct master *master, const uint8_t *bytes, size_t size);
/* An I frame. */
void ask(struct master *master, const uint8_t *asdu, size_t size);
/* An S frame; the master acknowledges what it receives again. */
void acknowledge(struct master *master);
/* Makes the station send k frames, which stay unacknowledged. */
void hold_back(unsigned master);

/* The next frame of the station; S frames are passed over. NULL: there is none. */
const uint8_t *next_frame(struct master *master);
void expect_asdu(unsigned master, const uint8_t *asdu, size_t size);
void expect_nothing(unsigned master);

#define ASK(master, ...)                                                                                     \
	ask(&masters[master], (const uint8_t[]){__VA_ARGS__}, sizeof((const uint8_t[]){__VA_ARGS__}))

#define EXPECT(master, ...)                                                                                  \
	expect_asdu(master, (const uint8_t[]){__VA_ARGS__}, sizeof((const uint8_t[]){__VA_ARGS__}))

#endif
