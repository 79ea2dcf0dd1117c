/* SPDX-License-Identifier: GPL-3.0-or-later */
/* Sets of points that are no Modbus device, as of a GPS receiver: added behind the others, in the finish of a part. */
#ifndef OPENRTU_CONFIG_SETS_H
#define OPENRTU_CONFIG_SETS_H

#include "config/files.h"

/*
 * Adds a set without points, and reports another set's common address. place: of ca in the file. The part's begin has counted
 * it in sets_max. Valid until the map is made.
 */
struct map_set *config_add_set(struct config_loader *loader, const struct config_place *place, uint16_t ca,
			       const char *name);

/*
 * Adds a point to the last set, and reports a name or an IOA that another point has. place: where the point is asked for in
 * the file. The part's begin has counted it in points_max.
 */
struct map_point *config_add_point(struct config_loader *loader, const struct config_place *place,
				   const char *name, enum map_type type, uint32_t ioa);

#endif
