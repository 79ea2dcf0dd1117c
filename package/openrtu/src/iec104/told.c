/* SPDX-License-Identifier: GPL-3.0-or-later */
/* What a module's points are told as when it is lost or back, beside what its events tell of them. */
#include "iec104/station_parts.h"

void iec104_note_told(struct iec104_connection *connection, uint32_t point)
{
	if (point < IEC104_TOLD_POINTS)
		connection->told[point / 32] |= 1u << point % 32;
}

static bool is_told(const struct iec104_connection *connection, uint32_t point)
{
	return point < IEC104_TOLD_POINTS && (connection->told[point / 32] & 1u << point % 32) != 0;
}

void iec104_forget_told(const struct iec104_station *station, struct iec104_connection *connection,
			uint32_t module)
{
	for (uint32_t i = 0; i < station->config->point_count && i < IEC104_TOLD_POINTS; i++)
		if (map_owner(station->map, i) == module)
			connection->told[i / 32] &= ~(1u << i % 32);
}

void iec104_note_silent(const struct iec104_station *station, struct iec104_connection *connection,
			uint32_t module)
{
	if (connection->silent_modules & map_module_bit(module))
		return;
	connection->silent_modules |= map_module_bit(module);
	if (!connection->down)
		iec104_forget_told(station, connection, module);
}

/* The points of the module that is down, of which events wait that came since. */
static void note_waiting(const struct iec104_station *station, struct iec104_connection *connection)
{
	const uint32_t module = connection->down_module, end = iec104_events_end(station, module);
	struct map_event event;

	while ((int32_t)(end - connection->down_ahead.next[module]) > 0 &&
	       map_event_next_of(station->map, &connection->down_ahead, module, &event))
		if (!event.past)
			iec104_note_told(connection, event.point);
}

/*
 * A value that came later has an event of its own. What was there before it, nobody knows any more: it is told as 0. A place is not:
 * 0° N 0° E is one.
 */
static void invalidate(const struct iec104_station *station, struct iec104_connection *connection,
		       uint32_t point, struct map_sample samples[IEC104_SAMPLES])
{
	if (samples[0].time_ns > connection->down_ns)
		note_waiting(station, connection);
	if (is_told(connection, point) && !iec104_is_position(station, point))
		samples[0].value.u = samples[0].detail = 0;
	samples[0].quality |= MAP_INVALID;
	samples[0].time_ns = connection->down_ns;
}

/* As of the moment at least when its module was lost or back. */
static void bring_up_to_date(const struct iec104_station *station, const struct iec104_connection *connection,
			     uint32_t point, struct map_sample *sample)
{
	const int64_t module_ns = connection->module_ns[map_owner(station->map, point)];

	if (sample->time_ns < module_ns)
		sample->time_ns = module_ns;
}

bool iec104_adapt(const struct iec104_station *station, struct iec104_connection *connection, uint32_t point,
		  const struct iec104_manner *manner, struct map_sample samples[IEC104_SAMPLES])
{
	if (manner->invalid)
		invalidate(station, connection, point, samples);
	if (manner->current)
		bring_up_to_date(station, connection, point, &samples[0]);
	return !(manner->valid_only && ((samples[0].quality & MAP_INVALID) || is_told(connection, point)));
}
