/* SPDX-License-Identifier: GPL-3.0-or-later */
/* Points with a period of their own. */
#include "iec104/station_parts.h"
#include "map/time_ns.h"

/* The end of the period that lies behind time. Periods count from the start of the monotonic clock. */
static int64_t period_end(const struct map_point *point, int64_t time_ns)
{
	int64_t period_ns = point->send_period_ms * NS_PER_MS;

	return (time_ns / period_ns + 1) * period_ns;
}

static bool period_ended(const struct iec104_station *station, const struct iec104_connection *connection,
			 uint32_t point)
{
	const struct map_point *object = iec104_point(station, point);
	struct map_parameters parameters;

	if (object->send_period_ms == 0 ||
	    period_end(object, connection->periodic_from_ns) > connection->periodic_to_ns)
		return false;
	map_parameters_read(station->map, point, &parameters);
	return parameters.cyclic;
}

void iec104_schedule_periodic(const struct iec104_station *station, struct iec104_connection *connection,
			      int64_t from_ns)
{
	connection->periodic = false;
	connection->periodic_from_ns = from_ns;
	connection->periodic_due_ns = INT64_MAX;
	for (uint32_t i = 0; i < station->config->point_count; i++) {
		const struct map_point *point = iec104_point(station, i);

		if (point->send_period_ms != 0 && period_end(point, from_ns) < connection->periodic_due_ns)
			connection->periodic_due_ns = period_end(point, from_ns);
	}
}

void iec104_begin_periodic(const struct iec104_station *station, struct iec104_connection *connection,
			   int64_t now_ns)
{
	if (connection->periodic || now_ns < connection->periodic_due_ns)
		return;
	connection->periodic = true;
	connection->periodic_to_ns = now_ns;
	iec104_begin_sweep_of_all(station, connection, &connection->periodic_sweep, period_ended);
}

bool iec104_send_periodic(const struct iec104_station *station, struct iec104_connection *connection,
			  int64_t now_ns)
{
	static const struct iec104_manner manner = {.wanted = period_ended, .cause = IEC104_CYCLIC};
	enum iec104_progress progress;

	if (!connection->periodic)
		return false;
	progress = iec104_send_points(station, connection, &connection->periodic_sweep, &manner, now_ns);
	if (progress == IEC104_SWEEP_DONE)
		iec104_schedule_periodic(station, connection, connection->periodic_to_ns);
	return progress == IEC104_SWEEP_GOES_ON;
}
