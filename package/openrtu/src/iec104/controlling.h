/* SPDX-License-Identifier: GPL-3.0-or-later */
/*
 * The controlling station: one connection to a controlled station, which it starts, asks and commands. Like the controlled
 * side it knows no socket and no clock: octets go through iec104_session_space and iec104_session_output of its session,
 * time is an argument. It allocates nothing.
 *
 * A request is a command, an interrogation, a read command or a clock synchronisation. Its progress has the states of a
 * command in the map (enum map_command_state):
 *
 *	select    selection request -> accepted selection | refused selection
 *	cancel    interruption request -> interrupted selection
 *	the rest  execution request -> executing (ACT_CON) -> executed command (ACT_TERM) | refused command
 *
 * A clock synchronisation, a test and a reset are executed with their confirmation, a read command with the value. Why a request ended is its result:
 * - MAP_RESULT_EXCEPTION: the station refused it; cause says how: 44..47, or the cause of the negative confirmation;
 * - MAP_RESULT_TIMEOUT: no confirmation, or no termination; a command may or may not have been carried out;
 * - MAP_RESULT_UNKNOWN_FATE: the connection ended meanwhile; the same holds.
 */
#ifndef OPENRTU_IEC104_CONTROLLING_H
#define OPENRTU_IEC104_CONTROLLING_H

#include "iec104/geoposition.h"
#include "iec104/information.h"
#include "iec104/session.h"

#define IEC104_CONTROLLING_REQUESTS_MAX 16

struct iec104_controlling_settings {
	struct iec104_times times;
	struct map_zone zone; /* of time tags, both ways */
	uint8_t originator;
	uint8_t position_type; /* IEC104_GEOPOSITION, or another private one; 0: none carries positions */
	uint8_t requests_max;  /* not ended at once, 1..IEC104_CONTROLLING_REQUESTS_MAX */
	int64_t confirmation_ns;
	int64_t selection_ns;   /* how long a selection is kept that is neither executed nor cancelled */
	int64_t termination_ns; /* of a command; 0: the station sends none, the confirmation is the end */
	int64_t
	    interrogation_ns; /* from the confirmation to the termination, with all that is sent between */
};

/* A moment: CLOCK_MONOTONIC for deadlines, CLOCK_REALTIME for time tags. */
struct iec104_moment {
	int64_t monotonic_ns;
	int64_t wall_ns; /* since 1970, UTC */
};

struct iec104_controlling_request {
	uint32_t id;  /* 0: none */
	uint8_t type; /* 45..51, 58..64, 100..103, 105, 107 */
	uint16_t ca;
	uint32_t ioa;                        /* 0 of interrogations and clock synchronisation */
	struct iec104_command command;       /* of a command; its time is not kept */
	uint8_t state;                       /* enum map_command_state */
	uint8_t result;                      /* enum map_command_result */
	uint8_t cause;                       /* MAP_RESULT_EXCEPTION: of transmission, of the refusal */
	bool tagged;                         /* a CP56Time2a follows the element */
	uint8_t element[IEC104_ELEMENT_MAX]; /* as sent, without time tag; a confirmation mirrors it */
	size_t element_size;
	int64_t deadline_ns;
};

/* No more is told of a request in this state. */
static inline bool iec104_controlling_has_ended(uint8_t state)
{
	return state == MAP_REFUSED_SELECTION || state == MAP_INTERRUPTED_SELECTION ||
	       state == MAP_REFUSED_COMMAND || state == MAP_EXECUTED_COMMAND;
}

/*
 * Who is told. From within a call requests may be made, executed and cancelled. asdu has type, cause, T and CA; what has T set
 * was sent for a test and is no process information.
 */
struct iec104_controlling_listener {
	void *context;
	/* Each object of types 1..21, 30..40 and 70 (end of initialisation). */
	void (*information)(void *context, const struct iec104_asdu *asdu,
			    const struct iec104_information *information);
	void (*position)(void *context, const struct iec104_asdu *asdu, uint32_t ioa,
			 const struct iec104_geoposition *position);
	/* A request has another state. Once it has ended, its id is no longer known. */
	void (*progress)(void *context, const struct iec104_controlling_request *request);
	/* An ASDU was looked at, and all that it says was told before. May be NULL. */
	void (*looked_at)(void *context, const struct iec104_asdu *asdu);
};

struct iec104_controlling {
	const struct iec104_controlling_settings *settings;
	const struct iec104_controlling_listener *listener;
	uint32_t next_id;
	uint32_t unknown_types; /* ASDUs, each counted and left */
	uint32_t unexpected;    /* confirmations and terminations that answer no request as it was sent */
	struct iec104_controlling_request requests[IEC104_CONTROLLING_REQUESTS_MAX];
	_Atomic uint32_t counters[IEC104_COUNT_OF_COUNTERS]; /* of frames, by the session */
	struct iec104_session session;
};

/*
 * Begins on a new connection, stopped; iec104_session_start of the session starts it. settings, listener and what memory
 * refers to, for settings->times, must outlive it.
 */
void iec104_controlling_open(struct iec104_controlling *controlling,
			     const struct iec104_controlling_settings *settings,
			     const struct iec104_controlling_listener *listener,
			     const struct iec104_memory *memory, struct iec104_moment now);

/* Does all there is to do now: after octets were received or written, and at the deadline. */
void iec104_controlling_run(struct iec104_controlling *controlling, struct iec104_moment now);
/* When iec104_controlling_run is due without them, CLOCK_MONOTONIC; INT64_MAX: the connection is over. */
int64_t iec104_controlling_deadline(const struct iec104_controlling *controlling);

/*
 * Requests. Each returns its id, or 0 and sends nothing: data transfer is stopped, k frames are unacknowledged, requests_max
 * requests have not ended, one of this type and address has not ended, or an address is none (CA 1..65534, IOA below 2^24).
 */

/* General interrogation (qoi 20), or of a group (21..36). */
uint32_t iec104_controlling_interrogate(struct iec104_controlling *controlling, uint16_t ca, uint8_t qoi,
					struct iec104_moment now);
/* Counter interrogation; qcc after IEC 60870-5-101, 7.2.6.23: 5 requests all counters. */
uint32_t iec104_controlling_interrogate_counters(struct iec104_controlling *controlling, uint16_t ca,
						 uint8_t qcc, struct iec104_moment now);
uint32_t iec104_controlling_read(struct iec104_controlling *controlling, uint16_t ca, uint32_t ioa,
				 struct iec104_moment now);
/* Clock synchronisation, to now.wall_ns. */
uint32_t iec104_controlling_set_clock(struct iec104_controlling *controlling, uint16_t ca,
				      struct iec104_moment now);
/* Test command: the station mirrors these 16 bits. */
uint32_t iec104_controlling_test(struct iec104_controlling *controlling, uint16_t ca, uint16_t pattern,
				 struct iec104_moment now);
/* Reset process; qrp after IEC 60870-5-101, 7.2.6.27: 1 the process, 2 the events that wait. */
uint32_t iec104_controlling_reset(struct iec104_controlling *controlling, uint16_t ca, uint8_t qrp,
				  struct iec104_moment now);
/*
 * A selection (command->select) or a direct command. A tagged one has now.wall_ns. 0 also for a command that cannot be: of a
 * counter, a selected bit string, a step that is neither -1 nor 1.
 */
uint32_t iec104_controlling_command(struct iec104_controlling *controlling, uint16_t ca,
				    const struct iec104_command *command, struct iec104_moment now);
/* Executes, or cancels, an accepted selection. False: there is none of this id, or nothing may be sent now. */
bool iec104_controlling_execute(struct iec104_controlling *controlling, uint32_t id,
				struct iec104_moment now);
bool iec104_controlling_cancel(struct iec104_controlling *controlling, uint32_t id, struct iec104_moment now);

#endif
