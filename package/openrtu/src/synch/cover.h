/* SPDX-License-Identifier: GPL-3.0-or-later */
/* Coverability (Karp and Miller 1969): what can be said of a net whose markings have no end. */
#ifndef OPENRTU_SYNCH_COVER_H
#define OPENRTU_SYNCH_COVER_H

#include "synch/analysis.h"
#include "synch/model.h"

/*
 * Completes findings that are not complete: bounds, and which transitions fire. Leaves them as they are where the net has
 * inhibitors, or the tree more than limit nodes. False: no memory.
 */
bool cover(const struct model *model, uint32_t limit, const struct synch_net *net,
	   struct synch_findings *out);

#endif
