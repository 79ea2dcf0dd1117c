/* SPDX-License-Identifier: GPL-3.0-or-later */
/*
 * libFuzzer on a controlling station in virtual time: the input is what a server sends, sound frames around any ASDU and any
 * octets, and what the controlling station asks meanwhile, of few addresses, so that answers meet requests. What must hold:
 * - never more requests are open than configured, and each ends once, in one of the four last states;
 * - the steps of a request follow each other as the states of a command do;
 * - information lies in its ranges;
 * - the deadline is ahead once all was run; a session that is over has no request left.
 */
#include <string.h>

#include "fuzz/input.h"
#include "iec104/controlling.h"

#define K        8
#define S        1000000000LL
#define WALL_NS  1110965882000000000
#define ANSWERED 4 /* kinds of answers */

static struct iec104_controlling_settings settings;
static struct iec104_controlling controlling;
static int64_t sent_ns[K], now;
static uint8_t input_octets[IEC104_INPUT_LEAST], output_octets[IEC104_OUTPUT_LEAST];
static const struct iec104_memory memory = {.sent_ns = sent_ns,
					    .input = input_octets,
					    .output = output_octets,
					    .input_size = sizeof(input_octets),
					    .output_size = sizeof(output_octets)};
static unsigned open_requests;
static bool asks_again; /* from within a call */

static struct iec104_moment moment(void)
{
	return (struct iec104_moment){.monotonic_ns = now, .wall_ns = WALL_NS};
}

static void note(uint32_t id)
{
	open_requests += id != 0;
	CHECK(open_requests <= settings.requests_max);
}

static void on_information(void *context, const struct iec104_asdu *asdu,
			   const struct iec104_information *information)
{
	(void)context;
	CHECK(asdu->count > 0);
	CHECK(information->content != IEC104_SINGLE || information->value.u <= 1);
	CHECK(information->tagged || information->wall_ns == 0);
}

static void on_position(void *context, const struct iec104_asdu *asdu, uint32_t ioa,
			const struct iec104_geoposition *position)
{
	(void)context;
	(void)ioa;
	CHECK(asdu->type == settings.position_type);
	CHECK(position->latitude >= -900000000 && position->latitude <= 900000000);
}

static void on_progress(void *context, const struct iec104_controlling_request *request)
{
	(void)context;
	CHECK(request->id != 0);
	switch (request->state) {
	case MAP_ACCEPTED_SELECTION:
		CHECK(request->command.select);
		if (asks_again)
			iec104_controlling_execute(&controlling, request->id, moment());
		return;
	case MAP_EXECUTING:
		CHECK(!request->command.select && request->type != IEC104_C_RD_NA_1);
		return;
	case MAP_EXECUTED_COMMAND:
		CHECK(request->result == MAP_RESULT_DONE);
		break;
	case MAP_REFUSED_SELECTION:
	case MAP_REFUSED_COMMAND:
		CHECK(request->result != MAP_RESULT_DONE && request->result != MAP_RESULT_NONE);
		break;
	default:
		CHECK(request->state == MAP_INTERRUPTED_SELECTION && request->result != MAP_RESULT_NONE);
		break;
	}
	CHECK(open_requests > 0);
	open_requests--;
	if (asks_again)
		note(iec104_controlling_read(&controlling, request->ca, request->ioa, moment()));
}

static const struct iec104_controlling_listener listener = {
    .information = on_information, .position = on_position, .progress = on_progress};

/* ---- what happens ------------------------------------------------------------------------ */

static void run(void)
{
	size_t size;

	iec104_controlling_run(&controlling, moment());
	iec104_session_output(&controlling.session, &size);
	iec104_session_written(&controlling.session, size);
	if (controlling.session.closing == IEC104_OPEN)
		CHECK(iec104_controlling_deadline(&controlling) > now);
	else
		CHECK(open_requests == 0 && iec104_controlling_deadline(&controlling) == INT64_MAX);
}

static void receive(const uint8_t *octets, size_t size)
{
	size_t room;
	uint8_t *place = iec104_session_space(&controlling.session, &room);

	if (size > room)
		size = room;
	memcpy(place, octets, size);
	iec104_session_received(&controlling.session, size);
	run();
}

static void receive_asdu(const uint8_t *asdu, size_t size)
{
	uint8_t frame[IEC104_APDU_MAX];

	iec104_apdu_encode(frame, &(struct iec104_apdu){.format = IEC104_I_FRAME,
							.ns = controlling.session.next_nr,
							.nr = controlling.session.next_ns,
							.asdu_size = size});
	memcpy(frame + IEC104_APCI_SIZE, asdu, size);
	receive(frame, IEC104_APCI_SIZE + size);
}

static void receive_anything(bool framed)
{
	uint8_t octets[IEC104_ASDU_MAX];
	size_t size = 1 + next_octet() % IEC104_ASDU_MAX;

	for (size_t i = 0; i < size; i++)
		octets[i] = next_octet();
	if (framed)
		receive_asdu(octets, size);
	else
		receive(octets, size);
}

/* What the station might say of an open request, but for what the input does to it. */
static void answer_request(uint8_t argument)
{
	static const uint8_t causes[ANSWERED] = {IEC104_ACTIVATION_CON, IEC104_ACTIVATION_TERM,
						 IEC104_DEACTIVATION_CON, IEC104_UNKNOWN_IOA};
	const struct iec104_controlling_request *request =
	    &controlling.requests[argument % IEC104_CONTROLLING_REQUESTS_MAX];
	const struct iec104_asdu header = {.type = request->type,
					   .cause = causes[next_octet() % ANSWERED],
					   .negative = next_octet() & 1,
					   .ca = request->ca};
	uint8_t element[IEC104_ELEMENT_MAX];
	struct iec104_builder builder;

	memset(element, 0, sizeof(element));
	memcpy(element, request->element, request->element_size);
	iec104_asdu_begin(&builder, &header);
	iec104_asdu_add(&builder, request->ioa, element,
			request->element_size + (request->tagged ? IEC104_TIME56_SIZE : 0u));
	receive_asdu(builder.bytes, builder.size);
}

static void command(uint8_t argument)
{
	const struct iec104_command wanted = {.ioa = argument & 3,
					      .type = (enum map_type)(next_octet() % (MAP_COUNTER + 1)),
					      .value.u = next_octet(),
					      .select = argument & 4,
					      .tagged = argument & 8,
					      .step = (int8_t)((argument & 3) - 1)};

	note(iec104_controlling_command(&controlling, 1, &wanted, moment()));
}

static void ask(uint8_t argument)
{
	uint16_t ca = 1 + (argument >> 2 & 1);

	switch (argument & 3) {
	case 0:
		note(iec104_controlling_interrogate(&controlling, ca, next_octet(), moment()));
		break;
	case 1:
		note(iec104_controlling_interrogate_counters(&controlling, ca, next_octet(), moment()));
		break;
	case 2:
		note(iec104_controlling_read(&controlling, ca, next_octet() & 3, moment()));
		break;
	default:
		note(iec104_controlling_set_clock(&controlling, ca, moment()));
		break;
	}
}

static void go_on(uint8_t argument)
{
	uint32_t id = controlling.requests[argument % IEC104_CONTROLLING_REQUESTS_MAX].id;

	if (argument & 16)
		iec104_controlling_cancel(&controlling, id, moment());
	else
		iec104_controlling_execute(&controlling, id, moment());
}

static void step(void)
{
	uint8_t octet = next_octet(), argument = octet >> 3;

	switch (octet & 7) {
	case 0:
		receive_anything(false);
		break;
	case 1:
		receive_anything(true);
		break;
	case 2:
	case 3:
		answer_request(argument);
		break;
	case 4:
		command(argument);
		break;
	case 5:
		ask(argument);
		break;
	case 6:
		go_on(argument);
		break;
	default:
		now += (1 + argument) * S;
		break;
	}
	run();
}

int LLVMFuzzerTestOneInput(const uint8_t *data, size_t size)
{
	static const uint8_t startdt_con[] = {0x68, 4, 0x0b, 0, 0, 0};

	input = (struct input){.at = data, .end = data + size};
	settings = (struct iec104_controlling_settings){
	    .times = {.k = K, .w = 4, .t1_ns = 15 * S, .t2_ns = 10 * S, .t3_ns = 20 * S},
	    .position_type = IEC104_GEOPOSITION,
	    .requests_max = (uint8_t)(1 + next_octet() % IEC104_CONTROLLING_REQUESTS_MAX),
	    .confirmation_ns = 5 * S,
	    .selection_ns = 30 * S,
	    .termination_ns = next_octet() % 20 * S,
	    .interrogation_ns = 60 * S};
	asks_again = next_octet() & 1;
	now = 1000 * S;
	open_requests = 0;
	iec104_controlling_open(&controlling, &settings, &listener, &memory, moment());
	iec104_session_start(&controlling.session, now);
	receive(startdt_con, sizeof(startdt_con));
	while (input.at < input.end)
		step();
	iec104_session_close(&controlling.session, IEC104_CLOSED_BY_PEER);
	run();
	return 0;
}
