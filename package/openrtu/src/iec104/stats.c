/* SPDX-License-Identifier: GPL-3.0-or-later */
/* What rtuctl sees of the connections. */
#include "iec104/station_parts.h"
#include "map/time_ns.h"

#include <stdio.h>

static struct iec104_connection_stats *stats_of(const struct iec104_station *station,
						const struct iec104_connection *connection)
{
	return &station->stats->connections[connection - station->connections];
}

static void set(_Atomic uint32_t *word, uint32_t value)
{
	atomic_store_explicit(word, value, memory_order_relaxed);
}

void iec104_show_opened(const struct iec104_station *station, const struct iec104_connection *connection)
{
	struct iec104_connection_stats *stats = stats_of(station, connection);

	snprintf(stats->peer, sizeof(stats->peer), "%s", connection->peer);
	set(&stats->since_s, (uint32_t)(station->now_ns / NS_PER_S));
	iec104_show_connection(station, connection);
	atomic_store_explicit(&stats->open, 1, memory_order_release);
}

void iec104_show_connection(const struct iec104_station *station, const struct iec104_connection *connection)
{
	const struct iec104_session *session = &connection->session;
	struct iec104_connection_stats *stats = stats_of(station, connection);
	struct map_queue_place place;
	bool moved = stats->next_ns != session->next_ns || stats->unacknowledged != session->unacknowledged;

	set(&stats->queue, connection->queue);
	set(&stats->started, session->started);
	set(&stats->next_ns, session->next_ns);
	set(&stats->next_nr, session->next_nr);
	set(&stats->unacknowledged, session->unacknowledged);
	set(&stats->owed, session->owed);
	if (!moved || !connection->holds_queue)
		return;
	map_queue_place(station->map, connection->queue, &place);
	map_queue_set_unacknowledged(station->map, connection->queue,
				     map_events_behind(station->map, &place.cursor) -
					 map_events_behind(station->map, &connection->cursor));
}

void iec104_show_closed(const struct iec104_station *station, const struct iec104_connection *connection)
{
	_Atomic uint32_t *counters = station->stats->counters;
	const unsigned int reason = connection->session.closing - IEC104_BAD_APDU;

	_Static_assert(IEC104_COUNT_CLOSED_BY_STATION - IEC104_COUNT_BAD_APDU ==
			   IEC104_CLOSED_BY_STATION - IEC104_BAD_APDU,
		       "each reason has its counter");

	map_count(&counters[IEC104_COUNT_BAD_APDU + reason], 1);
	atomic_store_explicit(&stats_of(station, connection)->open, 0, memory_order_release);
}
