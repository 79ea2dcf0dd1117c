/* SPDX-License-Identifier: GPL-3.0-or-later */
/* What the values of a point are called: an object whose keys are the numbers. */
#ifndef OPENRTU_CONFIG_MEANINGS_H
#define OPENRTU_CONFIG_MEANINGS_H

#include "config/keys.h"
#include "map/config.h"

#define CONFIG_KEY_NAMES    "names"
#define CONFIG_MEANINGS_MAX 64 /* of a point */

/* Reports what is none. place: that of the object. */
void config_check_meanings(struct config_report *report, const struct config_place *place, enum map_type type,
			   const json_t *names);
/* Keeps those of a point, behind those of the points before it. names: checked. */
void config_keep_meanings(struct config_report *report, struct map_config *config, uint32_t point,
			  const json_t *names);

#endif
