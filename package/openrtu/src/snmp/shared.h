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
	SNMP_COUNT_UNKNOWN_CONTEXTS,
	SNMP_COUNT_UNKNOWN_HANDLERS, /* of another engine's context */
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
	SNMP_EVENT_INITIALISED, /* a station */
	SNMP_EVENT_COLD_START,
	SNMP_EVENT_LINK_DOWN,
	SNMP_EVENT_LINK_UP,
};

#define SNMP_NO_CA 65535

/* It says of a point what a manager must know, since the configuration may have another one at its number by now. */
struct snmp_event {
	int64_t time_ms;       /* since 1970, UTC */
	uint32_t ioa : 24;     /* 0: of no point */
	uint32_t type : 4;     /* enum map_type of the point */
	uint32_t decimals : 4; /* snmp_decimals of it */
	union map_value value; /* of a command its number, of a link its ifIndex */
	uint32_t spin;         /* of a command, its spin lock */
	uint8_t kind;          /* enum snmp_event_kind */
	uint8_t quality, counter_detail;
	uint8_t cause; /* enum map_cause */
	bool time_valid;
	uint8_t state, result, detail; /* of a command; of a link its ifOperStatus and ifAdminStatus */
	uint8_t user;                  /* who commanded; SNMP_NO_USER: module did */
	uint8_t module;                /* that one, or the one that went down or up */
	uint16_t ca;                   /* SNMP_NO_CA: of no station */
};
_Static_assert(sizeof(struct snmp_event) == 32, "of 8 192 events");

/* How far the map's events have been numbered. */
struct snmp_position {
	struct map_cursor cursor;
	uint32_t last; /* number of the newest event, 0: none yet */
};

#define SNMP_INTERFACES_MAX 64
#define SNMP_MOUNTS_MAX     16
#define SNMP_NUMBERED_SIZE  60

/* What has come and gone keeps its number for when it comes again. */
struct snmp_numbered {
	uint32_t number; /* 0: none */
	uint8_t link;    /* of an interface, as it was told last, 0: not yet */
	char name[SNMP_NUMBERED_SIZE];
};

struct snmp_shared {
	_Atomic uint32_t counters[SNMP_COUNT_OF_COUNTERS];
	_Atomic uint32_t confirmed[SNMP_SINKS_MAX]; /* number of the last event that a sink has */
	_Atomic uint32_t sink_lost[SNMP_SINKS_MAX];
	_Atomic uint32_t
	    epoch; /* another one for each time that the numbers begin anew; 0: they have not begun */
	_Atomic uint32_t starts;                   /* of the station, as announced */
	_Atomic uint32_t configuration;            /* a number of its points, as announced */
	_Atomic uint32_t turn;                     /* of cyclic data, that ended last */
	_Atomic uint32_t taken[SNMP_USERS_MAX][2]; /* by a user who polls, of class 1 and 2 */
	uint8_t initialised[SNMP_NO_CA / 8 + 1];   /* stations whose initialisation has been told to end */
	bool changed;                              /* those that it has not are of a changed configuration */
	struct snmp_numbered interfaces[SNMP_INTERFACES_MAX]; /* ifIndex */
	struct snmp_numbered mounts[SNMP_MOUNTS_MAX];         /* hrStorageIndex */
	map_latch latch;
	struct snmp_position copies[2];
	struct snmp_event events[SNMP_EVENTS]; /* number n is at n modulo SNMP_EVENTS */
};

#endif
