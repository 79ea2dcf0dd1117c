/* SPDX-License-Identifier: GPL-3.0-or-later */
#include "journal/restore.h"

#include <stdlib.h>
#include <string.h>

#include "journal/record.h"
#include "map/retained.h"
#include "map/time_ns.h"
#include "map/type.h"

#define LATEST_NS (INT64_MAX / 2) /* in 2116; CP56Time2a ends with 2099 */

/* A queue as it was, and its slot as it is. */
struct reader {
	struct journal_queue queue;
	uint32_t slot;
};

struct readers {
	struct reader readers[MAP_QUEUES];
	uint32_t count;
};

/* ---- queues ------------------------------------------------------------------------------ */

static uint32_t group_slot(const struct map_settings *settings, const char *name)
{
	for (uint32_t i = 0; i < settings->queue_count; i++)
		if (strcmp(settings->queues[i].name, name) == 0)
			return settings->queues[i].slot;
	return MAP_NONE;
}

static uint32_t count_addresses(const struct journal_record *record)
{
	const uint8_t *at = record->queues;
	struct journal_queue queue;
	uint32_t count = 0;

	for (uint32_t i = 0; i < record->queue_count; i++) {
		journal_take_queue(record, &at, &queue);
		count += queue.kind == JOURNAL_ADDRESS;
	}
	return count;
}

/* Where there are more than there were places for, the addresses unused longest have no room. */
static void take_queues(const struct map *map, const struct journal_record *record, struct readers *readers,
			struct map_kept *kept)
{
	const struct map_settings *settings = &map_config(map)->settings;
	uint32_t slot = MAP_NAMED_QUEUES_MAX, room = MAP_QUEUES - slot, addresses = count_addresses(record);
	const uint8_t *at = record->queues;

	for (uint32_t i = 0; i < record->queue_count; i++) {
		struct reader *reader = &readers->readers[readers->count];

		journal_take_queue(record, &at, &reader->queue);
		if (reader->queue.kind == JOURNAL_GROUP) {
			reader->slot = group_slot(settings, reader->queue.name);
		} else if (addresses-- <= room) {
			reader->slot = slot;
			memcpy(kept->addresses[slot++], reader->queue.name, MAP_ADDRESS_SIZE);
		} else {
			reader->slot = MAP_NONE;
		}
		if (reader->slot != MAP_NONE)
			readers->count++;
	}
}

static uint32_t who_wants(const struct readers *readers, const struct journal_event *event)
{
	uint32_t wanted = 0;

	for (uint32_t i = 0; i < readers->count; i++)
		if ((int32_t)(event->number - readers->readers[i].queue.next[event->module]) >= 0)
			wanted |= 1u << readers->readers[i].slot;
	return wanted;
}

/* ---- events ------------------------------------------------------------------------------ */

/* False: there is no such point now, or there cannot be such an event. */
static bool translate(const struct map *map, const struct journal_event *event, struct map_event *out)
{
	uint32_t point = map_find(map, event->ca, event->ioa);

	if (point == MAP_NONE || map_config(map)->points[point].type != event->type ||
	    event->cause > MAP_RETURN_LOCAL || event->wall_ns < 0 || event->wall_ns > LATEST_NS ||
	    (event->time != MAP_TIME_WALL && event->time != MAP_TIME_WALL_UNSET))
		return false;
	*out = (struct map_event){
	    .point = point,
	    .kind = MAP_EVENT_CHANGE,
	    .cause = event->cause,
	    .time = event->time,
	    .sample = {.value.u = event->value,
		       .quality = event->quality,
		       .detail = event->detail,
		       .time_ns = event->wall_ns},
	};
	return true;
}

static void take_events(const struct map *map, const struct journal_record *record,
			const struct readers *readers, struct map_kept *kept,
			struct journal_findings *findings)
{
	for (uint32_t i = 0; i < record->event_count; i++) {
		const struct journal_event event = journal_event(record, i);
		struct map_kept_event *out = &kept->events[kept->event_count];

		if (event.cause >= JOURNAL_RETAINED)
			continue;
		if (event.module >= record->modules || !translate(map, &event, &out->event)) {
			findings->unknown++;
			continue;
		}
		out->wanted = who_wants(readers, &event);
		kept->event_count += out->wanted != 0;
	}
}

/* ---- the history ------------------------------------------------------------------------- */

static void take_entry(const struct map *map, const struct journal_event *event, uint32_t start,
		       struct map_kept_history *history, struct journal_findings *findings)
{
	struct journal_event change = *event;
	struct map_event now;

	change.cause = MAP_SPONTANEOUS;
	if (start == 0 || event->number == 0 || !translate(map, &change, &now)) {
		findings->unknown++;
		return;
	}
	history->entries[history->entry_count++] = (struct map_history_entry){
	    .number = event->number,
	    .point = now.point,
	    .start = start,
	    .reason = event->module,
	    .time = now.time,
	    .noted_ns = now.sample.time_ns, /* the file has no other */
	    .sample = now.sample,
	};
}

/* Readers as the last record has them. */
static void take_history_of(const struct map *map, const struct journal_record *record, bool last,
			    struct map_kept_history *history, struct journal_findings *findings)
{
	uint32_t start = 0;

	for (uint32_t i = 0; i < record->event_count; i++) {
		const struct journal_event event = journal_event(record, i);

		if (event.cause == JOURNAL_ENTRY)
			take_entry(map, &event, start, history, findings);
		if (event.cause == JOURNAL_READER && last)
			journal_take_reader(&event, history->readers, history->reader_count);
		if (event.cause != JOURNAL_HISTORY)
			continue;
		start = history->start = event.value;
		history->revision = event.ioa;
		history->next = event.number;
	}
}

static bool take_history(const struct map *map, const uint8_t *bytes, size_t size, uint32_t events,
			 struct map_kept_history *history, struct journal_findings *findings)
{
	struct journal_record record;
	struct map_history now;

	if (!map_history(map, &now))
		return true;
	history->reader_count = now.reader_count;
	history->readers = calloc(now.reader_count, sizeof(*history->readers));
	history->entries = calloc(events + 1u, sizeof(*history->entries));
	if (history->readers == NULL || history->entries == NULL)
		return false;
	for (uint32_t i = 0; i < findings->records; i++, bytes += record.size) {
		journal_parse(bytes, size, i, &record);
		size -= record.size;
		take_history_of(map, &record, i + 1 == findings->records, history, findings);
	}
	return true;
}

void journal_forget(struct map_kept *kept)
{
	free(kept->events);
	free(kept->samples);
	free(kept->values);
	free(kept->history.entries);
	free(kept->history.readers);
}

/* ---- retained points --------------------------------------------------------------------- */

static double number_of(enum map_type type, uint32_t bits)
{
	const union map_value value = {.u = bits};

	switch (map_types[type].form) {
	case MAP_FORM_SINGLE:
	case MAP_FORM_DOUBLE:
	case MAP_FORM_UNSIGNED:
		return value.u;
	case MAP_FORM_FLOAT:
		return (double)value.f;
	case MAP_FORM_SIGNED:
	case MAP_FORM_FRACTION:
	case MAP_FORM_DEGREES:
		break;
	}
	return value.i;
}

static bool can_hold(enum map_type type, uint32_t bits)
{
	const double number = number_of(type, bits);

	return number >= map_types[type].low && number <= map_types[type].high; /* nor a NaN */
}

/*
 * When it was, on the monotonic clock of now, which began later: before it was 0. Where one of the two wall clocks was not
 * set, or they contradict each other, all that is known is that it was before now.
 */
static int64_t time_of(const struct map *map, const struct journal_event *point)
{
	const int64_t now_ns = map_now_ns(), wall_ns = map_wall_ns(map_clock_read(map), now_ns);

	if (point->time != MAP_TIME_WALL || point->wall_ns > wall_ns ||
	    point->wall_ns < wall_ns - (MAP_PAST_DAYS - 1) * S_PER_DAY * NS_PER_S)
		return now_ns;
	return now_ns - (wall_ns - point->wall_ns);
}

/* Nobody has said it since the power was cut: it is not topical (IEC 60870-5-101, 7.2.6.3). False: it is not retained now. */
static bool translate_point(const struct map *map, const struct journal_event *point,
			    struct map_kept_sample *out)
{
	const uint32_t number = map_find(map, point->ca, point->ioa);
	const struct map_point *now = number == MAP_NONE ? NULL : &map_config(map)->points[number];

	if (now == NULL || now->type != point->type || !(now->flags & MAP_POINT_RETAIN) ||
	    !can_hold((enum map_type)point->type, point->value))
		return false;
	*out = (struct map_kept_sample){.point = number,
					.sample = {.value.u = point->value,
						   .quality = point->quality | MAP_NOT_TOPICAL,
						   .detail = point->detail,
						   .time_ns = time_of(map, point)}};
	return true;
}

/* As the last record has them. */
static bool take_points(const struct map *map, const struct journal_record *record, struct map_kept *kept,
			struct journal_findings *findings)
{
	kept->samples = calloc(record->event_count + 1u, sizeof(*kept->samples));
	if (kept->samples == NULL)
		return false;
	for (uint32_t i = 0; i < record->event_count; i++) {
		const struct journal_event point = journal_event(record, i);

		if (point.cause != JOURNAL_RETAINED)
			continue;
		if (translate_point(map, &point, &kept->samples[kept->sample_count]))
			kept->sample_count++;
		else
			findings->dropped++;
	}
	return true;
}

/* ---- retained values --------------------------------------------------------------------- */

/* From guess on, since they are in the same order unless the configuration has changed. MAP_NONE: there is none. */
static uint32_t find_name(const struct map_retained_name *names, uint32_t count, uint32_t guess,
			  const struct journal_event *value)
{
	for (uint32_t i = 0; i < count; i++) {
		const uint32_t name = (guess + i) % count;

		if (names[name].low == value->ioa && names[name].high == value->number)
			return name;
	}
	return MAP_NONE;
}

/* As the last record has them. */
static bool take_values(const struct map *map, const struct journal_record *record, struct map_kept *kept,
			struct journal_findings *findings)
{
	const struct map_retained_name *names = map_records(map_config(map), MAP_RETAINED, sizeof(*names));
	const uint32_t count = names == NULL ? 0 : map_record_count(map_config(map), MAP_RETAINED);
	uint32_t guess = 0;

	kept->values = calloc(record->event_count + 1u, sizeof(*kept->values));
	if (kept->values == NULL)
		return false;
	for (uint32_t i = 0; i < record->event_count; i++) {
		const struct journal_event value = journal_event(record, i);
		uint32_t name;

		if (value.cause != JOURNAL_VALUE)
			continue;
		name = find_name(names, count, guess, &value);
		if (name == MAP_NONE) {
			findings->dropped_values++;
			continue;
		}
		kept->values[kept->value_count++] = (struct map_kept_value){.name = name,
									    .low = value.value,
									    .high = (uint32_t)value.wall_ns,
									    .quality = value.quality};
		guess = name + 1;
	}
	return true;
}

/* ---- the file ---------------------------------------------------------------------------- */

/* How many events the whole records have; the last of these. */
static uint32_t count_events(const uint8_t *bytes, size_t size, struct journal_findings *findings,
			     struct journal_record *last)
{
	struct journal_record record;
	uint32_t events = 0;
	size_t at = 0;

	while (journal_parse(bytes + at, size - at, findings->records, &record) &&
	       (findings->records == 0 || record.modules == last->modules)) {
		findings->records++;
		events += record.event_count;
		at += record.size;
		*last = record;
	}
	findings->unread = size - at;
	return events;
}

bool journal_restore(const struct map *map, const uint8_t *bytes, size_t size, struct map_kept *kept,
		     struct journal_findings *findings)
{
	struct readers readers = {.count = 0};
	struct journal_record record = {0};
	uint32_t events;

	*kept = (struct map_kept){.event_count = 0};
	*findings = (struct journal_findings){.records = 0};
	events = count_events(bytes, size, findings, &record);
	kept->events = calloc(events + 1u, sizeof(*kept->events));
	if (kept->events == NULL || !take_points(map, &record, kept, findings) ||
	    !take_values(map, &record, kept, findings) ||
	    !take_history(map, bytes, size, events, &kept->history, findings))
		return false;
	take_queues(map, &record, &readers, kept); /* as the last record has them */
	for (uint32_t i = 0; i < findings->records; i++, bytes += record.size) {
		journal_parse(bytes, size, i, &record);
		size -= record.size;
		take_events(map, &record, &readers, kept, findings);
	}
	return true;
}
