/* SPDX-License-Identifier: GPL-3.0-or-later */
/*
 * The controlled stations: their connections, what they are asked, what they say as records. Nothing here waits: each function
 * does what can be done at the moment centre->now.
 */
#ifndef OPENRTU_CENTRE_STATION_H
#define OPENRTU_CENTRE_STATION_H

#include "centre/batches.h"
#include "centre/config.h"
#include "centre/deadlines.h"
#include "centre/window.h"
#include "channel/retry.h"
#include "iec104/octets.h"

/* Beside a record for each octet of its input: the ends of its requests, its link. */
#define CENTRE_RECORDS_BESIDE (2 * IEC104_CONTROLLING_REQUESTS_MAX + 8)

/* Who may do something at once; whoever was slow, or could not be reached, competes with its like. */
enum { CENTRE_CONNECT, CENTRE_CONNECT_AGAIN, CENTRE_POLL, CENTRE_POLL_SLOW, CENTRE_WINDOWS };
#define CENTRE_NO_WINDOW CENTRE_WINDOWS

struct centre;

/* A request of the consumer's that has not ended. */
struct centre_order {
	uint32_t request; /* 0: none */
	uint64_t id;
};

/* A link to a station. */
struct centre_station {
	struct centre *centre;
	const struct centre_plan *plan;
	struct iec104_poll *polls;      /* plan->poll_count */
	uint32_t number;                /* of the station, which both its links have */
	struct centre_station *partner; /* its other link; NULL: there is none */
	struct channel channel;         /* its fd is -1: not connected */
	struct channel_station security;
	uint8_t link;    /* enum centre_link */
	uint8_t window;  /* in which it has a place */
	bool waits;      /* for a place */
	bool slow;       /* its last poll was */
	bool failed;     /* its last connection was not one */
	bool traced;     /* its octets are told */
	bool gap;        /* some were not, for want of room */
	uint32_t events; /* of epoll, that are waited for */
	uint32_t connection;
	uint32_t connections; /* of the first link: so many were made to the station */
	int64_t place_until_ns;
	int64_t
	    due_ns; /* the next attempt; while connecting, the last moment for it; up, the next poll at the earliest */
	struct retry retry;
	uint16_t unwritten; /* octets of its session, at the last writing */
	uint32_t poll;      /* the request that is one */
	struct centre_order orders[IEC104_CONTROLLING_REQUESTS_MAX];
	struct centre_record *last; /* that the ASDU at hand has said; NULL: nothing yet */
	struct iec104_controlling_settings settings;
	struct iec104_controlling_listener listener;
	struct iec104_memory memory;
	struct iec104_controlling controlling;
};

struct centre {
	const struct centre_config *config;
	struct iec104_moment now;
	int epoll;     /* of the stations' connections */
	int consumer;  /* the socket; -1: there is none, and so no connection */
	uint32_t told; /* so many stations were told to the consumer */
	struct centre_batches batches;
	struct centre_deadlines deadlines;
	struct centre_window windows[CENTRE_WINDOWS];
	uint32_t *next;                  /* of the windows */
	struct centre_station *stations; /* links: config->link_count */
	uint8_t *octets;                 /* of all connections */
	int64_t *sent_ns;                /* of all connections */
	struct centre_record nowhere;    /* what is said while nobody listens */
};

/* What follows needs centre_has_room, each time anew. */

/* Its connection is readable, writable or broken: events of epoll. */
void centre_station_ready(struct centre_station *station, uint32_t events);
/* Its deadline is over. */
void centre_station_due(struct centre_station *station);
/* Those that wait for a place, while there are any; one at a time. False: nobody got one. */
bool centre_admit_next(struct centre *centre);

/* An ASDU is in the consumer's hands. */
void centre_station_release(struct centre *centre, const struct centre_record *record);

/* ---- for those that are made of it ------------------------------------------------------- */

/* i: of a link; it is the first one of the station of this number, or a second one. */
void centre_station_init(struct centre *centre, uint32_t i, uint32_t number);
/* When something is due next. */
void centre_station_schedule(struct centre_station *station);
void centre_station_transmit(struct centre_station *station);
void centre_station_close(struct centre_station *station);
/* Whose request this is; 0: a free place. NULL: there is none. */
struct centre_order *centre_order_of(struct centre_station *station, uint32_t request);

#endif
