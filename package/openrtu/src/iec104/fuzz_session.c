/* SPDX-License-Identifier: GPL-3.0-or-later */
/*
 * libFuzzer on one session in virtual time: the input is a stream of octets from the peer, cut in pieces, and what
 * else happens between them. What must hold whatever comes:
 * - the output is whole APDUs, I frames in sequence, at most k of them unacknowledged;
 * - received I frames are acknowledged at w;
 * - the deadline is ahead once the session has been run, and no later than t1, t2 and t3 allow;
 * - a session that is over sends and takes nothing more.
 */
#include <string.h>

#include "fuzz/input.h"
#include "iec104/session.h"

#define S       1000000000LL
#define MS      1000000LL
#define K_MOST  40 /* more than the output holds */
#define ASDU_OF 0x2a

static struct iec104_session session;
static _Atomic uint32_t counters[IEC104_COUNT_OF_COUNTERS];
static struct iec104_times times;
static int64_t sent_ns[K_MOST], now;
static uint8_t input_octets[IEC104_INPUT_SIZE], output_octets[IEC104_OUTPUT_SIZE];
static const struct iec104_memory memory = {.sent_ns = sent_ns,
					    .input = input_octets,
					    .output = output_octets,
					    .input_size = sizeof(input_octets),
					    .output_size = sizeof(output_octets)};
static uint16_t sent, written; /* I frames: given to the session, seen in its output */
static uint8_t pending[IEC104_APDU_MAX + IEC104_OUTPUT_SIZE];
static size_t pending_size;

/* ---- what comes out ---------------------------------------------------------------------------- */

static void check_frame(const uint8_t *octets, size_t size)
{
	struct iec104_apdu apdu;

	CHECK(iec104_apdu_decode(octets, size, &apdu));
	if (apdu.format != IEC104_I_FRAME)
		return;
	CHECK(apdu.ns == written % IEC104_SEQUENCE_MODULO);
	CHECK(apdu.asdu[0] == ASDU_OF);
	written++;
}

/* The peer takes as many octets as the input says; frames are checked when they are whole. */
static void take_output(size_t most)
{
	size_t size, done = 0;
	int apdu_size;
	const uint8_t *octets = iec104_session_output(&session, &size);

	if (most > size)
		most = size;
	CHECK(pending_size + most <= sizeof(pending));
	memcpy(pending + pending_size, octets, most);
	pending_size += most;
	iec104_session_written(&session, most);
	while ((apdu_size = iec104_apdu_size(pending + done, pending_size - done)) > 0 &&
	       (size_t)apdu_size <= pending_size - done) {
		check_frame(pending + done, (size_t)apdu_size);
		done += (size_t)apdu_size;
	}
	CHECK(apdu_size >= 0);
	CHECK(pending_size - done < IEC104_APDU_MAX);
	memmove(pending, pending + done, pending_size - done);
	pending_size -= done;
}

static void check_state(void)
{
	CHECK(session.unacknowledged <= times.k);
	CHECK(session.owed < times.w || session.closing != IEC104_OPEN);
	CHECK(session.input_end <= IEC104_INPUT_SIZE && session.output_end <= IEC104_OUTPUT_SIZE);
	if (session.closing == IEC104_OPEN) {
		int64_t deadline = iec104_session_deadline(&session);

		CHECK(deadline > now);
		CHECK(deadline <= now + (times.t1_ns > times.t3_ns ? times.t1_ns : times.t3_ns));
		CHECK(session.owed == 0 || deadline <= now + times.t2_ns);
		return;
	}
	CHECK(!iec104_session_may_send(&session));
	CHECK(iec104_session_deadline(&session) == INT64_MAX);
}

/* ---- what happens ------------------------------------------------------------------------------ */

static void run(void)
{
	const uint8_t *asdu;
	size_t size;

	while (iec104_session_next(&session, now, &asdu, &size)) {
		CHECK((asdu == NULL) == (size == 0) && size <= IEC104_ASDU_MAX);
		iec104_session_run(&session, now);
	}
	iec104_session_run(&session, now);
	check_state();
}

static void receive(const uint8_t *octets, size_t size)
{
	size_t room;
	uint8_t *place = iec104_session_space(&session, &room);

	CHECK(session.closing == IEC104_OPEN || room == 0);
	if (size > room)
		size = room;
	memcpy(place, octets, size);
	iec104_session_received(&session, size);
	run();
}

static void receive_anything(void)
{
	uint8_t octets[256] = {0};
	size_t size = next_octet();

	for (size_t i = 0; i < size; i++)
		octets[i] = next_octet();
	receive(octets, size);
}

/* A frame as the peer would send it, but for what the input does to its numbers. */
static void receive_frame(uint8_t kind)
{
	static const uint8_t functions[] = {0x07, 0x0b, 0x13, 0x23, 0x43, 0x83};
	uint8_t frame[IEC104_APDU_MAX] = {0x68, 4}, slip = next_octet();
	uint16_t ns = (uint16_t)((session.next_nr + (slip & 1)) % IEC104_SEQUENCE_MODULO);
	uint16_t nr = (uint16_t)((written + IEC104_SEQUENCE_MODULO - (slip >> 4)) % IEC104_SEQUENCE_MODULO);

	frame[4] = (uint8_t)(nr << 1);
	frame[5] = (uint8_t)(nr >> 7);
	if (kind == 0) {
		memset(frame + 4, 0, 2);
		frame[2] = functions[slip % sizeof(functions)];
	} else if (kind == 1) {
		frame[2] = 1;
	} else {
		frame[1] = (uint8_t)(5 + next_octet() % IEC104_ASDU_MAX);
		frame[2] = (uint8_t)(ns << 1);
		frame[3] = (uint8_t)(ns >> 7);
	}
	receive(frame, frame[1] + 2u);
}

static void send_some(uint8_t count)
{
	uint8_t asdu[IEC104_ASDU_MAX] = {ASDU_OF};

	for (; count > 0 && iec104_session_may_send(&session); count--, sent++)
		iec104_session_send(&session, asdu, 1 + next_octet() % IEC104_ASDU_MAX, now);
	run();
}

static void step(void)
{
	uint8_t octet = next_octet(), argument = octet >> 3;

	switch (octet & 7) {
	case 0:
		receive_anything();
		break;
	case 1:
	case 2:
	case 3:
		receive_frame((octet & 7) - 1);
		break;
	case 4:
		send_some(argument);
		break;
	case 5:
		now += (1 + argument) * (next_octet() & 1 ? S : MS);
		run();
		break;
	default:
		take_output((octet & 7) == 6 ? argument : SIZE_MAX);
		run();
		break;
	}
}

int LLVMFuzzerTestOneInput(const uint8_t *data, size_t size)
{
	input = (struct input){.at = data, .end = data + size};
	times = (struct iec104_times){.k = (uint16_t)(1 + next_octet() % K_MOST)};
	times.w = (uint16_t)(1 + next_octet() % times.k);
	times.t1_ns = (2 + next_octet() % 16) * S;
	times.t2_ns = times.t1_ns - S;
	times.t3_ns = (1 + next_octet() % 32) * S;
	now = 1000 * S;
	sent = written = 0;
	pending_size = 0;
	iec104_session_open(&session, &times, IEC104_CONTROLLED, counters, &memory, now);
	while (input.at < input.end)
		step();
	CHECK(written <= sent);
	return 0;
}
