/* SPDX-License-Identifier: GPL-3.0-or-later */
/*
 * libFuzzer on the ASDUs of the control direction: the input is a row of them, each behind an octet of size, and they
 * arrive in sound I frames, so that every octet of the input reaches the station. Devices answer each command at once.
 * What must hold: the connection is closed, or each ASDU is answered, and no refusal comes twice.
 */
#include <string.h>

#include "fuzz/target.h"
#include "iec104/fake_map.h"
#include "iec104/station.h"

#define K           12
#define TURNS_OF_GI 64 /* an interrogation of all is done in less */

static struct iec104_station station;
static struct iec104_connection *connection;
static int64_t sent_ns[K];
static struct map_queue_place places[K];
static uint16_t ns, nr;            /* V(S), V(R) of the controlling station */
static unsigned replies, refusals; /* since the last request */
static unsigned answered;          /* requests to the map */

static void take_asdu(const uint8_t *octets, size_t size)
{
	struct iec104_asdu asdu;

	CHECK(iec104_asdu_decode(octets, size, &asdu));
	CHECK(asdu.count > 0 || asdu.negative);
	replies++;
	refusals += asdu.negative;
}

static void take_output(void)
{
	struct iec104_apdu apdu;
	const uint8_t *octets;
	size_t size;
	int apdu_size;

	for (octets = iec104_session_output(&connection->session, &size); size > 0;
	     octets = iec104_session_output(&connection->session, &size)) {
		apdu_size = iec104_apdu_size(octets, size);
		CHECK(apdu_size > 0 && (size_t)apdu_size <= size);
		CHECK(iec104_apdu_decode(octets, (size_t)apdu_size, &apdu));
		if (apdu.format == IEC104_I_FRAME) {
			CHECK(apdu.ns == nr);
			nr = (uint16_t)((nr + 1) % IEC104_SEQUENCE_MODULO);
			take_asdu(apdu.asdu, apdu.asdu_size);
		}
		iec104_session_written(&connection->session, (size_t)apdu_size);
	}
}

static enum map_command_state outcome(uint8_t action)
{
	switch (action) {
	case MAP_SELECT:
		return MAP_ACCEPTED_SELECTION;
	case MAP_CANCEL:
		return MAP_INTERRUPTED_SELECTION;
	default:
		return MAP_EXECUTED_COMMAND;
	}
}

static void answer_requests(void)
{
	while (answered < fake.request_count) {
		uint8_t action = fake.requests[answered++ % REQUESTS].action;

		if (action != MAP_RELEASE)
			answer(answered, outcome(action), MAP_RESULT_DONE);
	}
}

static void send_frame(struct iec104_apdu apdu)
{
	size_t room, size = IEC104_APCI_SIZE + apdu.asdu_size;
	uint8_t *place = iec104_session_space(&connection->session, &room);

	if (room < size)
		return; /* the session is over */
	iec104_apdu_encode(place, &apdu);
	if (apdu.asdu_size > 0)
		memcpy(place + IEC104_APCI_SIZE, apdu.asdu, apdu.asdu_size);
	iec104_session_received(&connection->session, size);
	iec104_station_run(&station, now);
	answer_requests();
	iec104_station_run(&station, now);
	take_output();
}

static void acknowledge(void)
{
	send_frame((struct iec104_apdu){.format = IEC104_S_FRAME, .nr = nr});
}

static void ask(const uint8_t *asdu, size_t size)
{
	replies = refusals = 0;
	send_frame((struct iec104_apdu){
	    .format = IEC104_I_FRAME, .ns = ns, .nr = nr, .asdu = asdu, .asdu_size = size});
	ns = (uint16_t)((ns + 1) % IEC104_SEQUENCE_MODULO);
	for (int i = 0; i < TURNS_OF_GI; i++) {
		unsigned before = replies;

		acknowledge();
		if (replies == before)
			break;
	}
	CHECK(refusals <= 1);
	CHECK(connection->session.closing != IEC104_OPEN || replies > 0);
}

static void connect_master(void)
{
	connection = iec104_station_connect(
	    &station,
	    &(struct iec104_peer){
		.name = "fuzz", .address = "192.0.2.1", .party = MAP_NONE, .clock_master = true},
	    now);
	CHECK(connection != NULL);
	ns = nr = 0;
	send_frame((struct iec104_apdu){.format = IEC104_U_FRAME, .function = IEC104_STARTDT_ACT});
}

int LLVMFuzzerTestOneInput(const uint8_t *data, size_t size)
{
	fake_begin();
	for (uint32_t i = 0; i < POINTS; i++)
		fake.config.points[i].send_period_ms = 0;
	answered = 0;
	iec104_station_init(&station, &fake, sent_ns, places);
	connect_master();
	while (size > 0) {
		size_t asdu_size = 1 + data[0] % IEC104_ASDU_MAX;

		data++;
		size--;
		if (asdu_size > size)
			asdu_size = size;
		if (asdu_size == 0)
			break;
		ask(data, asdu_size);
		data += asdu_size;
		size -= asdu_size;
		now += MS;
		if (connection->session.closing != IEC104_OPEN) {
			iec104_station_disconnect(&station, connection);
			connect_master();
		}
	}
	return 0;
}
