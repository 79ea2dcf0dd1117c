/* SPDX-License-Identifier: GPL-3.0-or-later */
/*
 * The net with what the order of a module's scan adds to it: two places for each module that waits for its scan, of which one has
 * a token, and an end of that scan that fires nothing where the net has none.
 */
#ifndef OPENRTU_SYNCH_MODEL_H
#define OPENRTU_SYNCH_MODEL_H

#include "synch/net.h"

#define MODEL_PLACES      (SYNCH_PLACES_MAX + 2 * SYNCH_PARTICIPANTS_MAX)
#define MODEL_TRANSITIONS (SYNCH_TRANSITIONS_MAX + SYNCH_PARTICIPANTS_MAX)
#define MODEL_ARCS        (SYNCH_ARCS_MAX + 2 * MODEL_TRANSITIONS + 2 * SYNCH_POINTS_MAX)

struct model {
	struct synch_net net;
	struct synch_place places[MODEL_PLACES];
	struct synch_transition transitions[MODEL_TRANSITIONS];
	struct synch_arc arcs[MODEL_ARCS];
	uint8_t names[MODEL_TRANSITIONS]; /* as in a sequence: SYNCH_QUIET_END */
};

void model_make(struct model *model, const struct synch_net *net);

#endif
