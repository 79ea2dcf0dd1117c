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

static struct map_retained_value initial_of(const struct program *program, uint16_t point)
{
	const struct logic_link *link = link_of(program, point);
	union map_value initial = {0};

	if (!link->has_initial)
		return (struct map_retained_value){.quality = MAP_INVALID | MAP_RETAINED_KNOWN};
	logic_map_value(type_of(program, point), program->logic.points[point].type, (double)link->initial,
			&initial);
	return (struct map_retained_value){.low = initial.u, .quality = MAP_RETAINED_KNOWN};
}

/* A master that has set the very value that the point began with has changed nothing either. */
static bool has_been_set(const struct program *from, uint16_t point, const struct map_retained_value *kept)
{
	const struct map_retained_value initial = initial_of(from, point);

	return kept->low != initial.low || kept->quality != initial.quality;
}

/* Behind the retained slots. NULL: none of these names and types, or none that a master has set. */
static const struct map_retained_value *find_set_point(const struct program *from,
						       const struct map_retained_value *kept,
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

/* NULL: the former program did not retain it. */
static const struct map_retained_value *find_variable(const struct logic *from,
						      const struct map_retained_value *kept,
						      const struct logic *to,
						      const struct logic_retained *variable)
{
	for (uint16_t i = 0; i < from->head->retained; i++) {
		if (logic_retains_alike(from, &from->retained[i], to, variable))
			return kept;
		kept += from->retained[i].slots;
	}
	return NULL;
}

/* What neither has said yet, each begins with as its text says. */
static void carry(const struct program *from, const struct map_retained_value *kept, const struct program *to,
		  struct map_retained_value *out)
{
	const struct map_retained_value *found;

	for (uint16_t i = 0; i < to->logic.head->retained; i++) {
		const struct logic_retained *variable = &to->logic.retained[i];

		found = find_variable(&from->logic, kept, &to->logic, variable);
		if (found != NULL)
			memmove(out, found, variable->slots * sizeof(*out));
		out += variable->slots;
	}
	for (uint16_t i = 0; i < to->logic.head->points; i++) {
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
	const struct map_retained *left = (const void *)((const struct logic_stats *)from + 1);
	const struct logic_asked *asked = (const void *)((const uint8_t *)from + logic_asked_place(was));
	struct map_retained *begun = logic_kept_of(to);

	if (load(&old) && load(&new)) {
		const uint32_t whole = atomic_load_explicit(&left->latch, memory_order_acquire) & 1;

		carry_asked(&old.logic, asked, &new.logic, logic_asked_of(to, is));
		carry(&old, left->values + whole * logic_kept_count(was), &new, begun->values);
		atomic_store(&begun->latch, 0);
	}
	free(old.memory);
	free(new.memory);
}
