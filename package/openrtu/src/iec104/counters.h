/* SPDX-License-Identifier: GPL-3.0-or-later */
/* What rtu-iec104 shows of its work: the section of its own in its segment. */
#ifndef OPENRTU_IEC104_COUNTERS_H
#define OPENRTU_IEC104_COUNTERS_H

#include <stdatomic.h>

#include "map/map.h"

#define IEC104_KIND            "iec104"
#define IEC104_CONNECTIONS_MAX 16
#define IEC104_PEER_SIZE       64

/* The closings have the order of iec104/session.h, which checks it. */
enum iec104_counter {
	IEC104_COUNT_I_IN,
	IEC104_COUNT_S_IN,
	IEC104_COUNT_STARTDT_ACT_IN,
	IEC104_COUNT_STARTDT_CON_IN,
	IEC104_COUNT_STOPDT_ACT_IN,
	IEC104_COUNT_STOPDT_CON_IN,
	IEC104_COUNT_TESTFR_ACT_IN,
	IEC104_COUNT_TESTFR_CON_IN,
	IEC104_COUNT_I_OUT,
	IEC104_COUNT_S_OUT,
	IEC104_COUNT_STARTDT_ACT_OUT,
	IEC104_COUNT_STARTDT_CON_OUT,
	IEC104_COUNT_STOPDT_ACT_OUT,
	IEC104_COUNT_STOPDT_CON_OUT,
	IEC104_COUNT_TESTFR_ACT_OUT,
	IEC104_COUNT_TESTFR_CON_OUT,
	IEC104_COUNT_ACCEPTED,
	IEC104_COUNT_NOT_LISTED,
	IEC104_COUNT_TOO_MANY,
	IEC104_COUNT_BAD_APDU,
	IEC104_COUNT_BAD_ASDU,
	IEC104_COUNT_BAD_NS,
	IEC104_COUNT_BAD_NR,
	IEC104_COUNT_I_WHILE_STOPPED,
	IEC104_COUNT_T1_I_FRAME,
	IEC104_COUNT_T1_TESTFR,
	IEC104_COUNT_UNREAD_ANSWERS,
	IEC104_COUNT_TAKEN_OVER,
	IEC104_COUNT_GAVE_WAY,
	IEC104_COUNT_NOT_SECURE,
	IEC104_COUNT_NOT_AS_BEFORE,
	IEC104_COUNT_CLOSED_BY_PEER,
	IEC104_COUNT_CLOSED_BY_STATION,
	IEC104_COUNT_UNKNOWN_TYPE,
	IEC104_COUNT_UNKNOWN_CAUSE,
	IEC104_COUNT_UNKNOWN_CA,
	IEC104_COUNT_UNKNOWN_IOA,
	IEC104_COUNT_NEGATIVE,
	IEC104_COUNT_ORIGINATOR,
	IEC104_COUNT_EVENTS_SENT,
	IEC104_COUNT_EVENTS_LOST,
	IEC104_COUNT_OF_COUNTERS
};

/* Session numbers are those of IEC 60870-5-104, clause 5. */
struct iec104_connection_stats {
	char peer[IEC104_PEER_SIZE];
	_Atomic uint32_t open;
	_Atomic uint32_t queue;   /* slot, MAP_NONE before the first STARTDT */
	_Atomic uint32_t since_s; /* CLOCK_MONOTONIC */
	_Atomic uint32_t started;
	_Atomic uint32_t next_ns, next_nr; /* V(S), V(R) */
	_Atomic uint32_t unacknowledged;   /* own I frames, at most k */
	_Atomic uint32_t owed;             /* received I frames not yet acknowledged, at most w */
};

/* The same, as others see it. */
struct iec104_shown_connection {
	char peer[IEC104_PEER_SIZE];
	uint32_t queue;
	int64_t since_ns;
	bool started;
	uint32_t next_ns, next_nr;
	uint32_t unacknowledged, owed;
};

struct iec104_stats {
	_Atomic uint32_t counters[IEC104_COUNT_OF_COUNTERS]; /* since the gateway started; wrap at 2^32 */
	struct iec104_connection_stats connections[IEC104_CONNECTIONS_MAX];
};

/* Whether this program was built for the records that the map has of IEC 104. What reads them asks first. */
bool iec104_is_known(const struct map *map);
/* rtu-iec104: to count in. Others get the same memory read-only. */
struct iec104_stats *iec104_stats_of(const struct map *map);
/* A connection. False: there is none in this place. place < IEC104_CONNECTIONS_MAX. */
bool iec104_shown_connection(const struct map *map, unsigned place, struct iec104_shown_connection *out);
/* A counter's name, as in "i_frames_in". */
const char *iec104_counter_name(enum iec104_counter counter);

#endif
