/* SPDX-License-Identifier: GPL-3.0-or-later */
/*
 * What carries the octets of a connection of a protocol, of either side: TCP as it is (plain.c), or TLS on it (tls.c). A
 * program is built with one of the two; one that connects with TLS may have connections without it. No call waits.
 */
#ifndef OPENRTU_CHANNEL_CHANNEL_H
#define OPENRTU_CHANNEL_CHANNEL_H

#include <sys/types.h>

#include "channel/config.h"
#include "map/map.h"

#define CHANNEL_PEER_SIZE 64

/* Whose channels these are; of the whole process. */
struct channel_owner {
	const struct channel_tls *tls; /* of tls.c alone, as all up to say */
	bool controlling;              /* it connects to others, by channel_connect */
	const char *peers;             /* how those are called whom the settings may list */
	/* Octets of the message that begins at bytes, which has a record of its own. NULL: records are of any octets. */
	int (*message)(const uint8_t *bytes, size_t size);
	_Atomic uint32_t *refused; /* counts handshakes that did not succeed; NULL: nobody does */
	/* A line of the log; peer: of whose connection, NULL: of none. */
	void (*say)(enum map_log_level level, const char *peer, const char *text);
};

static inline void channel_count_refused(const struct channel_owner *owner)
{
	if (owner->refused != NULL)
		map_count(owner->refused, 1);
}

/* How a controlling station knows a controlled one, from connection to connection. Begins with zeros. */
struct channel_station {
	/* Its common name or fingerprint; NULL: whoever has a certificate from the CA. */
	const char *certificate;
	void *session;    /* by which the next connection is resumed; channel_forget frees it */
	uint32_t reading; /* of the files with which it began */
};

struct channel {
	int fd; /* non-blocking, for epoll */
	uint32_t
	    wants; /* EPOLLIN or EPOLLOUT: neither handshake nor receipt can go on before that; 0: nothing special */
	char peer[CHANNEL_PEER_SIZE];
	/* of tls.c alone */
	void *tls;
	bool stuck;                      /* a record is not wholly written */
	uint32_t reading;                /* of the files by which the peer's certificate was looked at last */
	int64_t look_ns;                 /* when it is looked at next */
	int64_t renew_ns;                /* when its keys are too old */
	struct channel_station *station; /* to which it was connected */
};

enum channel_progress {
	CHANNEL_READY,  /* octets may be received and transmitted */
	CHANNEL_WAITS,  /* for what the channel wants */
	CHANNEL_REFUSED /* logged; to be closed */
};

/* Before the first channel. owner must outlive all of them. False: it has said why, also on stderr. */
bool channel_start(const struct channel_owner *owner);

/* The owner's settings of TLS are elsewhere now, and the same. */
void channel_renew(void);

/* To be called in each turn: what lies outside, as files, may have changed. now_ns: CLOCK_MONOTONIC. */
void channel_watch(int64_t now_ns);

/* Puts a channel on a connected socket, which it closes in the end; peer names it in the log. */
enum channel_progress channel_open(struct channel *channel, int fd, const char *peer);
/*
 * The other side: of a socket that has been connected to a station. secure: with TLS, for which the program is built. station
 * and the channel's place in memory must outlive the connection.
 */
enum channel_progress channel_connect(struct channel *channel, int fd, const char *peer, bool secure,
				      struct channel_station *station);
void channel_forget(struct channel_station *station);
/* Continues the handshake, which finds out who the peer is. */
enum channel_progress channel_handshake(struct channel *channel);

/* Returns the octets that came, at most size; 0: none now, -1: the connection is over. */
ssize_t channel_receive(struct channel *channel, uint8_t *place, size_t size);
/* Octets have come that the socket does not have any more, so that epoll does not tell of them. */
bool channel_pending(const struct channel *channel);
/*
 * bytes: whole messages, or what is left of them. Returns how many octets went; 0: none now, -1: the connection is over. What
 * did not go must be offered again.
 */
ssize_t channel_transmit(struct channel *channel, const uint8_t *bytes, size_t size);

/* The common name of the peer's certificate, cut; empty: it shows none. */
void channel_name(const struct channel *channel, char name[CHANNEL_NAME_SIZE]);

/* Call it in each turn once the channel is ready: renews its keys in time. False: logged; to be closed. */
bool channel_keep(struct channel *channel, int64_t now_ns);

void channel_close(struct channel *channel);

#endif
