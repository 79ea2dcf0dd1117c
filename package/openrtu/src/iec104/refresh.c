/* SPDX-License-Identifier: GPL-3.0-or-later */
/* What is sent in the place of events: when a module goes or comes back, or events were lost. */
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
	       (connection->refresh_modules & map_module_bit(map_owner(station->map, point))) != 0;
}

void iec104_begin_refresh(const struct iec104_station *station, struct iec104_connection *connection)
{
	connection->refresh = true;
	iec104_begin_sweep_of_all(station, connection, &connection->refresh_sweep, to_be_refreshed);
}

void iec104_begin_return(const struct iec104_station *station, struct iec104_connection *connection,
			 uint32_t module, int64_t since_ns)
{
	connection->refresh_modules |= map_module_bit(module);
	connection->module_ns[module] = since_ns;
	iec104_begin_refresh(station, connection);
}

void iec104_refresh_recovered(const struct iec104_station *station, struct iec104_connection *connection,
			      int64_t now_ns)
{
	for (map_modules left = connection->silent_modules; left != 0; left &= left - 1) {
		const uint32_t i = (uint32_t)__builtin_ctzll(left);

		if (!map_alive(station->map, i))
			continue;
		connection->silent_modules &= ~map_module_bit(i);
		connection->returned_modules |= map_module_bit(i);
		iec104_begin_return(station, connection, i, now_ns);
	}
	if (connection->silent_modules != 0)
		connection->retry_ns = now_ns + DOUBT_NS;
}

void iec104_begin_invalid(const struct iec104_station *station, struct iec104_connection *connection,
			  uint32_t module, int64_t since_ns)
{
	connection->down = true;
	connection->returned_modules &= ~map_module_bit(module);
	connection->down_module = module;
	connection->down_ns = since_ns;
	connection->down_ahead = connection->cursor;
	connection->module_ns[module] = since_ns;
	iec104_forget_told(station, connection, module);
	iec104_begin_sweep_of_all(station, connection, &connection->down_sweep, of_down_module);
}

bool iec104_send_invalid(const struct iec104_station *station, struct iec104_connection *connection,
			 int64_t now_ns)
{
	const struct iec104_manner manner = {
	    .wanted = of_down_module,
	    .cause = IEC104_SPONTANEOUS,
	    .tagged = true,
	    .invalid = true,
	};
	enum iec104_progress progress =
	    iec104_send_points(station, connection, &connection->down_sweep, &manner, now_ns);

	if (progress == IEC104_SWEEP_DONE) {
		connection->down = false;
		iec104_forget_told(station, connection,
				   connection->down_module); /* what waits is not told yet */
	}
	return progress != IEC104_SWEEP_TRY_LATER;
}

bool iec104_send_refresh(struct iec104_station *station, struct iec104_connection *connection, int64_t now_ns)
{
	const struct iec104_manner manner = {
	    .wanted = to_be_refreshed,
	    .cause = IEC104_SPONTANEOUS,
	    .tagged = true,
	    .valid_only = !connection->refresh_all, /* an owner that was down was reported invalid */
	    .current = true,
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
