/* SPDX-License-Identifier: GPL-3.0-or-later */
#include "synch/config_builder.h"

#include <stdlib.h>

#include "config/scanners.h"

uint8_t synch_find_place(const struct synch_tables *tables, const char *name)
{
	for (uint32_t i = 0; i < tables->place_count; i++)
		if (strcmp(tables->places[i].name, name) == 0)
			return (uint8_t)i;
	return SYNCH_NOTHING;
}

uint8_t synch_find_transition(const struct synch_tables *tables, const char *name)
{
	for (uint32_t i = 0; i < tables->transition_count; i++)
		if (strcmp(tables->transitions[i].name, name) == 0)
			return (uint8_t)i;
	return SYNCH_NOTHING;
}

/* Arcs name either. */
static bool is_taken(struct synch_builder *builder, const struct config_place *place, const char *name)
{
	if (synch_find_place(builder->tables, name) == SYNCH_NOTHING &&
	    synch_find_transition(builder->tables, name) == SYNCH_NOTHING)
		return false;
	config_error(&builder->loader->report, place, "\"%s\" is the name of another place or transition",
		     name);
	return true;
}

/* False: there is no room for one more. */
static bool has_room(struct synch_builder *builder, const struct config_place *place, uint32_t count,
		     uint32_t most, const char *what)
{
	if (count < most)
		return true;
	config_error(&builder->loader->report, place, "is one %s too many, expected at most %u", what, most);
	return false;
}

uint8_t synch_add_place(struct synch_builder *builder, const struct config_place *place, const char *name,
			uint16_t tokens, uint16_t capacity)
{
	struct synch_tables *tables = builder->tables;
	struct synch_place *added;

	if (is_taken(builder, place, name) ||
	    !has_room(builder, place, tables->place_count, SYNCH_PLACES_MAX, "place"))
		return SYNCH_NOTHING;
	added = &tables->places[tables->place_count];
	*added = (struct synch_place){.tokens = tokens, .capacity = capacity};
	snprintf(added->name, sizeof(added->name), "%s", name);
	return (uint8_t)tables->place_count++;
}

uint8_t synch_add_transition(struct synch_builder *builder, const struct config_place *place,
			     const char *name)
{
	struct synch_tables *tables = builder->tables;
	struct synch_transition *added;

	if (is_taken(builder, place, name) ||
	    !has_room(builder, place, tables->transition_count, SYNCH_TRANSITIONS_MAX, "transition"))
		return SYNCH_NOTHING;
	added = &tables->transitions[tables->transition_count];
	*added = (struct synch_transition){.first_arc = 0};
	snprintf(added->name, sizeof(added->name), "%s", name);
	return (uint8_t)tables->transition_count++;
}

void synch_add_arc(struct synch_builder *builder, const struct config_place *place, enum synch_arc_kind kind,
		   uint8_t from_place, uint8_t transition, uint8_t weight)
{
	struct synch_tables *tables = builder->tables;

	if (from_place == SYNCH_NOTHING || transition == SYNCH_NOTHING ||
	    !has_room(builder, place, tables->arc_count, SYNCH_ARCS_MAX, "arc"))
		return;
	for (uint32_t i = 0; i < tables->arc_count; i++)
		if (tables->arcs[i].kind == kind && tables->arcs[i].place == from_place &&
		    tables->arcs[i].transition == transition) {
			config_error(&builder->loader->report, place,
				     "is there already: give that one a weight, as in \"a -(2)-> b\"");
			return;
		}
	tables->arcs[tables->arc_count++] = (struct synch_arc){
	    .kind = (uint8_t)kind, .place = from_place, .transition = transition, .weight = weight};
}

static void report_unknown(struct synch_builder *builder, const struct config_place *place, const char *name,
			   bool many)
{
	if (many)
		config_error(&builder->loader->report, place,
			     "\"%s\" is the name of more than one line, program or module: rename one", name);
	else
		config_error(
		    &builder->loader->report, place,
		    "\"%s\" is no active line (line1, line2, ...), no program of logic and no module", name);
}

uint8_t synch_take_participant(struct synch_builder *builder, const struct config_place *place,
			       const char *name)
{
	struct synch_tables *tables = builder->tables;
	const struct config_scanner *scanner;
	struct synch_participant *added;
	bool many;

	for (uint32_t i = 0; i < tables->participant_count; i++)
		if (strcmp(tables->participants[i].name, name) == 0)
			return (uint8_t)i;
	scanner = config_find_scanner(builder->loader, name, &many);
	if (scanner == NULL) {
		report_unknown(builder, place, name, many);
		return SYNCH_NOTHING;
	}
	if (!has_room(builder, place, tables->participant_count, SYNCH_PARTICIPANTS_MAX, "module"))
		return SYNCH_NOTHING;
	added = &tables->participants[tables->participant_count];
	*added =
	    (struct synch_participant){.begin = SYNCH_NOTHING, .end = SYNCH_NOTHING, .waits = scanner->waits};
	snprintf(added->name, sizeof(added->name), "%s", name);
	if (tables->priority < (uint32_t)scanner->priority)
		tables->priority = (uint32_t)scanner->priority;
	return (uint8_t)tables->participant_count++;
}

static int by_transition(const void *a, const void *b)
{
	const struct synch_arc *one = a, *other = b;

	if (one->transition != other->transition)
		return one->transition - other->transition;
	return one->place != other->place ? one->place - other->place : one->kind - other->kind;
}

void synch_order_arcs(struct synch_tables *tables)
{
	uint32_t arc = 0;

	qsort(tables->arcs, tables->arc_count, sizeof(tables->arcs[0]), by_transition);
	for (uint32_t i = 0; i < tables->transition_count; i++) {
		const uint32_t first = arc;

		while (arc < tables->arc_count && tables->arcs[arc].transition == i)
			arc++;
		tables->transitions[i].first_arc = (uint16_t)first;
		tables->transitions[i].arc_count = (uint16_t)(arc - first);
	}
}
