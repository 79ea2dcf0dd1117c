/* SPDX-License-Identifier: GPL-3.0-or-later */
/*
 * A program takes another one's place: what both retain, and points that masters have set, pass over by name and type; of
 * COMMANDs what was asked for, by the point and by their order.
 */
#include "modules/logic/carry.h"

#include <stdlib.h>
#include <string.h>

#include "logic/stats.h"
#include "logic/value.h"

struct program {
	const struct map_config *config;
	const struct logic_instance *instance;
	struct logic logic;
	void *memory;
};

static bool load(struct program *program)
{
	const uint8_t *file = logic_programs(program->config) + program->instance->program;
	const size_t size = logic_memory(file, program->instance->size);

	program->memory = size == 0 ? NULL : malloc(size);
	return program->memory != NULL &&
	       logic_load(&program->logic, program->memory, file, program->instance->size) == NULL;
}

static const struct logic_link *link_of(const struct program *program, uint16_t point)
{
	return &logic_links(program->config)[program->instance->first_link + point];
}

static uint8_t type_of(const struct program *program, uint16_t point)
{
	return program->config->points[link_of(program, point)->point].type;
}

static bool is_set_point(const struct program *program, uint16_t point)
{
	return !program->logic.points[point].written &&
	       program->config->points[link_of(program, point)->point].set == program->instance->set;
}

static struct logic_kept initial_of(const struct program *program, uint16_t point)
{
	const struct logic_link *link = link_of(program, point);
	union map_value initial = {0};

	if (!link->has_initial)
		return (struct logic_kept){.quality = MAP_INVALID};
	logic_map_value(type_of(program, point), program->logic.points[point].type, (double)link->initial,
			&initial);
	return (struct logic_kept){.low = initial.u, .quality = MAP_GOOD};
}

/* A master that has set the very value that the point began with has changed nothing either. */
static bool has_been_set(const struct program *from, uint16_t point, const struct logic_kept *kept)
{
	const struct logic_kept initial = initial_of(from, point);

	return kept->low != initial.low || kept->quality != initial.quality;
}

/* Behind the retained slots. NULL: none of these names and types, or none that a master has set. */
static const struct logic_kept *find_set_point(const struct program *from, const struct logic_kept *kept,
					       const char *name, uint8_t type)
{
	kept += from->instance->retained;
	for (uint16_t i = 0; i < from->logic.head->points; i++) {
		if (!is_set_point(from, i))
			continue;
		if (type_of(from, i) == type &&
		    strcmp(logic_name(&from->logic, from->logic.points[i].name), name) == 0)
			return has_been_set(from, i, kept) ? kept : NULL;
		kept++;
	}
	return NULL;
}

static void take_slots(struct logic *logic, const struct logic_kept *kept)
{
	for (uint16_t i = 0; i < logic->head->retained; i++)
		for (uint32_t slot = logic->retained[i].first, end = slot + logic->retained[i].slots;
		     slot < end; slot++, kept++) {
			logic->cells[slot].bits = (uint64_t)kept->high << 32 | kept->low;
			logic->quality[slot] = (uint8_t)kept->quality;
		}
}

static void keep_slots(const struct logic *logic, struct logic_kept *kept)
{
	for (uint16_t i = 0; i < logic->head->retained; i++)
		for (uint32_t slot = logic->retained[i].first, end = slot + logic->retained[i].slots;
		     slot < end; slot++)
			*kept++ = (struct logic_kept){(uint32_t)logic->cells[slot].bits,
						      (uint32_t)(logic->cells[slot].bits >> 32),
						      logic->quality[slot]};
}

static void carry(struct program *from, const struct logic_kept *kept, struct program *to,
		  struct logic_kept *out)
{
	take_slots(&from->logic, kept);
	logic_carry(&to->logic, &from->logic);
	keep_slots(&to->logic, out);
	out += to->instance->retained;
	for (uint16_t i = 0; i < to->logic.head->points; i++) {
		const struct logic_kept *found;

		if (!is_set_point(to, i))
			continue;
		found = find_set_point(from, kept, logic_name(&to->logic, to->logic.points[i].name),
				       type_of(to, i));
		*out++ = found != NULL ? *found : initial_of(to, i);
	}
}

static const char *command_name(const struct logic *logic, uint16_t number)
{
	return logic_name(logic, logic->commands[number].name);
}

/* Of the COMMANDs of one point, which one it is. */
static uint16_t order_of(const struct logic *logic, uint16_t number)
{
	uint16_t order = 0;

	for (uint16_t i = 0; i < number; i++)
		if (strcmp(command_name(logic, i), command_name(logic, number)) == 0)
			order++;
	return order;
}

static const struct logic_asked *find_asked(const struct logic *from, const struct logic_asked *asked,
					    const struct logic *to, uint16_t number)
{
	uint16_t before = order_of(to, number);

	for (uint16_t i = 0; i < from->head->commands; i++)
		if (strcmp(command_name(from, i), command_name(to, number)) == 0 && before-- == 0)
			return &asked[i];
	return NULL;
}

static void carry_asked(const struct logic *from, const struct logic_asked *asked, const struct logic *to,
			struct logic_asked *out)
{
	for (uint16_t i = 0; i < to->head->commands; i++) {
		const struct logic_asked *found = find_asked(from, asked, to, i);

		if (found == NULL)
			continue;
		atomic_store(&out[i].raised, atomic_load(&found->raised));
		atomic_store(&out[i].end, atomic_load(&found->end));
	}
}

void logic_carry_kept(const struct map_config *before, const struct logic_instance *was, const void *from,
		      const struct map_config *now, const struct logic_instance *is, void *to)
{
	struct program old = {.config = before, .instance = was}, new = {.config = now, .instance = is};
	const struct logic_stats *left = from;
	const struct logic_asked *asked = (const void *)((const uint8_t *)from + logic_asked_place(was));
	struct logic_stats *begun = to;
	const uint32_t which = atomic_load_explicit(&left->kept, memory_order_acquire);

	if (which != 0 && load(&old) && load(&new)) {
		const struct logic_kept *first = (const void *)(left + 1);

		carry_asked(&old.logic, asked, &new.logic, logic_asked_of(begun, is));
		carry(&old, first + (which == 1 ? 0 : logic_kept_count(was)), &new,
		      (struct logic_kept *)(void *)(begun + 1));
		atomic_store(&begun->kept, 1);
	}
	free(old.memory);
	free(new.memory);
}
