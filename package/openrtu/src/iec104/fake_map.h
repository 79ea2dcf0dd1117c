/* SPDX-License-Identifier: GPL-3.0-or-later */
/*
 * A map that a test holds in its hand: it decides what happens between two reads. It has the interface of
 * map/map.h, so far as the controlled station uses it, and takes its place when a test is linked.
 */
#ifndef OPENRTU_IEC104_FAKE_MAP_H
#define OPENRTU_IEC104_FAKE_MAP_H

#include "iec104/config.h"
#include "iec104/counters.h"
#include "map/station.h"

#define S  1000000000LL
#define MS 1000000LL

#define WALL_NS 1739971488152000000LL /* 2025-02-19 13:24:48.152 */

#define POINTS   20
#define DEVICES  2
#define OWN      4 /* points of the gateway's own station, of one redundancy group and all others */
#define PLACE    4 /* points of a receiver: a position, latitude, longitude, altitude */
#define ALL      (POINTS + OWN + PLACE)
#define RINGS    3    /* rtud and two owners */
#define EVENTS   4096 /* a power of two, as are the next two */
#define REQUESTS 64
#define ANSWERS  64

enum {
	COIL4 = 3,
	HOLDING3 = 12,
	DOUBLE1 = 13,
	BITS = 15,
	NORMALIZED = 16,
	FLOAT = 17,
	COUNTER = 18,
	POSITION = POINTS + OWN
};

extern struct map_point points[ALL];
extern struct map_set devices[DEVICES + 2];

struct map {
	struct map_config config;
	struct iec104_settings settings; /* its section */
	struct map_sample samples[ALL];
	struct map_sample totals[ALL]; /* of counters; time_ns 0: never frozen */
	struct map_parameters parameters[ALL];
	struct map_event events[EVENTS]; /* this and the next two: rings */
	uint32_t event_count;
	uint32_t event_capacity; /* how many are kept: a power of two, EVENTS at most */
	struct map_queue queues[MAP_QUEUES];
	struct map_queue_place places[MAP_QUEUES];
	uint32_t turns;
	struct iec104_stats stats;
	uint32_t lost_events;
	struct map_request requests[REQUESTS];
	unsigned request_count;
	struct map_answer answers[ANSWERS];
	unsigned answer_count, answers_read;
	struct map_command commands[ALL];
	bool dead[3]; /* rtud and the two modules */
	bool starting[3];
	bool silent[3]; /* its heartbeat is missing */
	uint32_t generation[3];
	struct map_clock clock;
	uint32_t starts, note;           /* as many: nothing to tell */
	void (*on_read)(uint32_t point); /* what happens elsewhere while a point is read */
	void (*on_last_answer)(void);    /* what happens, once, when all answers were taken */
	unsigned unreadable;             /* so many reads fail */
	unsigned log_count;              /* lines */
};

extern struct map fake;
extern int64_t now;

/* Begins anew at 500 s, with two devices of a module each: CA 3067 of the project report's figure 5.3, CA 4001. */
void fake_begin(void);
/* One redundancy group, and a station of the gateway's own, CA 900, which this process owns. */
void fake_own_station(void);
/* A receiver of positions, CA 7001, of the second module. */
void fake_receiver(void);
void put_event(enum map_event_kind kind, uint32_t point, struct map_sample sample);
/* The owner publishes a value: readers see it, and an event is made. */
void publish(uint32_t point, int32_t value);
/* The same after a command: an event of another cause. */
void return_information(uint32_t point, int32_t value);
/* The owner's answer to request id. */
void answer(uint32_t id, enum map_command_state state, enum map_command_result result);

#endif
