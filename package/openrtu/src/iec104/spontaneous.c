/* SPDX-License-Identifier: GPL-3.0-or-later */
/* Events, in their order. */
#include "iec104/station_parts.h"
#include "map/time_ns.h"

/* rtud may be stopped between noticing it and telling it: what the module told meanwhile is later. */
static int64_t lost_ns(const struct iec104_station *station, const struct iec104_connection *connection,
		       const struct map_event *event)
{
	const int64_t told_ns = earlier(connection->told_ns[event->point], station->now_ns);

	return later(event->sample.time_ns, told_ns);
}

/* What an event of a whole module means: further ASDUs, or nothing. */
static void take_module_event(const struct iec104_station *station, struct iec104_connection *connection,
			      const struct map_event *event, const struct map_cursor *before)
{
	switch (event->kind) {
	case MAP_EVENT_MODULE_DOWN:
		connection->refresh_modules &= ~map_module_bit(event->point);
		connection->silent_modules &= ~map_module_bit(event->point); /* its return is told */
		connection->before_down = *before;
		iec104_begin_invalid(station, connection, event->point, lost_ns(station, connection, event));
		break;
	case MAP_EVENT_MODULE_UP:
		if (!(connection->returned_modules & map_module_bit(event->point)))
			iec104_begin_return(station, connection, event->point, event->sample.time_ns);
		connection->returned_modules &= ~map_module_bit(event->point);
		break;
	default:
		break; /* the clock's change is in the time tags */
	}
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

/* Goes into the ASDU of the first one. A position has one of its own. */
static bool belongs(const struct iec104_station *station, const struct map_event *first,
		    const struct map_event *event)
{
	return event->kind == MAP_EVENT_CHANGE && event->cause == first->cause &&
	       iec104_point(station, event->point)->set == iec104_point(station, first->point)->set &&
	       iec104_type_of(station, event->point, true) == iec104_type_of(station, first->point, true) &&
	       iec104_is_tellable(station, event->point, &event->sample) &&
	       !iec104_is_position(station, event->point);
}

/* It is none of before its module was lost, which a module that was stopped may put in behind that. */
static bool is_news(const struct iec104_station *station, const struct iec104_connection *connection,
		    const struct map_event *event)
{
	return !event->past &&
	       event->sample.time_ns >= connection->module_ns[map_owner(station->map, event->point)];
}

/* False: the ASDU is full. */
static bool add_change(const struct iec104_station *station, struct iec104_connection *connection,
		       struct iec104_builder *builder, const struct map_event *event,
		       const struct map_sample *samples)
{
	int64_t *told_ns = &connection->told_ns[map_owner(station->map, event->point)];

	if (!iec104_add_event(station, builder, event, samples))
		return false;
	*told_ns = later(*told_ns, event->sample.time_ns);
	if (is_news(station, connection, event))
		iec104_note_told(connection, event->point);
	return true;
}

/* As many events as come one after another and go into one ASDU, in their order. */
static void send_changes(const struct iec104_station *station, struct iec104_connection *connection,
			 const struct map_event *first, int64_t now_ns)
{
	const struct iec104_manner manner = {.cause = wire_cause(first), .tagged = true};
	struct map_cursor ahead = connection->cursor;
	struct map_sample samples[IEC104_SAMPLES];
	struct iec104_builder builder;
	struct map_event event;

	if (!iec104_complete_event(station, &ahead, first, samples))
		return;
	iec104_begin_asdu(station, &builder, first->point, &manner, false);
	add_change(station, connection, &builder, first, samples);
	while (map_event_next(station->map, &ahead, &event) && belongs(station, first, &event) &&
	       add_change(station, connection, &builder, &event, &event.sample))
		connection->cursor = ahead;
	map_count(&station->stats->counters[IEC104_COUNT_EVENTS_SENT], iec104_asdu_count(&builder));
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
