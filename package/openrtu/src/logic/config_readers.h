/* SPDX-License-Identifier: GPL-3.0-or-later */
/* What the readers of the array "logic" know of each other. */
#ifndef OPENRTU_LOGIC_CONFIG_READERS_H
#define OPENRTU_LOGIC_CONFIG_READERS_H

#include "config/files.h"
#include "logic/config.h"
#include "logic/logic.h"

#define LOGIC_KEY "logic"

/* A point of a program's own, as the file has it. */
struct logic_own_point {
	const char *name;
	const char *ln; /* its name in IEC 61850, NULL: none; the file's */
	uint8_t type, group;
	bool select, has_initial, retain;
	uint32_t ioa;
	float deadband, initial;
};

/* An instance while the file is read. */
struct logic_reading {
	size_t element; /* of the array */
	struct logic_instance *instance;
	uint16_t ca;
	uint8_t *file; /* the compiled program */
	void *memory;  /* of the machine */
	struct logic logic;
	struct logic_own_point *points;
	uint32_t point_count;
	const json_t *names; /* of points that the program calls otherwise, or NULL */
};

struct logic_readings {
	struct logic_reading readings[LOGIC_INSTANCES_MAX];
	uint32_t count;
};

/* The places of errors: of an instance, of one of its keys, of one of its points. */
struct logic_place {
	struct config_place file, array, instance, key, point;
};

const struct config_place *logic_place_key(struct logic_place *place, const struct logic_reading *reading,
					   const char *key);
const struct config_place *logic_place_point(struct logic_place *place, const struct logic_reading *reading,
					     uint32_t point);

/* The program's point of that name; NULL: it has none. */
const struct logic_point *logic_find_point(const struct logic *logic, const char *name);
/* The program has a REQUEST for its point of that name. */
bool logic_decides(const struct logic *logic, const char *name);

/* ---- config_program.c -------------------------------------------------------------------- */

/* Reads and verifies the file of "program". False: it was reported why not. */
bool logic_read_program(struct config_loader *loader, struct logic_reading *reading, const char *path);

/* ---- config_retained.c ------------------------------------------------------------------- */

/* Names the retained values of all programs, for the journal. False: no memory. */
bool logic_name_retained(struct config_loader *loader, struct logic_readings *readings);

/* ---- config_own.c ------------------------------------------------------------------------ */

/* Reads the array "points". */
void logic_read_points(struct config_loader *loader, struct logic_reading *reading, const json_t *points);
/* Adds the set of an instance, with its points. */
void logic_add_set(struct config_loader *loader, struct logic_reading *reading);

/* ---- config_links.c ---------------------------------------------------------------------- */

/* Finds the points that the programs name, in a configuration that has all sets. False: no memory. */
bool logic_link(struct config_loader *loader, struct logic_readings *readings);

/* Of a point of a program. */
extern const struct config_table logic_point_table;

#endif
