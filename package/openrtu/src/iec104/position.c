/* SPDX-License-Identifier: GPL-3.0-or-later */
/* Where a connection is among the map's events. */
#include "iec104/station_parts.h"

bool iec104_event_waits(const struct iec104_station *station, const struct iec104_connection *connection)
{
	struct map_cursor ahead = connection->cursor;
	struct map_event event;

	return map_event_next(station->map, &ahead, &event);
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
