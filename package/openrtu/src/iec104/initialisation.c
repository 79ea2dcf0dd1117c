/* SPDX-License-Identifier: GPL-3.0-or-later */
/*
 * End of initialisation (IEC 60870-5-101, 7.4.3 and 6.1.5): each station says M_EI_NA_1 once after the gateway's start, and
 * after a reset that a controlling station asked for, when its devices have been asked; and one that a changed configuration
 * brings, likewise. A restart of this process alone initialises nothing.
 */
#include "iec104/station_parts.h"

#include <stdlib.h>

#define COI_POWER_ON     0
#define COI_LOCAL_RESET  1
#define COI_REMOTE_RESET 2
#define COI_CHANGED      0x80 /* after a change of local parameters */

#define CHECK_NS    200000000LL
#define PATIENCE_NS 30000000000LL /* a line whose port cannot be opened asks nobody */

static bool is_asked(const struct iec104_station *station, uint32_t point)
{
	struct map_module owner;
	struct map_sample sample;

	if (station->config->points[point].flags & MAP_POINT_NEVER_READ)
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

static bool has_started(const struct iec104_station *station)
{
	return *map_kept_number(station->map) != map_starts(station->map);
}

static bool anything_to_tell(const struct iec104_station *station)
{
	return has_started(station) || station->new_to_tell;
}

static void begin_telling(const struct iec104_station *station, struct iec104_connection *connection)
{
	connection->tells_initialised = true;
	connection->tells_new = !has_started(station);
	connection->next_initialised = 0;
}

static void note_told(struct iec104_station *station)
{
	*map_kept_number(station->map) = map_starts(station->map);
	station->new_to_tell = false;
}

/* ---- stations that a changed configuration brings ------------------------------------------ */

static bool has_station(const struct map_config *config, uint16_t ca)
{
	for (uint32_t i = 0; i < config->set_count; i++)
		if (config->sets[i].ca == ca)
			return true;
	return false;
}

/* It came with an earlier change, and somebody has still to be told. */
static bool was_new(const struct iec104_station *station, const struct map_config *before, uint16_t ca)
{
	bool telling = station->new_to_tell;

	for (unsigned i = 0; i < IEC104_CONNECTIONS_MAX; i++)
		telling |= station->connections[i].open && station->connections[i].tells_initialised;
	for (uint32_t i = 0; telling && station->new_stations != NULL && i < before->set_count; i++)
		if (station->new_stations[i] && before->sets[i].ca == ca)
			return true;
	return false;
}

void iec104_note_new_stations(struct iec104_station *station, const struct map_config *before)
{
	const struct map_config *config = station->config;
	bool *new_stations = calloc(config->set_count + 1, sizeof(*new_stations));
	bool any = false;

	for (uint32_t i = 0; new_stations != NULL && i < config->set_count;
	     i = iec104_next_station(station, i)) {
		const uint16_t ca = config->sets[i].ca;
		const bool is_new = !has_station(before, ca);

		new_stations[i] = is_new || was_new(station, before, ca);
		any |= is_new;
	}
	free(station->new_stations);
	station->new_stations = new_stations;
	if (!any)
		return;
	station->new_to_tell = true;
	station->initialised = false;
	station->initialising_since_ns = 0;
}

/* ---- telling ------------------------------------------------------------------------------- */

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
		begin_telling(station, connection);
		told = true;
	}
	if (told)
		note_told(station);
}

void iec104_begin_initialised(struct iec104_station *station, struct iec104_connection *connection)
{
	if (!station->initialised || !anything_to_tell(station))
		return;
	begin_telling(station, connection);
	note_told(station);
}

/* The next one of which it is to be told; set_count: there is none. */
static uint32_t next_to_tell(const struct iec104_station *station, const struct iec104_connection *connection)
{
	uint32_t next = connection->next_initialised;

	while (connection->tells_new && next < station->config->set_count &&
	       !(station->new_stations != NULL && station->new_stations[next]))
		next++;
	return next;
}

static uint8_t cause_of(const struct iec104_station *station, const struct iec104_connection *connection)
{
	if (connection->tells_new)
		return COI_CHANGED | COI_LOCAL_RESET;
	return map_starts(station->map) > 1 ? COI_REMOTE_RESET : COI_POWER_ON;
}

bool iec104_send_initialised(const struct iec104_station *station, struct iec104_connection *connection,
			     int64_t now_ns)
{
	const uint8_t cause = cause_of(station, connection);
	struct iec104_builder builder;

	if (!connection->tells_initialised)
		return false;
	connection->next_initialised = next_to_tell(station, connection);
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
