/* SPDX-License-Identifier: GPL-3.0-or-later */
/* Programs of Structured Text: how their scans go, and the memory of one of them as it was between two scans. */
#include <inttypes.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <time.h>

#include "logic/stats.h"
#include "map/time_ns.h"
#include "rows/rows.h"
#include "rtuctl/listing.h"
#include "rtuctl/rtuctl.h"

#define COUNT(array) (sizeof(array) / sizeof((array)[0]))
#define PATIENCE_NS  (2 * NS_PER_S) /* a scan is 500 ms at most, and as long a pause follows it */
#define RETRY_NS     (1 * NS_PER_MS)
#define WORD_SIZE    24

static const struct listing_column columns[] = {
    {"name", "NAME", LISTING_TEXT},
    {"file", "FILE", LISTING_TEXT},
    {"period_ms", "PERIOD", LISTING_RIGHT},
    {"scans", "SCANS", LISTING_RIGHT},
    {"late", "LATE", LISTING_RIGHT},
    {"longest_ms", "LONGEST", LISTING_RIGHT},
    {"variables", "VARIABLES", LISTING_RIGHT},
    {"octets", "OCTETS", LISTING_RIGHT},
    {"faults", "FAULTS", LISTING_RIGHT},
    {"line", "LINE", LISTING_RIGHT},
};

struct program {
	const struct logic_instance *instance;
	struct logic_stats *stats;
	struct logic_head head;
};

static struct program program_of(const struct map *map, const struct logic_instance *instance)
{
	struct program program = {.instance = instance, .stats = logic_stats_of(map, instance)};

	memcpy(&program.head, logic_programs(map_config(map)) + instance->program, sizeof(program.head));
	return program;
}

static uint32_t faults_of(const struct logic_stats *stats)
{
	uint32_t sum = 0;

	for (unsigned i = 0; i < LOGIC_FAULTS; i++)
		sum += atomic_load(&stats->faults[i]);
	return sum;
}

static json_t *row_of(const struct program *program)
{
	json_t *row = json_pack("{s:s, s:o, s:I, s:I, s:I}", "name", program->instance->name, "file",
				json_sprintf("%08" PRIx32, program->head.crc), "period_ms",
				(json_int_t)program->instance->period_ms, "variables",
				(json_int_t)program->head.slots - program->head.constants, "octets",
				(json_int_t)program->instance->memory);

	if (program->stats == NULL)
		return row;
	json_object_set_new(row, "scans", json_integer(program->stats->scans.count));
	json_object_set_new(row, "late", json_integer(program->stats->scans.missed));
	json_object_set_new(row, "longest_ms", rows_milliseconds(program->stats->scans.durations.longest_us));
	json_object_set_new(row, "faults", json_integer(faults_of(program->stats)));
	if (program->stats->last_line != 0)
		json_object_set_new(row, "line", json_integer(program->stats->last_line));
	return row;
}

/* ---- variables --------------------------------------------------------------------------- */

/* All of them of the same moment between two scans. False: there was none. */
static bool copy_memory(const struct program *program, uint8_t *copy)
{
	const struct timespec pause = {.tv_nsec = RETRY_NS};
	const int64_t until_ns = map_now_ns() + PATIENCE_NS;
	const void *memory = logic_memory_of(program->stats, program->instance);

	do {
		uint32_t turn = atomic_load_explicit(&program->stats->turn, memory_order_acquire);

		if (turn % 2 == 0) {
			memcpy(copy, memory, program->instance->memory);
			atomic_thread_fence(memory_order_acquire);
			if (atomic_load_explicit(&program->stats->turn, memory_order_relaxed) == turn)
				return turn != 0;
		}
		nanosleep(&pause, NULL);
	} while (map_now_ns() < until_ns);
	return false;
}

/* Of each slot "BITS:QUALITY", in hexadecimal digits. */
static json_t *cells_of(const struct program *program, const uint8_t *copy)
{
	const uint8_t *quality = copy + logic_quality_place(&program->head);
	json_t *cells = json_array();

	for (uint32_t slot = 0; slot < program->head.slots; slot++) {
		char word[WORD_SIZE];
		uint64_t bits;

		memcpy(&bits, copy + slot * sizeof(bits), sizeof(bits));
		snprintf(word, sizeof(word), "%" PRIx64 ":%x", bits, quality[slot]);
		json_array_append_new(cells, json_string(word));
	}
	return cells;
}

static bool add_cells(json_t *row, const struct program *program)
{
	uint8_t *copy = program->stats == NULL ? NULL : malloc(program->instance->memory);
	bool found = copy != NULL && copy_memory(program, copy);

	if (found)
		json_object_set_new(row, "cells", cells_of(program, copy));
	free(copy);
	return found;
}

int rtuctl_logic(struct map *map, const struct rtuctl_request *request)
{
	const struct logic_instance *instances = logic_instances(map_config(map));
	const uint32_t count = map_record_count(map_config(map), LOGIC_INSTANCES);
	const char *name = request->arguments[0];
	bool found = name == NULL, seen = true;
	struct listing listing;

	listing_begin(&listing, columns, COUNT(columns), request->json);
	for (uint32_t i = 0; i < count; i++) {
		struct program program = program_of(map, &instances[i]);
		json_t *row;

		if (name != NULL && strcmp(name, instances[i].name) != 0)
			continue;
		found = true;
		row = row_of(&program);
		if (name != NULL && request->json)
			seen = add_cells(row, &program);
		listing_add(&listing, row);
	}
	listing_end_found(&listing, found);
	if (!found)
		fputs("rtuctl: there is no such program: \"logic\" in the configuration names them\n",
		      stderr);
	if (!seen)
		fprintf(stderr,
			"rtuctl: %s has not ended a scan for 2 s: \"rtuctl modules\" says whether it runs\n",
			name);
	return found && seen ? RTUCTL_DONE : RTUCTL_FAILED;
}
