/* SPDX-License-Identifier: GPL-3.0-or-later */
/* What is behind struct openrtu. */
#ifndef OPENRTU_LIB_HANDLE_H
#define OPENRTU_LIB_HANDLE_H

#include "foreign/config.h"
#include "lib/openrtu.h"
#include "map/map.h"
#include "map/type.h"
#include "process/commanding.h"
#include "synch/synched.h"

/* What is requested of an own point: one selection and one command at a time. */
struct asked {
	/* A selection is judged in the scan that begins behind it, and settled when that ends. */
	bool selects;
	bool selection_seen;
	uint8_t refusal; /* enum map_command_result, MAP_RESULT_NONE: it is accepted */
	struct map_request selection;
	enum { ASKED_NOTHING, ASKED_NEW, ASKED_SEEN, ASKED_CONFIRMED, ASKED_ENDS } phase;
	uint8_t result; /* enum map_command_result, of one that ends with this scan */
	struct map_request command;
	int64_t begun_ns;
};

/* Inputs of one set, which are read together. */
struct input_set {
	uint32_t first, end;
	struct map_seen seen;
};

/* What a scan has made of one of its own points. */
struct output {
	bool written;
	uint8_t flags, event_rule; /* of struct map_update */
};

struct openrtu {
	struct map *map;
	const struct foreign_module *module;
	struct map_scans *scans; /* its own section */
	struct synched synched;
	int stop_fd; /* readable: it was asked to end */
	bool stopped;
	/* Its points: what it reads, then its own, then what it may command and does not read. */
	uint32_t input_count, own_count, point_count;
	uint32_t *points;           /* their numbers in the map */
	uint8_t *types;             /* enum map_type of each */
	struct map_sample *samples; /* inputs as frozen, own ones as written last */
	char (*names)[MAP_NAME_SIZE];
	uint32_t set_count; /* of its inputs */
	struct input_set *sets;
	struct map_sample *fresh;   /* what a set is read into */
	struct output *outputs;     /* of each own point */
	struct map_update *updates; /* of those that are written, for map_publish */
	struct asked *asked;        /* of each own point */
	bool asking;                /* one of these is not settled */
	uint32_t command_count;     /* that it may give */
	struct commanding *commands;
	uint32_t *command_of; /* of each point, among them; MAP_NONE: it may not */
	/* Events. */
	struct map_cursor cursor;
	uint32_t events_lost, events_taken; /* taken: in this scan */
	uint32_t ended; /* a module of which its inputs from ended_next on are to be told */
	uint32_t ended_next;
	int64_t ended_ns;
	/* The scan. */
	uint8_t seen; /* enum map_quality of the inputs that it has read so far */
	int64_t now_ns, next_ns;
	uint32_t missed;        /* periods since the last line about them */
	int64_t missed_said_ns; /* 0: never */
};

/* ---- values.c ---------------------------------------------------------------------------- */

static inline double value_number(enum map_type type, union map_value value)
{
	switch (map_types[type].class) {
	case MAP_CLASS_STATE:
	case MAP_CLASS_PATTERN:
		return value.u;
	case MAP_CLASS_POSITION:
		return value.i;
	case MAP_CLASS_MEASURED:
	case MAP_CLASS_TOTAL:
		break;
	}
	return map_number(type, value);
}
/* False: no value of this type; out is then left as it is. */
bool value_of_number(enum map_type type, double number, union map_value *out);

/* Whether a value that somebody else has made is one of this type. */
bool value_is_sound(enum map_type type, union map_value value);

static inline bool is_point(const struct openrtu *rtu, int point)
{
	return point >= 0 && (uint32_t)point < rtu->point_count;
}

static inline bool is_own(const struct openrtu *rtu, int point)
{
	return is_point(rtu, point) && (uint32_t)point >= rtu->input_count &&
	       (uint32_t)point < rtu->input_count + rtu->own_count;
}

static inline enum map_type type_of(const struct openrtu *rtu, int point)
{
	return (enum map_type)rtu->types[point];
}

/* ---- requests.c -------------------------------------------------------------------------- */

/* What a former process has left of commands that it carried out. */
void requests_begin(struct openrtu *rtu);
/* Takes what was requested of own points since the last scan. */
void requests_take(struct openrtu *rtu);
/* Whether its value goes out although the scan has not written it: who has commanded it waits for it. */
static inline bool requests_want(const struct openrtu *rtu, uint32_t own)
{
	return rtu->asking && rtu->asked[own].phase == ASKED_ENDS &&
	       rtu->asked[own].result == MAP_RESULT_DONE;
}
/* Which cause that has, by the command that ends with it. */
uint8_t requests_cause(const struct openrtu *rtu, uint32_t own);
/* Answers what this scan has decided, after its outputs are out. */
void requests_settle(struct openrtu *rtu);

/* ---- commands.c -------------------------------------------------------------------------- */

/* What became of its commands since the last scan. */
void commands_take(struct openrtu *rtu);

/* ---- events.c ---------------------------------------------------------------------------- */

void events_begin(struct openrtu *rtu);

/* ---- scan.c ------------------------------------------------------------------------------ */

/* The values that own points have before anybody writes them, published. */
void scan_publish_initial(struct openrtu *rtu);

/* ---- synch.c ----------------------------------------------------------------------------- */

/* Waits until the net lets a scan begin. False: the module shall end. */
bool synch_begin_scan(struct openrtu *rtu);
/* Tells the net that the scan has ended, and waits until that has fired. */
void synch_end_scan(struct openrtu *rtu);

#endif
