/* SPDX-License-Identifier: GPL-3.0-or-later */
/*
 * One TCP connection of IEC 60870-5-104, clause 5: the state machine of the transfer of APDUs, at the side that
 * is started and stopped or at the side that starts. Received octets and the time come in, octets to be sent go out; nothing here
 * knows a socket, a clock or what an ASDU means.
 *
 * Times are CLOCK_MONOTONIC nanoseconds, so that setting the wall clock fires none of t1..t3.
 */
#ifndef OPENRTU_IEC104_SESSION_H
#define OPENRTU_IEC104_SESSION_H

#include "iec104/apdu.h"
#include "iec104/counters.h"

/* Buffers of a controlled station's connection. */
#define IEC104_INPUT_SIZE  2048
#define IEC104_OUTPUT_SIZE 4096 /* the usual k of 12 I frames of full size, and the control frames between */
/* The least that work: an APDU; beside it in the output the control frames that may be due. */
#define IEC104_CONTROL_ROOM (5 * IEC104_APCI_SIZE)
#define IEC104_INPUT_LEAST  IEC104_APDU_MAX
#define IEC104_OUTPUT_LEAST (IEC104_APDU_MAX + IEC104_CONTROL_ROOM)

/* Clause 9.6. */
struct iec104_times {
	uint16_t k; /* sent and unacknowledged I frames at most, 1..32767 */
	uint16_t w; /* received I frames that are acknowledged at the latest, 1..k */
	int64_t t1_ns, t2_ns, t3_ns;
};

/* Which side this is: the controlling station starts data transfer, the controlled station is started. */
enum iec104_role { IEC104_CONTROLLED, IEC104_CONTROLLING };

/* Why a session is over; up to IEC104_CLOSED_BY_STATION each has its counter in counters.h. */
enum iec104_closing {
	IEC104_OPEN,
	IEC104_BAD_APDU,          /* start octet, length or control field */
	IEC104_BAD_ASDU,          /* no ASDU, or too short for its objects, or without one */
	IEC104_BAD_NS,            /* a frame was lost or repeated */
	IEC104_BAD_NR,            /* acknowledges what was never sent */
	IEC104_I_WHILE_STOPPED,   /* between STOPDT act, or the beginning, and STARTDT act */
	IEC104_T1_I_FRAME,        /* no acknowledgement in t1 */
	IEC104_T1_TESTFR,         /* no TESTFR con in t1 */
	IEC104_UNREAD_ANSWERS,    /* the peer asks on and on, and takes no answers */
	IEC104_TAKEN_OVER,        /* another connection of its redundancy group was started */
	IEC104_GAVE_WAY,          /* never started, and its place was wanted */
	IEC104_NOT_SECURE,        /* old keys, or a certificate no longer good */
	IEC104_NOT_AS_BEFORE,     /* a changed configuration grants its peer something else */
	IEC104_CLOSED_BY_PEER,    /* end of file or error of the connection */
	IEC104_CLOSED_BY_STATION, /* the process ends */
	/* Of a controlling station: */
	IEC104_T1_STARTDT,     /* no STARTDT con in t1 */
	IEC104_STARTED_BY_PEER /* STARTDT act or STOPDT act from the controlled station */
};

/* What a session works in; its owner's, and must outlive it. */
struct iec104_memory {
	int64_t *sent_ns; /* room for times.k */
	uint8_t *input;   /* input_size octets, at least IEC104_INPUT_LEAST */
	uint8_t *output;  /* output_size octets, at least IEC104_OUTPUT_LEAST */
	uint16_t input_size, output_size;
};

struct iec104_session {
	const struct iec104_times *times;
	_Atomic uint32_t *counters; /* by enum iec104_counter */
	enum iec104_role role;
	enum iec104_closing closing;
	bool started;  /* I frames may be sent and received */
	bool stopping; /* STOPDT act has come; its con waits until all sent I frames are acknowledged */

	uint16_t next_ns;        /* V(S) */
	uint16_t next_nr;        /* V(R) */
	uint16_t unacknowledged; /* own I frames */
	uint16_t owed;           /* received I frames not yet acknowledged, though they may be */
	bool holding;            /* a received I frame may be acknowledged when the owner says so */
	uint16_t held;           /* those that may not yet */

	struct iec104_memory memory; /* sent_ns is a ring: when each unacknowledged I frame was sent */
	uint16_t oldest;             /* its place in the ring */
	int64_t owed_since_ns;
	int64_t startdt_ns; /* when the unconfirmed STARTDT act was sent */
	bool startdt_open;
	int64_t testfr_ns; /* when the unconfirmed TESTFR act was sent */
	bool testfr_open;
	int64_t heard_ns; /* the last frame received */

	uint16_t input_begin, input_end;
	uint16_t output_begin, output_end;
};

/*
 * Begins a session on a new connection, stopped. times, the IEC104_COUNT_OF_COUNTERS counters it counts frames in, and what
 * memory refers to must outlive it.
 */
void iec104_session_open(struct iec104_session *session, const struct iec104_times *times,
			 enum iec104_role role, _Atomic uint32_t *counters,
			 const struct iec104_memory *memory, int64_t now_ns);

/*
 * From now on a received I frame is acknowledged only once the owner has released it, so that the peer keeps what it holds
 * until that is in good hands. iec104_session_release releases the oldest count of session->held.
 */
void iec104_session_hold(struct iec104_session *session);
void iec104_session_release(struct iec104_session *session, uint16_t count, int64_t now_ns);

/* A controlling station: asks for data transfer, once in a session. It is started when the peer has confirmed. */
void iec104_session_start(struct iec104_session *session, int64_t now_ns);

/*
 * Where the next received octets go: *size octets, 0 while the peer does not take what is to be sent to it, so
 * that TCP holds the rest back. iec104_session_received then tells how many came.
 */
uint8_t *iec104_session_space(struct iec104_session *session, size_t *size);
void iec104_session_received(struct iec104_session *session, size_t count);

/*
 * Takes the next APDU from what was received. True: one was taken, and *asdu is its ASDU until the next
 * call (NULL unless it is an I frame). False: none is complete, its answer has no room yet, or the session
 * is over.
 */
bool iec104_session_next(struct iec104_session *session, int64_t now_ns, const uint8_t **asdu, size_t *size);

/* An ASDU may be sent now: data transfer is started, fewer than k are unacknowledged, and there is room. */
bool iec104_session_may_send(const struct iec104_session *session);
/* Sends an ASDU of 1..IEC104_ASDU_MAX octets. Only while iec104_session_may_send. */
void iec104_session_send(struct iec104_session *session, const uint8_t *asdu, size_t size, int64_t now_ns);

/* Does what is due without a frame from the peer: w, t1, t2, t3. After each change and at each deadline. */
void iec104_session_run(struct iec104_session *session, int64_t now_ns);
/* When iec104_session_run is due next; INT64_MAX when the session is over. */
int64_t iec104_session_deadline(const struct iec104_session *session);

/* The octets to be sent, in order; iec104_session_written tells how many of them went. */
const uint8_t *iec104_session_output(const struct iec104_session *session, size_t *size);
void iec104_session_written(struct iec104_session *session, size_t count);

/* Ends the session; the first reason stands. */
void iec104_session_close(struct iec104_session *session, enum iec104_closing reason);
/* The reason in words, for the log. */
const char *iec104_closing_text(enum iec104_closing reason);

#endif
