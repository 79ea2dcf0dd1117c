/* SPDX-License-Identifier: GPL-3.0-or-later */
#include "modules/goose/publish.h"

#include <stdlib.h>

#include "goose/pace.h"
#include "goose/publisher.h"

#define EVENTS_A_TURN 256
#define READ_TRIES    3

static struct map *map;
static struct goose_stats *stats;
static struct goose_publisher publishers[GOOSE_PUBLISHED_MAX];
static struct goose_pace paces[GOOSE_PUBLISHED_MAX];
static uint32_t count;
static struct map_sample *samples; /* of all members */
static struct map_cursor cursor;
static bool has_more; /* events than one turn takes */

/* ---- members ----------------------------------------------------------------------------- */

static void set_member(struct goose_publisher *publisher, uint32_t member)
{
	struct map_sample sample;

	for (unsigned tries = 0; tries < READ_TRIES; tries++)
		if (map_read(map, publisher->members[member], &sample)) {
			goose_publisher_set(publisher, member, &sample);
			return;
		}
}

static void read_all(void)
{
	for (uint32_t i = 0; i < count; i++)
		for (uint32_t j = 0; j < publishers[i].publication->member_count; j++)
			set_member(&publishers[i], j);
}

/*
 * An owner that hangs has no valid points, and makes no event of it: before each message, and so in max_ms, it is seen. What it
 * published meanwhile is in its events.
 */
static void check_owners(struct goose_publisher *publisher)
{
	for (uint32_t i = 0; i < publisher->publication->member_count; i++) {
		struct map_sample sample = publisher->samples[i];
		const bool alive = map_alive(map, map_owner(map, publisher->members[i]));

		if (!alive) {
			sample.quality |= MAP_INVALID;
			goose_publisher_set(publisher, i, &sample);
		} else if (sample.quality & MAP_INVALID) {
			set_member(publisher, i);
		}
	}
}

/* ---- messages ---------------------------------------------------------------------------- */

static struct goose_time time_of(int64_t now_ns)
{
	const struct map_clock clock = map_clock_read(map);

	return (struct goose_time){
	    .utc_ns = map_wall_ns(clock, now_ns),
	    .quality = (uint8_t)(GOOSE_TIME_UNSPECIFIED | (clock.set ? 0 : GOOSE_TIME_UNSET)),
	};
}

static void send_message(struct wire *wire, uint32_t number, int64_t now_ns)
{
	struct goose_published *of = &stats->published[number];
	uint8_t frame[GOOSE_FRAME_MAX];
	const size_t size =
	    goose_publisher_send(&publishers[number], wire->address, time_of(now_ns), now_ns, frame);

	atomic_store(&of->states, publishers[number].state);
	goose_pace_take(&paces[number], now_ns);
	map_count(wire_send(wire, frame, size) ? &of->messages : &of->failures, 1);
}

/* ---- events ------------------------------------------------------------------------------ */

/* A second change of a member that was not sent yet would hide the first; whose points change without end, it does. */
static void set_changed(struct wire *wire, uint32_t number, uint32_t member, const struct map_sample *sample,
			int64_t now_ns)
{
	if (goose_publisher_has_changed(&publishers[number], member)) {
		if (goose_pace_may(&paces[number], now_ns))
			send_message(wire, number, now_ns);
		else
			map_count(&stats->published[number].merged, 1);
	}
	goose_publisher_set(&publishers[number], member, sample);
}

static void take_change(struct wire *wire, const struct map_event *event, int64_t now_ns)
{
	for (uint32_t i = 0; i < count; i++)
		for (uint32_t j = 0; j < publishers[i].publication->member_count; j++)
			if (publishers[i].members[j] == event->point)
				set_changed(wire, i, j, &event->sample, now_ns);
}

static void take_events(struct wire *wire, int64_t now_ns)
{
	struct map_event event;
	unsigned taken = 0;

	while (taken < EVENTS_A_TURN && map_event_next(map, &cursor, &event)) {
		taken++;
		if (event.past)
			continue; /* a message tells the state */
		if (event.kind == MAP_EVENT_CHANGE)
			take_change(wire, &event, now_ns);
		else if (event.kind != MAP_EVENT_CLOCK)
			read_all();
	}
	if (cursor.lost != 0) {
		map_count_lost_events(map, cursor.lost);
		cursor.lost = 0;
		read_all();
	}
	has_more = taken == EVENTS_A_TURN;
}

/* ------------------------------------------------------------------------------------------ */

static void name_counters(const struct goose_publication *publication, const struct goose_published *of)
{
	map_name_counter(map, &of->states, "%s.states", publication->stream.name);
	map_name_counter(map, &of->messages, "%s.messages", publication->stream.name);
	map_name_counter(map, &of->failures, "%s.failures", publication->stream.name);
	map_name_counter(map, &of->merged, "%s.merged", publication->stream.name);
}

bool publish_begin(struct map *of_map, struct goose_stats *of_stats)
{
	const struct map_config *config = map_config(of_map);

	map = of_map;
	stats = of_stats;
	count = map_record_count(config, GOOSE_PUBLICATIONS);
	samples = calloc((size_t)map_record_count(config, GOOSE_MEMBERS) + 1, sizeof(*samples));
	if (samples == NULL)
		return false;
	for (uint32_t i = 0; i < count; i++) {
		const struct goose_publication *publication = &goose_publications(config)[i];

		goose_publisher_init(&publishers[i], config, i, &samples[publication->first_member],
				     atomic_load(&stats->published[i].states));
		name_counters(publication, &stats->published[i]);
	}
	map_cursor_to_end(map, &cursor);
	read_all();
	return true;
}

void publish_end(void)
{
	free(samples);
}

static int64_t deadline_of(uint32_t number)
{
	return later(goose_publisher_deadline(&publishers[number]), goose_pace_free(&paces[number]));
}

void publish_run(struct wire *wire, int64_t now_ns)
{
	take_events(wire, now_ns);
	for (uint32_t i = 0; i < count; i++) {
		if (now_ns < deadline_of(i))
			continue;
		check_owners(&publishers[i]);
		send_message(wire, i, now_ns);
	}
}

int64_t publish_deadline(void)
{
	int64_t deadline_ns = has_more ? INT64_MIN : INT64_MAX;

	for (uint32_t i = 0; i < count; i++)
		deadline_ns = earlier(deadline_ns, deadline_of(i));
	return deadline_ns;
}
