/* SPDX-License-Identifier: GPL-3.0-or-later */
#include "iec104/session.h"

#include <string.h>

#include "map/time_ns.h"

/*
 * IEC104_CONTROL_ROOM is kept free of I frames, and an APDU is only taken while it is free: an APDU makes at most an S frame
 * and a confirmation, and until the next one is taken the timers add at most an S frame and a TESTFR act. A controlling
 * station adds its one STARTDT act.
 */

void iec104_session_open(struct iec104_session *session, const struct iec104_times *times,
			 enum iec104_role role, _Atomic uint32_t *counters,
			 const struct iec104_memory *memory, int64_t now_ns)
{
	memset(session, 0, sizeof(*session));
	session->times = times;
	session->role = role;
	session->counters = counters;
	session->memory = *memory;
	session->heard_ns = now_ns;
}

void iec104_session_close(struct iec104_session *session, enum iec104_closing reason)
{
	if (session->closing == IEC104_OPEN)
		session->closing = reason;
	session->started = false;
}

/* ---- counters ---------------------------------------------------------------------------- */

/* A frame's place among the counters of one direction. */
static unsigned frame_counter(const struct iec104_apdu *apdu)
{
	if (apdu->format == IEC104_I_FRAME)
		return IEC104_COUNT_I_IN;
	if (apdu->format == IEC104_S_FRAME)
		return IEC104_COUNT_S_IN;
	switch (apdu->function) {
	case IEC104_STARTDT_ACT:
		return IEC104_COUNT_STARTDT_ACT_IN;
	case IEC104_STARTDT_CON:
		return IEC104_COUNT_STARTDT_CON_IN;
	case IEC104_STOPDT_ACT:
		return IEC104_COUNT_STOPDT_ACT_IN;
	case IEC104_STOPDT_CON:
		return IEC104_COUNT_STOPDT_CON_IN;
	case IEC104_TESTFR_ACT:
		return IEC104_COUNT_TESTFR_ACT_IN;
	default:
		return IEC104_COUNT_TESTFR_CON_IN;
	}
}

static void count_in(struct iec104_session *session, const struct iec104_apdu *apdu)
{
	map_count(&session->counters[frame_counter(apdu)], 1);
}

static void count_out(struct iec104_session *session, const struct iec104_apdu *apdu)
{
	map_count(&session->counters[IEC104_COUNT_I_OUT + frame_counter(apdu)], 1);
}

/* ---- output ------------------------------------------------------------------------------ */

static size_t output_room(const struct iec104_session *session)
{
	return (size_t)session->memory.output_size - (size_t)(session->output_end - session->output_begin);
}

static void put(struct iec104_session *session, const uint8_t *bytes, size_t size)
{
	if ((size_t)session->output_end + size > session->memory.output_size) {
		session->output_end = (uint16_t)(session->output_end - session->output_begin);
		memmove(session->memory.output, session->memory.output + session->output_begin,
			session->output_end);
		session->output_begin = 0;
	}
	memcpy(session->memory.output + session->output_end, bytes, size);
	session->output_end = (uint16_t)(session->output_end + size);
}

static void put_apci(struct iec104_session *session, const struct iec104_apdu *apdu)
{
	uint8_t bytes[IEC104_APCI_SIZE];

	iec104_apdu_encode(bytes, apdu);
	count_out(session, apdu);
	put(session, bytes, sizeof(bytes));
}

static void put_function(struct iec104_session *session, enum iec104_function function)
{
	put_apci(session, &(struct iec104_apdu){.format = IEC104_U_FRAME, .function = function});
}

/* N(R): up to the first I frame that may not be acknowledged yet. */
static uint16_t acknowledged_nr(const struct iec104_session *session)
{
	return (uint16_t)((session->next_nr + IEC104_SEQUENCE_MODULO - session->held) %
			  IEC104_SEQUENCE_MODULO);
}

static void acknowledge(struct iec104_session *session)
{
	if (session->owed == 0)
		return;
	put_apci(session, &(struct iec104_apdu){.format = IEC104_S_FRAME, .nr = acknowledged_nr(session)});
	session->owed = 0;
}

bool iec104_session_may_send(const struct iec104_session *session)
{
	return session->started && !session->stopping && session->unacknowledged < session->times->k &&
	       output_room(session) >= IEC104_APDU_MAX + IEC104_CONTROL_ROOM;
}

void iec104_session_send(struct iec104_session *session, const uint8_t *asdu, size_t size, int64_t now_ns)
{
	uint32_t place = (uint32_t)session->oldest + session->unacknowledged;

	put_apci(session, &(struct iec104_apdu){.format = IEC104_I_FRAME,
						.ns = session->next_ns,
						.nr = acknowledged_nr(session),
						.asdu_size = size});
	put(session, asdu, size);
	session->memory.sent_ns[place % session->times->k] = now_ns;
	session->unacknowledged++;
	session->next_ns = (uint16_t)((session->next_ns + 1) % IEC104_SEQUENCE_MODULO);
	session->owed = 0;
}

const uint8_t *iec104_session_output(const struct iec104_session *session, size_t *size)
{
	*size = (size_t)(session->output_end - session->output_begin);
	return session->memory.output + session->output_begin;
}

void iec104_session_written(struct iec104_session *session, size_t count)
{
	session->output_begin = (uint16_t)(session->output_begin + count);
	if (session->output_begin == session->output_end)
		session->output_begin = session->output_end = 0;
}

void iec104_session_start(struct iec104_session *session, int64_t now_ns)
{
	if (session->closing != IEC104_OPEN || session->startdt_open || session->started)
		return;
	session->startdt_open = true;
	session->startdt_ns = now_ns;
	put_function(session, IEC104_STARTDT_ACT);
}

/* ---- input ------------------------------------------------------------------------------- */

uint8_t *iec104_session_space(struct iec104_session *session, size_t *size)
{
	size_t waiting = (size_t)(session->input_end - session->input_begin);

	memmove(session->memory.input, session->memory.input + session->input_begin, waiting);
	session->input_begin = 0;
	session->input_end = (uint16_t)waiting;
	*size = session->closing == IEC104_OPEN ? session->memory.input_size - waiting : 0;
	return session->memory.input + waiting;
}

void iec104_session_received(struct iec104_session *session, size_t count)
{
	session->input_end = (uint16_t)(session->input_end + count);
}

static void confirm_stop(struct iec104_session *session)
{
	if (!session->stopping || session->unacknowledged > 0)
		return;
	session->stopping = false;
	session->started = false;
	put_function(session, IEC104_STOPDT_CON);
}

/* N(R) acknowledges all own I frames below it. The same N(R) again acknowledges nothing and is no error. */
static bool take_nr(struct iec104_session *session, uint16_t nr)
{
	uint32_t still_open = (session->next_ns + IEC104_SEQUENCE_MODULO - nr) % IEC104_SEQUENCE_MODULO;
	uint32_t acknowledged;

	if (still_open > session->unacknowledged) {
		iec104_session_close(session, IEC104_BAD_NR);
		return false;
	}
	acknowledged = session->unacknowledged - still_open;
	session->unacknowledged = (uint16_t)still_open;
	session->oldest = (uint16_t)((session->oldest + acknowledged) % session->times->k);
	confirm_stop(session);
	return true;
}

static void owe(struct iec104_session *session, uint16_t count, int64_t now_ns)
{
	if (session->owed == 0)
		session->owed_since_ns = now_ns;
	session->owed = (uint16_t)(session->owed + count);
}

void iec104_session_hold(struct iec104_session *session)
{
	session->holding = true;
}

void iec104_session_release(struct iec104_session *session, uint16_t count, int64_t now_ns)
{
	if (count > session->held)
		count = session->held;
	session->held = (uint16_t)(session->held - count);
	if (count > 0)
		owe(session, count, now_ns);
}

static bool take_i(struct iec104_session *session, const struct iec104_apdu *apdu, int64_t now_ns)
{
	if (!session->started || session->stopping) {
		iec104_session_close(session, IEC104_I_WHILE_STOPPED);
		return false;
	}
	if (apdu->ns != session->next_nr) {
		iec104_session_close(session, IEC104_BAD_NS);
		return false;
	}
	if (!take_nr(session, apdu->nr))
		return false;
	session->next_nr = (uint16_t)((session->next_nr + 1) % IEC104_SEQUENCE_MODULO);
	if (session->holding)
		session->held++;
	else
		owe(session, 1, now_ns);
	return true;
}

static void confirm_start(struct iec104_session *session)
{
	session->started = true;
	session->stopping = false;
	put_function(session, IEC104_STARTDT_CON);
}

static void stop(struct iec104_session *session)
{
	acknowledge(session);
	session->stopping = true;
	confirm_stop(session);
}

static void take_start_con(struct iec104_session *session)
{
	if (!session->startdt_open)
		return; /* never asked for, and harmless */
	session->startdt_open = false;
	session->started = true;
}

static bool take_u(struct iec104_session *session, enum iec104_function function)
{
	bool starts_or_stops = function == IEC104_STARTDT_ACT || function == IEC104_STOPDT_ACT;

	if (session->role == IEC104_CONTROLLING && starts_or_stops) {
		iec104_session_close(session, IEC104_STARTED_BY_PEER);
		return false;
	}
	switch (function) {
	case IEC104_STARTDT_ACT:
		confirm_start(session);
		break;
	case IEC104_STOPDT_ACT:
		stop(session);
		break;
	case IEC104_TESTFR_ACT:
		put_function(session, IEC104_TESTFR_CON);
		break;
	case IEC104_TESTFR_CON:
		session->testfr_open = false;
		break;
	case IEC104_STARTDT_CON:
		take_start_con(session);
		break;
	case IEC104_STOPDT_CON:
		break; /* never asked for, and harmless */
	}
	return true;
}

/* The octets of the next APDU when it is complete and its answer has room; 0 otherwise. */
static size_t complete_apdu(struct iec104_session *session)
{
	const uint8_t *bytes = session->memory.input + session->input_begin;
	size_t waiting = (size_t)(session->input_end - session->input_begin);
	int size = iec104_apdu_size(bytes, waiting);

	if (size < 0)
		iec104_session_close(session, IEC104_BAD_APDU);
	if (size <= 0 || (size_t)size > waiting || output_room(session) < IEC104_CONTROL_ROOM)
		return 0;
	return (size_t)size;
}

bool iec104_session_next(struct iec104_session *session, int64_t now_ns, const uint8_t **asdu, size_t *size)
{
	struct iec104_apdu apdu;
	size_t apdu_size = session->closing == IEC104_OPEN ? complete_apdu(session) : 0;

	*asdu = NULL;
	*size = 0;
	if (apdu_size == 0)
		return false;
	if (!iec104_apdu_decode(session->memory.input + session->input_begin, apdu_size, &apdu)) {
		iec104_session_close(session, IEC104_BAD_APDU);
		return false;
	}
	session->input_begin = (uint16_t)(session->input_begin + apdu_size);
	session->heard_ns = now_ns;
	count_in(session, &apdu);
	switch (apdu.format) {
	case IEC104_I_FRAME:
		if (!take_i(session, &apdu, now_ns))
			return false;
		*asdu = apdu.asdu;
		*size = apdu.asdu_size;
		return true;
	case IEC104_S_FRAME:
		return take_nr(session, apdu.nr);
	case IEC104_U_FRAME:
		return take_u(session, apdu.function);
	}
	return false;
}

/* ---- timers ------------------------------------------------------------------------------ */

static int64_t t1_i_deadline(const struct iec104_session *session)
{
	return session->unacknowledged > 0 ? session->memory.sent_ns[session->oldest] + session->times->t1_ns
					   : INT64_MAX;
}

static int64_t t1_startdt_deadline(const struct iec104_session *session)
{
	return session->startdt_open ? session->startdt_ns + session->times->t1_ns : INT64_MAX;
}

static int64_t t1_testfr_deadline(const struct iec104_session *session)
{
	return session->testfr_open ? session->testfr_ns + session->times->t1_ns : INT64_MAX;
}

static int64_t t2_deadline(const struct iec104_session *session)
{
	return session->owed > 0 ? session->owed_since_ns + session->times->t2_ns : INT64_MAX;
}

/* While a TESTFR act is open, t1 runs in the place of t3. */
static int64_t t3_deadline(const struct iec104_session *session)
{
	return session->testfr_open ? INT64_MAX : session->heard_ns + session->times->t3_ns;
}

void iec104_session_run(struct iec104_session *session, int64_t now_ns)
{
	if (now_ns >= t1_i_deadline(session))
		iec104_session_close(session, IEC104_T1_I_FRAME);
	if (now_ns >= t1_startdt_deadline(session))
		iec104_session_close(session, IEC104_T1_STARTDT);
	if (now_ns >= t1_testfr_deadline(session))
		iec104_session_close(session, IEC104_T1_TESTFR);
	if (session->closing != IEC104_OPEN)
		return;
	if (now_ns >= t3_deadline(session)) {
		session->testfr_open = true;
		session->testfr_ns = now_ns;
		put_function(session, IEC104_TESTFR_ACT);
	}
	if (session->owed >= session->times->w || now_ns >= t2_deadline(session))
		acknowledge(session);
}

int64_t iec104_session_deadline(const struct iec104_session *session)
{
	if (session->closing != IEC104_OPEN)
		return INT64_MAX;
	return earlier(
	    earlier(t1_i_deadline(session), t1_testfr_deadline(session)),
	    earlier(t1_startdt_deadline(session), earlier(t2_deadline(session), t3_deadline(session))));
}

const char *iec104_closing_text(enum iec104_closing reason)
{
	static const char *const texts[] = {
	    [IEC104_OPEN] = "open",
	    [IEC104_BAD_APDU] = "not an APDU: start octet, length or control field",
	    [IEC104_BAD_ASDU] = "ASDU is too short for its type and number of objects, or has none",
	    [IEC104_BAD_NS] = "N(S) out of sequence",
	    [IEC104_BAD_NR] = "N(R) acknowledges frames that were never sent",
	    [IEC104_I_WHILE_STOPPED] = "I frame while data transfer is stopped",
	    [IEC104_T1_I_FRAME] = "I frame not acknowledged in t1",
	    [IEC104_T1_TESTFR] = "TESTFR act not confirmed in t1",
	    [IEC104_UNREAD_ANSWERS] = "more requests than answers are acknowledged",
	    [IEC104_TAKEN_OVER] = "another connection of its group was started",
	    [IEC104_GAVE_WAY] = "data transfer was never started, and another one needs the place",
	    [IEC104_NOT_SECURE] = "its keys or its certificate are no longer good",
	    [IEC104_NOT_AS_BEFORE] =
		"the changed configuration has its address in no list, or in another group",
	    [IEC104_CLOSED_BY_PEER] = "closed by the peer",
	    [IEC104_CLOSED_BY_STATION] = "station ends",
	    [IEC104_T1_STARTDT] = "STARTDT act not confirmed in t1",
	    [IEC104_STARTED_BY_PEER] = "STARTDT act or STOPDT act from the controlled station",
	};

	return texts[reason];
}
