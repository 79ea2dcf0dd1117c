/* SPDX-License-Identifier: GPL-3.0-or-later */
/*
 * Who gets a connection. Whoever reaches the port may take one and keep it with test frames for ever. Hence an address has
 * so many at most; a place is kept for each party, whom the settings name, until it is there; and a connection that never
 * started data transfer gives way. One that did never does.
 */
#include "iec104/station_parts.h"

#include <string.h>

_Static_assert(MAP_NAMED_QUEUES_MAX + IEC104_MASTERS_MAX <= 64, "a bit for each party");

/* The connections as they are, or as they would be without one. */
struct tally {
	unsigned open;
	unsigned of_address; /* the peer's */
	uint64_t parties;    /* that are there, a bit each */
};

static uint64_t party_bit(uint32_t party)
{
	return party == MAP_NONE ? 0 : (uint64_t)1 << party;
}

static struct tally count_connections(const struct iec104_station *station, const char *address,
				      const struct iec104_connection *without)
{
	struct tally tally = {.open = 0};

	for (unsigned i = 0; i < IEC104_CONNECTIONS_MAX; i++) {
		const struct iec104_connection *connection = &station->connections[i];

		if (connection == without || !connection->open)
			continue;
		tally.open++;
		tally.of_address += strcmp(connection->address, address) == 0;
		tally.parties |= party_bit(connection->party);
	}
	return tally;
}

/* The places that are free and not for this peer: of other parties that are not there. Its own party's first one is. */
static unsigned kept_from(const struct iec104_station *station, const struct iec104_peer *peer,
			  const struct tally *tally)
{
	const struct iec104_settings *settings = station->settings;
	uint64_t own = party_bit(peer->party);

	if (own & ~tally->parties)
		return 0;
	return station->config->settings.queue_count + settings->lone_masters -
	       (unsigned)__builtin_popcountll(tally->parties);
}

static bool has_place(const struct iec104_station *station, const struct iec104_peer *peer,
		      const struct iec104_connection *without)
{
	const struct iec104_settings *settings = station->settings;
	struct tally tally = count_connections(station, peer->address, without);

	return tally.of_address < settings->connections_per_address &&
	       tally.open + kept_from(station, peer, &tally) < settings->max_connections;
}

bool iec104_admits(struct iec104_station *station, const struct iec104_peer *peer)
{
	const struct iec104_settings *settings = station->settings;
	struct tally tally = count_connections(station, peer->address, NULL);

	if (has_place(station, peer, NULL))
		return true;
	if (tally.of_address >= settings->connections_per_address)
		iec104_log(station, MAP_LOG_WARNING, peer->name,
			   "refused, %u connections from its address are open", tally.of_address);
	else if (tally.open >= settings->max_connections)
		iec104_log(station, MAP_LOG_WARNING, peer->name, "refused, %u connections are open",
			   tally.open);
	else
		iec104_log(
		    station, MAP_LOG_WARNING, peer->name,
		    "refused, %u connections are open, the others are kept for redundancy groups and masters",
		    tally.open);
	return false;
}

/* A party's connection may be the one that it switches over to: it gives way to no stranger. */
static bool gives_way(const struct iec104_station *station, const struct iec104_connection *connection,
		      const struct iec104_peer *peer, int64_t now_ns)
{
	return connection->open && !connection->has_started &&
	       now_ns - connection->since_ns >= station->times.t1_ns &&
	       (connection->party == MAP_NONE || peer->party != MAP_NONE) &&
	       has_place(station, peer, connection);
}

/* A stranger before a party; of the address that has most; the oldest. */
static bool goes_before(const struct iec104_station *station, const struct iec104_connection *a,
			const struct iec104_connection *b)
{
	unsigned of_a = count_connections(station, a->address, NULL).of_address;
	unsigned of_b = count_connections(station, b->address, NULL).of_address;

	if ((a->party == MAP_NONE) != (b->party == MAP_NONE))
		return a->party == MAP_NONE;
	return of_a != of_b ? of_a > of_b : a->since_ns < b->since_ns;
}

struct iec104_connection *iec104_station_make_room(struct iec104_station *station,
						   const struct iec104_peer *peer, int64_t now_ns)
{
	struct iec104_connection *first = NULL;

	if (has_place(station, peer, NULL))
		return NULL;
	for (unsigned i = 0; i < IEC104_CONNECTIONS_MAX; i++) {
		struct iec104_connection *connection = &station->connections[i];

		if (gives_way(station, connection, peer, now_ns) &&
		    (first == NULL || goes_before(station, connection, first)))
			first = connection;
	}
	if (first != NULL)
		iec104_session_close(&first->session, IEC104_GAVE_WAY);
	return first;
}
