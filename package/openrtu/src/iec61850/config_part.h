/* SPDX-License-Identifier: GPL-3.0-or-later */
#ifndef OPENRTU_IEC61850_CONFIG_PART_H
#define OPENRTU_IEC61850_CONFIG_PART_H

#include "config/part.h"
#include "iec61850/ln_class.h"

/* "iec61850": an object; without it there is no server. */
extern const struct config_part iec61850_part;

/* ---- config_ln.c ------------------------------------------------------------------------- */

/* Keeps what a point's "ln" says, or reports what is wrong with it. */
void iec61850_take_ln(struct config_loader *loader, const struct config_place *place, uint32_t point,
		      const char *text);
/* Reports what is wrong with all of them together. False: no memory. */
bool iec61850_check_lns(struct config_loader *loader, const struct config_place *place);

/* ---- config_limits.c, config_sets.c ------------------------------------------------------ */

/* The common data class of a point, when all points and limits are there. */
enum iec61850_cdc iec61850_configured_cdc(const struct map_config *config, uint32_t point);
/* Reads the array of limits, when all points are there; NULL: there is none. False: no memory. */
bool iec61850_take_limits(struct config_loader *loader, const struct config_place *place,
			  const json_t *array);
/* Reads the array of data sets, when all points and limits are there; NULL: there is none. False: no memory. */
bool iec61850_take_sets(struct config_loader *loader, const struct config_place *place, const json_t *array);

/* Of each element of "limits" and "data_sets". */
extern const struct config_table iec61850_limits_table, iec61850_set_table;

#endif
