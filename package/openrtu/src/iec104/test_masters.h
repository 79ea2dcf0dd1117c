/* SPDX-License-Identifier: GPL-3.0-or-later */
/*
 * A controlled station on the map that the test holds in its hand, and the controlling stations that are
 * connected to it. Frames are written out octet by octet, those that have a name by name, after IEC 60870-5-101 and -104 and the
 * project report's chapter 5. The names are the test's own: a wrong number in asdu.h shows.
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
/* 100 ms later */
#define TIME_OF_RETURN 0x7c, 0xbc, 24, 13, 19, 2, 25

/* Type identification (IEC 60870-5-101, 7.2.1), without the _1 of all of them. */
enum {
	M_SP_NA = 1,
	M_DP_NA = 3,
	M_ST_NA = 5,
	M_BO_NA = 7,
	M_ME_NA = 9,
	M_ME_NB = 11,
	M_ME_NC = 13,
	M_IT_NA = 15,
	M_ME_ND = 21,
	M_SP_TB = 30,
	M_DP_TB = 31,
	M_ST_TB = 32,
	M_BO_TB = 33,
	M_ME_TD = 34,
	M_ME_TE = 35,
	M_ME_TF = 36,
	M_IT_TB = 37,
	C_SC_NA = 45,
	C_DC_NA = 46,
	C_RC_NA = 47,
	C_SE_NA = 48,
	C_SE_NB = 49,
	C_SE_NC = 50,
	C_BO_NA = 51,
	C_SC_TA = 58,
	C_DC_TA = 59,
	C_RC_TA = 60,
	C_SE_TA = 61,
	C_SE_TB = 62,
	C_SE_TC = 63,
	C_BO_TA = 64,
	M_EI_NA = 70,
	C_IC_NA = 100,
	C_CI_NA = 101,
	C_RD_NA = 102,
	C_CS_NA = 103,
	C_RP_NA = 105,
	C_TS_TA = 107,
	P_ME_NA = 110,
	P_ME_NB = 111,
	P_ME_NC = 112,
	P_AC_NA = 113,
};

/* Cause of transmission (7.2.3), with T and P/N. */
enum {
	CYCLIC = 1,
	BACKGROUND = 2,
	SPONTANEOUS = 3,
	INITIALISED = 4,
	REQUEST = 5,
	ACT = 6,
	ACT_CON = 7,
	DEACT = 8,
	DEACT_CON = 9,
	ACT_TERM = 10,
	RETURN_REMOTE = 11,
	RETURN_LOCAL = 12,
	INTERROGATED = 20,       /* of group n: + n */
	COUNTERS_REQUESTED = 37, /* likewise */
	UNKNOWN_TYPE = 44,
	UNKNOWN_CAUSE = 45,
	UNKNOWN_CA = 46,
	UNKNOWN_IOA = 47,
	NEGATIVE = 0x40,
	TEST_BIT = 0x80,
};

/* Common addresses, low octet first: the two stations, the gateway's own, one that is none, all. */
#define CA_3067    0xfb, 0x0b
#define CA_4001    0xa1, 0x0f
#define CA_900     0x84, 0x03
#define CA_UNKNOWN 0xfc, 0x0b
#define CA_ALL     0xff, 0xff

/* Information object address, low octet first. */
#define IOA(number) (number) & 0xff, (number) >> 8 & 0xff, (number) >> 16

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
