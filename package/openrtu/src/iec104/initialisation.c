/* SPDX-License-Identifier: GPL-3.0-or-later */
/*
 * End of initialisation (IEC 60870-5-101, 7.4.3 and 6.1.5): each station says M_EI_NA_1 once after the gateway's start, and
 * after a reset that a controlling station asked for, when its devices have been asked. A restart of this process alone
 * initialises nothing.
 */
#include "iec104/station_parts.h"

#define COI_POWER_ON     0
#define COI_REMOTE_RESET 2

#define CHECK_NS    200000000LL
#define PATIENCE_NS 30000000000LL /* a line whose port cannot be opened asks nobody */

static bool is_asked(const struct iec104_station *station, uint32_t point)
{
	struct map_module owner;
	struct map_sample sample;

	if (iec104_device(station, point)->never_read)
		return true;
	map_module(station->map, map_owner(station->map, point), &owner);
	return map_read(station->map, point, &sample) && sample.time_ns != 0 &&
	       sample.time_ns >= owner.started_ns;
}

static bool all_asked(struct iec104_station *station)
{
	while (station->points_asked < station->config->point_count &&
	       is_asked(station, station->points_asked))
		station->points_asked++;
	return station->points_asked == station->config->point_count;
}

static bool anything_to_tell(const struct iec104_station *station)
{
	return *map_kept_number(station->map) != map_starts(station->map);
}

void iec104_watch_initialisation(struct iec104_station *station, int64_t now_ns)
{
	bool told = false;

	if (station->initialised || !anything_to_tell(station))
		return;
	if (station->initialising_since_ns == 0)
		station->initialising_since_ns = now_ns;
	station->initialisation_check_ns = now_ns + CHECK_NS;
	station->initialised = all_asked(station) || now_ns - station->initialising_since_ns >= PATIENCE_NS;
	for (unsigned i = 0; station->initialised && i < IEC104_CONNECTIONS_MAX; i++) {
		struct iec104_connection *connection = &station->connections[i];

		if (!connection->open || !connection->transfer)
			continue;
		connection->tells_initialised = true;
		told = true;
	}
	if (told)
		*map_kept_number(station->map) = map_starts(station->map);
}

void iec104_begin_initialised(struct iec104_station *station, struct iec104_connection *connection)
{
	if (!station->initialised || !anything_to_tell(station))
		return;
	connection->tells_initialised = true;
	*map_kept_number(station->map) = map_starts(station->map);
}

bool iec104_send_initialised(const struct iec104_station *station, struct iec104_connection *connection,
			     int64_t now_ns)
{
	const uint8_t cause = map_starts(station->map) > 1 ? COI_REMOTE_RESET : COI_POWER_ON;
	struct iec104_builder builder;

	if (!connection->tells_initialised)
		return false;
	if (connection->next_initialised == station->config->set_count) {
		connection->tells_initialised = false;
		return false;
	}
	iec104_asdu_begin(&builder, &(struct iec104_asdu){
					.type = IEC104_M_EI_NA_1,
					.cause = IEC104_INITIALISED,
					.ca = station->config->sets[connection->next_initialised].ca,
				    });
	iec104_asdu_add(&builder, 0, &cause, 1);
	connection->next_initialised = iec104_next_station(station, connection->next_initialised);
	iec104_send(connection, &builder, now_ns);
	return true;
}

int64_t iec104_initialisation_deadline(const struct iec104_station *station)
{
	bool waiting = false;

	for (unsigned i = 0; i < IEC104_CONNECTIONS_MAX; i++)
		waiting |= station->connections[i].open && station->connections[i].transfer;
	if (!waiting || station->initialised || !anything_to_tell(station))
		return INT64_MAX;
	return station->initialisation_check_ns;
}
