/* SPDX-License-Identifier: GPL-3.0-or-later */
/*
 * What the files of the controlled station know of each other. Functions that send return true when they sent
 * an ASDU or got nearer to it, false when there is nothing to send now; they are called while
 * iec104_session_may_send.
 */
#ifndef OPENRTU_IEC104_STATION_PARTS_H
#define OPENRTU_IEC104_STATION_PARTS_H

#include "iec104/station.h"

static inline const struct map_point *iec104_point(const struct iec104_station *station, uint32_t point)
{
	return &station->config->points[point];
}

static inline const struct map_device *iec104_device(const struct iec104_station *station, uint32_t point)
{
	return &station->config->devices[iec104_point(station, point)->device];
}

/* ---- sweep.c ----------------------------------------------------------------------------- */

typedef bool iec104_wanted(const struct iec104_station *station, const struct iec104_connection *connection,
			   uint32_t point);

/* How a sweep's points are sent. */
struct iec104_manner {
	iec104_wanted *wanted;
	uint8_t cause; /* IEC104_CYCLIC: the periodic cause of the type */
	uint8_t originator;
	bool test;
	bool tagged;
	bool valid_only;
	bool invalid; /* whatever they are now, they became invalid at invalid_since_ns */
	int64_t invalid_since_ns;
};

enum iec104_progress {
	IEC104_SWEEP_GOES_ON,
	IEC104_SWEEP_DONE,      /* all was sent before */
	IEC104_SWEEP_TRY_LATER, /* a point could not be read just now */
};

/* Begins with the wanted points of the devices from first up to, and without, end. */
void iec104_begin_sweep(const struct iec104_station *station, const struct iec104_connection *connection,
			struct iec104_sweep *sweep, uint32_t first, uint32_t end, iec104_wanted *wanted);
void iec104_begin_sweep_of_all(const struct iec104_station *station,
			       const struct iec104_connection *connection, struct iec104_sweep *sweep,
			       iec104_wanted *wanted);
/* Sends the sweep's next ASDU, unless an event waits that may be older than the values in it. */
enum iec104_progress iec104_send_points(const struct iec104_station *station,
					struct iec104_connection *connection, struct iec104_sweep *sweep,
					const struct iec104_manner *manner, int64_t now_ns);

/* An event waits to be sent: nothing that was read from the map just now may go before it. */
bool iec104_event_waits(const struct iec104_station *station, const struct iec104_connection *connection);
/* map_read, and remembers an owner whose heartbeat is missing. */
bool iec104_read_point(const struct iec104_station *station, struct iec104_connection *connection,
		       uint32_t point, struct map_sample *sample);
/* Begins an ASDU for this point and others of its station and type. */
void iec104_begin_asdu(const struct iec104_station *station, struct iec104_builder *builder, uint32_t point,
		       const struct iec104_manner *manner, bool sequence);
/* Adds a point's sample, with its wall time if tagged. False: the ASDU is full. */
bool iec104_add_sample(const struct iec104_station *station, struct iec104_builder *builder, uint32_t point,
		       const struct map_sample *sample, bool tagged);
void iec104_send(struct iec104_connection *connection, const struct iec104_builder *builder, int64_t now_ns);
/* Comes back to a point that could not be read, without waiting for anything else. */
void iec104_retry_soon(struct iec104_connection *connection, int64_t now_ns);

/* ---- spontaneous.c ----------------------------------------------------------------------- */

bool iec104_send_event(struct iec104_station *station, struct iec104_connection *connection, int64_t now_ns);
/* While connection->down, in the place of all events: the points of a module that is down. */
bool iec104_send_invalid(const struct iec104_station *station, struct iec104_connection *connection,
			 int64_t now_ns);
/* Has the points of doubted modules refreshed that are alive. */
void iec104_resolve_doubts(const struct iec104_station *station, struct iec104_connection *connection,
			   int64_t now_ns);
/* Current values after lost events, or of a module that is back. */
bool iec104_send_refresh(const struct iec104_station *station, struct iec104_connection *connection,
			 int64_t now_ns);

/* ---- periodic.c -------------------------------------------------------------------------- */

/* Sets periodic_due_ns: the first end of a point's period after from_ns; INT64_MAX when no point has one. */
void iec104_schedule_periodic(const struct iec104_station *station, struct iec104_connection *connection,
			      int64_t from_ns);
/* Begins with the points whose period has ended, if any; they are sent as k allows. */
void iec104_begin_periodic(const struct iec104_station *station, struct iec104_connection *connection,
			   int64_t now_ns);
bool iec104_send_periodic(const struct iec104_station *station, struct iec104_connection *connection,
			  int64_t now_ns);

/* ---- interrogation.c --------------------------------------------------------------------- */

/* The device a common address means; broadcast: the first. False: there is none. */
bool iec104_find_device(const struct iec104_station *station, uint16_t ca, uint32_t *device);
/* The system command of an ASDU whose type, cause, common address and size were checked. */
struct iec104_procedure iec104_procedure_of(const struct iec104_station *station,
					    const struct iec104_asdu *asdu);
/* False: too many are waiting. */
bool iec104_add_procedure(struct iec104_connection *connection, const struct iec104_procedure *procedure);
/*
 * Activates or deactivates. False: the confirmation is negative. The positive one of an activation is the
 * procedure's own, when its turn has come.
 */
bool iec104_interrogate(const struct iec104_station *station, struct iec104_connection *connection,
			const struct iec104_asdu *asdu);
bool iec104_advance_procedure(const struct iec104_station *station, struct iec104_connection *connection,
			      int64_t now_ns);

/* ---- reply.c ----------------------------------------------------------------------------- */

/*
 * Queues a copy with this cause and P/N; with cause 5 a read command of a known point, which is answered in
 * its turn. Closes the session when the queue is full.
 */
void iec104_mirror(struct iec104_connection *connection, const uint8_t *asdu, size_t size,
		   enum iec104_cause cause, bool negative);
bool iec104_send_confirmation(struct iec104_connection *connection, int64_t now_ns);
bool iec104_answer_read(const struct iec104_station *station, struct iec104_connection *connection,
			int64_t now_ns);

/* ---- control.c --------------------------------------------------------------------------- */

/* An ASDU received in an I frame. */
void iec104_take_asdu(struct iec104_station *station, struct iec104_connection *connection,
		      const uint8_t *bytes, size_t size, int64_t now_ns);
/* An owner's or rtud's answer to a request of this process. */
void iec104_take_answer(struct iec104_station *station, const struct map_answer *answer);
/* Answers for owners that died or whose answer was lost: refused, and nobody knows what became of it. */
void iec104_conclude_orphans(struct iec104_station *station, int64_t now_ns);
/* Ends what a connection that is going has selected. */
void iec104_end_selections(struct iec104_station *station, const struct iec104_connection *connection);
/* When a command that is still open will be answered for its owner at the latest; INT64_MAX: none is open. */
int64_t iec104_orphan_deadline(const struct iec104_station *station);

#endif
