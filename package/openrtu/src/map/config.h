/* SPDX-License-Identifier: GPL-3.0-or-later */
/*
 * The configuration as the map carries it: flat tables of fixed-size records, filled by rtud from
 * the JSON file and read by every module. A module never sees the file.
 *
 * The tables refer to each other by index. Points are sorted by set, so that a set's points are contiguous. What only one room
 * knows of a point or a set stands in a section of that room's, by the same index.
 */
#ifndef OPENRTU_MAP_CONFIG_H
#define OPENRTU_MAP_CONFIG_H

#include <stdbool.h>
#include <stddef.h>
#include <stdint.h>

#include "codes.h"

#define MAP_NAME_SIZE        40 /* names of points, devices and modules, terminator included */
#define MAP_KIND_SIZE        16
#define MAP_PREFIX_SIZE      12 /* p65535.255 */
#define MAP_MODULES_MAX      64
#define MAP_GONE_MAX         8  /* whose events are kept for who has not read them */
#define MAP_ADDRESS_SIZE     46 /* INET6_ADDRSTRLEN */
#define MAP_NAMED_QUEUES_MAX 8

/* A set of modules, a bit for each. It is no atomic: on ARMv5 that has 32 bits. */
typedef uint64_t map_modules;
_Static_assert(MAP_MODULES_MAX <= 8 * sizeof(map_modules), "a bit each");
static inline map_modules map_module_bit(uint32_t module)
{
	return (map_modules)1 << module;
}

#define MAP_FILE_SIZE 128 /* a file's path */

/* The information types of the project report's tables 4.1 and 4.2, and two that no Modbus register has. */
enum map_type { MAP_STANDARD_TYPES(MAP_TYPE_CODE) MAP_OWN_TYPES(MAP_TYPE_CODE) };

#define MAP_ONE_MORE(...)    +1
#define MAP_TYPES            (0 MAP_STANDARD_TYPES(MAP_ONE_MORE) MAP_OWN_TYPES(MAP_ONE_MORE))
#define MAP_ANGLE_PER_DEGREE 10000000

#define MAP_POSITION_POINTS 4

enum map_point_flag {
	MAP_POINT_COMMAND = 1u << 0,    /* may be commanded */
	MAP_POINT_SELECT = 1u << 1,     /* a command needs a selection first */
	MAP_POINT_NO_QUALITY = 1u << 2, /* normalized: sent without quality, and so only while good */
	/*
	 * A position as a whole, the first of MAP_POSITION_POINTS, which are published together: the others are latitude,
	 * longitude (angles), altitude (m). Its own value are the kind of fix in bits 0 to 3, the satellites in bits 4 to 7.
	 */
	MAP_POINT_POSITION = 1u << 3,
	MAP_POINT_RETAIN = 1u << 4,     /* its value and quality outlive the process of its owner */
	MAP_POINT_LIMITS = 1u << 5,     /* it has some (map/limits.h) */
	MAP_POINT_NEVER_READ = 1u << 6, /* it takes commands, and has no value */
	MAP_POINT_TEXT = 1u << 7,       /* a bitstring that stands for a text: map/text.h */
};

/*
 * What is published and read together, and has one owner: the scan of a Modbus device, the gateway's own station. Sets with
 * one common address are one station.
 */
struct map_set {
	uint16_t module; /* the owner's number; its kind plans it */
	uint16_t ca;     /* common address */
	uint32_t first_point;
	uint32_t point_count;
	char name[MAP_NAME_SIZE];
	char prefix[MAP_PREFIX_SIZE]; /* of the names of points that have none: map_label */
	uint32_t latch;               /* place among its owner's sets; set by map_create */
};

/* One object, seen by every protocol. */
struct map_point {
	uint32_t name; /* place among the configuration's names, or a map_label */
	uint16_t set;
	uint8_t type;            /* enum map_type */
	uint8_t flags;           /* enum map_point_flag */
	uint8_t group;           /* interrogation group 1..16, 0: none */
	uint8_t counter_group;   /* 1..4, 0: none */
	uint16_t short_pulse_ms; /* of a command, 0: none */
	uint16_t long_pulse_ms;
	uint8_t unit;            /* place among MAP_UNITS and 1; 0: none */
	uint8_t decimals;        /* that people see of a float, and 1; 0: they were not given */
	uint32_t ioa;            /* information object address, 1..16777215 */
	uint32_t send_period_ms; /* of cyclic transmission or background scan, 0: none */
	uint32_t freeze_s;       /* a counter's period of local freezes, 0: none */
	float deadband;          /* in the unit of the value sent; 0: every change is an event */
	float step;       /* of a regulating step command, in that unit; 0: none, min and max mean nothing */
	float min, max;   /* within which the point is commanded, in that unit */
	uint32_t slot;    /* place among its owner's points; set by map_create */
	uint32_t command; /* place among its owner's commands; set by map_create */
	/* Place among its owner's totals, of a counter, parameters, of a measured value, or texts; set by map_create. */
	uint32_t extra;
};

/* When summer time begins or ends: the n-th weekday of a month, in the local time until then (POSIX TZ, Mm.w.d/time). */
struct map_zone_rule {
	uint8_t month;   /* 1..12; 0: there is no summer time */
	uint8_t week;    /* 1..5, 5 the last */
	uint8_t weekday; /* 0 Sunday .. 6 */
	uint8_t reserved;
	int32_t time_s; /* after midnight, may be negative or of a later day */
};

/* A time zone; all 0 is UTC. */
struct map_zone {
	int32_t offset_s; /* ahead of UTC */
	int32_t summer_s; /* the same in summer time */
	struct map_zone_rule begin, end;
};

/* Whom the clock is from (rtud/clock.h). */
enum map_clock_mode {
	MAP_CLOCK_GATEWAY, /* the system's clock while that is synchronised, else a controlling station */
	MAP_CLOCK_MASTERS, /* a controlling station */
	MAP_CLOCK_SYSTEM, /* the system's clock, which a controlling station sets unless it is synchronised */
};

/* An event queue that has a name of its own, as of a redundancy group. */
struct map_queue_plan {
	char name[MAP_NAME_SIZE];
	uint32_t limit; /* events that may wait in it, less than event_ring */
	uint32_t
	    slot; /* which of the queues it is, below MAP_NAMED_QUEUES_MAX; the same in all configurations that have the name */
};

/* What holds for all modules. */
struct map_settings {
	uint16_t select_timeout_s;  /* a selection that is not executed ends; of all protocols, as the next */
	uint16_t command_timeout_s; /* oldest acceptable time tag, longest wait for the device */
	uint8_t clock;              /* enum map_clock_mode */
	uint8_t queue_count;
	struct map_zone zone; /* of wall times that people and control centres see */
	uint32_t force_max_s; /* so long a point may be forced at most; 0: not at all */
	uint32_t event_ring;  /* each module keeps one event less; a power of two */
	struct map_queue_plan queues[MAP_NAMED_QUEUES_MAX];
};

/* What a module may do to the map, and wants of it. */
enum map_module_flag {
	MAP_IS_SUPERVISOR = 1u << 0, /* rtud: its segment carries the configuration */
	MAP_MAY_OWN = 1u << 1,       /* points */
	MAP_MAY_REQUEST = 1u << 2,   /* commands of others' points, and of rtud */
	MAP_HEARS_EVENTS = 1u << 3,  /* its bell is rung when there are some */
	MAP_KEEPS_QUEUES = 1u << 4,  /* the event queues lie in its segment: of one module in a map */
	MAP_IS_LOCAL = 1u << 5,      /* asks for people on the spot, not for a control centre */
	MAP_IS_GONE = 1u << 6, /* the configuration has it no more: it is there for the events that it left */
	MAP_REQUESTS_LISTED =
	    1u << 7, /* with MAP_MAY_REQUEST: commands of the points in MAP_LISTED, nothing else */
	MAP_COORDINATES = 1u << 8, /* scans: its bell is rung when a module asks it (map_synch_say) */
	MAP_TAKES_PART =
	    1u << 9, /* in the net: who coordinates it has mapped its segment, and knows its words */
	MAP_SHOWS_SCANS = 1u << 10, /* its own section begins with a struct map_scans */
	MAP_ASKS_SETUP = 1u << 11,  /* with MAP_MAY_REQUEST: may ask rtud for MAP_SETUP */
};

/* How many records each ring of a segment holds: a power of two; 1 where its module never writes one. */
struct map_rings {
	uint32_t requests, answers, events, log;
};

/* The history in a module's own section (map/history.h): at so many octets, of so many readers and entries. No entries: there is none. */
struct map_history_plan {
	uint32_t at, readers, entries;
};

/*
 * What a module retains in its own section (map/retained.h): at so many octets, so many values, the first of which have names, as
 * many as names from first on in MAP_RETAINED. No names: the journal keeps nothing of it.
 */
struct map_retained_plan {
	uint32_t at, values, first, names;
};

/* A module, as the map is made for it. rtud's segment keeps it: no reader has to know a kind. */
struct map_module_plan {
	char name[MAP_NAME_SIZE];
	char kind[MAP_KIND_SIZE];
	uint32_t flags; /* enum map_module_flag */
	struct map_rings rings;
	uint32_t heartbeat_limit_ms; /* how old its heartbeat may be */
	uint32_t section_size;       /* octets of its own section (map_section) */
	uint32_t counters;           /* so many in that section have a name at most (map_name_counter) */
	struct map_history_plan history;
	struct map_retained_plan retained;
	uint32_t first_listed, listed_count; /* with MAP_REQUESTS_LISTED: its part of MAP_LISTED */
	uint32_t gone;                       /* with MAP_IS_GONE: the epoch since which */
	uint32_t
	    user; /* what rtud adds to the first of the modules' users: no other's, or 0: no process of rtud's */
};

/* What a room alone knows of the configuration: a table of records that the map keeps and does not understand. */
struct map_section {
	uint32_t id; /* MAP_SECTION_ID of the room's choice */
	uint32_t record_size;
	uint32_t count;
	void *records;
};

#define MAP_SECTIONS_MAX 40
#define MAP_SECTION_ID(a, b, c, d)                                                                           \
	((uint32_t)(a) | (uint32_t)(b) << 8 | (uint32_t)(c) << 16 | (uint32_t)(d) << 24)

/* The points that modules with MAP_REQUESTS_LISTED may command: uint32_t, in ascending order for each module. */
#define MAP_LISTED MAP_SECTION_ID('M', 'L', 'S', 'T')

/* The units of points, each once. */
#define MAP_UNITS     MAP_SECTION_ID('U', 'N', 'I', 'T')
#define MAP_UNITS_MAX UINT8_MAX
struct map_unit {
	char text[16];
};

/*
 * The whole configuration. The arrays belong to whoever filled it, or lie in the map.
 */
struct map_config {
	struct map_settings settings;
	uint32_t set_count, point_count;
	/*
	 * Behind these: what the configuration has no more, so that events of it can still be told. Nothing finds them by an
	 * address or a name.
	 */
	uint32_t gone_set_count, gone_point_count;
	struct map_set *sets;
	struct map_point *points;
	char *names; /* given to points, each with its terminator; the first begins at 1 */
	uint32_t names_size;
	struct map_module_plan *modules; /* the first is rtud; not in the map, where map_module has them */
	uint32_t module_count;           /* MAP_MODULES_MAX at most */
	struct map_section sections[MAP_SECTIONS_MAX];
	uint32_t section_count;
	uint32_t text; /* hash of the file's text; not in the map */
};

/*
 * The records that a room keeps in the configuration, in as many octets each as it knows them to have. NULL: there are none, or
 * they are of another version.
 */
static inline void *map_records(const struct map_config *config, uint32_t id, size_t record_size)
{
	for (uint32_t i = 0; i < config->section_count; i++)
		if (config->sections[i].id == id && config->sections[i].record_size == record_size)
			return config->sections[i].records;
	return NULL;
}

/* "": the point has none. */
static inline const char *map_unit_of(const struct map_config *config, const struct map_point *point)
{
	const struct map_unit *units = map_records(config, MAP_UNITS, sizeof(*units));

	return units == NULL || point->unit == 0 ? "" : units[point->unit - 1].text;
}

/* How many records a section has; 0: there is none. */
static inline uint32_t map_record_count(const struct map_config *config, uint32_t id)
{
	for (uint32_t i = 0; i < config->section_count; i++)
		if (config->sections[i].id == id)
			return config->sections[i].count;
	return 0;
}

/*
 * Of a section whose records begin with a number, as that of their point, and are in the order of these: the first of this one's, of which
 * there are *count.
 */
const void *map_records_of(const struct map_config *config, uint32_t id, size_t record_size, uint32_t point,
			   uint32_t *count);

/* Adds a section. The records stay the caller's, or belong to config where that was loaded. */
void map_add_section(struct map_config *config, uint32_t id, size_t record_size, uint32_t count,
		     void *records);
/* The record behind the last one of a section, for which there is room; it counts from now on. */
void *map_next_record(struct map_config *config, uint32_t id);
/* The records of a section are elsewhere now, where there is more room. */
void map_move_section(struct map_config *config, uint32_t id, void *records);

/*
 * Adds a module, unless there is one of this name, and returns its number; UINT32_MAX: there are MAP_MODULES_MAX. modules has
 * room for as many. One that has a name and no kind keeps a number for the module of this name. Where MAP_GONE_MAX of these are
 * gone, or there is no other number left, the one that is gone longest gives its number away.
 */
uint32_t map_plan_module(struct map_config *config, const struct map_module_plan *module);

/*
 * What stands in map_point.name of a point without a name: its name is its set's prefix, a letter, a number, and what it has of
 * that number's 16 bits: so many from one on, 0 of them: all, as in "p1.5.i30", "p1.5.h4.7" or "p1.5.h4.8-15".
 */
#define MAP_LABEL (1u << 31)
static inline uint32_t map_label(char letter, uint16_t number, unsigned first_bit, unsigned bits)
{
	return MAP_LABEL | (uint32_t)letter << 24 | (bits & 0xfu) << 20 | (first_bit & 0xfu) << 16 | number;
}

/* A point's name: what the file gave it, or its label in its set. */
void map_point_name(const struct map_config *config, const struct map_point *point, char out[MAP_NAME_SIZE]);

#endif
