/* SPDX-License-Identifier: GPL-3.0-or-later */
/* The controlled station's part of the map: event queues and counters. */
#include "map/station.h"

#include <stdio.h>
#include <string.h>

#include "map/layout.h"
#include "map/time_ns.h"

static struct queue_cell *queue_cell(const struct map *map, unsigned slot)
{
	return &station_segment(map)->queues[slot];
}

/* ---- event queues ------------------------------------------------------------------------ */

/* A place ahead of a ring's head cannot be: read as it stands, it would count as four thousand million events lost. */
static void check_place(const struct map *map, struct map_queue_place *place)
{
	for (uint32_t i = 0; i < map->directory->module_count; i++) {
		uint32_t head = ring_head(&map->segments[i].events);

		if ((int32_t)(head - place->cursor.next[i]) >= 0)
			continue;
		place->cursor.next[i] = head;
		place->refresh = MAP_REFRESH_ALL;
	}
	place->cursor.lost = 0;
}

void map_queue_place(const struct map *map, unsigned slot, struct map_queue_place *out)
{
	struct queue_cell *cell = queue_cell(map, slot);

	/* Where its owner acknowledges faster than this reads, any of its places will do. */
	latch_load(&cell->latch, cell->places, out, sizeof(*out));
	check_place(map, out);
}

void map_queue_move(struct map *map, unsigned slot, const struct map_queue_place *place)
{
	struct queue_cell *cell = queue_cell(map, slot);

	if (memcmp(&cell->places[latch_whole_copy(&cell->latch)], place, sizeof(*place)) == 0)
		return;
	cell->places[!latch_whole_copy(&cell->latch)] = *place;
	latch_flip(&cell->latch);
}

void map_queue_use(struct map *map, unsigned slot)
{
	uint32_t last = 0;

	for (unsigned i = 0; i < MAP_QUEUES; i++)
		if (atomic_load(&queue_cell(map, i)->used) > last)
			last = atomic_load(&queue_cell(map, i)->used);
	atomic_store(&queue_cell(map, slot)->used, last + 1);
}

void map_queue_assign(struct map *map, unsigned slot, const char *address,
		      const struct map_queue_place *place)
{
	struct queue_cell *cell = queue_cell(map, slot);

	cell->name[0] = '\0'; /* free, should the process be killed before the name is there again */
	atomic_thread_fence(memory_order_release);
	map_queue_move(map, slot, place);
	atomic_store(&cell->lost, 0);
	atomic_store(&cell->unacknowledged, 0);
	snprintf(cell->name + 1, sizeof(cell->name) - 1, "%s", address + 1);
	atomic_thread_fence(memory_order_release);
	cell->name[0] = address[0];
}

void map_queue_count_lost(struct map *map, unsigned slot, uint32_t events)
{
	map_count(&queue_cell(map, slot)->lost, events);
}

void map_queue_set_unacknowledged(struct map *map, unsigned slot, uint32_t events)
{
	atomic_store_explicit(&queue_cell(map, slot)->unacknowledged, events, memory_order_relaxed);
}

void map_queue_free(struct map *map, unsigned slot)
{
	struct queue_cell *cell = queue_cell(map, slot);

	cell->name[0] = '\0';
	atomic_store(&cell->used, 0);
}

static bool is_address_character(char c)
{
	return (c >= '0' && c <= '9') || (c >= 'a' && c <= 'f') || c == '.' || c == ':';
}

/* The name is its writer's: what is no address is not shown, and not looked for. */
static void copy_address(char to[MAP_ADDRESS_SIZE], const char *from)
{
	memcpy(to, from, MAP_ADDRESS_SIZE);
	to[MAP_ADDRESS_SIZE - 1] = '\0';
	for (const char *c = to; *c != '\0'; c++)
		if (!is_address_character(*c))
			to[0] = '\0';
}

void map_queue(const struct map *map, unsigned slot, struct map_queue *out)
{
	const struct map_settings *settings = &map->config.settings;
	const struct queue_cell *cell = queue_cell(map, slot);
	struct map_queue_place place;

	map_queue_place(map, slot, &place);
	*out = (struct map_queue){
	    .limit = map_queue_limit(settings, slot),
	    .waiting = map_events_behind(map, &place.cursor),
	    .unacknowledged = atomic_load(&cell->unacknowledged),
	    .lost = atomic_load(&cell->lost),
	    .used = atomic_load(&cell->used),
	};
	if (slot < settings->group_count)
		memcpy(out->name, settings->groups[slot].name, sizeof(settings->groups[slot].name));
	else
		copy_address(out->name, cell->name);
	if (out->unacknowledged > out->waiting)
		out->unacknowledged = out->waiting;
}

/* ---- counters ---------------------------------------------------------------------------- */

/* The name is its writer's, and goes to the reader's terminal. */
static void copy_printable(char to[MAP_PEER_SIZE], const char *from)
{
	memcpy(to, from, MAP_PEER_SIZE);
	to[MAP_PEER_SIZE - 1] = '\0';
	for (char *c = to; *c != '\0'; c++)
		if (*c < ' ' || *c > '~')
			*c = '?';
}

bool map_connection(const struct map *map, unsigned place, struct map_connection *out)
{
	const struct map_connection_stats *stats = &map_station_stats(map)->connections[place];

	*out = (struct map_connection){
	    .queue = atomic_load(&stats->queue),
	    .since_ns = (int64_t)atomic_load(&stats->since_s) * NS_PER_S,
	    .started = atomic_load(&stats->started) != 0,
	    .next_ns = atomic_load(&stats->next_ns),
	    .next_nr = atomic_load(&stats->next_nr),
	    .unacknowledged = atomic_load(&stats->unacknowledged),
	    .owed = atomic_load(&stats->owed),
	};
	copy_printable(out->peer, stats->peer);
	return atomic_load(&stats->open) != 0;
}

const char *map_station_counter_name(enum map_station_counter counter)
{
	static const char *const names[MAP_STATION_COUNTERS] = {
	    [MAP_STATION_I_IN] = "i_frames_in",
	    [MAP_STATION_S_IN] = "s_frames_in",
	    [MAP_STATION_STARTDT_ACT_IN] = "startdt_act_in",
	    [MAP_STATION_STARTDT_CON_IN] = "startdt_con_in",
	    [MAP_STATION_STOPDT_ACT_IN] = "stopdt_act_in",
	    [MAP_STATION_STOPDT_CON_IN] = "stopdt_con_in",
	    [MAP_STATION_TESTFR_ACT_IN] = "testfr_act_in",
	    [MAP_STATION_TESTFR_CON_IN] = "testfr_con_in",
	    [MAP_STATION_I_OUT] = "i_frames_out",
	    [MAP_STATION_S_OUT] = "s_frames_out",
	    [MAP_STATION_STARTDT_ACT_OUT] = "startdt_act_out",
	    [MAP_STATION_STARTDT_CON_OUT] = "startdt_con_out",
	    [MAP_STATION_STOPDT_ACT_OUT] = "stopdt_act_out",
	    [MAP_STATION_STOPDT_CON_OUT] = "stopdt_con_out",
	    [MAP_STATION_TESTFR_ACT_OUT] = "testfr_act_out",
	    [MAP_STATION_TESTFR_CON_OUT] = "testfr_con_out",
	    [MAP_STATION_ACCEPTED] = "connections_accepted",
	    [MAP_STATION_NOT_LISTED] = "refused_address_not_listed",
	    [MAP_STATION_TOO_MANY] = "refused_too_many",
	    [MAP_STATION_BAD_APDU] = "closed_bad_apdu",
	    [MAP_STATION_BAD_ASDU] = "closed_bad_asdu",
	    [MAP_STATION_BAD_NS] = "closed_bad_ns",
	    [MAP_STATION_BAD_NR] = "closed_bad_nr",
	    [MAP_STATION_I_WHILE_STOPPED] = "closed_i_while_stopped",
	    [MAP_STATION_T1_I_FRAME] = "closed_t1_i_frame",
	    [MAP_STATION_T1_TESTFR] = "closed_t1_testfr",
	    [MAP_STATION_UNREAD_ANSWERS] = "closed_unread_answers",
	    [MAP_STATION_TAKEN_OVER] = "closed_taken_over",
	    [MAP_STATION_GAVE_WAY] = "closed_gave_way",
	    [MAP_STATION_NOT_SECURE] = "closed_not_secure",
	    [MAP_STATION_CLOSED_BY_PEER] = "closed_by_peer",
	    [MAP_STATION_CLOSED_BY_STATION] = "closed_by_station",
	    [MAP_STATION_UNKNOWN_TYPE] = "refused_44_unknown_type",
	    [MAP_STATION_UNKNOWN_CAUSE] = "refused_45_unknown_cause",
	    [MAP_STATION_UNKNOWN_CA] = "refused_46_unknown_ca",
	    [MAP_STATION_UNKNOWN_IOA] = "refused_47_unknown_ioa",
	    [MAP_STATION_NEGATIVE] = "negative_confirmations",
	    [MAP_STATION_ORIGINATOR] = "refused_originator",
	    [MAP_STATION_EVENTS_SENT] = "events_sent",
	    [MAP_STATION_EVENTS_LOST] = "events_lost",
	};

	return names[counter];
}
