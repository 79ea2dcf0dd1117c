/* SPDX-License-Identifier: GPL-3.0-or-later */
#include "map/layout.h"

#include <string.h>

#define SECTION_ALIGNMENT 32  /* a cache line of the ARM926 */
#define OWN_EVENTS        256 /* of the gateway's own station, which has two for each episode of losses */

static size_t section(struct layout *layout, size_t bytes)
{
	size_t offset = (layout->size + SECTION_ALIGNMENT - 1) & ~(size_t)(SECTION_ALIGNMENT - 1);

	layout->size = offset + bytes;
	return offset;
}

/* What a kind of module never writes has one place, where no record is ever read. */
static struct capacities capacities_of(const struct module_entry *entry, const struct map_config *config)
{
	static const struct capacities kinds[] = {
	    [MAP_MODULE_RTUD] = {.requests = 1, .answers = 256, .events = 256, .log = 128},
	    [MAP_MODULE_MODBUS] = {.requests = 1, .answers = 256, .log = 128},
	    [MAP_MODULE_IEC104] = {.requests = 256, .answers = 1, .events = 1, .log = 128},
	    [MAP_MODULE_RTUCTL] = {.requests = 256, .answers = 1, .events = 1, .log = 1},
	    [MAP_MODULE_JOURNAL] = {.requests = 1, .answers = 1, .events = 1, .log = 128},
	};
	struct capacities capacities = kinds[entry->kind];

	if (entry->kind == MAP_MODULE_MODBUS)
		capacities.events = config->settings.event_ring;
	else if (entry->kind == MAP_MODULE_IEC104 && entry->point_count > 0)
		capacities.events = OWN_EVENTS;
	return capacities;
}

struct layout layout_of(const struct module_entry *entry, const struct map_config *config)
{
	const struct capacities capacities = capacities_of(entry, config);
	struct layout layout = {.size = sizeof(struct segment_header), .capacities = capacities};

	if (entry->kind == MAP_MODULE_RTUD) {
		layout.directory = section(&layout, sizeof(struct directory));
		layout.lines = section(&layout, config->line_count * sizeof(struct map_line));
		layout.devices = section(&layout, config->device_count * sizeof(struct map_device));
		layout.points = section(&layout, config->point_count * sizeof(struct map_point));
		layout.by_address = section(&layout, config->point_count * sizeof(uint32_t));
		layout.names = section(&layout, config->names_size);
		layout.knots = section(&layout, config->knot_count * sizeof(struct map_knot));
	}
	layout.requests = section(&layout, ring_size(capacities.requests, sizeof(struct map_request)));
	layout.answers = section(&layout, ring_size(capacities.answers, sizeof(struct map_answer)));
	layout.events = section(&layout, ring_size(capacities.events, sizeof(struct map_event)));
	layout.log = section(&layout, ring_size(capacities.log, sizeof(struct map_log_line)));
	if (entry->kind == MAP_MODULE_IEC104) {
		layout.queues = section(&layout, MAP_QUEUES * sizeof(struct queue_cell));
		layout.station_stats = section(&layout, sizeof(struct map_station_stats));
	}
	if (entry->kind == MAP_MODULE_JOURNAL)
		layout.journal_stats = section(&layout, sizeof(struct map_journal_stats));
	if (entry->kind != MAP_MODULE_MODBUS && entry->point_count == 0)
		return layout;
	layout.latches = section(&layout, config->device_count * sizeof(map_latch));
	layout.samples[0] = section(&layout, entry->point_count * sizeof(struct map_sample));
	layout.samples[1] = section(&layout, entry->point_count * sizeof(struct map_sample));
	layout.commands = section(&layout, entry->command_count * sizeof(struct command_cell));
	layout.totals = section(&layout, entry->total_count * sizeof(struct total_cell));
	layout.parameters = section(&layout, entry->parameter_count * sizeof(struct parameter_cell));
	layout.line_stats = section(&layout, config->line_count * sizeof(struct map_line_stats));
	layout.device_stats = section(&layout, config->device_count * sizeof(struct map_device_stats));
	return layout;
}

static void *at(void *memory, size_t offset)
{
	return offset ? (uint8_t *)memory + offset : NULL;
}

void segment_place(struct segment *segment, void *memory, const struct layout *layout)
{
	const struct capacities *capacities = &layout->capacities;

	segment->header = memory;
	segment->requests =
	    ring_at(at(memory, layout->requests), capacities->requests, sizeof(struct map_request));
	segment->answers =
	    ring_at(at(memory, layout->answers), capacities->answers, sizeof(struct map_answer));
	segment->events = ring_at(at(memory, layout->events), capacities->events, sizeof(struct map_event));
	segment->log = ring_at(at(memory, layout->log), capacities->log, sizeof(struct map_log_line));
	segment->latches = at(memory, layout->latches);
	segment->samples[0] = at(memory, layout->samples[0]);
	segment->samples[1] = at(memory, layout->samples[1]);
	segment->commands = at(memory, layout->commands);
	segment->totals = at(memory, layout->totals);
	segment->parameters = at(memory, layout->parameters);
	segment->line_stats = at(memory, layout->line_stats);
	segment->device_stats = at(memory, layout->device_stats);
	segment->queues = at(memory, layout->queues);
	segment->station_stats = at(memory, layout->station_stats);
	segment->journal_stats = at(memory, layout->journal_stats);
	segment->size = layout->size;
}

uint32_t layout_fingerprint(void)
{
	const uint32_t sizes[] = {
	    sizeof(struct segment_header),    sizeof(struct directory),        sizeof(struct map_line),
	    sizeof(struct map_device),        sizeof(struct map_point),        sizeof(struct map_settings),
	    sizeof(struct map_sample),        sizeof(struct map_event),        sizeof(struct map_request),
	    sizeof(struct map_answer),        sizeof(struct command_cell),     sizeof(struct map_log_line),
	    sizeof(struct map_line_stats),    sizeof(struct map_device_stats), sizeof(struct queue_cell),
	    sizeof(struct map_station_stats), sizeof(struct total_cell),       sizeof(struct parameter_cell),
	    sizeof(struct map_journal_stats),
	};
	uint32_t hash = 2166136261u; /* FNV-1a */

	for (size_t i = 0; i < sizeof(sizes) / sizeof(sizes[0]); i++)
		hash = (hash ^ sizes[i]) * 16777619u;
	return hash;
}
