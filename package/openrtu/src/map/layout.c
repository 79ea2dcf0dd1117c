/* SPDX-License-Identifier: GPL-3.0-or-later */
#include "map/layout.h"

#include <string.h>

#include "map/hash.h"

#define SECTION_ALIGNMENT 32 /* a cache line of the ARM926 */

static size_t section(struct layout *layout, size_t bytes)
{
	size_t offset = (layout->size + SECTION_ALIGNMENT - 1) & ~(size_t)(SECTION_ALIGNMENT - 1);

	layout->size = offset + bytes;
	return offset;
}

static size_t table(struct config_layout *layout, size_t bytes)
{
	size_t offset = (layout->size + SECTION_ALIGNMENT - 1) & ~(size_t)(SECTION_ALIGNMENT - 1);

	layout->size = offset + bytes;
	return offset;
}

struct config_layout config_layout_of(const struct map_config *config)
{
	const size_t sets = (size_t)config->set_count + config->gone_set_count;
	const size_t points = (size_t)config->point_count + config->gone_point_count;
	struct config_layout layout = {.size = sizeof(struct config_header)};

	layout.sets = table(&layout, sets * sizeof(struct map_set));
	layout.points = table(&layout, points * sizeof(struct map_point));
	layout.by_address = table(&layout, config->point_count * sizeof(uint32_t));
	layout.owned = table(&layout, points * sizeof(uint32_t));
	layout.names = table(&layout, config->names_size);
	for (uint32_t i = 0; i < config->section_count; i++)
		layout.sections[i] =
		    table(&layout, (size_t)config->sections[i].count * config->sections[i].record_size);
	return layout;
}

struct layout layout_of(const struct module_entry *entry)
{
	const struct map_rings rings = entry->plan.rings;
	struct layout layout = {.size = sizeof(struct segment_header), .rings = rings};

	if (entry->plan.flags & MAP_IS_SUPERVISOR)
		layout.directory = section(&layout, sizeof(struct directory));
	layout.requests = section(&layout, ring_size(rings.requests, sizeof(struct map_request)));
	layout.answers = section(&layout, ring_size(rings.answers, sizeof(struct map_answer)));
	layout.events = section(&layout, ring_size(rings.events, sizeof(struct map_event)));
	layout.log = section(&layout, ring_size(rings.log, sizeof(struct map_log_line)));
	if (entry->plan.flags & MAP_KEEPS_QUEUES)
		layout.queues = section(&layout, MAP_QUEUES * sizeof(struct queue_cell));
	layout.own = section(&layout, entry->plan.section_size);
	layout.counters = section(&layout, entry->plan.counters * sizeof(struct counter_entry));
	if (entry->point_count == 0)
		return layout;
	layout.latches = section(&layout, entry->set_count * sizeof(map_latch));
	layout.samples[0] = section(&layout, entry->point_count * sizeof(struct map_sample));
	layout.samples[1] = section(&layout, entry->point_count * sizeof(struct map_sample));
	layout.commands = section(&layout, entry->command_count * sizeof(struct command_cell));
	layout.totals = section(&layout, entry->total_count * sizeof(struct total_cell));
	layout.parameters = section(&layout, entry->parameter_count * sizeof(struct parameter_cell));
	layout.texts = section(&layout, entry->text_count * sizeof(struct text_cell));
	layout.covers = section(&layout, MAP_FORCES_MAX * sizeof(struct cover));
	return layout;
}

static void *at(void *memory, size_t offset)
{
	return offset ? (uint8_t *)memory + offset : NULL;
}

void segment_place(struct segment *segment, void *memory, const struct layout *layout)
{
	const struct map_rings *rings = &layout->rings;

	segment->header = memory;
	segment->requests =
	    ring_at(at(memory, layout->requests), rings->requests, sizeof(struct map_request));
	segment->answers = ring_at(at(memory, layout->answers), rings->answers, sizeof(struct map_answer));
	segment->events = ring_at(at(memory, layout->events), rings->events, sizeof(struct map_event));
	segment->log = ring_at(at(memory, layout->log), rings->log, sizeof(struct map_log_line));
	segment->latches = at(memory, layout->latches);
	segment->samples[0] = at(memory, layout->samples[0]);
	segment->samples[1] = at(memory, layout->samples[1]);
	segment->commands = at(memory, layout->commands);
	segment->totals = at(memory, layout->totals);
	segment->parameters = at(memory, layout->parameters);
	segment->texts = at(memory, layout->texts);
	segment->covers = at(memory, layout->covers);
	segment->queues = at(memory, layout->queues);
	segment->own = at(memory, layout->own);
	segment->counters = at(memory, layout->counters);
	segment->size = layout->size;
}

uint32_t layout_fingerprint(void)
{
	const uint32_t sizes[] = {
	    sizeof(struct segment_header), sizeof(struct directory),      sizeof(struct map_set),
	    sizeof(struct map_point),      sizeof(struct map_settings),   sizeof(struct map_sample),
	    sizeof(struct map_event),      sizeof(struct map_request),    sizeof(struct map_answer),
	    sizeof(struct command_cell),   sizeof(struct map_log_line),   sizeof(struct queue_cell),
	    sizeof(struct total_cell),     sizeof(struct parameter_cell), sizeof(struct counter_entry),
	    sizeof(struct config_header),  sizeof(struct cover),          sizeof(struct text_cell),
	};
	uint32_t hash = MAP_HASH_BASIS;

	for (size_t i = 0; i < sizeof(sizes) / sizeof(sizes[0]); i++)
		hash = map_hash_word(hash, sizes[i]);
	return hash;
}
