/* SPDX-License-Identifier: GPL-3.0-or-later */
/*
 * libFuzzer on the agent with its library. The input is a row of acts, an octet each with what it needs behind it: octets of
 * anybody at the socket; a PDU of an authentic user; a SET whose names and spin locks are right, since chance does not find them;
 * the points' owner answers, or is another process; time passes. Whatever comes, no answer is longer than it may be, a command
 * has one of ten states, and what was asked ends.
 */
#include <stdio.h>
#include <string.h>
#include <sys/socket.h>
#include <unistd.h>

#include "fuzz/input.h"
#include "map/supervise.h"
#include "map/test_modules.h"
#include "modules/snmp/answer.h"
#include "modules/snmp/wire.h"

#define POINTS      8
#define MESSAGE_MAX 2048
#define MOST        1472
#define ACTS_MAX    64
#define VARBINDS    4

static char directory[] = "/dev/shm/fuzz_snmp.XXXXXX";
static struct map *rtud, *owner, *map;
static struct snmp_agent agent;
static struct snmp_shared *shared;
static struct wire *wire;
static int outside = -1;
static uint32_t owners_number;

static struct snmp_settings settings = {
    .base = {1, 3, 6, 1, 4, 1, 8072, 9999, 9999, 104},
    .base_length = 10,
    .station = "fuzzed",
    .max_message = MOST,
    .rate = 100000,
    .release_s = 1,
    .user_count = 3,
    .users = {{"viewer", SNMP_VIEWER}, {"operator", SNMP_OPERATOR}, {"engineer", SNMP_ENGINEER}},
};

static struct snmp_keyring ring = {.engine = {{0x80, 0, 0x1f, 0x88, 5, 1, 2, 3, 4}, 9}};

static void remove_map(void)
{
	map_remove(rtud);
	rmdir(directory);
}

static struct map *attach(const char *name)
{
	char error[MAP_ERROR_SIZE];
	struct map *attached = NULL;

	for (uint32_t i = 0; i < map_module_count(rtud); i++) {
		struct map_module module;

		map_module(rtud, i, &module);
		if (strcmp(module.name, name) == 0)
			map_module_starting(rtud, i);
	}
	CHECK(map_attach(&attached, directory, name, error) == 0);
	return attached;
}

/* Commands with selection and without, a counter, measured values. */
static void make_map(void)
{
	static const uint8_t types[POINTS] = {MAP_SINGLE, MAP_DOUBLE,     MAP_SCALED,  MAP_FLOAT,
					      MAP_STEP,   MAP_NORMALIZED, MAP_COUNTER, MAP_BITSTRING};
	struct map_set set = {.ca = 1001, .point_count = POINTS};
	struct map_point points[POINTS];
	struct map_module_plan modules[MAP_MODULES_MAX];
	uint16_t processes[1] = {1};
	struct map_config config = {
	    .settings = {.event_ring = 64, .select_timeout_s = 1, .command_timeout_s = 1},
	    .set_count = 1,
	    .point_count = POINTS,
	    .sets = &set,
	    .points = points};
	char error[MAP_ERROR_SIZE];

	for (uint32_t i = 0; i < POINTS; i++)
		points[i] = (struct map_point){.type = types[i],
					       .ioa = i + 1,
					       .flags = types[i] == MAP_COUNTER ? 0
							: i % 2 == 0            ? MAP_POINT_COMMAND
								     : MAP_POINT_COMMAND | MAP_POINT_SELECT,
					       .group = 1,
					       .short_pulse_ms = 100,
					       .step = 1,
					       .send_period_ms = 1000};
	CHECK(mkdtemp(directory) != NULL);
	map_add_section(&config, SNMP_SETTINGS, sizeof(settings), 1, &settings);
	plan_modules(&config, modules, processes);
	CHECK(map_create(&rtud, directory, &config, 0, error) == 0);
	atexit(remove_map);
	owner = attach("rtu-modbus-1");
	map = attach("rtu-iec104");
	owners_number = map_self(owner);
}

static void begin(void)
{
	int sockets[2];

	make_map();
	CHECK(socketpair(AF_UNIX, SOCK_DGRAM | SOCK_NONBLOCK, 0, sockets) == 0);
	outside = sockets[0];
	for (uint32_t i = 0; i < settings.user_count; i++)
		ring.users[i] = (struct snmp_keys){.auth_size = 32, .priv_size = 16};
	shared = calloc(1, sizeof(*shared));
	CHECK(shared != NULL && snmp_begin(&agent, map, shared));
	agent.boots = 1;
	agent.engine_id_size = ring.engine.size;
	memcpy(agent.engine_id, ring.engine.octets, ring.engine.size);
	if (!wire_init(&agent, &ring))
		abort();
	wire = wire_listen(&agent, sockets[1], answer_request, &agent);
	CHECK(wire != NULL);
	snmp_end(&agent);
}

static size_t take_octets(uint8_t *out, size_t most)
{
	size_t length = next_octet() | (size_t)(next_octet() & 7) << 8, i = 0;

	for (; i < length && i < most && input.at < input.end; i++)
		out[i] = next_octet();
	return i;
}

static void check_answers(void)
{
	static uint8_t answer[65536];
	ssize_t size;

	while ((size = recv(outside, answer, sizeof(answer), MSG_DONTWAIT)) > 0)
		CHECK(size <= MOST);
}

/* ---- acts -------------------------------------------------------------------------------- */

static void hear_anybody(void)
{
	uint8_t octets[MESSAGE_MAX];
	size_t length = take_octets(octets, sizeof(octets));

	if (send(outside, octets, length, 0) > 0)
		wire_read(wire, 1);
}

static void ask(netsnmp_pdu *pdu)
{
	static const long sizes[] = {484, 1472, 65507, 0};
	const uint8_t octet = next_octet();

	pdu->version = SNMP_VERSION_3;
	pdu->securityModel = SNMP_SEC_MODEL_USM;
	pdu->securityLevel = SNMP_SEC_LEVEL_AUTHPRIV;
	pdu->msgMaxSize = sizes[octet & 3];
	pdu->securityName = strdup(settings.users[(octet >> 2 & 3) % settings.user_count].name);
	pdu->securityNameLen = strlen(pdu->securityName);
	pdu->securityEngineID = netsnmp_memdup(agent.engine_id, agent.engine_id_size);
	pdu->securityEngineIDLen = agent.engine_id_size;
	pdu->contextEngineID = netsnmp_memdup(agent.engine_id, agent.engine_id_size);
	pdu->contextEngineIDLen = agent.engine_id_size;
	snmp_new_message(&agent);
	agent.is_clock_master = (octet & 64) != 0;
	answer_request(&agent, wire_session(wire), pdu);
}

static void hear_user(void)
{
	uint8_t octets[MESSAGE_MAX];
	size_t length = take_octets(octets, sizeof(octets));
	netsnmp_pdu *pdu = snmp_pdu_create(SNMP_MSG_GET);

	CHECK(pdu != NULL);
	if (snmp_pdu_parse(pdu, octets, &length) == 0)
		ask(pdu);
	snmp_free_pdu(pdu);
}

static void add_number(netsnmp_pdu *pdu, const struct snmp_place *place, u_char type, const void *value,
		       size_t size)
{
	uint32_t name[SNMP_IDS_MAX];
	const size_t length = snmp_name(&agent, place, name);
	oid ids[SNMP_IDS_MAX];

	for (size_t i = 0; i < length; i++)
		ids[i] = name[i];
	snmp_pdu_add_variable(pdu, ids, length, type, value, size);
}

static long any_number(void)
{
	const uint8_t octet = next_octet();

	return octet < 250 ? octet % 16 : (long)(int32_t)(octet * 0x01020304u);
}

/* Of a row of what can be written: its spin lock, and some of its columns. */
static void add_row(netsnmp_pdu *pdu)
{
	static const uint32_t groups[][3] = {{1, 3, 1}, {1, 4, 2}, {1, 6, 1}, {1, 7, 0}};
	const uint32_t *group = groups[next_octet() % 4];
	uint32_t name[SNMP_IDS_MAX];
	struct snmp_place place;
	struct snmp_value spin;
	long number;

	memcpy(name, settings.base, settings.base_length * sizeof(name[0]));
	memcpy(&name[settings.base_length], group, 3 * sizeof(name[0]));
	CHECK(snmp_next(&agent, name, settings.base_length + (group[2] == 0 ? 2 : 3), SNMP_ENGINEER, &place));
	for (unsigned skip = next_octet() % POINTS; skip > 0; skip--) {
		struct snmp_place next = place;

		if (snmp_after(&agent, SNMP_ENGINEER, &next) && next.column == place.column)
			place = next;
	}
	CHECK(snmp_table_at(&agent, &place)->read(&agent, place.column, place.row, &spin));
	number = (long)spin.number;
	add_number(pdu, &place, ASN_INTEGER, &number, sizeof(number));
	for (unsigned columns = next_octet(); columns != 0; columns >>= 1) {
		uint8_t octets[9];
		size_t size;

		place.column++;
		if (!(columns & 1) || place.column > snmp_table_at(&agent, &place)->last)
			continue;
		number = any_number();
		size = take_octets(octets, sizeof(octets));
		if (size == 0)
			add_number(pdu, &place, ASN_INTEGER, &number, sizeof(number));
		else
			add_number(pdu, &place, ASN_OCTET_STR, octets, size);
	}
}

static void set(void)
{
	netsnmp_pdu *pdu = snmp_pdu_create(SNMP_MSG_SET);
	unsigned rows = next_octet() % VARBINDS + 1u;

	CHECK(pdu != NULL);
	while (rows-- > 0)
		add_row(pdu);
	ask(pdu);
	snmp_free_pdu(pdu);
}

static void serve_requests(void)
{
	struct map_request request;

	map_bell_clear(owner);
	while (map_request_next(owner, &request))
		if (map_command_request(owner, &request))
			map_command_finish(owner, request.point,
					   (enum map_command_result)(1 + next_octet() % MAP_RESULT_SENT),
					   next_octet());
}

static void publish(void)
{
	const struct map_update update = {
	    .point = next_octet() % POINTS,
	    .sample = {.value.u = next_octet(), .quality = next_octet(), .time_ns = map_now_ns()}};

	map_publish(owner, &update, 1);
}

static void tick(void)
{
	snmp_new_message(&agent);
	agent.now_ns += next_octet() * 50 * NS_PER_MS;
	snmp_events_take(&agent);
	snmp_tick(&agent);
}

static void check_agent(void)
{
	for (uint32_t i = 0; i < agent.lists[SNMP_COMMANDS].count; i++)
		CHECK(agent.commands[i].state <= MAP_EXECUTED_COMMAND &&
		      agent.commands[i].spin <= SNMP_SPIN_MAX);
	for (uint32_t i = 0; i < agent.freeze_count; i++)
		CHECK(agent.freezes[i].state == MAP_INACTIVE || agent.freezes[i].state >= MAP_EXECUTING);
}

static void let_pass(int64_t seconds)
{
	snmp_new_message(&agent);
	agent.now_ns += seconds * NS_PER_S;
	snmp_tick(&agent);
}

/* Later than any deadline nothing is asked; a selection, whose time the map measures, ends with its owner's process. */
static void end(void)
{
	let_pass(100);
	CHECK(agent.freezing.waiting == 0 && agent.clock_setting.id == 0);
	for (unsigned i = 0; i < SNMP_ROWS_SET_MAX; i++)
		CHECK(agent.loadings[i].last_id == 0);
	map_module_starting(rtud, owners_number);
	let_pass(200);
	let_pass(300);
	for (uint32_t i = 0; i < agent.lists[SNMP_COMMANDS].count; i++)
		CHECK(agent.commands[i].state == MAP_INACTIVE);
	serve_requests();
}

int LLVMFuzzerTestOneInput(const uint8_t *data, size_t size)
{
	if (rtud == NULL)
		begin();
	input.at = data;
	input.end = data + size;
	shared->epoch = shared->starts = 0;
	CHECK(snmp_begin(&agent, map, shared));
	agent.engine_id_size = ring.engine.size;
	memcpy(agent.engine_id, ring.engine.octets, ring.engine.size);
	for (unsigned acts = 0; acts < ACTS_MAX && input.at < input.end; acts++) {
		map_heartbeat(owner);
		map_heartbeat(map);
		switch (next_octet() % 8) {
		case 0:
			hear_anybody();
			break;
		case 1:
			hear_user();
			break;
		case 2:
		case 3:
			set();
			break;
		case 4:
			serve_requests();
			break;
		case 5:
			publish();
			break;
		case 6:
			map_module_starting(rtud, owners_number);
			break;
		default:
			tick();
			break;
		}
		check_answers();
		check_agent();
	}
	end();
	check_answers();
	snmp_end(&agent);
	return 0;
}
