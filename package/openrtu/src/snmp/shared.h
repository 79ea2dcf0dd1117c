/* SPDX-License-Identifier: GPL-3.0-or-later */
/*
 * What rtu-snmp keeps in its segment: counters, and the events with their numbers, so that another process of the module goes
 * on where the one before ended.
 */
#ifndef OPENRTU_SNMP_SHARED_H
#define OPENRTU_SNMP_SHARED_H

#include <stdatomic.h>

#include "map/latch.h"
#include "map/map.h"
#include "snmp/config.h"

#define SNMP_EVENTS  8192 /* a power of two */
#define SNMP_NO_USER 0xffu

enum snmp_counter {
	SNMP_COUNT_MESSAGES,
	SNMP_COUNT_LIMITED,     /* dropped: their sender sends too many, or is none of the managers */
	SNMP_COUNT_DAMAGED,     /* no message of version 3, not authentic, of no user */
	SNMP_COUNT_DENIED,      /* what a user has no right to */
	SNMP_COUNT_SETS,        /* carried out */
	SNMP_COUNT_EVENTS,      /* numbered */
	SNMP_COUNT_EVENTS_LOST, /* read too late */
	SNMP_COUNT_NOTIFICATIONS,
	SNMP_COUNT_RETRIES,
	SNMP_COUNT_SILENT, /* times that a sink fell silent */
	SNMP_COUNT_OF_COUNTERS
};

/* As rtuEventKind has it. */
enum snmp_event_kind {
	SNMP_EVENT_CHANGE = 1,
	SNMP_EVENT_MODULE_DOWN,
	SNMP_EVENT_MODULE_UP,
	SNMP_EVENT_CLOCK,
	SNMP_EVENT_COMMAND,
	SNMP_EVENT_FROZEN,
	SNMP_EVENT_PARAMETER,
	SNMP_EVENT_STARTED,
	SNMP_EVENT_CYCLIC,
};

struct snmp_event {
	int64_t time_ms;       /* since 1970, UTC */
	uint32_t point;        /* or a module's number; MAP_NONE: neither */
	union map_value value; /* of a command its number */
	uint32_t spin;         /* of a command, its spin lock */
	uint8_t kind;          /* enum snmp_event_kind */
	uint8_t quality, counter_detail;
	uint8_t cause; /* enum map_cause */
	bool time_valid;
	uint8_t state, result, detail; /* of a command */
	uint8_t user;                  /* who commanded; SNMP_NO_USER: module did */
	uint8_t module;
	uint8_t reserved[2];
};

/* How far the map's events have been numbered. */
struct snmp_position {
	struct map_cursor cursor;
	uint32_t last; /* number of the newest event, 0: none yet */
};

struct snmp_shared {
	_Atomic uint32_t counters[SNMP_COUNT_OF_COUNTERS];
	_Atomic uint32_t confirmed[SNMP_SINKS_MAX]; /* number of the last event that a sink has */
	_Atomic uint32_t sink_lost[SNMP_SINKS_MAX];
	_Atomic uint32_t
	    epoch; /* another one for each time that the numbers begin anew; 0: they have not begun */
	_Atomic uint32_t starts; /* of the station, as announced */
	map_latch latch;
	struct snmp_position copies[2];
	struct snmp_event events[SNMP_EVENTS]; /* number n is at n modulo SNMP_EVENTS */
};

#endif
