/* SPDX-License-Identifier: GPL-3.0-or-later */
/* What is behind struct openrtu. */
#ifndef OPENRTU_LIB_HANDLE_H
#define OPENRTU_LIB_HANDLE_H

#include "foreign/config.h"
#include "foreign/stats.h"
#include "lib/openrtu.h"
#include "map/map.h"
#include "modules/synched.h"

struct openrtu {
	struct map *map;
	const struct foreign_module *module;
	struct foreign_stats *stats;
	struct synched synched;
	int stop_fd; /* readable: it was asked to end */
	bool stopped;
	/* Its points: what it reads, then its own. */
	uint32_t input_count, own_count;
	uint32_t *points;           /* their numbers in the map */
	struct map_sample *samples; /* inputs as frozen, own ones as written last */
	char (*names)[MAP_NAME_SIZE];
	struct map_sample *fresh;   /* what a set is read into */
	struct map_update *updates; /* own points that this scan has written, the others' point is MAP_NONE */
	struct map_update *written; /* the same without gaps, for map_publish */
	/* The scan. */
	uint8_t seen; /* enum map_quality of the inputs that it has read so far */
	int64_t now_ns, next_ns;
	uint32_t missed;        /* periods since the last line about them */
	int64_t missed_said_ns; /* 0: never */
};

/* ---- values.c ---------------------------------------------------------------------------- */

double value_number(enum map_type type, union map_value value);
/* False: no value of this type; out is then left as it is. */
bool value_of_number(enum map_type type, double number, union map_value *out);

/* ---- scan.c ------------------------------------------------------------------------------ */

/* The values that own points have before anybody writes them, published. */
void scan_publish_initial(struct openrtu *rtu);

/* ---- synch.c ----------------------------------------------------------------------------- */

/* Waits until the net lets a scan begin. False: the module shall end. */
bool synch_begin_scan(struct openrtu *rtu);
/* Tells the net that the scan has ended, and waits until that has fired. */
void synch_end_scan(struct openrtu *rtu);

#endif
