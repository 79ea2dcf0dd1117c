/* SPDX-License-Identifier: GPL-3.0-or-later */
/*
 * libFuzzer on the controlled station: the input says, octet by octet, what two controlling stations send, what
 * happens in the map and how time goes by. Two models of a controlling station watch what comes out:
 * - every APDU is well formed, in sequence, and within k;
 * - no value of a point is followed by an older one;
 * - no command has more than one confirmation or refusal, nor a termination without a confirmation;
 * - once all is acknowledged, each point is what the model was told last: no event was lost, nothing stale is good.
 */
#include <stdio.h>
#include <string.h>

#include "fuzz/input.h"
#include "iec104/fake_map.h"
#include "iec104/station.h"

#define CONNECTIONS     2
#define K               12
#define MODULES         2 /* that own points: 1, 2 */
#define STEPS_TO_SETTLE 2000
#define RUNS_UNTIL_DONE 4

static struct iec104_station station;
static int64_t sent_ns[CONNECTIONS * K];
static struct map_queue_place places[CONNECTIONS * K];

/* ---- a controlling station and what it knows --------------------------------------------------- */

static struct model {
	struct iec104_connection *connection;
	uint16_t ns, nr, acknowledged; /* V(S), V(R), last N(R) sent */
	bool proper;                   /* has sent nothing but whole APDUs in sequence */
	bool known[POINTS + OWN];      /* was told a value */
	bool invalid[POINTS + OWN];
	uint32_t value[POINTS + OWN];
	unsigned commands, confirmed, terminated;
	bool deaf; /* reads nothing for a while */
} models[CONNECTIONS];

static void connect_model(struct model *model)
{
	struct iec104_peer peer = {.name = "fuzz",
				   .party = fake.config.settings.queue_count > 0 ? 0 : MAP_NONE,
				   .clock_master = true};

	snprintf(peer.address, sizeof(peer.address), "10.0.0.%u", (unsigned)(model - models) + 1);
	*model = (struct model){.connection = iec104_station_connect(&station, &peer, now), .proper = true};
	CHECK(model->connection != NULL);
}

static uint32_t get(const uint8_t *octets, size_t size)
{
	uint32_t value = 0;

	while (size-- > 0)
		value = value << 8 | octets[size];
	return value;
}

/* Values count upwards. Those of one or two bits and step positions are too short to show it. */
static bool counts_upwards(uint8_t type)
{
	return type != MAP_SINGLE && type != MAP_DOUBLE && type != MAP_STEP;
}

/* Has no quality: what it was told is good, and may be out of date. */
static bool is_plain(uint32_t point)
{
	return (points[point].flags & MAP_POINT_NO_QUALITY) != 0;
}

static void take_object(struct model *model, uint32_t point, const uint8_t *element)
{
	static const uint8_t value_sizes[] = {
	    [MAP_SINGLE] = 0,     [MAP_DOUBLE] = 0, [MAP_STEP] = 1,  [MAP_BITSTRING] = 4,
	    [MAP_NORMALIZED] = 2, [MAP_SCALED] = 2, [MAP_FLOAT] = 4, [MAP_COUNTER] = 4};
	uint8_t type = points[point].type, value_size = value_sizes[type];
	uint32_t value = value_size > 0 ? get(element, value_size) : (uint32_t)(element[0] & 3);
	bool invalid = !is_plain(point) && (element[value_size] & MAP_INVALID) != 0;

	/* An invalid value says nothing. */
	if (!invalid && model->known[point] && !model->invalid[point] && counts_upwards(type))
		CHECK(value >= model->value[point]);
	model->known[point] = true;
	model->invalid[point] = invalid;
	model->value[point] = value;
}

static void take_information(struct model *model, const struct iec104_asdu *asdu)
{
	static const uint8_t sizes[] = {
	    [MAP_SINGLE] = 1,     [MAP_DOUBLE] = 1, [MAP_STEP] = 2,  [MAP_BITSTRING] = 5,
	    [MAP_NORMALIZED] = 3, [MAP_SCALED] = 3, [MAP_FLOAT] = 5, [MAP_COUNTER] = 5};
	bool tagged = asdu->type >= IEC104_M_SP_TB_1, plain = asdu->type == IEC104_M_ME_ND_1;
	enum map_type type =
	    plain ? MAP_NORMALIZED : (enum map_type)(tagged ? asdu->type - IEC104_M_SP_TB_1 : asdu->type / 2);
	size_t size = sizes[type] + (size_t)(tagged ? IEC104_TIME56_SIZE : 0) - plain;
	const uint8_t *at = asdu->objects, *end = at + asdu->objects_size;
	uint32_t ioa = 0;

	CHECK(asdu->count > 0);
	for (unsigned i = 0; i < asdu->count; i++) {
		uint32_t point;

		ioa++;
		if (i == 0 || !asdu->sequence) {
			CHECK(end - at >= IEC104_IOA_SIZE);
			ioa = get(at, IEC104_IOA_SIZE);
			at += IEC104_IOA_SIZE;
		}
		CHECK((size_t)(end - at) >= size);
		point = map_find(&fake, asdu->ca, ioa);
		CHECK(point != MAP_NONE && points[point].type == type && is_plain(point) == plain);
		if (asdu->cause < IEC104_COUNTERS_REQUESTED) /* a frozen reading is older, and may be */
			take_object(model, point, at);
		at += size;
	}
	CHECK(at == end);
}

static bool is_command(uint8_t type)
{
	return type >= IEC104_C_SC_NA_1 && type <= IEC104_C_BO_TA_1;
}

static void take_asdu(struct model *model, const uint8_t *octets, size_t size)
{
	struct iec104_asdu asdu;

	CHECK(iec104_asdu_decode(octets, size, &asdu));
	if (asdu.type <= IEC104_M_IT_TB_1 && asdu.cause < IEC104_UNKNOWN_TYPE) {
		take_information(model, &asdu);
	} else if (is_command(asdu.type)) {
		if (asdu.cause == IEC104_ACTIVATION_TERM)
			model->terminated++;
		else
			model->confirmed++;
		CHECK(model->confirmed <= model->commands && model->terminated <= model->confirmed);
	} else if (asdu.type == IEC104_C_RP_NA_1 && asdu.cause == IEC104_ACTIVATION_CON && !asdu.negative) {
		memset(model->known, 0, sizeof(model->known)); /* events may have been dropped on request */
	}
}

static void take_output(struct model *model)
{
	struct iec104_session *session = &model->connection->session;
	struct iec104_apdu apdu;
	const uint8_t *octets;
	size_t size, apdu_size;

	if (model->deaf)
		return;
	for (octets = iec104_session_output(session, &size); size > 0;
	     octets = iec104_session_output(session, &size)) {
		apdu_size = (size_t)iec104_apdu_size(octets, size);
		CHECK(apdu_size > 0 && apdu_size <= size && iec104_apdu_decode(octets, apdu_size, &apdu));
		if (apdu.format == IEC104_I_FRAME) {
			CHECK(apdu.ns == model->nr);
			model->nr = (uint16_t)((model->nr + 1) % IEC104_SEQUENCE_MODULO);
			CHECK((model->nr - model->acknowledged + IEC104_SEQUENCE_MODULO) %
				  IEC104_SEQUENCE_MODULO <=
			      K);
			take_asdu(model, apdu.asdu, apdu.asdu_size);
		}
		iec104_session_written(session, apdu_size);
	}
}

static void run_station(void)
{
	uint32_t events;

	do { /* its own events ring its bell */
		events = fake.event_count;
		iec104_station_run(&station, now);
	} while (fake.event_count != events);
	for (unsigned i = 0; i < CONNECTIONS; i++) {
		take_output(&models[i]);
		if (models[i].connection->session.closing != IEC104_OPEN) {
			iec104_station_disconnect(&station, models[i].connection);
			connect_model(&models[i]);
		}
	}
}

static void send_octets(struct model *model, const uint8_t *octets, size_t size)
{
	size_t room;
	uint8_t *place = iec104_session_space(&model->connection->session, &room);

	if (room < size) /* the station holds this one back: what follows is no longer in sequence */
		model->proper = false;
	memcpy(place, octets, size < room ? size : room);
	iec104_session_received(&model->connection->session, size < room ? size : room);
	run_station();
}

static void send_apdu(struct model *model, struct iec104_apdu apdu)
{
	uint8_t octets[IEC104_APDU_MAX];

	iec104_apdu_encode(octets, &apdu);
	if (apdu.asdu_size > 0)
		memcpy(octets + IEC104_APCI_SIZE, apdu.asdu, apdu.asdu_size);
	send_octets(model, octets, IEC104_APCI_SIZE + apdu.asdu_size);
}

static void acknowledge(struct model *model)
{
	model->acknowledged = model->nr;
	send_apdu(model, (struct iec104_apdu){.format = IEC104_S_FRAME, .nr = model->nr});
}

/* ---- what the input may let happen --------------------------------------------------------------- */

static void send_anything(struct model *model)
{
	uint8_t octets[256] = {0};
	size_t size = next_octet();

	for (size_t i = 0; i < size; i++)
		octets[i] = next_octet();
	model->proper = false;
	model->commands += (unsigned)(size / IEC104_APCI_SIZE);
	send_octets(model, octets, size);
}

static void send_request(struct model *model)
{
	uint8_t asdu[IEC104_ASDU_MAX] = {next_octet(), 1, next_octet(), next_octet()};
	size_t size = IEC104_ASDU_HEADER + iec104_control_object_size(asdu[0]);
	uint32_t ca = devices[next_octet() % DEVICES].ca, ioa = points[next_octet() % POINTS].ioa;
	uint8_t variant = next_octet();

	if (variant & 1)
		ca = IEC104_CA_BROADCAST;
	if (variant & 2)
		ioa = 0;
	asdu[4] = (uint8_t)ca;
	asdu[5] = (uint8_t)(ca >> 8);
	if (variant & 4)
		size = 1 + next_octet() % IEC104_ASDU_MAX;
	for (size_t i = IEC104_ASDU_HEADER; i < size; i++)
		asdu[i] = i < 9 ? (uint8_t)(ioa >> 8 * (i - 6)) : next_octet();
	model->acknowledged = model->nr;
	model->commands += is_command(asdu[0]);
	send_apdu(
	    model,
	    (struct iec104_apdu){
		.format = IEC104_I_FRAME, .ns = model->ns, .nr = model->nr, .asdu = asdu, .asdu_size = size});
	model->ns = (uint16_t)((model->ns + 1) % IEC104_SEQUENCE_MODULO);
}

static void send_function(struct model *model)
{
	static const enum iec104_function functions[] = {IEC104_STARTDT_ACT, IEC104_STARTDT_CON,
							 IEC104_STOPDT_ACT,  IEC104_STOPDT_CON,
							 IEC104_TESTFR_ACT,  IEC104_TESTFR_CON};

	send_apdu(model,
		  (struct iec104_apdu){.format = IEC104_U_FRAME, .function = functions[next_octet() % 6]});
}

/* Runs at each deadline on the way. What was due is done then: a loop around the station does not spin. */
static void let_time_pass(void)
{
	int64_t then = now + next_octet() * (next_octet() & 1 ? 100 : 1) * MS;

	run_station();
	while (now < then) {
		int64_t deadline = iec104_station_deadline(&station);

		for (int i = 0; i < RUNS_UNTIL_DONE && deadline <= now; i++) {
			run_station();
			deadline = iec104_station_deadline(&station);
		}
		CHECK(deadline > now);
		now = deadline < then ? deadline : then;
		run_station();
	}
}

static uint8_t to_be_published; /* while a point is read */

static void publish_next(uint32_t point)
{
	if (map_alive(&fake, map_owner(&fake, point)))
		publish(point, fake.samples[point].value.i + 1);
}

static void publish_while_read(uint32_t point)
{
	(void)point;
	fake.on_read = NULL;
	publish_next(to_be_published);
}

static void publish_now_or_while_read(void)
{
	uint8_t octet = next_octet();

	to_be_published = octet % POINTS;
	if (octet & 0x80)
		fake.on_read = publish_while_read;
	else
		publish_next(to_be_published);
	if (octet & 0x20 && fake.event_count > 0)
		fake.events[(fake.event_count - 1) % EVENTS].cause = MAP_RETURN_REMOTE;
	fake.unreadable = octet & 0x40 ? 1 : 0;
}

static void announce(enum map_event_kind kind, uint32_t module)
{
	put_event(kind, module, (struct map_sample){.quality = MAP_INVALID, .time_ns = now});
}

/* A new generation has read nothing yet; then it reads all. */
static void restart(uint32_t module)
{
	fake.generation[module]++;
	fake.silent[module] = false;
	for (uint32_t i = 0; i < POINTS; i++)
		if (map_owner(&fake, i) == module)
			publish_next(i);
}

static void change_module(void)
{
	uint8_t octet = next_octet();
	uint32_t module = 1 + octet % MODULES;

	fake.dead[module] = !fake.dead[module];
	if (fake.dead[module])
		announce(MAP_EVENT_MODULE_DOWN, module);
	else if (octet & 0x80)
		restart(module);
	else
		announce(MAP_EVENT_MODULE_UP, module);
	run_station();
}

/* Not for so long that rtud would notice. */
static void miss_heartbeats(void)
{
	uint8_t octet = next_octet();

	fake.silent[1 + octet % MODULES] = (octet & 0x80) != 0;
}

static void answer_request(void)
{
	uint8_t octet = next_octet();

	if (fake.request_count == 0)
		return;
	answer(fake.request_count - octet / 10 % (fake.request_count < 16 ? fake.request_count : 16),
	       (enum map_command_state)(octet % 10), octet & 0x80 ? MAP_RESULT_DONE : MAP_RESULT_NONE);
	run_station();
}

/* The next process finds the queues in the map, and nothing else. */
static void restart_station(void)
{
	memset(&station, 0x5a, sizeof(station));
	memset(places, 0x5a, sizeof(places));
	iec104_station_init(&station, &fake, sent_ns, places);
	for (unsigned i = 0; i < CONNECTIONS; i++)
		connect_model(&models[i]);
}

static void step(void)
{
	uint8_t octet = next_octet();
	struct model *model = &models[octet >> 7];

	switch (octet & 0x0f) {
	case 0:
		send_anything(model);
		break;
	case 1:
	case 2:
	case 3:
		send_request(model);
		break;
	case 4:
		acknowledge(model);
		break;
	case 5:
		send_function(model);
		break;
	case 6:
		let_time_pass();
		break;
	case 7:
		change_module();
		break;
	case 8:
		answer_request();
		break;
	case 9:
		iec104_station_disconnect(&station, model->connection);
		connect_model(model);
		break;
	case 10:
		run_station();
		break;
	case 11:
		miss_heartbeats();
		break;
	case 13:
		restart_station();
		break;
	case 12:
		model->deaf = !model->deaf;
		break;
	default:
		publish_now_or_while_read();
		break;
	}
}

/* ---- in the end ---------------------------------------------------------------------------------- */

static void expect_truth(const struct model *model)
{
	for (uint32_t i = 0; i < fake.config.point_count; i++) {
		const struct map_sample *sample = &fake.samples[i];
		uint8_t type = points[i].type;
		bool invalid = fake.dead[map_owner(&fake, i)] || (sample->quality & MAP_INVALID);
		uint32_t mask = type == MAP_STEP                               ? 0x7f
				: type == MAP_NORMALIZED || type == MAP_SCALED ? 0xffff
				: counts_upwards(type)                         ? UINT32_MAX
				: type == MAP_SINGLE                           ? 1
									       : 3;

		if (!model->known[i] || (is_plain(i) && invalid))
			continue;
		CHECK(model->invalid[i] == invalid);
		CHECK(invalid || (model->value[i] & mask) == (sample->value.u & mask));
	}
}

static void settle(struct model *model)
{
	uint32_t serial = model->connection->serial;

	if (!model->proper || !model->connection->session.started)
		return;
	model->deaf = false;
	take_output(model);
	fake.on_read = NULL;
	fake.unreadable = 0;
	memset(fake.silent, 0, sizeof(fake.silent));
	for (int i = 0; i < STEPS_TO_SETTLE; i++) {
		uint16_t before = model->nr;

		acknowledge(model);
		if (model->connection->serial != serial)
			return; /* closed: a STOPDT, an earlier slip */
		if (model->nr == before)
			break;
	}
	if (model->connection->session.started)
		expect_truth(model);
}

int LLVMFuzzerTestOneInput(const uint8_t *data, size_t size)
{
	uint8_t variant;

	input = (struct input){.at = data, .end = data + size};
	fake_begin();
	fake.settings.max_connections = CONNECTIONS;
	variant = next_octet();
	if (variant & 1)
		fake.event_capacity = 8;
	if (variant & 128)
		fake_own_station();
	if (variant & 2) /* both are of one redundancy group */
		fake.config.settings.queue_count = 1;
	fake.config.settings.queues[0].limit = variant & 4 ? 6 : EVENTS - 1;
	if (variant & 8)
		fake.starts = 1;
	if (variant & 16)
		fake.parameters[NORMALIZED].loaded = fake.parameters[FLOAT].loaded = 0x1e;
	points[NORMALIZED].flags =
	    variant & 64 ? MAP_POINT_COMMAND | MAP_POINT_NO_QUALITY : MAP_POINT_COMMAND;
	if (variant & 32)
		fake.totals[COUNTER].time_ns = now;
	for (uint32_t i = 0; i < POINTS; i++)
		fake.samples[i].value.u = 0;
	iec104_station_init(&station, &fake, sent_ns, places);
	for (unsigned i = 0; i < CONNECTIONS; i++)
		connect_model(&models[i]);
	for (unsigned i = 0; i < CONNECTIONS; i++)
		send_apdu(&models[i],
			  (struct iec104_apdu){.format = IEC104_U_FRAME, .function = IEC104_STARTDT_ACT});
	while (input.at < input.end)
		step();
	for (unsigned i = 0; i < CONNECTIONS; i++)
		settle(&models[i]);
	return 0;
}
