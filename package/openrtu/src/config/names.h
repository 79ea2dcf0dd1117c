/* SPDX-License-Identifier: GPL-3.0-or-later */
/* Names of points. */
#ifndef OPENRTU_CONFIG_NAMES_H
#define OPENRTU_CONFIG_NAMES_H

#include "config/keys.h"
#include "map/config.h"

#define CONFIG_KEY_NAME "name" /* of whatever is a point */

/* A point's name in IEC 61850, for the readers of points of all rooms. */
#define CONFIG_KEY_LN  "ln"
#define CONFIG_LN_SIZE 30
#define CONFIG_LN_RULE                                                                                       \
	{                                                                                                    \
		CONFIG_KEY_LN, CONFIG_TEXT,                                                                  \
		    .page = true, .low = 1, .high = CONFIG_LN_SIZE - 1,                                      \
		    CONFIG_SAYS(                                                                             \
			"Data object of IEC 61850 that it is, instead of one of GGIO1, as `MMXU1.TotW`: "    \
			"prefix or none, class and number of the logical node, and the data object.",        \
			.see = "iec61850.md#logical-nodes",                                                  \
			.pattern = "^[A-Za-z][0-9A-Za-z_]*[1-9][0-9]*\\.[A-Z][0-9A-Za-z]*$")                 \
	}

/* Gives the point a name of its own; there is room for one each. */
void config_keep_name(struct map_config *config, struct map_point *point, const char *name);
/* Gives the point a unit: the 256th of a configuration is none. */
void config_keep_unit(struct map_config *config, struct map_point *point, const char *unit);
/* Reports what no name of a point may have. place: of the name, or of what is put before it. */
void config_check_name(struct config_report *report, const struct config_place *place, const char *name);

#endif
