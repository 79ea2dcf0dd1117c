/* SPDX-License-Identifier: GPL-3.0-or-later */
/* Events, and what is sent in their place when a module goes, comes back, or events were lost. */
#include "iec104/station_parts.h"
#include "map/time_ns.h"

#define DOUBT_NS (MAP_HEARTBEAT_LIMIT_MS * NS_PER_MS)

static bool of_down_module(const struct iec104_station *station, const struct iec104_connection *connection,
			   uint32_t point)
{
	return map_owner(station->map, point) == connection->down_module;
}

static bool to_be_refreshed(const struct iec104_station *station, const struct iec104_connection *connection,
			    uint32_t point)
{
	return connection->refresh_all ||
	       (connection->refresh_modules & 1u << map_owner(station->map, point)) != 0;
}

void iec104_begin_refresh(const struct iec104_station *station, struct iec104_connection *connection)
{
	connection->refresh = true;
	iec104_begin_sweep_of_all(station, connection, &connection->refresh_sweep, to_be_refreshed);
}

void iec104_refresh_recovered(const struct iec104_station *station, struct iec104_connection *connection,
			      int64_t now_ns)
{
	for (uint32_t i = 0; connection->silent_modules >> i != 0; i++) {
		if (!(connection->silent_modules & 1u << i) || !map_alive(station->map, i))
			continue;
		connection->silent_modules &= ~(1u << i);
		connection->refresh_modules |= 1u << i;
		iec104_begin_refresh(station, connection);
	}
	if (connection->silent_modules != 0)
		connection->retry_ns = now_ns + DOUBT_NS;
}

bool iec104_send_invalid(const struct iec104_station *station, struct iec104_connection *connection,
			 int64_t now_ns)
{
	const struct iec104_manner manner = {
	    .wanted = of_down_module,
	    .cause = IEC104_SPONTANEOUS,
	    .tagged = true,
	    .invalid = true,
	    .invalid_since_ns = connection->down_ns,
	};
	enum iec104_progress progress =
	    iec104_send_points(station, connection, &connection->down_sweep, &manner, now_ns);

	if (progress == IEC104_SWEEP_DONE)
		connection->down = false;
	return progress != IEC104_SWEEP_TRY_LATER;
}

bool iec104_send_refresh(struct iec104_station *station, struct iec104_connection *connection, int64_t now_ns)
{
	const struct iec104_manner manner = {
	    .wanted = to_be_refreshed,
	    .cause = IEC104_SPONTANEOUS,
	    .tagged = true,
	    .valid_only = !connection->refresh_all, /* an owner that was down was reported invalid */
	};
	enum iec104_progress progress;

	if (!connection->refresh)
		return false;
	progress = iec104_send_points(station, connection, &connection->refresh_sweep, &manner, now_ns);
	if (progress == IEC104_SWEEP_DONE) {
		station->losses_changed |= connection->refresh_all;
		connection->refresh = connection->refresh_all = false;
		connection->refresh_modules = 0;
	}
	return progress != IEC104_SWEEP_TRY_LATER;
}

/* What an event of a whole module means: further ASDUs, or nothing. */
static void take_module_event(const struct iec104_station *station, struct iec104_connection *connection,
			      const struct map_event *event, const struct map_cursor *before)
{
	switch (event->kind) {
	case MAP_EVENT_MODULE_DOWN:
		connection->refresh_modules &= ~(1u << event->point);
		connection->silent_modules &= ~(1u << event->point); /* its return is told */
		connection->down = true;
		connection->before_down = *before;
		connection->down_module = event->point;
		connection->down_ns = event->sample.time_ns;
		iec104_begin_sweep_of_all(station, connection, &connection->down_sweep, of_down_module);
		break;
	case MAP_EVENT_MODULE_UP:
		connection->refresh_modules |= 1u << event->point;
		iec104_begin_refresh(station, connection);
		break;
	default:
		break; /* the clock's change is in the time tags */
	}
}

uint32_t iec104_events_end(const struct iec104_station *station, uint32_t module)
{
	struct map_cursor end;

	map_cursor_to_end(station->map, &end);
	return end.next[module];
}

bool iec104_events_were_sent(const struct iec104_connection *connection, uint32_t module, uint32_t end)
{
	return (int32_t)(connection->cursor.next[module] - end) >= 0;
}

static uint8_t wire_cause(const struct map_event *event)
{
	switch ((enum map_cause)event->cause) {
	case MAP_RETURN_REMOTE:
		return IEC104_RETURN_REMOTE;
	case MAP_RETURN_LOCAL:
		return IEC104_RETURN_LOCAL;
	case MAP_SPONTANEOUS:
		break;
	}
	return IEC104_SPONTANEOUS;
}

/* Adds an event to the ASDU; the first one begins it. False: it does not belong into this one. */
static bool add_event(const struct iec104_station *station, struct iec104_builder *builder,
		      const struct map_event *first, const struct map_event *event)
{
	const struct iec104_manner manner = {.cause = wire_cause(event), .tagged = true};

	if (event == first)
		iec104_begin_asdu(station, builder, event->point, &manner, false);
	else if (event->kind != MAP_EVENT_CHANGE || event->cause != first->cause ||
		 iec104_point(station, event->point)->device != iec104_point(station, first->point)->device ||
		 iec104_monitor_type(iec104_point(station, event->point), true) !=
		     iec104_monitor_type(iec104_point(station, first->point), true) ||
		 !iec104_is_tellable(station, event->point, &event->sample))
		return false;
	return iec104_add_event(station, builder, event);
}

/* As many events as come one after another and go into one ASDU, in their order. */
static void send_changes(const struct iec104_station *station, struct iec104_connection *connection,
			 const struct map_event *first, int64_t now_ns)
{
	struct map_cursor ahead = connection->cursor;
	struct iec104_builder builder;
	struct map_event event;

	add_event(station, &builder, first, first);
	while (map_event_next(station->map, &ahead, &event) && add_event(station, &builder, first, &event))
		connection->cursor = ahead;
	map_count(&station->stats->counters[MAP_STATION_EVENTS_SENT], iec104_asdu_count(&builder));
	iec104_send(connection, &builder, now_ns);
}

static bool is_return_information(const struct map_event *event)
{
	return event->kind == MAP_EVENT_CHANGE && event->cause != MAP_SPONTANEOUS;
}

/* Return information was published after its command was confirmed: so that is told first, if it came only now. */
bool iec104_send_event(struct iec104_station *station, struct iec104_connection *connection, int64_t now_ns)
{
	struct map_cursor before = connection->cursor, ahead = before;
	struct map_event event;

	if (!map_event_next(station->map, &ahead, &event))
		return false;
	if (is_return_information(&event) && iec104_take_answers(station))
		return true;
	connection->cursor = ahead;
	if (event.kind != MAP_EVENT_CHANGE)
		take_module_event(station, connection, &event, &before);
	else if (iec104_is_tellable(station, event.point, &event.sample))
		send_changes(station, connection, &event, now_ns);
	iec104_note_lost_events(station, connection);
	return true;
}
