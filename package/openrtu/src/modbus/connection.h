/* SPDX-License-Identifier: GPL-3.0-or-later */
/*
 * What a TCP connection shows of whoever is at its end, and what the line makes of it.
 *
 * A peer that hangs up behind an answer, at once or when nothing was asked for some time, has done nothing wrong: its devices
 * live, and the next request makes the next connection. What was under way then is read again; of a write nobody knows, and
 * it is not repeated. A peer that hangs up before it answered anything is lost.
 *
 * A connection that brings nothing any more is hung when MODBUS_HUNG_REQUESTS time-outs have passed, no living device is
 * left that has not had one, and even an answer that is late by MODBUS_LATE_NS has had its time. It is made anew. Where the
 * next one brings nothing either, the line waits twice as long, up to MODBUS_RAREST_PROBE_NS: it is the device.
 *
 * A peer that needs time behind its connect shows it in two ways: it hangs up on what comes sooner, or does not answer it. The
 * line then waits so long before the first request of each connection; behind a time that was guessed, it tries once without.
 */
#ifndef OPENRTU_MODBUS_CONNECTION_H
#define OPENRTU_MODBUS_CONNECTION_H

#include <stdbool.h>
#include <stdint.h>

#define MODBUS_HUNG_REQUESTS 3
#define MODBUS_SETTLE_MAX_NS 5000000000LL /* what takes longer has another cause */

struct modbus_connection {
	/* Filled in by the caller. */
	int64_t settle_least_ns; /* from a connection to the first request on it, at least */

	/* For the caller to look at. */
	int64_t settle_ns; /* the same, as learned; 0: nothing */
	int64_t
	    idle_ns; /* the shortest time without a request behind which the peer hung up; 0: it never did */
	uint32_t closes; /* that were no fault */
	uint32_t hung;   /* connections that were made anew since they brought nothing */

	/* Its own. */
	int64_t made_ns;
	int64_t vain_ns;     /* since when nothing comes */
	int64_t patience_ns; /* how long that may last; 0: not longer than the first time */
	uint32_t answers;    /* frames of this connection */
	uint32_t vain;       /* requests since the last of them */
	bool settled;        /* settle_ns is needed: less was tried */
	bool trying;         /* less, on this connection */
	bool worked;         /* an answer came behind settle_ns */
	uint8_t slow_starts; /* connections in a row whose first request was not answered, but a later one */
	bool asked;          /* something was sent on it */
	bool there;
};

/* What a former process had learned. */
void modbus_connection_take(struct modbus_connection *connection, int64_t settle_ns);

#endif
