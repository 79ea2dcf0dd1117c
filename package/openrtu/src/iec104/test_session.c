/* SPDX-License-Identifier: GPL-3.0-or-later */
/* The session in virtual time; frames are written out as octets. */
#include <setjmp.h>
#include <stdarg.h>
#include <stddef.h>
#include <stdint.h>
#include <stdlib.h>
#include <string.h>

#include <cmocka.h>

#include "iec104/session.h"

#define S 1000000000LL

static const struct iec104_times usual = {.k = 12, .w = 8, .t1_ns = 15 * S, .t2_ns = 10 * S, .t3_ns = 20 * S};
static const struct iec104_times one_at_a_time = {
    .k = 1, .w = 1, .t1_ns = 15 * S, .t2_ns = 10 * S, .t3_ns = 20 * S};

static struct iec104_session session;
static int64_t sent_ns[32767];
static uint8_t input_octets[IEC104_INPUT_SIZE], output_octets[IEC104_OUTPUT_SIZE];
static const struct iec104_memory memory = {.sent_ns = sent_ns,
					    .input = input_octets,
					    .output = output_octets,
					    .input_size = sizeof(input_octets),
					    .output_size = sizeof(output_octets)};
static int64_t now;
static _Atomic uint32_t counters[IEC104_COUNT_OF_COUNTERS];
static unsigned asdus; /* received */

static void open_session(const struct iec104_times *times)
{
	now = 1000 * S;
	asdus = 0;
	iec104_session_open(&session, times, IEC104_CONTROLLED, counters, &memory, now);
}

static void take_all(void)
{
	const uint8_t *asdu;
	size_t size;

	while (iec104_session_next(&session, now, &asdu, &size)) {
		asdus += asdu != NULL;
		iec104_session_run(&session, now);
	}
	iec104_session_run(&session, now);
}

static void receive(const uint8_t *bytes, size_t size)
{
	size_t room;
	uint8_t *place = iec104_session_space(&session, &room);

	assert_true(room >= size);
	memcpy(place, bytes, size);
	iec104_session_received(&session, size);
	take_all();
}

static void receive_frame(uint8_t c1, uint8_t c2, uint8_t c3, uint8_t c4)
{
	const uint8_t frame[] = {0x68, 0x04, c1, c2, c3, c4};

	receive(frame, sizeof(frame));
}

static void receive_u(uint8_t function)
{
	receive_frame(function, 0, 0, 0);
}

static void receive_s(unsigned nr)
{
	receive_frame(1, 0, (uint8_t)(nr << 1), (uint8_t)(nr >> 7));
}

static void receive_i(unsigned ns, unsigned nr)
{
	const uint8_t frame[] = {
	    0x68, 0x05, (uint8_t)(ns << 1), (uint8_t)(ns >> 7), (uint8_t)(nr << 1), (uint8_t)(nr >> 7), 0x2a};

	receive(frame, sizeof(frame));
}

static void send_one(void)
{
	assert_true(iec104_session_may_send(&session));
	iec104_session_send(&session, (const uint8_t[]){0x2a}, 1, now);
}

static void expect(const uint8_t *bytes, size_t size)
{
	size_t waiting;
	const uint8_t *output = iec104_session_output(&session, &waiting);

	assert_int_equal(waiting, size);
	if (size > 0)
		assert_memory_equal(output, bytes, size);
	iec104_session_written(&session, size);
}

#define EXPECT(...)        expect((const uint8_t[]){__VA_ARGS__}, sizeof((const uint8_t[]){__VA_ARGS__}))
#define EXPECT_U(function) EXPECT(0x68, 4, function, 0, 0, 0)

static void expect_nothing(void)
{
	expect(NULL, 0);
}

static void drop_output(void)
{
	size_t size;

	iec104_session_output(&session, &size);
	iec104_session_written(&session, size);
}

static void run_at(int64_t time)
{
	now = time;
	iec104_session_run(&session, now);
}

static void start(const struct iec104_times *times)
{
	open_session(times);
	receive_u(0x07);
	EXPECT_U(0x0b);
	assert_true(session.started);
}

static void test_start_and_stop(void **state)
{
	(void)state;
	start(&usual);
	receive_u(0x07); /* again: confirmed again */
	EXPECT_U(0x0b);
	receive_u(0x13);
	EXPECT_U(0x23);
	assert_false(session.started);
	receive_u(0x13);
	EXPECT_U(0x23);
	assert_false(iec104_session_may_send(&session));
	assert_int_equal(session.closing, IEC104_OPEN);
}

static void test_testfr_also_while_stopped(void **state)
{
	(void)state;
	open_session(&usual);
	receive_u(0x43);
	EXPECT_U(0x83);
	receive_u(0x83); /* not asked for */
	expect_nothing();
	assert_int_equal(session.closing, IEC104_OPEN);
}

static void test_stop_waits_for_acknowledgements(void **state)
{
	(void)state;
	start(&usual);
	send_one();
	send_one();
	receive_i(0, 0);
	drop_output();
	receive_u(0x13);
	EXPECT(0x68, 4, 0x01, 0, 0x02, 0); /* the received frame is acknowledged at once, the con waits */
	assert_false(iec104_session_may_send(&session));
	receive_s(1);
	expect_nothing();
	receive_s(2);
	EXPECT_U(0x23);
	receive_s(2); /* after STOPDT con: allowed */
	expect_nothing();
	assert_int_equal(session.closing, IEC104_OPEN);
}

static void test_t1_after_stop(void **state)
{
	(void)state;
	start(&usual);
	send_one();
	drop_output();
	receive_u(0x13);
	expect_nothing();
	run_at(now + 15 * S - 1);
	assert_int_equal(session.closing, IEC104_OPEN);
	run_at(now + 1);
	assert_int_equal(session.closing, IEC104_T1_I_FRAME);
}

static void test_i_while_stopped(void **state)
{
	(void)state;
	open_session(&usual);
	receive_i(0, 0);
	assert_int_equal(session.closing, IEC104_I_WHILE_STOPPED);
	start(&usual);
	send_one();
	receive_u(0x13); /* con is still to come, but the peer may not send any more */
	receive_i(0, 0);
	assert_int_equal(session.closing, IEC104_I_WHILE_STOPPED);
	assert_int_equal(asdus, 0);
	start(&usual);
	receive_u(0x13);
	receive_i(0, 0);
	assert_int_equal(session.closing, IEC104_I_WHILE_STOPPED);
}

static void test_sequence_errors(void **state)
{
	(void)state;
	start(&usual);
	receive_i(1, 0);
	assert_int_equal(session.closing, IEC104_BAD_NS);
	start(&usual);
	receive_i(0, 0);
	receive_i(0, 0);
	assert_int_equal(session.closing, IEC104_BAD_NS);
	start(&usual);
	receive_s(1);
	assert_int_equal(session.closing, IEC104_BAD_NR);
	start(&usual);
	send_one();
	send_one();
	receive_s(2);
	receive_s(2);
	assert_int_equal(session.closing, IEC104_OPEN);
	receive_s(1); /* was acknowledged before: going back is as wrong as going ahead */
	assert_int_equal(session.closing, IEC104_BAD_NR);
	assert_true(iec104_session_deadline(&session) == INT64_MAX);
}

static void test_k(void **state)
{
	(void)state;
	start(&usual);
	for (int i = 0; i < 12; i++)
		send_one();
	assert_false(iec104_session_may_send(&session));
	receive_s(1);
	send_one();
	assert_false(iec104_session_may_send(&session));
	receive_s(13);
	assert_int_equal(session.unacknowledged, 0);
	assert_int_equal(session.closing, IEC104_OPEN);
}

static void test_w(void **state)
{
	(void)state;
	start(&usual);
	for (unsigned i = 0; i < 7; i++)
		receive_i(i, 0);
	expect_nothing();
	receive_i(7, 0);
	EXPECT(0x68, 4, 0x01, 0, 0x10, 0);
	receive_i(8, 0);
	send_one(); /* an own I frame acknowledges */
	EXPECT(0x68, 5, 0x00, 0, 0x12, 0, 0x2a);
	run_at(now + 10 * S);
	expect_nothing();
}

static void test_k_and_w_of_one(void **state)
{
	(void)state;
	start(&one_at_a_time);
	for (unsigned i = 0; i < 40000; i++) {
		receive_i(i % 32768, i % 32768);
		EXPECT(0x68, 4, 0x01, 0, (uint8_t)((i + 1) << 1), (uint8_t)((i + 1) % 32768 >> 7));
		send_one();
		assert_false(iec104_session_may_send(&session));
		EXPECT(0x68, 5, (uint8_t)(i << 1), (uint8_t)(i % 32768 >> 7), (uint8_t)((i + 1) << 1),
		       (uint8_t)((i + 1) % 32768 >> 7), 0x2a);
	}
	assert_int_equal(session.closing, IEC104_OPEN);
}

/* More than 40 000 frames each way with a large k: the ring of times and the 15 bits wrap at different places. */
/* What the owner holds is acknowledged by nothing: not by w, not by t2, not by an I frame of our own. */
static void test_held_frames_are_acknowledged_when_released(void **state)
{
	(void)state;
	start(&usual);
	iec104_session_hold(&session);
	for (unsigned i = 0; i < 10; i++)
		receive_i(i, 0);
	expect_nothing();
	run_at(now + 11 * S);
	expect_nothing();
	receive_u(0x43); /* t3 begins anew */
	EXPECT_U(0x83);
	send_one();
	EXPECT(0x68, 5, 0, 0, 0, 0, 0x2a); /* N(R) 0 */
	receive_s(1);
	iec104_session_release(&session, 8, now);
	run_at(now);
	EXPECT(0x68, 4, 1, 0, 16, 0); /* w */
	iec104_session_release(&session, 1, now);
	run_at(now);
	expect_nothing();
	run_at(now + 10 * S);
	EXPECT(0x68, 4, 1, 0, 18, 0);               /* t2 */
	iec104_session_release(&session, 100, now); /* there is one */
	assert_int_equal(session.held, 0);
	receive_i(10, 1);
	send_one();
	EXPECT(0x68, 5, 2, 0, 20, 0, 0x2a); /* ten of eleven */
}

static void test_wrap_with_many_unacknowledged(void **state)
{
	static const struct iec104_times wide = {
	    .k = 3000, .w = 2000, .t1_ns = 15 * S, .t2_ns = 10 * S, .t3_ns = 20 * S};
	unsigned sent = 0;

	(void)state;
	start(&wide);
	while (sent < 41000) {
		for (int i = 0; i < 1000; i++, sent++) {
			now += S / 1000;
			send_one();
			drop_output();
		}
		now += S;
		receive_s((sent - 500) % 32768);
		assert_int_equal(session.unacknowledged, 500);
		assert_true(iec104_session_deadline(&session) == now - S - 499 * (S / 1000) + 15 * S);
	}
	assert_int_equal(session.closing, IEC104_OPEN);
}

static void test_t1_counts_from_the_oldest_frame(void **state)
{
	(void)state;
	start(&usual);
	send_one();
	now += 5 * S;
	send_one();
	drop_output();
	now += 5 * S;
	receive_s(1);
	run_at(1000 * S + 15 * S);
	assert_int_equal(session.closing, IEC104_OPEN);
	assert_true(iec104_session_deadline(&session) == 1000 * S + 20 * S);
	run_at(1000 * S + 20 * S);
	assert_int_equal(session.closing, IEC104_T1_I_FRAME);
}

static void test_t1_is_cleared_when_all_is_acknowledged(void **state)
{
	(void)state;
	start(&usual);
	send_one();
	drop_output();
	now += 14 * S;
	receive_s(1);
	run_at(now + 19 * S);
	assert_int_equal(session.closing, IEC104_OPEN);
}

static void test_t2_counts_from_the_first_frame(void **state)
{
	(void)state;
	start(&usual);
	receive_i(0, 0);
	now += 6 * S;
	receive_i(1, 0);
	run_at(1000 * S + 10 * S - 1);
	expect_nothing();
	run_at(1000 * S + 10 * S);
	EXPECT(0x68, 4, 0x01, 0, 0x04, 0);
	run_at(1000 * S + 16 * S);
	expect_nothing();
}

static void test_t3_and_t1_of_testfr(void **state)
{
	(void)state;
	open_session(&usual);
	assert_true(iec104_session_deadline(&session) == 1020 * S);
	run_at(1020 * S - 1);
	expect_nothing();
	run_at(1020 * S);
	EXPECT_U(0x43);
	assert_true(iec104_session_deadline(&session) == 1035 * S);
	now += 5 * S;
	receive_u(0x83);
	assert_true(iec104_session_deadline(&session) == 1045 * S);
	run_at(1045 * S);
	EXPECT_U(0x43);
	now += 14 * S;
	receive_u(0x43); /* any other frame is no confirmation */
	EXPECT_U(0x83);
	run_at(1060 * S);
	assert_int_equal(session.closing, IEC104_T1_TESTFR);
}

static void test_t3_restarts_with_every_frame(void **state)
{
	(void)state;
	start(&usual);
	now += 19 * S;
	receive_i(0, 0);
	assert_true(iec104_session_deadline(&session) == now + 10 * S);
	run_at(now + 19 * S);
	drop_output();
	run_at(now + 1 * S);
	EXPECT_U(0x43);
}

/* A peer that sends an octet now and then does not hold its place: only a whole frame proves that it lives. */
static void test_octets_are_no_frame(void **state)
{
	static const uint8_t frame[200] = {0x68, 0xfd};

	(void)state;
	open_session(&usual);
	for (unsigned i = 0; i < 20; i++) {
		receive(&frame[i], 1);
		run_at(now + 1 * S);
	}
	EXPECT_U(0x43);
	for (unsigned i = 20; i < 35; i++) {
		receive(&frame[i], 1);
		run_at(now + 1 * S);
	}
	assert_int_equal(session.closing, IEC104_T1_TESTFR);
}

/* STARTDT act, three I frames with different lengths, S, TESTFR act; cut in two at every octet, then octet by octet. */
static void test_splits_at_every_octet(void **state)
{
	static const uint8_t stream[] = {
	    0x68, 4, 0x07, 0, 0, 0, 0x68, 5, 0, 0,    0, 0, 1, 0x68, 6, 2,    0, 0,    0, 1, 2,
	    0x68, 7, 4,    0, 0, 0, 1,    2, 3, 0x68, 4, 1, 0, 0,    0, 0x68, 4, 0x43, 0, 0, 0,
	};

	(void)state;
	for (size_t cut = 0; cut <= sizeof(stream); cut++) {
		open_session(&usual);
		receive(stream, cut);
		receive(stream + cut, sizeof(stream) - cut);
		EXPECT(0x68, 4, 0x0b, 0, 0, 0, 0x68, 4, 0x83, 0, 0, 0);
		assert_int_equal(asdus, 3);
	}
	open_session(&usual);
	for (size_t i = 0; i < sizeof(stream); i++)
		receive(stream + i, 1);
	EXPECT(0x68, 4, 0x0b, 0, 0, 0, 0x68, 4, 0x83, 0, 0, 0);
	assert_int_equal(asdus, 3);
}

static void test_wrong_frames_close(void **state)
{
	static const uint8_t wrong[][2] = {{0x67, 4}, {0x68, 0}, {0x68, 3}, {0x68, 254}, {0x68, 255}};

	(void)state;
	for (size_t i = 0; i < sizeof(wrong) / sizeof(wrong[0]); i++) {
		open_session(&usual);
		receive(wrong[i], 2);
		assert_int_equal(session.closing, IEC104_BAD_APDU);
	}
	open_session(&usual);
	receive((const uint8_t[]){0x16}, 1);
	assert_int_equal(session.closing, IEC104_BAD_APDU);
	start(&usual);
	receive((const uint8_t[]){0x68, 4, 0, 0, 0, 0}, 6); /* an I frame without an ASDU */
	assert_int_equal(session.closing, IEC104_BAD_APDU);
}

static void test_largest_frame(void **state)
{
	uint8_t frame[255] = {0x68, 253}, asdu[249];

	(void)state;
	start(&usual);
	receive(frame, sizeof(frame));
	assert_int_equal(asdus, 1);
	memset(asdu, 0x5a, sizeof(asdu));
	iec104_session_send(&session, asdu, sizeof(asdu), now);
	frame[4] = 2;
	memset(frame + 6, 0x5a, 249);
	expect(frame, sizeof(frame));
}

/* The peer takes nothing: sending stops, then taking requests stops; nothing is lost or changed in order. */
static void test_peer_takes_nothing(void **state)
{
	static const struct iec104_times wide = {
	    .k = 1000, .w = 500, .t1_ns = 15 * S, .t2_ns = 10 * S, .t3_ns = 20 * S};
	static const uint8_t test[] = {0x68, 4, 0x43, 0, 0, 0};
	uint8_t asdu[249] = {0};
	unsigned frames = 0, confirmations = 0;
	size_t size, room;

	(void)state;
	start(&wide);
	while (iec104_session_may_send(&session)) {
		asdu[0] = (uint8_t)frames++;
		iec104_session_send(&session, asdu, sizeof(asdu), now);
	}
	assert_int_equal(frames, 15);
	for (;;) {
		uint8_t *place = iec104_session_space(&session, &room);

		if (room < sizeof(test))
			break;
		memcpy(place, test, sizeof(test));
		iec104_session_received(&session, sizeof(test));
		confirmations++;
		take_all();
	}
	assert_int_equal(session.closing, IEC104_OPEN);
	for (unsigned i = 0; i < frames; i++) {
		const uint8_t *output = iec104_session_output(&session, &size);

		assert_true(size >= 255);
		assert_int_equal(output[2], i << 1);
		assert_int_equal(output[6], i);
		iec104_session_written(&session, 255);
		take_all();
	}
	for (; confirmations > 0; confirmations--) {
		const uint8_t *output = iec104_session_output(&session, &size);

		assert_true(size >= 6);
		assert_int_equal(output[2], 0x83);
		iec104_session_written(&session, 6);
		take_all();
	}
	expect_nothing();
}

/* xorshift32: the same frames in every run. */
static uint32_t random_state;

static uint32_t random_below(uint32_t limit)
{
	random_state ^= random_state << 13;
	random_state ^= random_state >> 17;
	random_state ^= random_state << 5;
	return random_state % limit;
}

static size_t random_frame(uint8_t *frame)
{
	static const uint8_t functions[] = {0x07, 0x07, 0x13, 0x43, 0x83, 0x0b, 0x23, 0x01};
	uint32_t kind = random_below(20);
	size_t size = kind < 8 ? 7 + random_below(249) : 6;

	memset(frame, 0, 6);
	frame[0] = 0x68;
	frame[1] = (uint8_t)(size - 2);
	if (kind < 8) {
		uint32_t nr = session.next_ns - random_below(2), ns = session.next_nr;

		frame[2] = (uint8_t)(ns << 1);
		frame[3] = (uint8_t)(ns >> 7);
		frame[4] = (uint8_t)(nr << 1);
		frame[5] = (uint8_t)(nr >> 7);
	} else if (kind < 19) {
		frame[2] = functions[random_below(8)];
	} else {
		for (size_t i = 0; i < size; i++)
			frame[i] = (uint8_t)random_below(256);
	}
	if (random_below(50) == 0)
		frame[random_below(6)] ^= (uint8_t)(1u << random_below(8));
	return size;
}

static void random_step(void)
{
	static uint8_t asdu[249];
	uint8_t frame[255];
	size_t size, room, taken = random_frame(frame);
	uint8_t *place = iec104_session_space(&session, &room);

	if (taken > room)
		taken = room;
	memcpy(place, frame, taken);
	iec104_session_received(&session, taken);
	now += random_below(4) * S;
	take_all();
	while (iec104_session_may_send(&session) && random_below(3))
		iec104_session_send(&session, asdu, 1 + random_below(249), now);
	iec104_session_output(&session, &size);
	iec104_session_written(&session, size > 0 ? random_below((uint32_t)size + 1) : 0);
	assert_true(session.unacknowledged <= session.times->k);
	assert_true(session.output_end <= sizeof(output_octets));
}

static void test_random_streams(void **state)
{
	(void)state;
	for (uint32_t seed = 1; seed <= 3000; seed++) {
		random_state = seed;
		open_session(seed % 2 ? &usual : &one_at_a_time);
		for (int step = 0; step < 200 && session.closing == IEC104_OPEN; step++)
			random_step();
	}
}

int main(void)
{
	const struct CMUnitTest tests[] = {
	    cmocka_unit_test(test_start_and_stop),
	    cmocka_unit_test(test_testfr_also_while_stopped),
	    cmocka_unit_test(test_stop_waits_for_acknowledgements),
	    cmocka_unit_test(test_t1_after_stop),
	    cmocka_unit_test(test_i_while_stopped),
	    cmocka_unit_test(test_sequence_errors),
	    cmocka_unit_test(test_k),
	    cmocka_unit_test(test_w),
	    cmocka_unit_test(test_k_and_w_of_one),
	    cmocka_unit_test(test_held_frames_are_acknowledged_when_released),
	    cmocka_unit_test(test_wrap_with_many_unacknowledged),
	    cmocka_unit_test(test_t1_counts_from_the_oldest_frame),
	    cmocka_unit_test(test_t1_is_cleared_when_all_is_acknowledged),
	    cmocka_unit_test(test_t2_counts_from_the_first_frame),
	    cmocka_unit_test(test_t3_and_t1_of_testfr),
	    cmocka_unit_test(test_t3_restarts_with_every_frame),
	    cmocka_unit_test(test_octets_are_no_frame),
	    cmocka_unit_test(test_splits_at_every_octet),
	    cmocka_unit_test(test_wrong_frames_close),
	    cmocka_unit_test(test_largest_frame),
	    cmocka_unit_test(test_peer_takes_nothing),
	    cmocka_unit_test(test_random_streams),
	};

	return cmocka_run_group_tests(tests, NULL, NULL);
}
