/* SPDX-License-Identifier: GPL-3.0-or-later */
/*
 * libFuzzer on an outstation of rtu-104m in virtual time, its links without sockets: the input is what the outstation sends on
 * either link, sound frames around any ASDU and any octets, answers to what it is asked, links that come and go, commands of the
 * map. What must hold:
 * - what is published together is of one set, each point once, of a time that is not ahead, with qualities that there are;
 * - a command is executed on the wire once at most, and ends once;
 * - two links never have data transfer at once, and without any for t1 all points are invalid;
 * - it does not ask to be run again and again.
 */
#include <stdlib.h>
#include <string.h>

#include "fuzz/input.h"
#include "map/time_ns.h"
#include "modules/iec104m/outstation.h"

#define POINTS    13 /* one of each type that the standard has, then those of another set */
#define OTHER     8  /* the first of that set: a second single one */
#define POSITION  9  /* the first of the position's four */
#define FIRST     1  /* IOA of the first */
#define CA        1
#define WALL_NS   (1110965882 * NS_PER_S)
#define LINKS     IEC104_OUTSTATION_LINKS_MAX
#define RETRY_NS  NS_PER_S
#define TURNS_MAX 50

static struct map_set sets[] = {{.point_count = OTHER},
				{.first_point = OTHER, .point_count = POINTS - OTHER}};
static struct map_point points[POINTS];
static struct iec104_outstation config = {.name = "town",
					  .addresses = {"1", "2"},
					  .address_count = LINKS,
					  .k = 8,
					  .w = 4,
					  .t1_s = 15,
					  .t2_s = 10,
					  .t3_s = 20,
					  .interrogates = true,
					  .confirmation_ms = 5000,
					  .termination_ms = 9000,
					  .interrogation_ms = 60000,
					  .counters_s = 30,
					  .clock_s = 40,
					  .position_type = IEC104_GEOPOSITION,
					  .set_count = 2};
static struct iec104_outstation_set there[] = {{.set = 0, .ca = CA},
					       {.set = 1, .ca = CA + 1, .first_point = OTHER}};
static struct iec104_outstation_point objects[POINTS];
static struct map_config configuration = {
    .set_count = 2, .point_count = POINTS, .sets = sets, .points = points};

static struct outstation outstation;
static struct iec104_outstation_stats stats;
static struct map_sample samples[POINTS];
static bool executing[POINTS];
static unsigned executions[POINTS]; /* on the wire, of the command under way */
static int64_t now, lost_ns;        /* without data transfer since; 0: there is some */
static bool clock_set;
static int64_t sent_ns[LINKS][8];

/* ---- the map, of which this is all that the module asks ------------------------------------ */

const struct map_config *map_config(const struct map *map)
{
	(void)map;
	return &configuration;
}

struct map_sample map_own_sample(const struct map *map, uint32_t point)
{
	(void)map;
	return samples[point];
}

void map_publish(struct map *map, const struct map_update *updates, size_t count)
{
	bool seen[POINTS] = {false};

	(void)map;
	for (size_t i = 0; i < count; i++) {
		const struct map_update *update = &updates[i];

		CHECK(update->point < POINTS && !seen[update->point]);
		CHECK(points[update->point].set == points[updates[0].point].set);
		CHECK(update->sample.time_ns <= now && update->cause <= MAP_RETURN_LOCAL);
		CHECK((update->sample.quality & 0x0e) == 0);
		seen[update->point] = true;
		samples[update->point].quality = update->sample.quality;
	}
}

struct map_clock map_clock_read(const struct map *map)
{
	(void)map;
	return (struct map_clock){.offset_ns = WALL_NS, .set = clock_set};
}

void map_module(const struct map *map, uint32_t index, struct map_module *out)
{
	(void)map, (void)index;
	memset(out, 0, sizeof(*out));
}

void map_log(struct map *map, enum map_log_level level, const char *format, ...)
{
	(void)map, (void)level, (void)format;
}

int64_t map_pulse_end(const struct map *map, uint32_t point)
{
	(void)map, (void)point;
	return 0;
}

void map_pulse_set_end(struct map *map, uint32_t point, int64_t off_ns)
{
	(void)map, (void)point, (void)off_ns;
}

void map_command_confirm(struct map *map, uint32_t point)
{
	(void)map;
	CHECK(executing[point] && executions[point] == 1);
}

void map_command_finish(struct map *map, uint32_t point, enum map_command_result result, uint8_t detail)
{
	(void)map, (void)detail;
	CHECK(executing[point] && result != MAP_RESULT_NONE);
	CHECK(result != MAP_RESULT_DONE || executions[point] == 1);
	executing[point] = false;
}

/* ---- links without sockets ---------------------------------------------------------------- */

bool link_init(struct link *link, const struct iec104_outstation *of, unsigned number,
	       const struct iec104_controlling_settings *settings,
	       const struct iec104_controlling_listener *listener)
{
	*link = (struct link){.outstation = of,
			      .settings = settings,
			      .listener = listener,
			      .address = of->addresses[number],
			      .reason = "",
			      .due_ns = now};
	link->memory = (struct iec104_memory){.sent_ns = sent_ns[number],
					      .input = link->input,
					      .output = link->output,
					      .input_size = LINK_INPUT_SIZE,
					      .output_size = LINK_OUTPUT_SIZE};
	return true;
}

void link_start(struct link *link, struct iec104_moment moment)
{
	link->state = LINK_STARTING;
	iec104_session_start(&link->controlling.session, moment.monotonic_ns);
}

static void look_at_command(const uint8_t *asdu, size_t size)
{
	struct iec104_command command;
	struct iec104_asdu header;

	if (!iec104_asdu_decode(asdu, size, &header) || header.cause != IEC104_ACTIVATION ||
	    !iec104_command_decode(header.type, header.objects, &command) || command.select)
		return;
	for (unsigned i = 0; i < POINTS; i++)
		if (objects[i].command_ioa == command.ioa && there[points[i].set].ca == header.ca)
			CHECK(executing[i] && ++executions[i] == 1);
}

static void take_output(struct link *link)
{
	size_t size, frame;
	const uint8_t *octets = iec104_session_output(&link->controlling.session, &size);

	for (size_t at = 0; at < size; at += frame) {
		frame = octets[at + 1] + 2u;
		if (frame > IEC104_APCI_SIZE && (octets[at + 2] & 1) == 0)
			look_at_command(octets + at + IEC104_APCI_SIZE, frame - IEC104_APCI_SIZE);
	}
	iec104_session_written(&link->controlling.session, size);
}

void link_run(struct link *link, struct iec104_moment moment)
{
	struct iec104_session *session = &link->controlling.session;

	if (link->state < LINK_OPEN)
		return;
	iec104_controlling_run(&link->controlling, moment);
	if (link->state == LINK_STARTING && session->started)
		link->state = LINK_STARTED;
	take_output(link);
	if (session->closing == IEC104_OPEN)
		return;
	iec104_controlling_run(&link->controlling, moment);
	link->state = LINK_DOWN;
	link->failures++;
	link->due_ns = now + RETRY_NS;
}

int64_t link_deadline(const struct link *link)
{
	return link->state >= LINK_OPEN ? iec104_controlling_deadline(&link->controlling) : INT64_MAX;
}

void link_close(struct link *link)
{
	link->state = LINK_DOWN;
}

/* ---- what happens ------------------------------------------------------------------------ */

static void check(void)
{
	const bool one = outstation.links[0].state == LINK_STARTED,
		   other = outstation.links[1].state == LINK_STARTED;

	CHECK(!one || !other);
	lost_ns = one || other ? 0 : lost_ns == 0 ? now : lost_ns;
	if (lost_ns != 0 && now >= lost_ns + config.t1_s * NS_PER_S)
		for (unsigned i = 0; i < POINTS; i++)
			CHECK(samples[i].quality & MAP_INVALID);
}

static void run(void)
{
	unsigned turns = 0;

	do { /* each may make the next one due: a poll, a link that takes over */
		outstation_run(&outstation, now);
		CHECK(++turns < TURNS_MAX);
	} while (outstation_deadline(&outstation) <= now);
	check();
}

static void connect_link(struct link *link)
{
	if (link->state != LINK_DOWN || now < link->due_ns)
		return;
	link->state = LINK_OPEN;
	iec104_controlling_open(&link->controlling, link->settings, link->listener, &link->memory,
				(struct iec104_moment){now, now + WALL_NS});
}

static void receive(struct link *link, const uint8_t *octets, size_t size)
{
	size_t room;
	uint8_t *place;

	if (link->state < LINK_OPEN)
		return;
	place = iec104_session_space(&link->controlling.session, &room);
	size = size < room ? size : room;
	memcpy(place, octets, size);
	iec104_session_received(&link->controlling.session, size);
}

static void receive_asdu(struct link *link, const uint8_t *asdu, size_t size)
{
	uint8_t frame[IEC104_APDU_MAX];

	iec104_apdu_encode(frame, &(struct iec104_apdu){.format = IEC104_I_FRAME,
							.ns = link->controlling.session.next_nr,
							.nr = link->controlling.session.next_ns,
							.asdu_size = size});
	memcpy(frame + IEC104_APCI_SIZE, asdu, size);
	receive(link, frame, IEC104_APCI_SIZE + size);
}

static void receive_anything(struct link *link, bool framed)
{
	uint8_t octets[IEC104_ASDU_MAX];
	size_t size = 1 + next_octet() % IEC104_ASDU_MAX;

	for (size_t i = 0; i < size; i++)
		octets[i] = next_octet();
	if (framed)
		receive_asdu(link, octets, size);
	else
		receive(link, octets, size);
}

/* Objects of the type that a point has, with and without time tags. */
static void tell(struct link *link, uint8_t argument)
{
	static const uint8_t causes[] = {IEC104_SPONTANEOUS, IEC104_RETURN_REMOTE, IEC104_RETURN_LOCAL,
					 IEC104_INTERROGATED, IEC104_COUNTERS_REQUESTED};
	const unsigned place = argument % (POSITION + 1);
	const bool tagged = next_octet() & 1;
	const struct iec104_asdu header = {
	    .type = place == POSITION ? IEC104_GEOPOSITION : iec104_monitor_type(&points[place], tagged),
	    .cause = causes[next_octet() % sizeof(causes)],
	    .ca = there[points[place].set].ca};
	struct iec104_builder builder;
	uint8_t element[IEC104_GEOPOSITION_SIZE];
	const size_t size = place == POSITION ? sizeof(element) : iec104_information_size(header.type);

	iec104_asdu_begin(&builder, &header);
	for (unsigned i = 1 + next_octet() % 4; i > 0; i--) {
		for (unsigned octet = 0; octet < sizeof(element); octet++)
			element[octet] = next_octet();
		iec104_asdu_add(&builder, FIRST + place, element, size);
	}
	receive_asdu(link, builder.bytes, builder.size);
}

static void answer_request(struct link *link, uint8_t argument)
{
	static const uint8_t causes[] = {IEC104_ACTIVATION_CON, IEC104_ACTIVATION_TERM,
					 IEC104_DEACTIVATION_CON, IEC104_UNKNOWN_IOA};
	const struct iec104_controlling_request *request =
	    &link->controlling.requests[argument % IEC104_CONTROLLING_REQUESTS_MAX];
	const struct iec104_asdu header = {.type = request->type,
					   .cause = causes[next_octet() % sizeof(causes)],
					   .negative = next_octet() % 8 == 0,
					   .ca = request->ca};
	uint8_t element[IEC104_ELEMENT_MAX] = {0};
	struct iec104_builder builder;

	memcpy(element, request->element, request->element_size);
	iec104_asdu_begin(&builder, &header);
	iec104_asdu_add(&builder, request->ioa, element,
			request->element_size + (request->tagged ? IEC104_TIME56_SIZE : 0u));
	receive_asdu(link, builder.bytes, builder.size);
}

static void command(uint8_t argument)
{
	const struct map_request request = {.point = argument % POSITION,
					    .action = MAP_EXECUTE,
					    .value.u = next_octet(),
					    .step = (int8_t)(next_octet() % 3 - 1),
					    .pulse_ms = next_octet() % 4,
					    .deadline_ns = now + 3 * NS_PER_S};

	if (executing[request.point] || points[request.point].type == MAP_COUNTER)
		return; /* the map's state machine refuses it */
	executing[request.point] = true;
	executions[request.point] = 0;
	outstation_execute(&outstation, &request, now);
}

static void step(void)
{
	static const uint8_t startdt_con[] = {0x68, 4, 0x0b, 0, 0, 0};
	const uint8_t octet = next_octet(), argument = octet >> 4;
	struct link *link = &outstation.links[octet >> 3 & 1];

	switch (octet & 7) {
	case 0:
		connect_link(link);
		break;
	case 1:
		receive(link, startdt_con, sizeof(startdt_con));
		break;
	case 2:
		receive_anything(link, argument & 1);
		break;
	case 3:
		tell(link, argument);
		break;
	case 4:
		answer_request(link, argument);
		break;
	case 5:
		command(argument);
		break;
	case 6:
		if (link->state >= LINK_OPEN && argument == 0)
			iec104_session_close(&link->controlling.session, IEC104_CLOSED_BY_PEER);
		clock_set ^= argument == 1;
		break;
	default:
		now += (1 + argument) * NS_PER_S;
		break;
	}
	run();
}

/* A type of each number; a position's points are behind. */
static enum map_type type_of(unsigned point)
{
	static const enum map_type others[] = {MAP_SINGLE, MAP_BITSTRING, MAP_ANGLE, MAP_ANGLE, MAP_FLOAT};

	return point < OTHER ? (enum map_type)point : others[point - OTHER];
}

static void set_up(void)
{
	for (unsigned i = 0; i < POINTS; i++) {
		points[i] = (struct map_point){.set = i >= OTHER,
					       .type = (uint8_t)type_of(i),
					       .flags = i == POSITION ? MAP_POINT_POSITION : 0,
					       .short_pulse_ms = 1,
					       .long_pulse_ms = 2};
		objects[i] = (struct iec104_outstation_point){
		    .ioa = i > POSITION ? (i - POSITION) << 24 | (FIRST + POSITION) : FIRST + i,
		    .command_ioa = 100 + i,
		    .select = i % 2 && i != MAP_BITSTRING};
		samples[i] = (struct map_sample){.quality = MAP_INVALID};
		executing[i] = false;
	}
	configuration.section_count = 0;
	map_add_section(&configuration, IEC104_OUTSTATION_SETS, sizeof(there[0]), 2, there);
	map_add_section(&configuration, IEC104_OUTSTATION_POINTS, sizeof(objects[0]), POINTS, objects);
	config.terminates = next_octet() & 1;
	now = 1000 * NS_PER_S;
	lost_ns = now;
	clock_set = false;
}

int LLVMFuzzerTestOneInput(const uint8_t *data, size_t size)
{
	input = (struct input){.at = data, .end = data + size};
	set_up();
	CHECK(outstation_init(&outstation, NULL, &config, &stats, 1));
	while (input.at < input.end)
		step();
	for (unsigned i = 0; i < LINKS; i++)
		if (outstation.links[i].state >= LINK_OPEN)
			iec104_session_close(&outstation.links[i].controlling.session, IEC104_CLOSED_BY_PEER);
	run();
	for (unsigned i = 0; i < POINTS; i++)
		CHECK(!executing[i]);
	outstation_free(&outstation);
	return 0;
}
