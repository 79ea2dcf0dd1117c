/* SPDX-License-Identifier: GPL-3.0-or-later */
/*
 * The controlled station: what controlling stations see of the point map, on up to 16 connections at once.
 * Every device of the map is a station of its own with its common address.
 *
 * Nothing here knows a socket: octets and CLOCK_MONOTONIC nanoseconds come in, octets go out. One thread.
 *
 * Order on a connection: confirmations; events (spontaneous, with time tag); what is read from the map when
 * it is encoded (read command, refresh after lost events, interrogation, periodic). The latter is sent only
 * when no event waits, not even one that came while it was encoded, so that no value is followed by an older
 * one of the same point. A station whose events come faster than they are acknowledged answers no
 * interrogation meanwhile.
 *
 * What the standard leaves open. A request gets one refusal, the first of: 44 type, 45 cause, 46 common
 * address, 47 information object address (also of a point that is not commandable, or of another type than
 * the command), negative confirmation. The latter is the answer to
 * - what the device refuses, does not answer, or has not selected;
 * - what cannot be carried out: pulses, DCS 0 and 3, reserved qualifiers, not-a-number;
 * - a time tag that is invalid, or further than command_timeout_s from the map's clock. While that clock is
 *   not set, the age cannot be known and is not judged;
 * - an interrogation of a station while one is under way; those of different stations wait for each other;
 * - a clock synchronisation by a controlling station that may not.
 * An ASDU of a known type with not one object (SQ = 0), or of another size, closes the connection.
 * With the test bit, a command is checked and confirmed, and not carried out.
 * STOPDT ends interrogations and drops confirmations that wait; events wait for the next STARTDT. A
 * connection that ends leaves its commands to their devices; what it has selected is no longer.
 */
#ifndef OPENRTU_IEC104_STATION_H
#define OPENRTU_IEC104_STATION_H

#include "iec104/asdu.h"
#include "iec104/session.h"
#include "map/map.h"

#define IEC104_CONNECTIONS_MAX    16
#define IEC104_PEER_SIZE          64
#define IEC104_REPLIES_SIZE       8192
#define IEC104_INTERROGATIONS_MAX 64 /* of different stations, under way or waiting, on one connection */
#define IEC104_OPEN_COMMANDS_MAX  64 /* waiting for their devices, of all connections */

/* Confirmations and refusals that wait for room in k, oldest first: one octet of size, then the ASDU. */
struct iec104_replies {
	uint16_t begin, end;
	uint8_t bytes[IEC104_REPLIES_SIZE];
};

/* A place in the points of some devices, ordered by device, then type. */
struct iec104_sweep {
	uint32_t device, end_device;
	uint32_t next; /* point */
	uint8_t types; /* of this device's wanted points, those not done yet: bits of enum map_type */
};

enum iec104_phase { IEC104_CONFIRM, IEC104_DATA, IEC104_TERMINATE };

/* Interrogation, counter interrogation or confirmation of a clock synchronisation, station by station. */
struct iec104_procedure {
	uint8_t type;
	uint8_t qualifier; /* QOI, QCC */
	uint8_t originator;
	bool test;
	bool broadcast; /* all stations, one after another */
	enum iec104_phase phase;
	uint32_t device;
	struct iec104_sweep sweep;
};

struct iec104_connection {
	bool open;
	bool clock_master; /* may set the clock */
	bool transfer;     /* data transfer is started, as last logged */
	bool ever_started;
	bool selects;    /* has selected a point, which may have been executed or cancelled since */
	uint32_t serial; /* tells this connection from an earlier one in this place */
	char peer[IEC104_PEER_SIZE];
	struct iec104_session session;
	struct iec104_replies replies;

	struct map_cursor *cursor; /* events */
	uint32_t lost;             /* of them, as last logged */
	bool down;                 /* a module's points are being reported invalid */
	uint32_t down_module;
	int64_t down_ns;
	struct iec104_sweep down_sweep;
	bool refresh;             /* current values are being reported as if they had changed: */
	bool refresh_all;         /* of all points, after lost events, */
	uint32_t refresh_modules; /* or of modules that are back, a bit each */
	struct iec104_sweep refresh_sweep;
	uint32_t doubted_modules; /* sent as invalid for want of a heartbeat, maybe unseen by rtud */

	struct iec104_procedure procedures[IEC104_INTERROGATIONS_MAX]; /* a ring, the first is under way */
	unsigned first_procedure, procedure_count;

	bool periodic; /* values whose period ended after from and until to are being sent */
	int64_t periodic_from_ns, periodic_to_ns;
	int64_t periodic_due_ns;
	struct iec104_sweep periodic_sweep;

	int64_t retry_ns; /* a point could not be read just now, or its owner is doubted; INT64_MAX: none */
};

/* A request to a point's owner or to rtud that has not been answered. */
struct iec104_open_command {
	struct map_request request; /* id 0: free */
	uint32_t generation;        /* of the owner, when it was asked */
	struct iec104_connection *connection;
	uint32_t serial;                  /* of the connection then */
	uint8_t asdu[IEC104_COMMAND_MAX]; /* as received */
	size_t asdu_size;
};

struct iec104_station {
	struct map *map;
	const struct map_config *config;
	struct iec104_times times;
	int64_t *sent_ns;
	uint32_t next_serial;
	struct iec104_connection connections[IEC104_CONNECTIONS_MAX];
	struct iec104_open_command open_commands[IEC104_OPEN_COMMANDS_MAX];

	int64_t now_ns;        /* of the last call that had it */
	int64_t log_paid_ns;   /* each line moves it on; far in the future, lines are left out */
	uint32_t log_withheld; /* lines left out since the last one */
};

/*
 * Begins with no connections. sent_ns: room for settings.k times for each of settings.max_connections
 * connections, for as long as the station is used.
 */
void iec104_station_init(struct iec104_station *station, struct map *map, int64_t *sent_ns);

/*
 * A new connection, which peer names in the log. NULL: settings.max_connections (16 at most) are open.
 * Octets then go to iec104_session_space of its session, iec104_station_run answers them, and
 * iec104_session_output has the answers. When the session's closing is no longer IEC104_OPEN, the connection
 * is to be ended.
 */
struct iec104_connection *iec104_station_connect(struct iec104_station *station, const char *peer,
						 bool clock_master, int64_t now_ns);
/* The connection is gone; logs why. Commands under way end at their devices, unanswered here; selections end. */
void iec104_station_disconnect(struct iec104_station *station, struct iec104_connection *connection);

/* Does all there is to do now: after octets were received or written, after a bell, at the deadline. */
void iec104_station_run(struct iec104_station *station, int64_t now_ns);
/* When iec104_station_run is due without any of these; INT64_MAX: never. */
int64_t iec104_station_deadline(const struct iec104_station *station);

/* A line about a connection, by whoever carries it too; left out, and counted, when there were too many just now. */
void iec104_log(struct iec104_station *station, enum map_log_level level, const char *peer,
		const char *format, ...) __attribute__((format(printf, 4, 5)));

#endif
