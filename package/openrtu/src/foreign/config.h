/* SPDX-License-Identifier: GPL-3.0-or-later */
/* What the configuration says of modules that others wrote: sections that libopenrtu reads as well. */
#ifndef OPENRTU_FOREIGN_CONFIG_H
#define OPENRTU_FOREIGN_CONFIG_H

#include <string.h>

#include "map/config.h"

#define FOREIGN_MODULES MAP_SECTION_ID('F', 'M', 'O', 'D') /* struct foreign_module */
#define FOREIGN_POINTS  MAP_SECTION_ID('F', 'P', 'N', 'T') /* struct foreign_point */
#define FOREIGN_READS   MAP_SECTION_ID('F', 'R', 'D', 'S') /* uint32_t, points of others */
#define FOREIGN_TEXTS   MAP_SECTION_ID('F', 'T', 'X', 'T') /* char, texts with their terminators */

#define FOREIGN_COUNTERS 2 /* of its scans, that have names */

#define FOREIGN_KIND      "foreign"
#define FOREIGN_USER_SIZE 32
#define FOREIGN_NO_SET    UINT16_MAX

struct foreign_module {
	char name[MAP_NAME_SIZE];
	char program[MAP_FILE_SIZE];  /* absolute path */
	char user[FOREIGN_USER_SIZE]; /* of the system, empty: one that rtud gives it */
	uint32_t period_ms;           /* between two scans */
	uint32_t period_given;        /* 0: the file has none, and a net that lets it begin is all */
	uint32_t heartbeat_limit_ms;
	uint32_t memory_mb;   /* of address space, at most */
	uint16_t priority;    /* SCHED_FIFO, 0: none */
	uint16_t set;         /* its points; FOREIGN_NO_SET: it has none */
	uint32_t first_point; /* of the set, among FOREIGN_POINTS */
	uint32_t first_read, read_count;
	uint32_t first_command, command_count; /* among MAP_LISTED */
	uint32_t config;                       /* JSON, by its place among FOREIGN_TEXTS */
};

struct foreign_point {
	uint32_t description; /* by its place among FOREIGN_TEXTS */
	double initial;       /* NaN: none, it is invalid until it is written */
};

static inline uint32_t foreign_count(const struct map_config *config)
{
	return map_record_count(config, FOREIGN_MODULES);
}

static inline struct foreign_module *foreign_modules(const struct map_config *config)
{
	return map_records(config, FOREIGN_MODULES, sizeof(struct foreign_module));
}

/* NULL: there is none of this name. */
static inline const struct foreign_module *foreign_find(const struct map_config *config, const char *name)
{
	const struct foreign_module *modules = foreign_modules(config);

	for (uint32_t i = 0; modules != NULL && i < foreign_count(config); i++)
		if (strcmp(modules[i].name, name) == 0)
			return &modules[i];
	return NULL;
}

static inline const char *foreign_text(const struct map_config *config, uint32_t place)
{
	return (const char *)map_records(config, FOREIGN_TEXTS, sizeof(char)) + place;
}

/* What the file says of a point beside what the map knows; NULL: it is no point of such a module. */
static inline const struct foreign_point *foreign_point_of(const struct map_config *config, uint32_t point)
{
	const struct foreign_point *points = map_records(config, FOREIGN_POINTS, sizeof(*points));
	const struct foreign_module *modules = foreign_modules(config);
	const uint16_t set = config->points[point].set;

	for (uint32_t i = 0; modules != NULL && points != NULL && i < foreign_count(config); i++)
		if (modules[i].set == set)
			return &points[modules[i].first_point + point - config->sets[set].first_point];
	return NULL;
}

#endif
