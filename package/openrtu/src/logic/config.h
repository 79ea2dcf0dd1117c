/* SPDX-License-Identifier: GPL-3.0-or-later */
/* What only programs know of the configuration: the instances, their compiled programs, and which point each of them names. */
#ifndef OPENRTU_LOGIC_CONFIG_H
#define OPENRTU_LOGIC_CONFIG_H

#include "map/config.h"

#define LOGIC_KIND          "logic"
#define LOGIC_NAME_SIZE     28 /* of an instance, so that its module's name fits */
#define LOGIC_INSTANCES_MAX 32

#define LOGIC_INSTANCES MAP_SECTION_ID('L', 'G', 'C', 'I')
#define LOGIC_LINKS     MAP_SECTION_ID('L', 'G', 'C', 'L')
/* Octets: a module runs the very program that was checked, and opens no file. */
#define LOGIC_PROGRAMS MAP_SECTION_ID('L', 'G', 'C', 'P')

struct logic_instance {
	char name[LOGIC_NAME_SIZE];
	uint32_t module;
	uint32_t set; /* its own points */
	uint32_t period_ms;
	uint32_t period_given;         /* 0: the file has none, and a net that lets it begin is all */
	uint32_t budget;               /* instructions of a scan */
	uint32_t program, size;        /* its octets in LOGIC_PROGRAMS */
	uint32_t memory;               /* octets of its machine */
	uint32_t first_link;           /* of as many as the program has points, in their order */
	uint32_t retained, remembered; /* slots; remembered: those that end with the power */
	uint32_t set_points;           /* own points that the program does not write */
	uint32_t first_retained;       /* the name of the first slot, in MAP_RETAINED */
	uint32_t commands;             /* COMMANDs */
};

/* The point that a program's one is. */
struct logic_link {
	uint32_t point;
	float initial; /* of a point that masters set, until they do */
	uint32_t has_initial;
};

static inline struct logic_instance *logic_instances(const struct map_config *config)
{
	return map_records(config, LOGIC_INSTANCES, sizeof(struct logic_instance));
}

static inline const struct logic_link *logic_links(const struct map_config *config)
{
	return map_records(config, LOGIC_LINKS, sizeof(struct logic_link));
}

static inline const uint8_t *logic_programs(const struct map_config *config)
{
	return map_records(config, LOGIC_PROGRAMS, 1);
}

#endif
