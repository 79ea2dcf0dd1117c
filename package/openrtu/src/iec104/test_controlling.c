/* SPDX-License-Identifier: GPL-3.0-or-later */
/*
 * The controlling station in virtual time: back to back with our controlled station on the map that the test holds in its hand,
 * or against octets written out.
 */
#include "iec104/controlling.h"

#include <string.h>

#include "iec104/test_masters.h"

#define K    12
#define SEEN 256

static struct iec104_controlling_settings settings;
static struct iec104_controlling polling;
static int64_t times_of_sending[K];
static uint8_t input_octets[IEC104_INPUT_SIZE], output_octets[IEC104_OUTPUT_SIZE];
static const struct iec104_memory memory = {.sent_ns = times_of_sending,
					    .input = input_octets,
					    .output = output_octets,
					    .input_size = sizeof(input_octets),
					    .output_size = sizeof(output_octets)};
static struct iec104_session *peer; /* of the station's connection */
static size_t piece;                /* so many octets arrive at a time */
static unsigned answered;           /* requests to the map */
static bool devices_refuse;

static struct seen {
	uint8_t type, cause;
	uint16_t ca;
	struct iec104_information information;
} seen[SEEN];
static unsigned seen_count, position_count;
static struct iec104_geoposition last_position;
static struct iec104_controlling_request steps[SEEN];
static unsigned step_count;

static struct iec104_moment moment(void)
{
	return (struct iec104_moment){.monotonic_ns = now, .wall_ns = WALL_NS};
}

static void on_information(void *context, const struct iec104_asdu *asdu,
			   const struct iec104_information *information)
{
	(void)context;
	assert_true(seen_count < SEEN);
	seen[seen_count++] = (struct seen){asdu->type, asdu->cause, asdu->ca, *information};
}

static void on_position(void *context, const struct iec104_asdu *asdu, uint32_t ioa,
			const struct iec104_geoposition *position)
{
	(void)context;
	assert_int_equal(asdu->type, IEC104_GEOPOSITION);
	assert_int_equal(ioa, 7);
	last_position = *position;
	position_count++;
}

static void on_progress(void *context, const struct iec104_controlling_request *request)
{
	(void)context;
	assert_true(step_count < SEEN);
	steps[step_count++] = *request;
}

static const struct iec104_controlling_listener listener = {
    .information = on_information, .position = on_position, .progress = on_progress};

/* ---- octets between both ----------------------------------------------------------------- */

static bool carry(struct iec104_session *from, struct iec104_session *to)
{
	size_t size, room;
	const uint8_t *octets = iec104_session_output(from, &size);
	uint8_t *place = iec104_session_space(to, &room);

	if (size > piece)
		size = piece;
	if (size > room)
		size = room;
	memcpy(place, octets, size);
	iec104_session_received(to, size);
	iec104_session_written(from, size);
	return size > 0;
}

static void answer_requests(void)
{
	static const enum map_command_state done[] = {[MAP_SELECT] = MAP_ACCEPTED_SELECTION,
						      [MAP_EXECUTE] = MAP_EXECUTED_COMMAND,
						      [MAP_CANCEL] = MAP_INTERRUPTED_SELECTION,
						      [MAP_SET_CLOCK] = MAP_EXECUTED_COMMAND};

	for (; answered < fake.request_count; answered++) {
		uint8_t action = fake.requests[answered].action;

		if (action == MAP_RELEASE)
			continue;
		if (devices_refuse)
			answer(answered + 1,
			       action == MAP_SELECT ? MAP_REFUSED_SELECTION : MAP_REFUSED_COMMAND,
			       MAP_RESULT_EXCEPTION);
		else
			answer(answered + 1, done[action], MAP_RESULT_DONE);
	}
}

static void turn(void)
{
	iec104_controlling_run(&polling, moment());
	run();
	answer_requests();
	run();
}

static void pump(void)
{
	bool moved = true;

	for (turn(); moved; turn()) {
		moved = carry(&polling.session, peer);
		moved |= carry(peer, &polling.session);
	}
}

static void open_polling(void)
{
	iec104_controlling_open(&polling, &settings, &listener, &memory, moment());
	seen_count = position_count = step_count = answered = 0;
	devices_refuse = false;
	piece = SIZE_MAX;
}

static int set_up_polling(void **state)
{
	(void)state;
	settings = (struct iec104_controlling_settings){
	    .times = {.k = K, .w = 8, .t1_ns = 15 * S, .t2_ns = 10 * S, .t3_ns = 20 * S},
	    .position_type = IEC104_GEOPOSITION,
	    .requests_max = 4,
	    .confirmation_ns = 5 * S,
	    .selection_ns = 30 * S,
	    .termination_ns = 20 * S,
	    .interrogation_ns = 60 * S};
	fake_begin();
	iec104_station_init(&station, &fake, sent_ns, places);
	connect_master(0, true);
	peer = &masters[0].connection->session;
	open_polling();
	return 0;
}

static int set_up_started(void **state)
{
	set_up_polling(state);
	iec104_session_start(&polling.session, now);
	pump();
	assert_true(polling.session.started);
	return 0;
}

/* What a server writes that is not ours. */
static void receive(const uint8_t *octets, size_t size)
{
	size_t room;
	uint8_t *place = iec104_session_space(&polling.session, &room);

	assert_true(size <= room);
	memcpy(place, octets, size);
	iec104_session_received(&polling.session, size);
	iec104_controlling_run(&polling, moment());
}

#define RECEIVE(...) receive((const uint8_t[]){__VA_ARGS__}, sizeof((const uint8_t[]){__VA_ARGS__}))

/* An I frame in sequence, which acknowledges all. */
static void receive_asdu(const uint8_t *asdu, size_t size)
{
	uint8_t frame[IEC104_APDU_MAX];

	iec104_apdu_encode(frame, &(struct iec104_apdu){.format = IEC104_I_FRAME,
							.ns = polling.session.next_nr,
							.nr = polling.session.next_ns,
							.asdu_size = size});
	memcpy(frame + IEC104_APCI_SIZE, asdu, size);
	receive(frame, IEC104_APCI_SIZE + size);
}

#define RECEIVE_ASDU(...) receive_asdu((const uint8_t[]){__VA_ARGS__}, sizeof((const uint8_t[]){__VA_ARGS__}))

static void run_at(int64_t time)
{
	now = time;
	iec104_controlling_run(&polling, moment());
}

static void expect_step(unsigned step, enum map_command_state state, enum map_command_result result)
{
	assert_true(step < step_count);
	assert_int_equal(steps[step].state, state);
	assert_int_equal(steps[step].result, result);
}

/* ---- the connection ---------------------------------------------------------------------- */

static void test_startdt_without_confirmation(void **state)
{
	(void)state;
	iec104_session_start(&polling.session, now);
	iec104_session_start(&polling.session, now); /* once */
	assert_int_equal(polling.counters[IEC104_COUNT_STARTDT_ACT_OUT], 1);
	assert_int_equal(iec104_controlling_interrogate(&polling, 3067, 20, moment()), 0);
	assert_true(iec104_controlling_deadline(&polling) == now + 15 * S);
	run_at(now + 15 * S - 1);
	assert_int_equal(polling.session.closing, IEC104_OPEN);
	run_at(now + 1);
	assert_int_equal(polling.session.closing, IEC104_T1_STARTDT);
	assert_true(iec104_controlling_deadline(&polling) == INT64_MAX);
}

static void test_stands_by_stopped(void **state)
{
	(void)state;
	RECEIVE(0x68, 4, 0x0b, 0, 0, 0); /* a confirmation that was not asked for starts nothing */
	assert_false(polling.session.started);
	run_at(now + 20 * S);
	pump();
	assert_int_equal(polling.counters[IEC104_COUNT_TESTFR_ACT_OUT], 1);
	assert_int_equal(polling.counters[IEC104_COUNT_TESTFR_CON_IN], 1);
	run_at(now + 20 * S);
	run_at(now + 15 * S); /* unanswered */
	assert_int_equal(polling.session.closing, IEC104_T1_TESTFR);
}

static void test_answers_testfr(void **state)
{
	(void)state;
	RECEIVE(0x68, 4, 0x43, 0, 0, 0);
	assert_int_equal(polling.counters[IEC104_COUNT_TESTFR_CON_OUT], 1);
}

static void test_controlled_station_does_not_start_or_stop(void **state)
{
	(void)state;
	RECEIVE(0x68, 4, 0x07, 0, 0, 0);
	assert_int_equal(polling.session.closing, IEC104_STARTED_BY_PEER);
	open_polling();
	RECEIVE(0x68, 4, 0x13, 0, 0, 0);
	assert_int_equal(polling.session.closing, IEC104_STARTED_BY_PEER);
	assert_string_equal(iec104_closing_text(polling.session.closing),
			    "STARTDT act or STOPDT act from the controlled station");
}

static void test_information_before_start(void **state)
{
	(void)state;
	iec104_session_start(&polling.session, now);
	RECEIVE_ASDU(1, 1, 3, 0, 1, 0, 1, 0, 0, 1);
	assert_int_equal(polling.session.closing, IEC104_I_WHILE_STOPPED);
	assert_int_equal(seen_count, 0);
}

static void test_unacknowledged_request(void **state)
{
	(void)state;
	iec104_controlling_read(&polling, 3067, 1, moment());
	run_at(now + 15 * S);
	assert_int_equal(polling.session.closing, IEC104_T1_I_FRAME);
}

static void test_acknowledges_at_w_and_t2(void **state)
{
	(void)state;
	for (unsigned i = 0; i < settings.times.w - 1u; i++)
		RECEIVE_ASDU(1, 1, 3, 0, 1, 0, 1, 0, 0, 1);
	assert_int_equal(polling.counters[IEC104_COUNT_S_OUT], 0);
	RECEIVE_ASDU(1, 1, 3, 0, 1, 0, 1, 0, 0, 1);
	assert_int_equal(polling.counters[IEC104_COUNT_S_OUT], 1);
	RECEIVE_ASDU(1, 1, 3, 0, 1, 0, 1, 0, 0, 1);
	run_at(now + 10 * S);
	assert_int_equal(polling.counters[IEC104_COUNT_S_OUT], 2);
}

static void test_sends_no_more_than_k(void **state)
{
	(void)state;
	settings.times.k = 2;
	settings.times.w = 2;
	assert_int_not_equal(iec104_controlling_read(&polling, 3067, 1, moment()), 0);
	assert_int_not_equal(iec104_controlling_read(&polling, 3067, 2, moment()), 0);
	assert_int_equal(iec104_controlling_read(&polling, 3067, 3, moment()), 0);
	pump();
	assert_int_not_equal(iec104_controlling_read(&polling, 3067, 3, moment()), 0);
}

/* ---- what a station has ------------------------------------------------------------------ */

static void interrogate(uint16_t ca, uint8_t qoi)
{
	uint32_t id = iec104_controlling_interrogate(&polling, ca, qoi, moment());

	assert_int_not_equal(id, 0);
	pump();
	assert_int_equal(step_count, 2);
	expect_step(0, MAP_EXECUTING, MAP_RESULT_NONE);
	expect_step(1, MAP_EXECUTED_COMMAND, MAP_RESULT_DONE);
	assert_int_equal(steps[1].id, id);
}

static void test_general_interrogation(void **state)
{
	(void)state;
	piece = 1; /* octet by octet */
	interrogate(3067, 20);
	assert_int_equal(seen_count, 13);
	for (unsigned i = 0; i < seen_count; i++) {
		assert_int_equal(seen[i].ca, 3067);
		assert_int_equal(seen[i].cause, IEC104_INTERROGATED);
		assert_int_equal(seen[i].information.ioa, points[i].ioa);
		assert_int_equal(seen[i].information.value.i, fake.samples[i].value.i);
		assert_int_equal(seen[i].information.quality, 0);
	}
}

static void test_group_interrogation(void **state)
{
	(void)state;
	interrogate(4001, 22);
	assert_int_equal(seen_count, 2); /* the counter is not of an interrogation */
	assert_int_equal(seen[0].cause, 22);
	assert_int_equal(seen[0].information.content, IEC104_DOUBLE);
	assert_int_equal(seen[1].information.content, IEC104_NORMALIZED);
}

static void test_counter_interrogation(void **state)
{
	(void)state;
	fake.samples[COUNTER].value.i = 1234;
	assert_int_not_equal(iec104_controlling_interrogate_counters(&polling, 4001, 5, moment()), 0);
	pump();
	expect_step(1, MAP_EXECUTED_COMMAND, MAP_RESULT_DONE);
	assert_int_equal(seen_count, 1);
	assert_int_equal(seen[0].information.content, IEC104_TOTAL);
	assert_int_equal(seen[0].information.value.i, 1234);
}

static void test_read(void **state)
{
	(void)state;
	iec104_controlling_read(&polling, 4001, 11, moment());
	pump();
	assert_int_equal(step_count, 1);
	expect_step(0, MAP_EXECUTED_COMMAND, MAP_RESULT_DONE);
	assert_int_equal(seen[0].cause, IEC104_REQUEST);
	assert_true(seen[0].information.value.f == 1.5f);
	iec104_controlling_read(&polling, 4001, 12, moment()); /* there is none */
	pump();
	expect_step(1, MAP_REFUSED_COMMAND, MAP_RESULT_EXCEPTION);
	assert_int_equal(steps[1].cause, IEC104_UNKNOWN_IOA);
}

static void test_clock(void **state)
{
	(void)state;
	iec104_controlling_set_clock(&polling, 3067, moment());
	pump();
	assert_int_equal(step_count, 1);
	expect_step(0, MAP_EXECUTED_COMMAND, MAP_RESULT_DONE);
	assert_int_equal(fake.requests[0].action, MAP_SET_CLOCK);
	assert_true(fake.requests[0].wall_ns == WALL_NS);
}

static void test_events(void **state)
{
	(void)state;
	publish(COIL4, 1);
	pump();
	assert_int_equal(seen_count, 1);
	assert_int_equal(seen[0].type, IEC104_M_SP_TB_1);
	assert_int_equal(seen[0].cause, IEC104_SPONTANEOUS);
	assert_true(seen[0].information.wall_ns == WALL_NS);
}

static void test_end_of_initialisation(void **state)
{
	(void)state;
	RECEIVE_ASDU(70, 1, 4, 0, 0xfb, 0x0b, 0, 0, 0, 2);
	assert_int_equal(seen[0].information.content, IEC104_INITIALISATION);
	assert_int_equal(seen[0].information.value.u, 2);
}

static void test_position(void **state)
{
	struct iec104_geoposition position = {
	    .latitude = 522190650, .longitude = 210108517, .wall_ns = WALL_NS};
	uint8_t asdu[9 + IEC104_GEOPOSITION_SIZE] = {IEC104_GEOPOSITION, 1, 3, 0, 1, 0, 7, 0, 0};

	(void)state;
	iec104_geoposition_encode(asdu + 9, &position, &settings.zone);
	receive_asdu(asdu, sizeof(asdu));
	assert_int_equal(position_count, 1);
	assert_int_equal(last_position.latitude, position.latitude);
	receive_asdu(asdu, sizeof(asdu) - 1); /* another's type 201 */
	position.latitude = 910000000;
	iec104_geoposition_encode(asdu + 9, &position, &settings.zone);
	receive_asdu(asdu, sizeof(asdu));
	RECEIVE_ASDU(126, 1, 3, 0, 1, 0, 7, 0, 0);
	assert_int_equal(position_count, 1);
	assert_int_equal(polling.unknown_types, 3);
	assert_int_equal(polling.session.closing, IEC104_OPEN);
}

/* ---- commands ---------------------------------------------------------------------------- */

static void test_direct_commands(void **state)
{
	static const struct {
		uint16_t ca;
		struct iec104_command command;
	} commands[] = {
	    {3067, {.ioa = 4, .type = MAP_SINGLE, .value.u = 1, .qualifier = 1}},
	    {3067, {.ioa = 40001, .type = MAP_SCALED, .value.i = -2}},
	    {4001, {.ioa = 1, .type = MAP_DOUBLE, .value.u = 2, .tagged = true}},
	    {4001, {.ioa = 7, .type = MAP_BITSTRING, .value.u = 0x92345678}},
	    {4001, {.ioa = 9, .type = MAP_NORMALIZED, .value.i = -16384, .tagged = true}},
	    {4001, {.ioa = 11, .type = MAP_FLOAT, .value.f = 2.5f}},
	};

	(void)state;
	for (unsigned i = 0; i < sizeof(commands) / sizeof(commands[0]); i++) {
		uint32_t before = fake.request_count;

		step_count = 0;
		assert_int_not_equal(
		    iec104_controlling_command(&polling, commands[i].ca, &commands[i].command, moment()), 0);
		pump();
		assert_int_equal(step_count, 2);
		expect_step(0, MAP_EXECUTING, MAP_RESULT_NONE);
		expect_step(1, MAP_EXECUTED_COMMAND, MAP_RESULT_DONE);
		assert_int_equal(fake.requests[before].action, MAP_EXECUTE);
		assert_int_equal(fake.requests[before].value.u, commands[i].command.value.u);
	}
	assert_int_equal(fake.requests[0].pulse_ms, 500);
}

static void test_step_command(void **state)
{
	const struct iec104_command higher = {.ioa = 40003, .type = MAP_STEP, .step = 1},
				    lower = {.ioa = 40003, .type = MAP_STEP, .step = -1},
				    none = {.ioa = 40003, .type = MAP_STEP};

	(void)state;
	assert_int_equal(iec104_controlling_command(&polling, 3067, &none, moment()), 0);
	iec104_controlling_command(&polling, 3067, &higher, moment());
	pump();
	assert_int_equal(fake.requests[0].step, 1);
	step_count = 0;
	iec104_controlling_command(&polling, 3067, &lower, moment());
	pump();
	expect_step(1, MAP_EXECUTED_COMMAND, MAP_RESULT_DONE);
	assert_int_equal(fake.requests[2].step, -1);
}

static const struct iec104_command select_coil4 = {
    .ioa = 4, .type = MAP_SINGLE, .value.u = 1, .select = true};

static uint32_t selected(void)
{
	uint32_t id = iec104_controlling_command(&polling, 3067, &select_coil4, moment());

	assert_false(iec104_controlling_execute(&polling, id, moment())); /* not accepted yet */
	pump();
	assert_int_equal(step_count, 1);
	expect_step(0, MAP_ACCEPTED_SELECTION, MAP_RESULT_NONE);
	assert_int_equal(fake.requests[0].action, MAP_SELECT);
	return id;
}

static void test_select_and_execute(void **state)
{
	uint32_t id = selected();

	(void)state;
	assert_true(iec104_controlling_execute(&polling, id, moment()));
	pump();
	assert_int_equal(step_count, 3);
	expect_step(1, MAP_EXECUTING, MAP_RESULT_NONE);
	expect_step(2, MAP_EXECUTED_COMMAND, MAP_RESULT_DONE);
	assert_int_equal(steps[2].id, id);
	assert_int_equal(fake.requests[1].action, MAP_EXECUTE);
	assert_false(iec104_controlling_execute(&polling, id, moment()));
}

static void test_select_and_cancel(void **state)
{
	uint32_t id = selected();

	(void)state;
	assert_true(iec104_controlling_cancel(&polling, id, moment()));
	pump();
	assert_int_equal(step_count, 2);
	expect_step(1, MAP_INTERRUPTED_SELECTION, MAP_RESULT_DONE);
	assert_int_equal(fake.requests[1].action, MAP_CANCEL);
}

static void test_selection_that_is_forgotten(void **state)
{
	(void)state;
	selected();
	now += 16 * S;
	pump();
	run_at(now + 14 * S);
	expect_step(1, MAP_INTERRUPTED_SELECTION, MAP_RESULT_TIMEOUT);
}

static void test_refusals(void **state)
{
	const struct iec104_command coil = {.ioa = 4, .type = MAP_SINGLE}, nowhere = {.ioa = 99};

	(void)state;
	devices_refuse = true;
	iec104_controlling_command(&polling, 3067, &select_coil4, moment());
	pump();
	expect_step(0, MAP_REFUSED_SELECTION, MAP_RESULT_EXCEPTION);
	assert_int_equal(steps[0].cause, IEC104_ACTIVATION_CON);
	iec104_controlling_command(&polling, 3067, &coil, moment());
	pump();
	expect_step(1, MAP_REFUSED_COMMAND, MAP_RESULT_EXCEPTION);
	iec104_controlling_command(&polling, 3067, &nowhere, moment());
	iec104_controlling_command(&polling, 3068, &coil, moment());
	pump();
	assert_int_equal(steps[2].cause, IEC104_UNKNOWN_IOA);
	assert_int_equal(steps[3].cause, IEC104_UNKNOWN_CA);
	assert_int_equal(step_count, 4);
}

static void test_no_confirmation_and_no_termination(void **state)
{
	const struct iec104_command coil = {.ioa = 4, .type = MAP_SINGLE, .value.u = 1};

	(void)state;
	iec104_controlling_command(&polling, 1, &coil, moment());
	assert_true(iec104_controlling_deadline(&polling) == now + 5 * S);
	run_at(now + 5 * S);
	expect_step(0, MAP_REFUSED_COMMAND, MAP_RESULT_TIMEOUT);
	RECEIVE_ASDU(45, 1, 7, 0, 1, 0, 4, 0, 0, 1); /* too late */
	assert_int_equal(polling.unexpected, 1);
	iec104_controlling_command(&polling, 1, &coil, moment());
	RECEIVE_ASDU(45, 1, 7, 0, 1, 0, 4, 0, 0, 1);
	expect_step(1, MAP_EXECUTING, MAP_RESULT_NONE);
	run_at(now + 19 * S);
	RECEIVE(0x68, 4, 0x43, 0, 0, 0);
	run_at(now + 1 * S);
	expect_step(2, MAP_REFUSED_COMMAND, MAP_RESULT_TIMEOUT);
	assert_int_equal(step_count, 3);
}

static void test_station_without_terminations(void **state)
{
	const struct iec104_command coil = {.ioa = 4, .type = MAP_SINGLE, .value.u = 1};

	(void)state;
	settings.termination_ns = 0;
	iec104_controlling_command(&polling, 1, &coil, moment());
	RECEIVE_ASDU(45, 1, 7, 0, 1, 0, 4, 0, 0, 1);
	assert_int_equal(step_count, 1);
	expect_step(0, MAP_EXECUTED_COMMAND, MAP_RESULT_DONE);
}

static void test_failed_termination(void **state)
{
	const struct iec104_command coil = {.ioa = 4, .type = MAP_SINGLE, .value.u = 1};

	(void)state;
	iec104_controlling_command(&polling, 1, &coil, moment());
	RECEIVE_ASDU(45, 1, 7, 0, 1, 0, 4, 0, 0, 1);
	RECEIVE_ASDU(45, 1, 0x4a, 0, 1, 0, 4, 0, 0, 1);
	expect_step(1, MAP_REFUSED_COMMAND, MAP_RESULT_EXCEPTION);
	assert_int_equal(steps[1].cause, IEC104_ACTIVATION_TERM);
}

/* What answers no request as it was sent changes none. */
static void test_answers_to_something_else(void **state)
{
	const struct iec104_command coil = {.ioa = 4, .type = MAP_SINGLE, .value.u = 1};

	(void)state;
	iec104_controlling_command(&polling, 1, &coil, moment());
	RECEIVE_ASDU(45, 1, 7, 0, 1, 0, 4, 0, 0, 0);    /* another value */
	RECEIVE_ASDU(45, 1, 7, 0, 1, 0, 4, 0, 0, 0x81); /* of a selection */
	RECEIVE_ASDU(45, 1, 7, 0, 1, 0, 5, 0, 0, 1);    /* another address */
	RECEIVE_ASDU(45, 1, 7, 0, 2, 0, 4, 0, 0, 1);    /* another station */
	RECEIVE_ASDU(46, 1, 7, 0, 1, 0, 4, 0, 0, 1);    /* another type */
	RECEIVE_ASDU(45, 1, 0x87, 0, 1, 0, 4, 0, 0, 1); /* a test */
	RECEIVE_ASDU(45, 1, 10, 0, 1, 0, 4, 0, 0, 1);   /* a termination before the confirmation */
	RECEIVE_ASDU(45, 1, 9, 0, 1, 0, 4, 0, 0, 1);    /* of a deactivation */
	RECEIVE_ASDU(45, 1, 6, 0, 1, 0, 4, 0, 0, 1);    /* an activation */
	assert_int_equal(polling.unexpected, 9);
	assert_int_equal(step_count, 0);
	RECEIVE_ASDU(45, 1, 7, 0, 1, 0, 4, 0, 0, 1);
	RECEIVE_ASDU(45, 1, 7, 0, 1, 0, 4, 0, 0, 1); /* twice */
	assert_int_equal(polling.unexpected, 10);
	expect_step(0, MAP_EXECUTING, MAP_RESULT_NONE);
	assert_int_equal(step_count, 1);
}

static void test_outstanding_requests_are_bounded(void **state)
{
	(void)state;
	assert_int_not_equal(iec104_controlling_read(&polling, 1, 1, moment()), 0);
	assert_int_equal(iec104_controlling_read(&polling, 1, 1, moment()), 0); /* once at a time */
	assert_int_equal(iec104_controlling_read(&polling, 0, 1, moment()), 0);
	assert_int_equal(iec104_controlling_read(&polling, 65535, 1, moment()), 0);
	assert_int_equal(iec104_controlling_read(&polling, 1, 1u << 24, moment()), 0);
	for (uint32_t ioa = 2; ioa <= 4; ioa++)
		assert_int_not_equal(iec104_controlling_read(&polling, 1, ioa, moment()), 0);
	assert_int_equal(iec104_controlling_read(&polling, 1, 5, moment()), 0);
	RECEIVE_ASDU(1, 1, 5, 0, 1, 0, 3, 0, 0, 1);
	assert_int_not_equal(iec104_controlling_read(&polling, 1, 5, moment()), 0);
}

static void test_connection_ends_in_the_middle(void **state)
{
	const struct iec104_command coil = {.ioa = 5, .type = MAP_SINGLE};

	(void)state;
	iec104_controlling_command(&polling, 3067, &select_coil4, moment());
	iec104_controlling_command(&polling, 3067, &coil, moment());
	RECEIVE_ASDU(45, 1, 7, 0, 0xfb, 0x0b, 4, 0, 0, 0x81);
	iec104_session_close(&polling.session, IEC104_CLOSED_BY_PEER);
	run_at(now);
	assert_int_equal(step_count, 3);
	expect_step(1, MAP_INTERRUPTED_SELECTION, MAP_RESULT_UNKNOWN_FATE);
	expect_step(2, MAP_REFUSED_COMMAND, MAP_RESULT_UNKNOWN_FATE);
	assert_int_equal(iec104_controlling_read(&polling, 3067, 1, moment()), 0);
}

/* ---- what a server should not send ------------------------------------------------------- */

static void expect_bad_asdu(const uint8_t *asdu, size_t size)
{
	set_up_started(NULL);
	receive_asdu(asdu, size);
	assert_int_equal(polling.session.closing, IEC104_BAD_ASDU);
	assert_int_equal(seen_count, 0);
}

#define EXPECT_BAD_ASDU(...)                                                                                 \
	expect_bad_asdu((const uint8_t[]){__VA_ARGS__}, sizeof((const uint8_t[]){__VA_ARGS__}))

static void test_malformed_asdus(void **state)
{
	(void)state;
	EXPECT_BAD_ASDU(1);
	EXPECT_BAD_ASDU(1, 0, 3, 0, 1, 0);
	EXPECT_BAD_ASDU(1, 2, 3, 0, 1, 0, 1, 0, 0, 1);
	EXPECT_BAD_ASDU(1, 1, 3, 0, 1, 0, 1, 0, 0, 1, 1);
	EXPECT_BAD_ASDU(45, 1, 7, 0, 1, 0, 1, 0, 0);
	EXPECT_BAD_ASDU(45, 2, 7, 0, 1, 0, 1, 0, 0, 1, 2, 0, 0, 1);
	EXPECT_BAD_ASDU(100, 0x81, 7, 0, 1, 0, 0, 0, 0, 20);
}

/*
 * An octet less, or another one. IEC 104 has no checksum (TCP loses nothing), so an ASDU may be read wrong; but a lost octet
 * spoils the frame behind it, whatever comes the session ends, and with it each request.
 */
static void damaged_interrogation(size_t at, bool lost)
{
	static uint8_t stream[IEC104_OUTPUT_SIZE];
	const uint8_t *octets;
	size_t size;

	set_up_started(NULL);
	iec104_controlling_interrogate(&polling, 3067, 20, moment());
	carry(&polling.session, peer);
	run();
	octets = iec104_session_output(peer, &size);
	memcpy(stream, octets, size);
	at %= size;
	if (lost)
		memmove(stream + at, stream + at + 1, --size - at);
	else
		stream[at] ^= 0x55;
	receive(stream, size);
	for (int64_t end = now + 70 * S; now < end && polling.session.closing == IEC104_OPEN;)
		run_at(iec104_controlling_deadline(&polling));
	assert_int_not_equal(polling.session.closing, IEC104_OPEN);
	assert_true(seen_count <= 13);
	assert_true(step_count >= 1);
	assert_true(steps[step_count - 1].state == MAP_EXECUTED_COMMAND ||
		    steps[step_count - 1].state == MAP_REFUSED_COMMAND);
	assert_int_equal(polling.requests[0].id, 0);
}

static void test_lost_and_damaged_octets(void **state)
{
	(void)state;
	for (size_t at = 0; at < 200; at++) {
		damaged_interrogation(at, true);
		damaged_interrogation(at, false);
	}
}

#define POLLING(name) cmocka_unit_test_setup(name, set_up_polling)
#define STARTED(name) cmocka_unit_test_setup(name, set_up_started)

int main(void)
{
	const struct CMUnitTest tests[] = {
	    POLLING(test_startdt_without_confirmation),
	    POLLING(test_stands_by_stopped),
	    POLLING(test_answers_testfr),
	    POLLING(test_controlled_station_does_not_start_or_stop),
	    POLLING(test_information_before_start),
	    STARTED(test_unacknowledged_request),
	    STARTED(test_acknowledges_at_w_and_t2),
	    STARTED(test_sends_no_more_than_k),
	    STARTED(test_general_interrogation),
	    STARTED(test_group_interrogation),
	    STARTED(test_counter_interrogation),
	    STARTED(test_read),
	    STARTED(test_clock),
	    STARTED(test_events),
	    STARTED(test_end_of_initialisation),
	    STARTED(test_position),
	    STARTED(test_direct_commands),
	    STARTED(test_step_command),
	    STARTED(test_select_and_execute),
	    STARTED(test_select_and_cancel),
	    STARTED(test_selection_that_is_forgotten),
	    STARTED(test_refusals),
	    STARTED(test_no_confirmation_and_no_termination),
	    STARTED(test_station_without_terminations),
	    STARTED(test_failed_termination),
	    STARTED(test_answers_to_something_else),
	    STARTED(test_outstanding_requests_are_bounded),
	    STARTED(test_connection_ends_in_the_middle),
	    POLLING(test_malformed_asdus),
	    POLLING(test_lost_and_damaged_octets),
	};

	return cmocka_run_group_tests_name("controlling", tests, NULL, NULL);
}
