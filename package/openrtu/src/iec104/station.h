/* SPDX-License-Identifier: GPL-3.0-or-later */
/*
 * The controlled station: what controlling stations see of the point map, on up to 16 connections at once.
 * Every device of the map is a station of its own with its common address.
 *
 * Nothing here knows a socket: octets and CLOCK_MONOTONIC nanoseconds come in, octets go out. One thread.
 *
 * Order on a connection: confirmations; terminations of commands whose return information was sent; events (spontaneous
 * or return information, with time tag); what is read from the map when it is encoded (read command, refresh after lost
 * events, interrogation, periodic). The latter is sent only
 * when no event waits, not even one that came while it was encoded, so that no value is followed by an older
 * one of the same point. A station whose events come faster than they are acknowledged answers no
 * interrogation meanwhile.
 *
 * What the standard leaves open. A request gets one refusal, the first of: 44 type, 45 cause, 46 common address, negative
 * confirmation of what has not one object (SQ = 0) or octets behind it, which the answer leaves out, 47 information object
 * address (also of a point that is not commandable, or of another type than the command), negative confirmation. The latter
 * is the answer to
 * - what the device refuses, does not answer, or has not selected;
 * - what cannot be carried out: a pulse without configured duration, a pulse to OFF, DCS and RCS 0 and 3, reserved
 *   qualifiers, not-a-number, a value or step beyond the point's limits, a step from a value that is not good;
 * - a time tag that is invalid, or further than command_timeout_s from the map's clock. While that clock is
 *   not set, the age cannot be known: any time tag, unless settings.command_without_clock says otherwise;
 * - an interrogation of a station while one is under way; those of different stations wait for each other;
 * - a freeze of counters whose owner is not alive, or any counter interrogation while the connection's freeze waits;
 * - a clock synchronisation by a controlling station that may not;
 * - a request by an originator that is not among the configured ones; a read command then with its cause.
 * An ASDU that is too short for its objects, or says that it has none, closes the connection: an answer would be as wrong.
 * Counters: FRZ 1..3 is confirmed and terminated when all owners have carried it out, and brings no readings; FRZ 0
 * brings those frozen last. A frozen reading carries its sequence number, CY and CA; any other reading has them 0.
 * Reset process: QRP 1 restarts all of the gateway's modules, whatever station it is sent to. QRP 2 drops the events that
 * wait on this connection, those of all stations: it is refused unless it is sent to all, or there is but one.
 * Parameters (P_ME, P_AC) are for a measured value of their own type, have LPC and POP 0, and are in force when confirmed.
 * A station interrogation sends those that were loaded behind the values.
 * A value without quality descriptor (type 21) is sent only while it is good; a read command of one that is not comes back
 * with P/N = 1.
 * With the test bit, a command is checked and confirmed, and not carried out.
 * A command is confirmed when its device has confirmed it, and terminated after its point's return information; of a
 * pulse, after that of its end. What fails in between is told by a negative termination.
 * STOPDT ends interrogations and drops confirmations and terminations that wait; events wait for the next STARTDT. A
 * connection that ends leaves its commands to their devices; what it has selected is no longer.
 *
 * Events wait in queues that outlive connections and this process (map/station.h). A redundancy group has one, and one started
 * connection: STARTDT on another one of the group closes the first, whose link may have failed in silence. An event leaves
 * the queue when its frame is acknowledged; those that are not are sent again to the next connection that is started.
 * A controlling station without a group has a queue by its address, from its first STARTDT on. A further connection from an
 * address may be another controlling station, or the same one after its link failed in silence: nothing is closed, and it
 * begins with what the first one has not acknowledged.
 * With settings.own_ca, that events are lost is itself told by points, of which this process is the owner (losses.c).
 */
#ifndef OPENRTU_IEC104_STATION_H
#define OPENRTU_IEC104_STATION_H

#include "channel/lines.h"
#include "iec104/asdu.h"
#include "iec104/config.h"
#include "iec104/counters.h"
#include "iec104/session.h"
#include "map/map.h"
#include "map/station.h"

#define IEC104_REPLIES_SIZE       8192
#define IEC104_INTERROGATIONS_MAX 64 /* of different stations, under way or waiting, on one connection */
#define IEC104_OPEN_REQUESTS_MAX  64 /* waiting for their devices, of all connections */
#define IEC104_OPEN_FREEZES_MAX   16 /* waiting for the counters' owners, one a connection */
#define IEC104_TOLD_POINTS        65536 /* of those behind, a value may be told twice when their module is back */

/* Confirmations and refusals that wait for room in k, oldest first: one octet of size, then the ASDU. */
struct iec104_replies {
	uint16_t begin, end;
	uint8_t bytes[IEC104_REPLIES_SIZE];
};

/* A place in the points of some devices, ordered by device, then type. */
struct iec104_sweep {
	uint32_t device, end_device;
	uint16_t ca;    /* of the devices that are meant, 0: all */
	uint32_t next;  /* point */
	uint32_t types; /* of this device's wanted points, those not done yet: bits of enum iec104_type */
};

enum iec104_phase { IEC104_CONFIRM, IEC104_DATA, IEC104_PARAMETERS, IEC104_TERMINATE };

/* Interrogation, counter interrogation or confirmation of a clock synchronisation or reset, station by station. */
struct iec104_procedure {
	uint8_t type;
	uint8_t qualifier; /* QOI, QCC */
	uint8_t originator;
	bool test;
	bool broadcast; /* all stations, one after another */
	enum iec104_phase phase;
	uint32_t device;
	struct iec104_sweep sweep;
	uint32_t next_parameter; /* point */
};

struct iec104_connection {
	bool open;
	bool clock_master; /* may set the clock */
	bool transfer;     /* data transfer is started, as last logged */
	bool has_started;  /* it was, at some time */
	bool selects;      /* has selected a point, which may have been executed or cancelled since */
	uint32_t serial;   /* tells this connection from an earlier one in this place */
	int64_t since_ns;
	char peer[IEC104_PEER_SIZE];
	char address[MAP_ADDRESS_SIZE];
	struct iec104_session session;
	uint8_t input[IEC104_INPUT_SIZE];
	uint8_t output[IEC104_OUTPUT_SIZE];
	struct iec104_replies replies;

	bool tells_initialised;    /* M_EI_NA_1 is being sent, */
	bool tells_new;            /* of stations alone that a changed configuration has brought, */
	uint32_t next_initialised; /* of this device next */

	uint32_t party;           /* as in struct iec104_peer */
	uint32_t group;           /* the queue of its redundancy group; MAP_NONE: none */
	uint32_t queue;           /* the event queue it has, or had last; MAP_NONE: none */
	bool holds_queue;         /* and is sent its events now */
	struct map_cursor cursor; /* the events to be sent */
	struct map_queue_place
	    *places;         /* behind the events up to each unacknowledged I frame, as session.sent_ns */
	uint16_t first_open; /* N(S) of the first of them */
	uint32_t
	    overtaken; /* so many of them were overtaken by lost events: their places are no longer true */

	int64_t succeeded_ns; /* when another connection from its address began with its events; 0: never */

	bool down; /* a module's points are being reported invalid */
	struct map_cursor before_down;
	struct map_cursor down_ahead; /* behind these of its events it was looked which points they tell */
	uint32_t down_module;
	int64_t down_ns;
	struct iec104_sweep down_sweep;
	bool refresh;                /* current values are being reported as if they had changed: */
	bool refresh_all;            /* of all points, after lost events, */
	map_modules refresh_modules; /* or of modules that are back */
	struct iec104_sweep refresh_sweep;
	map_modules silent_modules;   /* sent as invalid for want of a heartbeat, maybe unseen by rtud */
	map_modules returned_modules; /* of these, those that are back, until rtud's event tells it */
	/* When each was lost or back: its points are as of then or later. */
	int64_t module_ns[MAP_MODULES_MAX];
	int64_t told_ns[MAP_MODULES_MAX]; /* the latest of what the module's events told */
	/* A bit for each point: an event told it since its module was lost; while down: tells it, once that is sent. */
	uint32_t told[IEC104_TOLD_POINTS / 32];

	struct iec104_procedure procedures[IEC104_INTERROGATIONS_MAX]; /* a ring, the first is under way */
	unsigned first_procedure, procedure_count;

	unsigned terminations; /* of its commands, that wait for their return information to be sent */

	bool periodic; /* values whose period ended after from and until to are being sent */
	int64_t periodic_from_ns, periodic_to_ns;
	int64_t periodic_due_ns;
	struct iec104_sweep periodic_sweep;

	int64_t retry_ns; /* a point could not be read just now, or its owner is silent; INT64_MAX: none */
};

/* A request to a point's owner or to rtud that has not been answered, or whose end has not been sent. */
struct iec104_open_request {
	struct map_request request; /* id 0: answered */
	bool confirmed;             /* ACT_CON was sent: ACT_TERM follows */
	bool terminating;           /* answered, ACT_TERM waits: */
	bool failed;                /* with P/N = 1, */
	uint32_t events_end;        /* until the owner's events before this one were sent */
	uint32_t generation;        /* of the owner, when it was asked */
	struct iec104_connection *connection;
	uint32_t serial;                  /* of the connection then */
	uint8_t asdu[IEC104_COMMAND_MAX]; /* as received */
	size_t asdu_size;
};

/* A counter interrogation that freezes or resets, until the counters' owners have answered. */
struct iec104_freeze {
	bool used;
	bool failed; /* an owner refused, or has ended */
	struct iec104_connection *connection;
	uint32_t serial;                   /* of the connection then */
	struct iec104_procedure procedure; /* which confirms it */
	uint8_t asdu[IEC104_COMMAND_MAX];  /* as received */
	size_t asdu_size;
	map_modules waiting; /* for these owners */
	uint32_t ids[MAP_MODULES_MAX];
	uint32_t generations[MAP_MODULES_MAX]; /* of the owners, when they were asked */
	int64_t posted_ns, deadline_ns;
};

struct iec104_station {
	struct map *map;
	const struct map_config *config;
	const struct iec104_settings *settings;
	struct iec104_times times;
	int64_t *sent_ns;
	struct map_queue_place *places;
	struct iec104_stats *stats;
	uint32_t queues;     /* those that a group or an address has, a bit each */
	bool losses_changed; /* what the own station says of them */
	uint32_t next_serial;
	struct iec104_connection connections[IEC104_CONNECTIONS_MAX];
	struct iec104_open_request open_requests[IEC104_OPEN_REQUESTS_MAX];
	struct iec104_freeze freezes[IEC104_OPEN_FREEZES_MAX];

	bool initialised;      /* all devices were asked since the start; not looked at once it was told */
	uint32_t points_asked; /* of the first so many it is known */
	int64_t initialising_since_ns, initialisation_check_ns;
	/* By device: a changed configuration has brought its station; NULL: it brought none. */
	bool *new_stations;
	bool new_to_tell; /* nobody has been told of these */

	int64_t now_ns;         /* of the last call that had it */
	struct map_lines lines; /* of the log, about peers */
};

/*
 * Begins with no connections, and the event queues that are in the map. sent_ns, places: room for settings.k of them for
 * each of settings.max_connections connections, for as long as the station is used.
 */
void iec104_station_init(struct iec104_station *station, struct map *map, int64_t *sent_ns,
			 struct map_queue_place *places);

/* Who connects. */
struct iec104_peer {
	char name[IEC104_PEER_SIZE];    /* in the log: address and port */
	char address[MAP_ADDRESS_SIZE]; /* IPv4 or IPv6, in the one way that inet_ntop writes it */
	uint32_t
	    party; /* of the settings' groups; behind these, of their masters in none; MAP_NONE: neither */
	bool clock_master; /* may set the clock */
};

/*
 * Who gives way to a peer for whom there is no place: a connection whose data transfer was not started once in t1. It is to
 * be ended, and the peer connected. NULL: there is a place, or nobody gives way.
 */
struct iec104_connection *iec104_station_make_room(struct iec104_station *station,
						   const struct iec104_peer *peer, int64_t now_ns);
/*
 * A new connection. NULL: there is no place for this peer, as settings.max_connections (16 at most),
 * connections_per_address and the places that are kept for parties say.
 * Octets then go to iec104_session_space of its session, iec104_station_run answers them, and
 * iec104_session_output has the answers. When the session's closing is no longer IEC104_OPEN, the connection
 * is to be ended.
 */
struct iec104_connection *iec104_station_connect(struct iec104_station *station,
						 const struct iec104_peer *peer, int64_t now_ns);
/* Logs and counts a peer whose address is not in settings.masters. */
void iec104_station_refuse(struct iec104_station *station, const char *name, int64_t now_ns);
/* The connection is gone; logs why. Commands under way end at their devices, unanswered here; selections end. */
void iec104_station_disconnect(struct iec104_station *station, struct iec104_connection *connection);

/* The queue of the redundancy group of a party (struct iec104_peer); MAP_NONE: it has none. */
uint32_t iec104_group_of(const struct iec104_station *station, uint32_t party);

/* The map has another configuration (map_renew), whose k and number of connections are the same. */
void iec104_station_renew(struct iec104_station *station, const struct map_config *before);

/* Does all there is to do now: after octets were received or written, after a bell, at the deadline. */
void iec104_station_run(struct iec104_station *station, int64_t now_ns);
/* When iec104_station_run is due without any of these; INT64_MAX: never. */
int64_t iec104_station_deadline(const struct iec104_station *station);

/*
 * A line about a connection, of the station or of who carries the connection; left out, and counted, when there were too
 * many just now.
 */
void iec104_log(struct iec104_station *station, enum map_log_level level, const char *peer,
		const char *format, ...) __attribute__((format(printf, 4, 5)));

#endif
