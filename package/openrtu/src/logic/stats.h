/* SPDX-License-Identifier: GPL-3.0-or-later */
/*
 * What a program shows of itself, and what it retains: the section of its own in its module's segment. The machine's memory
 * lies in it, so that whoever reads variables costs the program nothing.
 */
#ifndef OPENRTU_LOGIC_STATS_H
#define OPENRTU_LOGIC_STATS_H

#include "logic/config.h"
#include "logic/logic.h"
#include "map/retained.h"

#define LOGIC_COUNTERS (2 + LOGIC_FAULTS) /* that have names */

/* Since the gateway started. */
struct logic_stats {
	_Alignas(union logic_cell) struct map_scans scans; /* which others find at its beginning */
	_Atomic uint32_t last_fault, last_line;            /* 0: there was none */
	_Atomic uint32_t faults[LOGIC_FAULTS];
	_Atomic uint32_t turn; /* of the memory behind what is retained; odd: a scan is changing it */
};
_Static_assert(sizeof(struct logic_stats) % sizeof(union logic_cell) == 0, "the cells are aligned");

/* Of a COMMAND: no process of the module asks for what a former one has asked for. */
struct logic_asked {
	_Atomic uint32_t raised; /* EXECUTE was true in the last scan */
	_Atomic uint32_t end; /* enum map_command_state << 8 | enum map_command_result; 0: it has not ended */
};
_Static_assert(sizeof(struct logic_asked) % sizeof(union logic_cell) == 0, "the cells are aligned");

/* Slots of retained variables, then points that masters set. */
static inline uint32_t logic_kept_count(const struct logic_instance *instance)
{
	return instance->retained + instance->set_points;
}

static inline struct map_retained *logic_kept_of(struct logic_stats *stats)
{
	return (void *)(stats + 1);
}

static inline size_t logic_asked_place(const struct logic_instance *instance)
{
	return sizeof(struct logic_stats) + map_retained_size(logic_kept_count(instance));
}

static inline size_t logic_memory_place(const struct logic_instance *instance)
{
	return logic_asked_place(instance) + instance->commands * sizeof(struct logic_asked);
}

static inline struct logic_asked *logic_asked_of(struct logic_stats *stats,
						 const struct logic_instance *instance)
{
	return (void *)((uint8_t *)stats + logic_asked_place(instance));
}

static inline size_t logic_section_size(const struct logic_instance *instance)
{
	return logic_memory_place(instance) + instance->memory;
}

/* Of the machine: for logic_load(). The cells of all slots, then the file, then their qualities. */
static inline void *logic_memory_of(struct logic_stats *stats, const struct logic_instance *instance)
{
	return (uint8_t *)stats + logic_memory_place(instance);
}

/* The instance of a module; NULL: it is of another kind. */
static inline const struct logic_instance *logic_instance_of(const struct map *map, uint32_t module)
{
	const struct map_config *config = map_config(map);
	const struct logic_instance *instances = logic_instances(config);

	for (uint32_t i = 0; instances != NULL && i < map_record_count(config, LOGIC_INSTANCES); i++)
		if (instances[i].module == module)
			return &instances[i];
	return NULL;
}

static inline struct logic_stats *logic_stats_of(const struct map *map, const struct logic_instance *instance)
{
	return map_section(map, instance->module, logic_section_size(instance));
}

#endif
