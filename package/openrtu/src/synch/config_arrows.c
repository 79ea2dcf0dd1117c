/* SPDX-License-Identifier: GPL-3.0-or-later */
/*
 * The simple form: "A -(n)-> B" is a place that the end of each scan of A gives one token, and of which a scan of B takes n. It has
 * room for n: a B that is late leaves scans of A out, as a module that is late leaves periods out.
 */
#include "synch/arrow.h"
#include "synch/config_builder.h"

/* The transition of a participant's scan, which is added where nothing has named one. */
static uint8_t hook(struct synch_builder *builder, const struct config_place *here, uint8_t participant,
		    bool begins)
{
	struct synch_participant *record = &builder->tables->participants[participant];
	uint8_t *transition = begins ? &record->begin : &record->end;
	char name[SYNCH_LABEL_SIZE];

	snprintf(name, sizeof(name), "%s.%s", record->name, begins ? "scan_begin" : "scan_end");
	if (*transition == SYNCH_NOTHING)
		*transition = synch_add_transition(builder, here, name);
	return *transition;
}

static bool check_ends(struct synch_builder *builder, const struct config_place *here,
		       const struct synch_arrow *arrow, uint8_t to)
{
	struct config_report *report = &builder->loader->report;

	if (arrow->weight == 0)
		config_error(report, here, "has the weight 0, expected 1 to %d scans", SYNCH_WEIGHT_MAX);
	else if (!builder->tables->participants[to].waits)
		config_error(report, here, "\"%s\" waits for nobody: a line can only be left of an arrow",
			     arrow->to);
	else
		return true;
	return false;
}

static void read_arrow(struct synch_builder *builder, const struct config_place *here, const char *text)
{
	struct synch_arrow arrow;
	uint8_t from, to, place;
	char name[SYNCH_LABEL_SIZE];

	if (text == NULL || !synch_read_arrow(text, &arrow)) {
		config_error(&builder->loader->report, here,
			     "is no arrow, expected one like \"line1 -> filter\" or \"line1 -(2)-> filter\"");
		return;
	}
	from = synch_take_participant(builder, here, arrow.from);
	to = synch_take_participant(builder, here, arrow.to);
	if (from == SYNCH_NOTHING || to == SYNCH_NOTHING || !check_ends(builder, here, &arrow, to))
		return;
	snprintf(name, sizeof(name), "%s -> %s", arrow.from, arrow.to);
	place = synch_add_place(builder, here, name, 0, arrow.weight);
	synch_add_arc(builder, here, SYNCH_GIVES, place, hook(builder, here, from, false), 1);
	synch_add_arc(builder, here, SYNCH_TAKES, place, hook(builder, here, to, true), arrow.weight);
}

void synch_read_arrows(struct synch_builder *builder, const struct config_place *array, const json_t *arrows)
{
	for (size_t i = 0; i < json_array_size(arrows); i++) {
		const struct config_place here = config_element_of(array, i);

		read_arrow(builder, &here, json_string_value(json_array_get(arrows, i)));
	}
}

/* Whether the place is that of an arrow to the participant: its name ends so, and no other place's has a space. */
static bool leads_to(const struct synch_tables *tables, uint32_t place, const char *name)
{
	const char *shaft = strstr(tables->places[place].name, " -> ");

	return shaft != NULL && strcmp(shaft + strlen(" -> "), name) == 0;
}

void synch_read_start(struct synch_builder *builder, const struct config_place *array, const json_t *names)
{
	struct synch_tables *tables = builder->tables;

	for (size_t i = 0; i < json_array_size(names); i++) {
		const struct config_place here = config_element_of(array, i);
		const char *name = json_string_value(json_array_get(names, i));
		bool found = false;

		for (uint32_t place = 0; name != NULL && place < tables->place_count; place++)
			if (leads_to(tables, place, name)) {
				tables->places[place].tokens = tables->places[place].capacity;
				found = true;
			}
		if (!found)
			config_error(&builder->loader->report, &here,
				     "is no name to which an arrow of \"synch\" leads: only who waits can be "
				     "told to start");
	}
}
