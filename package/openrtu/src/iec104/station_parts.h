/* SPDX-License-Identifier: GPL-3.0-or-later */
/*
 * What the files of the controlled station know of each other. Functions that send return true when they sent
 * an ASDU or got nearer to it, false when there is nothing to send now; they are called while
 * iec104_session_may_send.
 */
#ifndef OPENRTU_IEC104_STATION_PARTS_H
#define OPENRTU_IEC104_STATION_PARTS_H

#include "iec104/geoposition.h"
#include "iec104/station.h"

/* An ASDU that a connection has received. */
struct iec104_received {
	struct iec104_connection *connection;
	const uint8_t *bytes;
	size_t size;
	struct iec104_asdu asdu;
	int64_t now_ns;
};

static inline const struct map_point *iec104_point(const struct iec104_station *station, uint32_t point)
{
	return &station->config->points[point];
}

static inline const struct map_set *iec104_device(const struct iec104_station *station, uint32_t point)
{
	return &station->config->sets[iec104_point(station, point)->set];
}

/* ---- admission.c ------------------------------------------------------------------------- */

/* There is a place for this peer. False: logged. */
bool iec104_admits(struct iec104_station *station, const struct iec104_peer *peer);

/* ---- queue.c ----------------------------------------------------------------------------- */

/* Takes the connection's event queue, from another one if need be, and begins where it is. */
void iec104_claim_queue(struct iec104_station *station, struct iec104_connection *connection);
/* Leaves it to another connection, where it is; if the connection holds one. */
void iec104_release_queue(struct iec104_station *station, struct iec104_connection *connection);
/* After each step of sending: what was sent up to here belongs to the last I frame. */
void iec104_note_place(struct iec104_station *station, struct iec104_connection *connection);
/* After each received APDU: events whose frames were acknowledged leave the queue. */
void iec104_take_acknowledgement(struct iec104_station *station, struct iec104_connection *connection);
/* After events were read: if some were lost, current values are to be sent in their place. */
void iec104_note_lost_events(struct iec104_station *station, struct iec104_connection *connection);
/* Drops the oldest events of queues in which more wait than may. */
void iec104_trim_queues(struct iec104_station *station);
/* Events of this queue were lost, and the current values that take their place have not all been sent. */
bool iec104_queue_recovers(struct iec104_station *station, uint32_t queue);
/* Those that a former process of this station has left. */
void iec104_find_queues(struct iec104_station *station);
/* The groups are those of the configuration. A new one has what waited for its members; before: NULL, or the former one. */
void iec104_adopt_groups(struct iec104_station *station, const struct map_config *before);

/* ---- losses.c ---------------------------------------------------------------------------- */

/* Publishes the points of the gateway's own station, if there is one and they may have changed. */
void iec104_publish_losses(struct iec104_station *station);

/* ---- stats.c ----------------------------------------------------------------------------- */

/* For rtuctl: a connection that was opened, that did something, whose session is over. */
void iec104_show_opened(const struct iec104_station *station, const struct iec104_connection *connection);
void iec104_show_connection(const struct iec104_station *station, const struct iec104_connection *connection);
void iec104_show_closed(const struct iec104_station *station, const struct iec104_connection *connection);

/* ---- address.c --------------------------------------------------------------------------- */

/* The first device that a common address means; broadcast: of all. False: there is none. */
bool iec104_find_device(const struct iec104_station *station, uint16_t ca, uint32_t *device);
/* Devices with one common address are one station, known by its first device: that of the next one, device_count: none. */
uint32_t iec104_next_station(const struct iec104_station *station, uint32_t device);
/* Behind the last device of this one's station. */
uint32_t iec104_station_end(const struct iec104_station *station, uint32_t device);

/* ---- position.c -------------------------------------------------------------------------- */

/* An event waits to be sent: nothing that was read from the map just now may go before it. */
bool iec104_event_waits(const struct iec104_station *station, const struct iec104_connection *connection);
/* A mark behind a module's newest event, and whether this connection has sent all of that module's before it. */
uint32_t iec104_events_end(const struct iec104_station *station, uint32_t module);
bool iec104_events_were_sent(const struct iec104_connection *connection, uint32_t module, uint32_t end);

/* ---- place.c ----------------------------------------------------------------------------- */

/* Of a position its own, those of latitude, longitude and altitude; of any other point the first one only. */
#define IEC104_SAMPLES 4

/* The point is sent with those behind it as one object, of the private type. */
static inline bool iec104_is_position(const struct iec104_station *station, uint32_t point)
{
	return (iec104_point(station, point)->flags & MAP_POINT_POSITION) != 0;
}
/* All of one fix. False as for map_read. */
bool iec104_read_position(const struct iec104_station *station, uint32_t point,
			  struct map_sample samples[IEC104_SAMPLES]);
/* Those that were published with an event of any point, from the cursor behind it. False: a position that is not there whole. */
bool iec104_complete_event(const struct iec104_station *station, const struct map_cursor *behind,
			   const struct map_event *event, struct map_sample samples[IEC104_SAMPLES]);
/* The element, without its time. */
struct iec104_geoposition iec104_position_of(const struct map_sample samples[IEC104_SAMPLES]);

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
	bool totals;  /* counters' frozen readings */
	bool invalid; /* whatever they are now, they became so when their module was lost */
	bool current; /* as of the moment at least when their module was lost or back */
};

enum iec104_progress {
	IEC104_SWEEP_GOES_ON,
	IEC104_SWEEP_DONE,      /* all was sent before */
	IEC104_SWEEP_TRY_LATER, /* a point could not be read just now */
};

/* Begins with the wanted points of the devices from first up to, and without, end. */
void iec104_begin_sweep_of_station(const struct iec104_station *station,
				   const struct iec104_connection *connection, struct iec104_sweep *sweep,
				   uint32_t first, iec104_wanted *wanted);
void iec104_begin_sweep_of_all(const struct iec104_station *station,
			       const struct iec104_connection *connection, struct iec104_sweep *sweep,
			       iec104_wanted *wanted);
/* Sends the sweep's next ASDU, unless an event waits that may be older than the values in it. */
enum iec104_progress iec104_send_points(const struct iec104_station *station,
					struct iec104_connection *connection, struct iec104_sweep *sweep,
					const struct iec104_manner *manner, int64_t now_ns);

/*
 * map_read, and remembers an owner whose heartbeat is missing. A counter that freezes by itself is sent as it was frozen,
 * with totals every counter.
 */
bool iec104_read_point(const struct iec104_station *station, struct iec104_connection *connection,
		       uint32_t point, bool totals, struct map_sample samples[IEC104_SAMPLES]);
/* Its type identification. */
uint8_t iec104_type_of(const struct iec104_station *station, uint32_t point, bool tagged);
/* Begins an ASDU for this point and others of its station and type. */
void iec104_begin_asdu(const struct iec104_station *station, struct iec104_builder *builder, uint32_t point,
		       const struct iec104_manner *manner, bool sequence);
/* The sample can be sent as what it is: a type without quality is only of a good one. */
bool iec104_is_tellable(const struct iec104_station *station, uint32_t point,
			const struct map_sample *sample);
/* Adds tellable samples of a point, with their wall time if tagged and its type has a time tag. False: the ASDU is full. */
bool iec104_add_samples(const struct iec104_station *station, struct iec104_builder *builder, uint32_t point,
			const struct map_sample samples[IEC104_SAMPLES], bool tagged);
/* Adds an event of the ASDU's station and type, with the time it had. samples: the event's own, of a position all. False: the ASDU is full. */
bool iec104_add_event(const struct iec104_station *station, struct iec104_builder *builder,
		      const struct map_event *event, const struct map_sample *samples);
void iec104_send(struct iec104_connection *connection, const struct iec104_builder *builder, int64_t now_ns);
/* Comes back to a point that could not be read, without waiting for anything else. */
void iec104_retry_soon(struct iec104_connection *connection, int64_t now_ns);

/* ---- told.c ------------------------------------------------------------------------------ */

/* A point of the module was read, and is invalid for want of a heartbeat. */
void iec104_note_silent(const struct iec104_station *station, struct iec104_connection *connection,
			uint32_t module);
/* Of the module's points, no event has told any. */
void iec104_forget_told(const struct iec104_station *station, struct iec104_connection *connection,
			uint32_t module);
/* An event of the point was sent. */
void iec104_note_told(struct iec104_connection *connection, uint32_t point);
/* What is sent of a point in a manner that is invalid or current, from what was read. False: nothing, it needs not be told. */
bool iec104_adapt(const struct iec104_station *station, struct iec104_connection *connection, uint32_t point,
		  const struct iec104_manner *manner, struct map_sample samples[IEC104_SAMPLES]);

/* ---- refresh.c --------------------------------------------------------------------------- */

/* Begins to send current values, of connection->refresh_modules or refresh_all. */
void iec104_begin_refresh(const struct iec104_station *station, struct iec104_connection *connection);
/* Begins to send those of a module that is back since then, but for what its events have told since it was lost. */
void iec104_begin_return(const struct iec104_station *station, struct iec104_connection *connection,
			 uint32_t module, int64_t since_ns);
/* Begins to send the points of a module that is down since then; connection->before_down is where its events stay. */
void iec104_begin_invalid(const struct iec104_station *station, struct iec104_connection *connection,
			  uint32_t module, int64_t since_ns);
/* While connection->down, in the place of all events: the points of a module that is down. */
bool iec104_send_invalid(const struct iec104_station *station, struct iec104_connection *connection,
			 int64_t now_ns);
/* Refreshes the points of silent modules that are alive again. */
void iec104_refresh_recovered(const struct iec104_station *station, struct iec104_connection *connection,
			      int64_t now_ns);
/* Current values after lost events, or of a module that is back. */
bool iec104_send_refresh(struct iec104_station *station, struct iec104_connection *connection,
			 int64_t now_ns);

/* ---- spontaneous.c ----------------------------------------------------------------------- */

bool iec104_send_event(struct iec104_station *station, struct iec104_connection *connection, int64_t now_ns);

/* ---- periodic.c -------------------------------------------------------------------------- */

/* Sets periodic_due_ns: the first end of a point's period after from_ns; INT64_MAX when no point has one. */
void iec104_schedule_periodic(const struct iec104_station *station, struct iec104_connection *connection,
			      int64_t from_ns);
/* Begins with the points whose period has ended, if any; they are sent as k allows. */
void iec104_begin_periodic(const struct iec104_station *station, struct iec104_connection *connection,
			   int64_t now_ns);
bool iec104_send_periodic(const struct iec104_station *station, struct iec104_connection *connection,
			  int64_t now_ns);

/* ---- procedure.c ------------------------------------------------------------------------- */

/* Of the QCC (IEC 60870-5-101, 7.2.6.23): RQT 1..4 a group, 5 general; FRZ is 0, or enum map_freeze. */
#define IEC104_QCC_REQUEST(qcc) ((qcc)&0x3fu)
#define IEC104_QCC_GROUP(qcc)   (IEC104_QCC_REQUEST(qcc) % 5u) /* 0: any */
#define IEC104_QCC_FREEZE(qcc)  ((qcc) >> 6)

/* The point is a counter that a counter interrogation with this QCC means. */
bool iec104_is_counter_of(const struct iec104_station *station, uint32_t point, uint8_t qualifier);
/* The system command of an ASDU whose type, cause, common address and size were checked. */
struct iec104_procedure iec104_procedure_of(const struct iec104_station *station,
					    const struct iec104_asdu *asdu);
/* False: too many are waiting. */
bool iec104_add_procedure(struct iec104_connection *connection, const struct iec104_procedure *procedure);
/* In their order: 0 is the one whose turn it is. */
struct iec104_procedure *iec104_procedure_at(struct iec104_connection *connection, unsigned place);
/* The place of a procedure like this one; procedure_count: there is none. */
unsigned iec104_find_procedure(struct iec104_connection *connection, const struct iec104_procedure *like);
void iec104_end_first_procedure(struct iec104_connection *connection);
void iec104_remove_procedure(struct iec104_connection *connection, unsigned place);

/* ---- freeze.c ---------------------------------------------------------------------------- */

/*
 * Asks the owners of the counters that a counter interrogation means to freeze or reset them. False, and nothing
 * asked: an owner is not alive, or too many are waiting. The confirmation follows when all have answered.
 */
bool iec104_freeze(struct iec104_station *station, const struct iec104_received *received,
		   const struct iec104_procedure *procedure);
/* The connection waits for a freeze. */
bool iec104_freeze_waits(const struct iec104_station *station, const struct iec104_connection *connection);
void iec104_take_freeze_answer(struct iec104_station *station, const struct map_answer *answer);
/* Ends what waits for owners that died or whose answer was lost. */
void iec104_conclude_freezes(struct iec104_station *station, int64_t now_ns);
/* When iec104_conclude_freezes is due at the latest; INT64_MAX: none waits. */
int64_t iec104_freeze_deadline(const struct iec104_station *station);

/* ---- station.c --------------------------------------------------------------------------- */

struct iec104_times iec104_times_of(const struct iec104_settings *settings);

/* ---- initialisation.c -------------------------------------------------------------------- */

/* Looks whether all devices have been asked, as long as that is to be told; then all connections are told. */
void iec104_watch_initialisation(struct iec104_station *station, int64_t now_ns);
/* The stations that a changed configuration brings are to be told of as well. */
void iec104_note_new_stations(struct iec104_station *station, const struct map_config *before);
/* A connection's data transfer begins: it is told, if nobody was there before. */
void iec104_begin_initialised(struct iec104_station *station, struct iec104_connection *connection);
bool iec104_send_initialised(const struct iec104_station *station, struct iec104_connection *connection,
			     int64_t now_ns);
int64_t iec104_initialisation_deadline(const struct iec104_station *station);

/* ---- parameter.c ------------------------------------------------------------------------- */

/* The measured value that a parameter is for; MAP_NONE: there is none of this type. */
uint32_t iec104_parameter_point(const struct iec104_station *station, const struct iec104_asdu *asdu);
/*
 * What the owner of request->point is asked for: detail and value. False: a qualifier that is reserved or not for a controlling
 * station, or a value that the point cannot hold.
 */
bool iec104_parameter_request(const struct iec104_station *station, const struct iec104_asdu *asdu,
			      struct map_request *request);
/* Sends the loaded parameters of the procedure's next point that has some. False: there is none. */
bool iec104_send_parameters(const struct iec104_station *station, struct iec104_connection *connection,
			    struct iec104_procedure *procedure, iec104_wanted *wanted, int64_t now_ns);

/* ---- interrogation.c --------------------------------------------------------------------- */

/*
 * Activates or deactivates. False: the confirmation is negative. The positive one of an activation is the
 * procedure's own, when its turn has come.
 */
bool iec104_interrogate(struct iec104_station *station, const struct iec104_received *received);
void iec104_restart_procedure(const struct iec104_station *station, struct iec104_connection *connection);
bool iec104_advance_procedure(const struct iec104_station *station, struct iec104_connection *connection,
			      int64_t now_ns);

/* ---- reply.c ----------------------------------------------------------------------------- */

/*
 * Queues a copy with this cause and P/N; with cause 5 a read command of a known point, which is answered in
 * its turn. Closes the session when the queue is full.
 */
void iec104_mirror(struct iec104_connection *connection, const uint8_t *asdu, size_t size,
		   enum iec104_cause cause, bool negative);
/* A controlling station's time, in ns since 1970. False: it is none, or refused for its SU bit, as the log says. */
bool iec104_take_time(struct iec104_station *station, const struct iec104_received *received,
		      const uint8_t *time, int64_t *wall_ns);
/* The same of what was received, with P/N = 1; and its confirmation, of an activation or a deactivation. */
void iec104_refuse(const struct iec104_received *received, enum iec104_cause cause);
void iec104_confirm(const struct iec104_received *received, bool negative);
bool iec104_send_confirmation(struct iec104_connection *connection, int64_t now_ns);
bool iec104_answer_read(const struct iec104_station *station, struct iec104_connection *connection,
			int64_t now_ns);

/* ---- control.c --------------------------------------------------------------------------- */

/* An ASDU received in an I frame. */
void iec104_take_asdu(struct iec104_station *station, struct iec104_connection *connection,
		      const uint8_t *bytes, size_t size, int64_t now_ns);

/* ---- command.c --------------------------------------------------------------------------- */

/* A command whose type, cause, common address and size were checked. */
void iec104_take_command(struct iec104_station *station, const struct iec104_received *received);

/* ---- request.c --------------------------------------------------------------------------- */

/* Asks the point's owner, or rtud where there is no point. False: it is not there, or too many requests are open. */
bool iec104_post(struct iec104_station *station, const struct iec104_received *received,
		 struct map_request request);
/*
 * An owner whose generation has ended will not answer, and nobody knows what became of what it was asked. One that is
 * only silent for a moment will: rtud decides, not the heartbeat's age.
 */
bool iec104_owner_has_ended(const struct iec104_station *station, uint32_t owner, uint32_t generation);
/* The answer to a request that iec104_post posted. */
void iec104_take_request_answer(struct iec104_station *station, const struct map_answer *answer);
/* ACT_TERM of a command whose return information was sent. */
bool iec104_send_termination(struct iec104_station *station, struct iec104_connection *connection,
			     int64_t now_ns);
/* Nobody waits for the ends of this connection's commands any more. */
void iec104_drop_terminations(struct iec104_station *station, struct iec104_connection *connection);
/* Answers for owners that died or whose answer was lost: refused, and nobody knows what became of it. */
void iec104_conclude_orphans(struct iec104_station *station, int64_t now_ns);
/* Ends what a connection that is going has selected. */
void iec104_end_selections(struct iec104_station *station, const struct iec104_connection *connection);
/* When a command that is still open will be answered for its owner at the latest; INT64_MAX: none is open. */
int64_t iec104_orphan_deadline(const struct iec104_station *station);

/* ---- answer.c ---------------------------------------------------------------------------- */

/* The owners' and rtud's answers to requests of this process. True: there were some. */
bool iec104_take_answers(struct iec104_station *station);

#endif
