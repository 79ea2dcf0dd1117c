/* SPDX-License-Identifier: GPL-3.0-or-later */
/* The readers of what the configuration file says of IEC 60870-5-104. */
#ifndef OPENRTU_IEC104_CONFIG_READERS_H
#define OPENRTU_IEC104_CONFIG_READERS_H

#include "config/files.h"
#include "iec104/config.h"

/* ---- config_masters.c -------------------------------------------------------------------- */

/*
 * The settings of these names, from arrays of at most IEC104_MASTERS_MAX, MAP_NAMED_QUEUES_MAX and 256 elements. After
 * event_ring, which queues are measured by.
 */
void iec104_read_masters(struct config_loader *loader, const struct config_place *array, const json_t *json);
void iec104_read_groups(struct config_loader *loader, const struct config_place *array, const json_t *json);
void iec104_read_originators(struct config_loader *loader, const struct config_place *array,
			     const json_t *json);
/* Reports a group's master that may not connect, and counts the masters in no group. groups: where the groups are. */
void iec104_check_masters(struct config_loader *loader, const struct config_place *groups);

/* ---- config_own.c ------------------------------------------------------------------------ */

#define IEC104_OWN_POINTS_MAX (2 * (MAP_NAMED_QUEUES_MAX + 1))

/*
 * Adds the gateway's own station behind all others, if the settings have its common address. There is room for a set and
 * IEC104_OWN_POINTS_MAX points. Reports what they collide with.
 */
void iec104_add_own_station(struct config_loader *loader);

/* Of each element of "redundancy_groups". */
extern const struct config_table iec104_group_table;

#endif
