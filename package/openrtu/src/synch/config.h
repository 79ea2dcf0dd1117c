/* SPDX-License-Identifier: GPL-3.0-or-later */
/* The net as the configuration carries it: one section of one record, if the file has a net. */
#ifndef OPENRTU_SYNCH_CONFIG_H
#define OPENRTU_SYNCH_CONFIG_H

#include <string.h>

#include "synch/net.h"

#define SYNCH_NET MAP_SECTION_ID('S', 'Y', 'N', 'N')

struct synch_tables {
	uint32_t place_count, transition_count, arc_count, participant_count, point_count;
	uint32_t
	    priority; /* SCHED_FIFO, the highest of who takes part: none of them waits for a lower one; 0: none */
	struct synch_place places[SYNCH_PLACES_MAX];
	struct synch_transition transitions[SYNCH_TRANSITIONS_MAX];
	struct synch_arc arcs[SYNCH_ARCS_MAX];
	struct synch_participant participants[SYNCH_PARTICIPANTS_MAX];
	struct synch_point points[SYNCH_POINTS_MAX];
};

/* NULL: the file has no net. */
static inline struct synch_tables *synch_tables(const struct map_config *config)
{
	return map_records(config, SYNCH_NET, sizeof(struct synch_tables));
}

static inline struct synch_net synch_net_of(const struct synch_tables *tables)
{
	return (struct synch_net){
	    .place_count = tables->place_count,
	    .transition_count = tables->transition_count,
	    .arc_count = tables->arc_count,
	    .participant_count = tables->participant_count,
	    .point_count = tables->point_count,
	    .places = tables->places,
	    .transitions = tables->transitions,
	    .arcs = tables->arcs,
	    .participants = tables->participants,
	    .points = tables->points,
	};
}

/* A participant's number; UINT32_MAX: the net has none of this name, or there is no net. */
static inline uint32_t synch_participant_named(const struct map_config *config, const char *name)
{
	const struct synch_tables *tables = synch_tables(config);

	for (uint32_t i = 0; tables != NULL && i < tables->participant_count; i++)
		if (strcmp(tables->participants[i].name, name) == 0)
			return i;
	return UINT32_MAX;
}

/* A kind plans its module: whoever of that name is in the net, is that module or a part of it. */
static inline void synch_bind(struct map_config *config, const char *name, uint32_t module)
{
	const uint32_t number = synch_participant_named(config, name);

	if (number == UINT32_MAX)
		return;
	synch_tables(config)->participants[number].module = (uint16_t)module;
	config->modules[module].flags |= MAP_TAKES_PART;
}

#endif
