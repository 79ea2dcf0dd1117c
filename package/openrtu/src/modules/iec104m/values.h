/* SPDX-License-Identifier: GPL-3.0-or-later */
/* What an outstation says, as points of the map. */
#ifndef OPENRTU_MODULES_IEC104M_VALUES_H
#define OPENRTU_MODULES_IEC104M_VALUES_H

#include "iec104/controlling.h"
#include "iec104/outstation_stats.h"
#include "iec104/outstations.h"

#define VALUES_AT_ONCE IEC104_OBJECTS_MAX /* of an ASDU */

/* An object of the outstation that is a point. */
struct values_entry {
	uint16_t ca;
	uint32_t ioa;
	uint32_t point;
	uint32_t command_ioa;
	bool select;
	uint32_t batch;   /* the last that it was in */
	int64_t known_ns; /* what the map has of it was so then; an event of before is past */
};

struct values {
	struct map *map;
	struct iec104_outstation_stats *stats;
	struct values_entry *entries; /* by ca and ioa */
	uint32_t count;
	uint32_t batch;
	uint32_t update_count;
	struct map_update updates[VALUES_AT_ONCE]; /* of one set */
};

/* False: there is no memory. */
bool values_init(struct values *values, struct map *map, const struct iec104_outstation *outstation,
		 struct iec104_outstation_stats *stats);
void values_free(struct values *values);

/* True: some point is not invalid, as those that a former process leaves when a configuration changes. */
bool values_hold(const struct values *values);

/* NULL: it is none of the outstation's. */
const struct values_entry *values_of_point(const struct values *values, uint32_t point);
const struct values_entry *values_find(const struct values *values, uint16_t ca, uint32_t ioa);

/* When something came, by the map's clocks. */
struct values_moment {
	int64_t now_ns;
	int64_t asked_ns; /* what is no event was so at that time or later */
	struct map_clock clock;
};

/*
 * An object that came. cause: of its return information (enum map_cause). It is published with the others of its ASDU by
 * values_publish. False: it is an event of before what the map has, and contradicts it.
 */
bool values_take(struct values *values, const struct iec104_asdu *asdu,
		 const struct iec104_information *information, enum map_cause cause,
		 const struct values_moment *moment);
/* A position, likewise; its points are published in one step. */
bool values_take_position(struct values *values, const struct iec104_asdu *asdu, uint32_t ioa,
			  const struct iec104_geoposition *position, const struct values_moment *moment);
void values_publish(struct values *values);

/* Nobody knows them any more: all are invalid, with the values that they had. */
void values_invalidate(struct values *values, int64_t now_ns);

#endif
