/* SPDX-License-Identifier: GPL-3.0-or-later */
#include "journal/follow.h"

#include <stdlib.h>
#include <string.h>

#include "map/time_ns.h"

#define CLOCK_MOVED_NS NS_PER_S /* less is a master's daily correction: not worth a whole file */

void journal_follow(struct journal_follower *follower, const struct map *map, uint8_t *memory, size_t size)
{
	*follower = (struct journal_follower){.map = map, .record = {.bytes = memory, .size = size}};
}

/* ---- queues ------------------------------------------------------------------------------ */

struct used_queue {
	uint32_t slot, used;
};

static int compare_used(const void *left, const void *right)
{
	const struct used_queue *a = left, *b = right;

	return (a->used > b->used) - (a->used < b->used);
}

static void note_queue(const struct map *map, uint32_t slot, struct journal_queue *out)
{
	struct map_queue_place place;
	struct map_queue queue;

	map_queue(map, slot, &queue);
	map_queue_place(map, slot, &place);
	out->kind = slot < MAP_NAMED_QUEUES_MAX ? JOURNAL_GROUP : JOURNAL_ADDRESS;
	memcpy(out->name, queue.name, sizeof(out->name));
	memcpy(out->next, place.cursor.next, sizeof(out->next));
}

/* The one unused longest first. */
static void note_queues(const struct map *map, struct journal_content *written)
{
	struct used_queue used[MAP_QUEUES];
	struct map_queue queue;

	written->queue_count = 0;
	for (uint32_t slot = 0; slot < MAP_QUEUES; slot++) {
		map_queue(map, slot, &queue);
		if (queue.name[0] != '\0')
			used[written->queue_count++] = (struct used_queue){slot, queue.used};
	}
	qsort(used, written->queue_count, sizeof(used[0]), compare_used);
	for (uint32_t i = 0; i < written->queue_count; i++)
		note_queue(map, used[i].slot, &written->queues[i]);
}

/* Of two numbers of a ring, which wrap. */
static uint32_t last_of(uint32_t a, uint32_t b)
{
	return (int32_t)(a - b) >= 0 ? a : b;
}

static uint32_t first_of(uint32_t a, uint32_t b)
{
	return (int32_t)(a - b) >= 0 ? b : a;
}

/* The first event of a module that some queue wants; end: none does. */
static uint32_t first_wanted(const struct journal_content *written, uint32_t module, uint32_t end)
{
	for (uint32_t i = 0; i < written->queue_count; i++)
		end = first_of(end, written->queues[i].next[module]);
	return end;
}

/* Of what the file holds the queues want the same as it says that they do. */
static bool same_wishes(const struct journal_content *written, const struct journal_content *now,
			uint32_t modules)
{
	if (written->queue_count != now->queue_count)
		return false;
	for (uint32_t i = 0; i < now->queue_count; i++) {
		const struct journal_queue *before = &written->queues[i], *after = &now->queues[i];

		if (before->kind != after->kind || strcmp(before->name, after->name) != 0)
			return false;
		for (uint32_t module = 0; module < modules; module++)
			if (first_of(before->next[module], written->heads[module]) !=
			    first_of(after->next[module], written->heads[module]))
				return false;
	}
	return true;
}

static bool anything_wanted(const struct journal_content *written, uint32_t modules)
{
	for (uint32_t module = 0; module < modules; module++)
		if (first_wanted(written, module, written->heads[module]) != written->heads[module])
			return true;
	return false;
}

/* ---- events ------------------------------------------------------------------------------ */

static struct journal_event translate(const struct map *map, const struct map_event *event, uint32_t number,
				      struct map_clock clock)
{
	const struct map_point *point = &map_config(map)->points[event->point];

	return (struct journal_event){
	    .ca = map_config(map)->sets[point->set].ca,
	    .module = (uint8_t)map_owner(map, event->point),
	    .type = point->type,
	    .ioa = point->ioa,
	    .number = number,
	    .value = event->sample.value.u,
	    .quality = event->sample.quality,
	    .detail = event->sample.detail,
	    .cause = event->cause,
	    .time = map_event_time_is_set(event, clock) ? MAP_TIME_WALL : MAP_TIME_WALL_UNSET,
	    .wall_ns = map_event_wall_ns(event, clock),
	};
}

/* The newest that fit: what a file has no room for is the oldest. */
static uint32_t skip_oldest(const struct map *map, struct map_cursor *cursor, size_t room)
{
	uint32_t most = map_events_behind(map, cursor), skipped = 0;
	struct map_event event;

	while (map_events_behind(map, cursor) > room / JOURNAL_EVENT_SIZE && skipped < most &&
	       map_event_next(map, cursor, &event))
		skipped++;
	return skipped;
}

/* What has no room waits for the next record. Events of modules are no points': after a power cut all are read anew. */
static void add_events(struct journal_follower *follower, struct map_cursor *cursor, struct map_clock clock)
{
	struct map_cursor ahead = *cursor;
	struct map_event event;

	while (map_event_next(follower->map, &ahead, &event)) {
		uint32_t owner =
		    event.kind == MAP_EVENT_CHANGE ? map_owner(follower->map, event.point) : MAP_RTUD;
		struct journal_event entry;

		if (owner != MAP_RTUD) {
			entry = translate(follower->map, &event, ahead.next[owner] - 1, clock);
			if (!journal_add(&follower->record, &entry))
				return;
		}
		*cursor = ahead;
	}
}

/* ---- retained points and values ---------------------------------------------------------- */

/* One that was never written says nothing; nor does one whose writer overtakes every try to read it, as only a wild one does. */
static void keep_point(struct journal_follower *follower, uint32_t point, struct map_clock clock)
{
	struct map_event now = {.point = point, .time = MAP_TIME_MONOTONIC};
	struct journal_event entry;

	if (!map_read_own(follower->map, point, &now.sample) || now.sample.time_ns == 0)
		return;
	entry = translate(follower->map, &now, 0, clock);
	journal_keep(&follower->record, &entry);
}

/* All of them, whose number the configuration bounds: so the last record alone says what they were. */
static void keep_points(struct journal_follower *follower, struct map_clock clock)
{
	const struct map_config *config = map_config(follower->map);

	for (uint32_t i = 0; i < config->point_count; i++)
		if (config->points[i].flags & MAP_POINT_RETAIN)
			keep_point(follower, i, clock);
}

static void add_values(struct journal_builder *record, const struct map_retained_name *names, uint32_t count,
		       const struct map_retained_value *values)
{
	for (uint32_t i = 0; i < count; i++)
		if (values[i].quality & MAP_RETAINED_KNOWN)
			journal_keep_value(record, names[i], values[i]);
}

/* Of one moment. What cannot be read so is not kept: its writer overtakes every try, as only a wild one does. */
static void keep_values_of(struct journal_follower *follower, uint32_t module,
			   const struct map_retained_name *names)
{
	const struct map_retained_plan *plan;
	struct map_retained *retained = map_retained(follower->map, module, &plan);
	const struct journal_builder before = follower->record;

	for (int tries = 0; retained != NULL && tries < LATCH_TRIES; tries++) {
		const uint32_t sequence = latch_read_begin(&retained->latch);

		add_values(&follower->record, names + plan->first, plan->names,
			   retained->values + (sequence & 1) * plan->values);
		if (latch_read_done(&retained->latch, sequence))
			return;
		follower->record = before;
	}
}

static void keep_values(struct journal_follower *follower)
{
	const struct map_retained_name *names =
	    map_records(map_config(follower->map), MAP_RETAINED, sizeof(*names));

	for (uint32_t i = 0; names != NULL && i < map_module_count(follower->map); i++)
		keep_values_of(follower, i, names);
}

/* ---- the history ------------------------------------------------------------------------- */

/* The first entry that there may be: from there to next is a bounded way, whatever its keeper writes. */
static uint32_t oldest_entry(const struct map_history *history, uint32_t next)
{
	return next > history->size ? next - history->size : next != 0;
}

/* Where the entries of a record begin: a file begins with the newest that fit, and what was overwritten is no more. */
static uint32_t begin_entries(const struct journal_follower *follower, const struct map_history *history,
			      uint32_t next, bool first, uint32_t room)
{
	const uint32_t oldest = oldest_entry(history, next), from = follower->written.entry;

	if (!first && follower->written.start != 0 && from - oldest <= next - oldest)
		return from;
	return first && next - oldest > room ? next - room : oldest;
}

static bool add_entry(struct journal_follower *follower, const struct map_history_entry *entry,
		      struct map_clock clock)
{
	const struct map_event event = {.point = entry->point, .time = entry->time, .sample = entry->sample};
	struct journal_event out;

	if (entry->point >= map_config(follower->map)->point_count)
		return true;
	out = translate(follower->map, &event, entry->number, clock);
	out.module = entry->reason;
	out.cause = JOURNAL_ENTRY;
	return journal_add(&follower->record, &out);
}

/* room: of pieces for entries, and the places before them. Returns the number of the entry that the next record begins with. */
static uint32_t add_entries(struct journal_follower *follower, const struct map_history *history,
			    uint32_t from, uint32_t next, size_t room, struct map_clock clock)
{
	const size_t end = follower->record.used + room * JOURNAL_EVENT_SIZE;
	const uint32_t revision = history->head->revision;
	struct map_history_entry entry;
	uint32_t start = 0;

	for (; from != next; from++) {
		if (!map_history_read(history, from, &entry))
			continue;
		if (follower->record.used + 2 * JOURNAL_EVENT_SIZE > end ||
		    (entry.start != start && !journal_place(&follower->record, entry.start, revision, from)))
			break;
		start = entry.start;
		if (!add_entry(follower, &entry, clock))
			break;
	}
	return from;
}

static void keep_readers(struct journal_follower *follower, const struct map_history *history)
{
	for (uint32_t i = 0; i < history->reader_count; i++)
		if (history->readers[i].used)
			journal_keep_reader(&follower->record, i, history->readers[i].octets);
}

static bool is_read(const struct map_history *history)
{
	for (uint32_t i = 0; i < history->reader_count; i++)
		if (history->readers[i].used)
			return true;
	return false;
}

/* The history, if one has begun and somebody reads it: else it wears nothing out. */
static bool find_history(const struct journal_follower *follower, struct map_history *out)
{
	return map_history(follower->map, out) && out->head->start != 0 && is_read(out);
}

/* Half of what is left is for entries. */
static void add_history(struct journal_follower *follower, const struct map_history *history, bool first,
			struct map_clock clock)
{
	struct journal_content *now = &follower->next;
	const uint32_t start = now->start, next = map_history_place(history)->next;
	size_t room;

	keep_readers(follower, history);
	now->digest = follower->record.digest;
	room = (follower->record.size - follower->record.used) / JOURNAL_EVENT_SIZE / 2;
	if (room < 4)
		return;
	now->entry = begin_entries(follower, history, next, first, (uint32_t)room - 4);
	now->entry = add_entries(follower, history, now->entry, next, room - 1, clock);
	journal_place(&follower->record, start, history->head->revision, now->entry);
}

/* ---- records ----------------------------------------------------------------------------- */

static bool clock_moved(struct map_clock written, struct map_clock now)
{
	return written.set != now.set || llabs(written.offset_ns - now.offset_ns) > CLOCK_MOVED_NS;
}

static struct map_cursor begin_at(const struct journal_follower *follower, const struct journal_content *now,
				  bool first, uint32_t modules)
{
	struct map_cursor cursor;

	map_cursor_to_end(follower->map, &cursor);
	for (uint32_t i = 0; i < modules; i++) {
		cursor.next[i] = first_wanted(now, i, cursor.next[i]);
		if (!first)
			cursor.next[i] = last_of(cursor.next[i], follower->written.heads[i]);
	}
	return cursor;
}

bool journal_make(struct journal_follower *follower, bool anew)
{
	struct journal_content *now = &follower->next;
	const uint32_t modules = map_module_count(follower->map);
	const struct map_clock clock = map_clock_read(follower->map);
	struct map_cursor cursor;
	struct map_history history;
	const bool read = find_history(follower, &history);
	bool first;

	note_queues(follower->map, now);
	memcpy(now->heads, follower->written.heads, sizeof(now->heads));
	now->start = read ? history.head->start : 0;
	now->entry = follower->written.entry;
	first = anew || !follower->begun ||
		(follower->written.start != 0 && now->start != follower->written.start) ||
		(clock_moved(follower->written.clock, clock) && (anything_wanted(now, modules) || read));
	now->clock = first ? clock : follower->written.clock;
	now->number = first ? 0 : follower->written.number;
	cursor = begin_at(follower, now, first, modules);
	follower->left_out = 0;
	journal_begin(&follower->record, now->number, modules, now->queues, now->queue_count);
	keep_points(follower, clock);
	keep_values(follower);
	now->digest = follower->record.digest;
	if (read)
		add_history(follower, &history, first, clock);
	if (first)
		follower->left_out =
		    skip_oldest(follower->map, &cursor, follower->record.size - follower->record.used);
	add_events(follower, &cursor, clock);
	if (!first && follower->record.events == follower->record.states &&
	    now->digest == follower->written.digest && same_wishes(&follower->written, now, modules))
		return false;
	memcpy(now->heads, cursor.next, sizeof(now->heads));
	journal_end(&follower->record);
	now->number++;
	return true;
}

void journal_written(struct journal_follower *follower)
{
	follower->written = follower->next;
	follower->begun = true;
}

void journal_abandon(struct journal_follower *follower)
{
	follower->begun = false;
}

uint32_t journal_pending(const struct journal_follower *follower)
{
	uint32_t pending = 0;

	for (uint32_t i = MAP_RTUD + 1; i < map_module_count(follower->map); i++)
		pending += follower->written.heads[i] -
			   first_wanted(&follower->written, i, follower->written.heads[i]);
	return pending;
}
