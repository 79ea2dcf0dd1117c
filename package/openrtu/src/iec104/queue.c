/* SPDX-License-Identifier: GPL-3.0-or-later */
/*
 * Event queues: which connection is sent the events of which, and how far its controlling station has acknowledged them.
 *
 * A connection reads ahead of its queue's place in the map. Beside each I frame that is not acknowledged stands the place
 * behind all events that were sent up to this frame; its acknowledgement moves the queue there. So a connection may end at
 * any time, and this process too: the next one begins behind what was acknowledged.
 */
#include "iec104/station_parts.h"

#include <inttypes.h>
#include <string.h>

#include "map/address.h"

/* The connection that is sent the events of a queue; NULL: none is. */
static struct iec104_connection *holder_of(struct iec104_station *station, uint32_t queue)
{
	for (unsigned i = 0; i < IEC104_CONNECTIONS_MAX; i++) {
		struct iec104_connection *connection = &station->connections[i];

		if (connection->open && connection->holds_queue && connection->queue == queue)
			return connection;
	}
	return NULL;
}

/* ---- places ------------------------------------------------------------------------------ */

/* Where the queue will be when all that was sent is acknowledged. */
static struct map_queue_place place_of(const struct iec104_connection *connection)
{
	struct map_queue_place place = {
	    .cursor = connection->down ? connection->before_down : connection->cursor,
	    .refresh_all = connection->refresh_all,
	    .refresh_modules = connection->refresh_modules | connection->silent_modules,
	};

	place.cursor.lost = 0;
	return place;
}

static struct map_queue_place *place_beside(struct iec104_connection *connection, uint32_t frame)
{
	const struct iec104_session *session = &connection->session;

	return &connection->places[((uint32_t)session->oldest + frame) % session->times->k];
}

void iec104_note_place(struct iec104_station *station, struct iec104_connection *connection)
{
	struct map_queue_place place = place_of(connection);
	uint16_t unacknowledged = connection->session.unacknowledged;

	if (!connection->holds_queue)
		return;
	if (unacknowledged > 0)
		*place_beside(connection, unacknowledged - 1u) = place;
	else
		map_queue_move(station->map, connection->queue, &place);
}

void iec104_take_acknowledgement(struct iec104_station *station, struct iec104_connection *connection)
{
	const struct iec104_session *session = &connection->session;
	uint16_t first_open =
	    (uint16_t)((session->next_ns + IEC104_SEQUENCE_MODULO - session->unacknowledged) %
		       IEC104_SEQUENCE_MODULO);
	uint32_t count =
	    (first_open + IEC104_SEQUENCE_MODULO - connection->first_open) % IEC104_SEQUENCE_MODULO;

	connection->first_open = first_open;
	if (connection->holds_queue && count > connection->overtaken)
		map_queue_move(station->map, connection->queue,
			       place_beside(connection, session->times->k - 1u));
	connection->overtaken -= count < connection->overtaken ? count : connection->overtaken;
}

/* ---- more events than may wait ----------------------------------------------------------- */

/*
 * What is not yet acknowledged of the sent events is older than the lost ones, and could not be sent again either: the
 * queue goes on behind them, whatever frame is acknowledged.
 */
static void skip_lost(struct iec104_station *station, struct iec104_connection *connection)
{
	uint16_t unacknowledged = connection->session.unacknowledged;
	struct map_queue_place place;

	connection->before_down = connection->cursor;
	connection->refresh_all = true;
	iec104_begin_refresh(station, connection);
	connection->overtaken = unacknowledged > 0 ? unacknowledged - 1u : 0;
	place = place_of(connection);
	map_queue_move(station->map, connection->queue, &place);
	iec104_note_place(station, connection);
}

static void note_lost(struct iec104_station *station, uint32_t slot, bool episode_begins, uint32_t lost)
{
	struct map_queue queue;

	map_queue_count_lost(station->map, slot, lost);
	map_count(&station->stats->counters[IEC104_COUNT_EVENTS_LOST], lost);
	map_count_lost_events(station->map, lost);
	if (!episode_begins)
		return;
	station->losses_changed = true;
	map_queue(station->map, slot, &queue);
	iec104_log(station, MAP_LOG_WARNING, queue.name,
		   "more than %" PRIu32 " events wait, the oldest are lost; all points will be sent",
		   queue.limit);
}

void iec104_note_lost_events(struct iec104_station *station, struct iec104_connection *connection)
{
	uint32_t lost = connection->cursor.lost;

	if (lost == 0)
		return;
	connection->cursor.lost = 0;
	note_lost(station, connection->queue, !connection->refresh_all, lost);
	skip_lost(station, connection);
}

bool iec104_queue_recovers(struct iec104_station *station, uint32_t queue)
{
	const struct iec104_connection *holder = holder_of(station, queue);
	struct map_queue_place place;

	if (holder != NULL)
		return holder->refresh_all;
	map_queue_place(station->map, queue, &place);
	return place.refresh_all;
}

/* As long as this takes: a module that puts events faster holds nobody up. */
static void drop_oldest(struct iec104_station *station, struct map_cursor *cursor, uint32_t limit)
{
	uint32_t most = station->config->settings.event_ring * MAP_MODULES_MAX;
	struct map_event event;

	while (map_events_behind(station->map, cursor) > limit && most-- > 0 &&
	       map_event_next(station->map, cursor, &event))
		cursor->lost++;
}

static void trim_waiting(struct iec104_station *station, uint32_t slot)
{
	struct map_queue_place place;
	bool episode_begins;

	map_queue_place(station->map, slot, &place);
	drop_oldest(station, &place.cursor, map_queue_limit(&station->config->settings, slot));
	if (place.cursor.lost == 0)
		return;
	episode_begins = !place.refresh_all;
	place.refresh_all = true;
	note_lost(station, slot, episode_begins, place.cursor.lost);
	place.cursor.lost = 0;
	map_queue_move(station->map, slot, &place);
}

/* Each time that events may have come: what only waits is counted too. */
void iec104_trim_queues(struct iec104_station *station)
{
	uint32_t waiting = station->queues;

	for (unsigned i = 0; i < IEC104_CONNECTIONS_MAX; i++) {
		struct iec104_connection *connection = &station->connections[i];

		if (!connection->open || !connection->holds_queue)
			continue;
		waiting &= ~(1u << connection->queue);
		drop_oldest(station, &connection->cursor,
			    map_queue_limit(&station->config->settings, connection->queue));
		iec104_note_lost_events(station, connection);
	}
	for (; waiting != 0; waiting &= waiting - 1)
		trim_waiting(station, (uint32_t)__builtin_ctz(waiting));
}

/* ---- who has which queue ----------------------------------------------------------------- */

static void take_over(struct iec104_station *station, struct iec104_connection *holder,
		      const struct iec104_connection *by)
{
	iec104_log(station, MAP_LOG_WARNING, holder->peer, "%s takes over", by->peer);
	iec104_release_queue(station, holder);
	iec104_session_close(&holder->session, IEC104_TAKEN_OVER);
}

/* The queue that this connection had before, or the one that was last used at its address; MAP_NONE: there is none. */
static uint32_t former_queue(struct iec104_station *station, const struct iec104_connection *connection)
{
	uint32_t found = MAP_NONE, last_used = 0;
	struct map_queue queue;

	for (uint32_t slot = MAP_NAMED_QUEUES_MAX; slot < MAP_QUEUES; slot++) {
		map_queue(station->map, slot, &queue);
		if (strcmp(queue.name, connection->address) != 0 || holder_of(station, slot) != NULL)
			continue;
		if (slot == connection->queue)
			return slot;
		if (queue.used >= last_used) {
			found = slot;
			last_used = queue.used;
		}
	}
	return found;
}

/* One that was never used, or the one unused longest. There are more than there can be connections. */
static uint32_t unused_queue(struct iec104_station *station)
{
	uint32_t found = MAP_QUEUES - 1, first_used = UINT32_MAX;
	struct map_queue queue;

	for (uint32_t slot = MAP_NAMED_QUEUES_MAX; slot < MAP_QUEUES; slot++) {
		map_queue(station->map, slot, &queue);
		if (queue.used < first_used && holder_of(station, slot) == NULL) {
			found = slot;
			first_used = queue.used;
		}
	}
	return found;
}

/* Whichever of its address's other connections has failed in silence, if one has: what was not acknowledged is not lost. */
static bool succeed(struct iec104_station *station, const struct iec104_connection *connection,
		    struct map_queue_place *place)
{
	uint32_t most_waiting = 0;

	for (unsigned i = 0; i < IEC104_CONNECTIONS_MAX; i++) {
		struct iec104_connection *other = &station->connections[i];
		struct map_queue queue;

		if (!other->open || !other->holds_queue || other->group != MAP_NONE ||
		    strcmp(other->address, connection->address) != 0)
			continue;
		other->succeeded_ns = station->now_ns;
		map_queue(station->map, other->queue, &queue);
		if (queue.waiting > most_waiting) {
			most_waiting = queue.waiting;
			map_queue_place(station->map, other->queue, place);
		}
	}
	return most_waiting > 0;
}

/* Begins with what happens from now on, if there is nothing to succeed to: the interrogation brings the state. */
static uint32_t new_queue(struct iec104_station *station, const struct iec104_connection *connection)
{
	uint32_t slot = unused_queue(station);
	struct map_queue_place place = {.refresh_all = 0};
	struct map_queue former;

	map_queue(station->map, slot, &former);
	if (former.name[0] != '\0')
		iec104_log(station, MAP_LOG_WARNING, connection->peer,
			   "takes the queue of %s, which was unused longest", former.name);
	if (!succeed(station, connection, &place))
		map_cursor_to_end(station->map, &place.cursor);
	map_queue_assign(station->map, slot, connection->address, &place);
	station->queues |= 1u << slot;
	station->losses_changed = true;
	return slot;
}

/* Several connections from one address have a queue each: they may be behind a router that translates addresses. */
static uint32_t queue_of(struct iec104_station *station, const struct iec104_connection *connection)
{
	uint32_t slot = connection->group;

	if (slot == MAP_NONE)
		slot = former_queue(station, connection);
	return slot == MAP_NONE ? new_queue(station, connection) : slot;
}

static void continue_queue(struct iec104_station *station, struct iec104_connection *connection)
{
	struct map_queue_place place;

	map_queue_place(station->map, connection->queue, &place);
	connection->cursor = place.cursor;
	connection->down = false;
	connection->silent_modules = connection->returned_modules = 0;
	connection->refresh = false;
	connection->refresh_all = place.refresh_all;
	connection->refresh_modules = 0;
	if (place.refresh_all)
		iec104_begin_refresh(station, connection);
	memset(connection->told, 0, sizeof(connection->told));
	memset(connection->module_ns, 0, sizeof(connection->module_ns));
	memset(connection->told_ns, 0, sizeof(connection->told_ns));
	for (map_modules left = place.refresh_modules; left != 0; left &= left - 1)
		iec104_begin_return(station, connection, (uint32_t)__builtin_ctzll(left), station->now_ns);
	connection->overtaken = 0;
}

void iec104_claim_queue(struct iec104_station *station, struct iec104_connection *connection)
{
	uint32_t slot = queue_of(station, connection);
	struct iec104_connection *holder = holder_of(station, slot);

	if (holder != NULL)
		take_over(station, holder, connection);
	connection->queue = slot;
	connection->holds_queue = true;
	map_queue_use(station->map, connection->queue);
	continue_queue(station, connection);
}

void iec104_release_queue(struct iec104_station *station, struct iec104_connection *connection)
{
	if (!connection->holds_queue)
		return;
	connection->holds_queue = false;
	map_queue_set_unacknowledged(station->map, connection->queue, 0);
	if (connection->succeeded_ns > connection->session.heard_ns) { /* its successor has all of it */
		map_queue_free(station->map, connection->queue);
		station->queues &= ~(1u << connection->queue);
		station->losses_changed = true;
	} else {
		map_queue_use(station->map, connection->queue);
	}
}

/* ---- groups that come ----------------------------------------------------------------------- */

/* What waits behind either place. */
static void join(struct map_queue_place *to, const struct map_queue_place *from)
{
	for (uint32_t i = 0; i < MAP_MODULES_MAX; i++)
		if ((int32_t)(from->cursor.next[i] - to->cursor.next[i]) < 0)
			to->cursor.next[i] = from->cursor.next[i];
	to->refresh_all |= from->refresh_all;
	to->refresh_modules |= from->refresh_modules;
}

static bool is_member(const struct iec104_group *group, const char *text)
{
	struct in6_addr address;

	return map_address_parse(text, &address) &&
	       map_address_place(group->masters, group->master_count, &address) < group->master_count;
}

static bool shares_member(const struct iec104_group *group, const struct iec104_group *other)
{
	for (uint32_t i = 0; i < other->master_count; i++)
		if (is_member(group, other->masters[i]))
			return true;
	return false;
}

/* The queues that its members had by their addresses: a bit each. */
static uint32_t queues_of_members(const struct iec104_station *station, const struct iec104_group *group)
{
	struct map_queue queue;
	uint32_t found = 0;

	for (uint32_t slot = MAP_NAMED_QUEUES_MAX; slot < MAP_QUEUES; slot++) {
		map_queue(station->map, slot, &queue);
		if (is_member(group, queue.name))
			found |= 1u << slot;
	}
	return found;
}

/* Of the groups of before that a member was in. NULL: nobody knows them. */
static uint32_t groups_of_members(const struct iec104_group *group, const struct map_config *before)
{
	uint32_t found = 0;

	for (uint32_t i = 0; before != NULL && i < before->settings.queue_count; i++)
		if (shares_member(group, &iec104_settings(before)->groups[i]))
			found |= 1u << before->settings.queues[i].slot;
	return found;
}

/* Its masters have the group's queue from now on. */
static void give_up_queue(struct iec104_station *station, uint32_t slot)
{
	struct iec104_connection *holder = holder_of(station, slot);

	if (holder != NULL)
		iec104_release_queue(station, holder);
	map_queue_free(station->map, slot);
	station->queues &= ~(1u << slot);
}

/* A new one begins with what waited for its members, wherever that was, else with what happens from now on. */
static void adopt_group(struct iec104_station *station, uint32_t index, const struct map_config *before)
{
	const struct iec104_group *group = &station->settings->groups[index];
	const uint32_t slot = station->config->settings.queues[index].slot;
	const uint32_t own = queues_of_members(station, group);
	uint32_t former = own | groups_of_members(group, before);
	struct map_queue_place anew = {.refresh_all = 0}, place;

	map_cursor_to_end(station->map, &anew.cursor);
	for (; former != 0; former &= former - 1) {
		map_queue_place(station->map, (uint32_t)__builtin_ctz(former), &place);
		join(&anew, &place);
	}
	map_queue_adopt(station->map, slot, &anew);
	for (former = own; former != 0; former &= former - 1)
		give_up_queue(station, (uint32_t)__builtin_ctz(former));
}

void iec104_adopt_groups(struct iec104_station *station, const struct map_config *before)
{
	const struct map_settings *settings = &station->config->settings;
	struct map_queue_place end = {.refresh_all = 0};

	for (uint32_t i = 0; i < settings->queue_count; i++)
		adopt_group(station, i, before);
	map_cursor_to_end(station->map, &end.cursor);
	for (uint32_t slot = 0; slot < MAP_NAMED_QUEUES_MAX; slot++) {
		const bool is_there = map_queue_plan(settings, slot) != NULL;

		map_queue_adopt(station->map, slot, &end);
		station->queues = (station->queues & ~(1u << slot)) | (uint32_t)is_there << slot;
	}
}

void iec104_find_queues(struct iec104_station *station)
{
	_Static_assert(MAP_QUEUES <= 32, "station->queues has a bit for each");
	struct map_queue queue;

	station->queues = 0;
	iec104_adopt_groups(station, NULL);
	for (uint32_t slot = 0; slot < MAP_QUEUES; slot++) {
		map_queue_set_unacknowledged(station->map, slot, 0);
		map_queue(station->map, slot, &queue);
		if (queue.name[0] != '\0')
			station->queues |= 1u << slot;
	}
}
