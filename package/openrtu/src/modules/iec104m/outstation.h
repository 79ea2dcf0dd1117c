/* SPDX-License-Identifier: GPL-3.0-or-later */
/* An outstation: its links, of which one has data transfer, what it is asked by itself, its points and commands. */
#ifndef OPENRTU_MODULES_IEC104M_OUTSTATION_H
#define OPENRTU_MODULES_IEC104M_OUTSTATION_H

#include "iec104/polls.h"
#include "modules/iec104m/commands.h"
#include "modules/iec104m/link.h"
#include "modules/iec104m/values.h"

struct outstation {
	struct map *map;
	const struct iec104_outstation *config;
	struct iec104_outstation_stats *stats;
	struct iec104_controlling_settings settings;
	struct iec104_controlling_listener listener;
	struct link links[IEC104_OUTSTATION_LINKS_MAX];
	struct link *active; /* that was asked to start; NULL: none */
	struct iec104_poll *polls;
	uint32_t poll_count;
	uint32_t poll;    /* the request that is one; 0: none is under way */
	int64_t poll_ns;  /* the next at the earliest */
	int64_t asked_ns; /* when that under way was sent */
	bool valid;       /* its points may be good: they are so from the start to the loss of all links */
	bool taken_over;  /* they are a former process's, and there was no data transfer yet */
	bool doubted;     /* it told what was before, which has been said of this data transfer */
	bool unanswered;  /* the last general interrogation failed, which has been said */
	/* What a station that comes and goes would say each time. */
	struct map_repeats invalid, doubts, refusals;
	int64_t valid_until_ns; /* without data transfer, while another link takes over */
	struct iec104_moment now;
	struct map_clock clock;
	struct values values;
	struct commands commands;
};

/* now_ns: from now on, what a former process leaves holds for t1 without data transfer. False: there is no memory. */
bool outstation_init(struct outstation *outstation, struct map *map, const struct iec104_outstation *config,
		     struct iec104_outstation_stats *stats, int64_t now_ns);
void outstation_free(struct outstation *outstation);

/* All there is to do now. */
void outstation_run(struct outstation *outstation, int64_t now_ns);
int64_t outstation_deadline(const struct outstation *outstation);

/* One of its points has this set. */
bool outstation_has(const struct outstation *outstation, uint16_t set);
/* A request that the map's state machine has let through. */
void outstation_execute(struct outstation *outstation, const struct map_request *request, int64_t now_ns);

#endif
