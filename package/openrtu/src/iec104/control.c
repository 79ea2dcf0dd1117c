/* SPDX-License-Identifier: GPL-3.0-or-later */
/* Control direction: what is received, checked, refused, carried out and answered. */
#include "iec104/station_parts.h"

#include <math.h>
#include <string.h>

#define NS_PER_S      1000000000LL
#define QU_NONE       0
#define QU_PERSISTENT 3
#define DOUBLE_OFF    1
#define DOUBLE_ON     2

/* An ASDU that a connection has received. */
struct received {
	struct iec104_connection *connection;
	const uint8_t *bytes;
	size_t size;
	struct iec104_asdu asdu;
	int64_t now_ns;
};

static void refuse(const struct received *received, enum iec104_cause cause)
{
	iec104_mirror(received->connection, received->bytes, received->size, cause, true);
}

static void confirm(const struct received *received, bool negative)
{
	iec104_mirror(received->connection, received->bytes, received->size,
		      received->asdu.cause == IEC104_DEACTIVATION ? IEC104_DEACTIVATION_CON
								  : IEC104_ACTIVATION_CON,
		      negative);
}

/* ---- commands ---------------------------------------------------------------------------- */

/* Selections are told apart by connection and originator. */
static uint32_t session_of(const struct iec104_connection *connection, uint8_t originator)
{
	return connection->serial << 8 | originator;
}

static bool is_session_of(const struct iec104_connection *connection, uint32_t session)
{
	return session_of(connection, (uint8_t)session) == session;
}

static bool post(struct iec104_station *station, const struct received *received, struct map_request request)
{
	struct iec104_connection *connection = received->connection;
	uint32_t owner = request.point == MAP_NONE ? MAP_RTUD : map_owner(station->map, request.point);
	struct iec104_open_command *open = station->open_commands;
	struct map_module module;

	while (open < station->open_commands + IEC104_OPEN_COMMANDS_MAX && open->request.id != 0)
		open++;
	if (open == station->open_commands + IEC104_OPEN_COMMANDS_MAX)
		return false;
	map_module(station->map, owner, &module);
	request.session = session_of(connection, received->asdu.originator);
	request.time_ns = received->now_ns;
	request.deadline_ns = received->now_ns + station->config->settings.command_timeout_s * NS_PER_S;
	request.id = map_request_post(station->map, request);
	if (request.id == 0)
		return false;
	open->request = request;
	open->generation = module.generation;
	open->connection = connection;
	open->serial = connection->serial;
	open->asdu_size = received->size;
	memcpy(open->asdu, received->bytes, received->size);
	return true;
}

static bool value_can_be_sent(const struct iec104_command *command)
{
	switch (command->type) {
	case MAP_SINGLE: /* a pulse would need its end kept in the map, whatever becomes of this process */
		return command->qualifier == QU_NONE || command->qualifier == QU_PERSISTENT;
	case MAP_DOUBLE:
		return (command->qualifier == QU_NONE || command->qualifier == QU_PERSISTENT) &&
		       (command->value.u == DOUBLE_OFF || command->value.u == DOUBLE_ON);
	case MAP_FLOAT:
		return command->qualifier == 0 && isfinite(command->value.f);
	default:
		return command->qualifier == 0;
	}
}

static bool time_tag_is_recent(const struct iec104_station *station, const struct iec104_command *command,
			       int64_t now_ns)
{
	struct map_clock clock = map_clock_read(station->map);
	int64_t limit_ns = station->config->settings.command_timeout_s * NS_PER_S;
	int64_t wall_ns, age_ns;

	if (!iec104_time56_decode(command->time, &wall_ns))
		return false;
	age_ns = now_ns + clock.offset_ns - wall_ns;
	return !clock.set || (age_ns <= limit_ns && age_ns >= -limit_ns);
}

static enum map_action action_of(const struct received *received, const struct iec104_command *command)
{
	if (received->asdu.cause == IEC104_DEACTIVATION)
		return MAP_CANCEL;
	return command->select ? MAP_SELECT : MAP_EXECUTE;
}

static void take_command(struct iec104_station *station, const struct received *received)
{
	struct iec104_command command;
	uint32_t point;

	iec104_command_decode(received->asdu.type, received->asdu.objects, &command);
	point = map_find(station->map, received->asdu.ca, command.ioa);
	if (point == MAP_NONE || iec104_point(station, point)->type != command.type ||
	    !(iec104_point(station, point)->flags & MAP_POINT_COMMAND)) {
		refuse(received, IEC104_UNKNOWN_IOA);
		return;
	}
	if (!value_can_be_sent(&command) ||
	    (command.tagged && !time_tag_is_recent(station, &command, received->now_ns))) {
		confirm(received, true);
		return;
	}
	if (received->asdu.test) {
		confirm(received, false);
		return;
	}
	if (!post(station, received,
		  (struct map_request){.point = point,
				       .action = (uint8_t)action_of(received, &command),
				       .value = command.value}))
		confirm(received, true);
}

static void take_clock(struct iec104_station *station, const struct received *received)
{
	struct iec104_procedure procedure = iec104_procedure_of(station, &received->asdu);
	int64_t wall_ns;

	if (!received->connection->clock_master) {
		iec104_log(station, MAP_LOG_WARNING, received->connection->peer, "may not set the clock");
		confirm(received, true);
		return;
	}
	if (!iec104_time56_decode(received->asdu.objects + IEC104_IOA_SIZE, &wall_ns)) {
		confirm(received, true);
		return;
	}
	if (received->asdu.test) {
		if (!iec104_add_procedure(received->connection, &procedure))
			confirm(received, true);
		return;
	}
	if (!post(station, received,
		  (struct map_request){.point = MAP_NONE, .action = MAP_SET_CLOCK, .wall_ns = wall_ns}))
		confirm(received, true);
}

static bool is_still_there(const struct iec104_open_command *open)
{
	return open->connection->open && open->connection->serial == open->serial;
}

/* Tells the connection that asked, if it is still there and takes data. */
static void report(const struct iec104_station *station, const struct iec104_open_command *open,
		   bool positive)
{
	struct iec104_connection *connection = open->connection;
	struct received received = {.connection = connection, .bytes = open->asdu, .size = open->asdu_size};
	struct iec104_procedure procedure;

	if (!is_still_there(open) || !connection->session.started)
		return;
	iec104_asdu_decode(open->asdu, open->asdu_size, &received.asdu);
	if (positive && open->request.action == MAP_SET_CLOCK) {
		procedure = iec104_procedure_of(station, &received.asdu);
		if (iec104_add_procedure(connection, &procedure))
			return;
		positive = false;
	}
	confirm(&received, !positive);
	if (positive && open->request.action == MAP_EXECUTE)
		iec104_mirror(connection, open->asdu, open->asdu_size, IEC104_ACTIVATION_TERM, false);
}

/* Back to inactive. The owner sees to it that only the session that was last served can do that. */
static void release(struct iec104_station *station, uint32_t point, uint32_t session)
{
	map_request_post(station->map,
			 (struct map_request){.point = point, .action = MAP_RELEASE, .session = session});
}

static void conclude(struct iec104_station *station, struct iec104_open_command *open, bool positive)
{
	bool selected = positive && open->request.action == MAP_SELECT && is_still_there(open);

	report(station, open, positive);
	open->request.id = 0;
	if (selected)
		open->connection->selects = true;
	else if (open->request.action != MAP_SET_CLOCK)
		release(station, open->request.point, open->request.session);
}

/* Nobody else can use them, and each keeps everybody else from its point until it times out. */
void iec104_end_selections(struct iec104_station *station, const struct iec104_connection *connection)
{
	for (uint32_t i = 0; connection->selects && i < station->config->point_count; i++) {
		struct map_command command;

		if ((iec104_point(station, i)->flags & MAP_POINT_COMMAND) &&
		    map_command_read(station->map, i, &command) && command.state == MAP_ACCEPTED_SELECTION &&
		    command.requester == map_self(station->map) && is_session_of(connection, command.session))
			release(station, i, command.session);
	}
}

void iec104_take_answer(struct iec104_station *station, const struct map_answer *answer)
{
	for (unsigned i = 0; i < IEC104_OPEN_COMMANDS_MAX; i++) {
		struct iec104_open_command *open = &station->open_commands[i];

		if (open->request.id == 0 || open->request.id != answer->id)
			continue;
		if (answer->state != MAP_EXECUTING)
			conclude(station, open,
				 answer->state == MAP_ACCEPTED_SELECTION ||
				     answer->state == MAP_INTERRUPTED_SELECTION ||
				     answer->state == MAP_EXECUTED_COMMAND);
		return;
	}
}

/*
 * An owner whose generation has ended will not answer, and nobody knows what became of the command. One that
 * is only silent for a moment will: rtud decides, not the heartbeat's age.
 */
static bool owner_has_ended(const struct iec104_station *station, const struct iec104_open_command *open)
{
	struct map_module module;

	if (open->request.point == MAP_NONE)
		return false; /* rtud, which this process does not outlive */
	map_module(station->map, map_owner(station->map, open->request.point), &module);
	return module.state == MAP_MODULE_DOWN || module.state == MAP_MODULE_STOPPED ||
	       module.generation != open->generation;
}

/*
 * No command begins after its deadline; then its device has at most 10 s (response_timeout_ms), twice for two
 * writes, and the octets take their time. Later than this, request or answer was overwritten in the map unread.
 */
static int64_t last_moment(const struct iec104_open_command *open)
{
	return open->request.deadline_ns + 30 * NS_PER_S;
}

void iec104_conclude_orphans(struct iec104_station *station, int64_t now_ns)
{
	for (unsigned i = 0; i < IEC104_OPEN_COMMANDS_MAX; i++) {
		struct iec104_open_command *open = &station->open_commands[i];

		if (open->request.id != 0 && (owner_has_ended(station, open) || now_ns >= last_moment(open)))
			conclude(station, open, false);
	}
}

int64_t iec104_orphan_deadline(const struct iec104_station *station)
{
	int64_t deadline = INT64_MAX;

	for (unsigned i = 0; i < IEC104_OPEN_COMMANDS_MAX; i++) {
		const struct iec104_open_command *open = &station->open_commands[i];

		if (open->request.id != 0 && last_moment(open) < deadline)
			deadline = last_moment(open);
	}
	return deadline;
}

/* ---- receiving --------------------------------------------------------------------------- */

static bool cause_fits(const struct iec104_asdu *asdu)
{
	switch (asdu->type) {
	case IEC104_C_RD_NA_1:
		return asdu->cause == IEC104_REQUEST;
	case IEC104_C_CS_NA_1:
	case IEC104_C_TS_TA_1:
		return asdu->cause == IEC104_ACTIVATION;
	default:
		return asdu->cause == IEC104_ACTIVATION || asdu->cause == IEC104_DEACTIVATION;
	}
}

/* IEC 60870-5-101, 7.2.4: the types of this room that may address all stations. */
static bool may_be_broadcast(uint8_t type)
{
	return type == IEC104_C_IC_NA_1 || type == IEC104_C_CI_NA_1 || type == IEC104_C_CS_NA_1;
}

static bool is_system_command(uint8_t type)
{
	return may_be_broadcast(type) || type == IEC104_C_TS_TA_1;
}

static bool may_command(const struct iec104_station *station, uint8_t originator)
{
	return !(station->config->settings.originators_refused[originator / 32] & 1u << originator % 32);
}

/* A read command knows no confirmation: it comes back with its own cause. */
static void refuse_originator(const struct received *received)
{
	map_count(&received->connection->session.counters[MAP_STATION_ORIGINATOR], 1);
	if (received->asdu.type == IEC104_C_RD_NA_1)
		refuse(received, IEC104_REQUEST);
	else
		confirm(received, true);
}

static void take_interrogation(const struct iec104_station *station, const struct received *received)
{
	bool accepted = iec104_interrogate(station, received->connection, &received->asdu);

	if (!accepted || received->asdu.cause == IEC104_DEACTIVATION)
		confirm(received, !accepted);
}

static void take_read(const struct iec104_station *station, const struct received *received)
{
	if (map_find(station->map, received->asdu.ca, iec104_ioa_decode(received->asdu.objects)) == MAP_NONE)
		refuse(received, IEC104_UNKNOWN_IOA);
	else
		iec104_mirror(received->connection, received->bytes, received->size, IEC104_REQUEST, false);
}

static void carry_out(struct iec104_station *station, const struct received *received)
{
	switch (received->asdu.type) {
	case IEC104_C_IC_NA_1:
	case IEC104_C_CI_NA_1:
		take_interrogation(station, received);
		break;
	case IEC104_C_RD_NA_1:
		take_read(station, received);
		break;
	case IEC104_C_CS_NA_1:
		take_clock(station, received);
		break;
	case IEC104_C_TS_TA_1:
		confirm(received, false);
		break;
	default:
		take_command(station, received);
		break;
	}
}

void iec104_take_asdu(struct iec104_station *station, struct iec104_connection *connection,
		      const uint8_t *bytes, size_t size, int64_t now_ns)
{
	struct received received = {.connection = connection, .bytes = bytes, .size = size, .now_ns = now_ns};
	const struct iec104_asdu *asdu = &received.asdu;
	size_t object_size;
	uint32_t device;

	if (!iec104_asdu_decode(bytes, size, &received.asdu)) {
		iec104_session_close(&connection->session, IEC104_BAD_ASDU);
		return;
	}
	object_size = iec104_control_object_size(asdu->type);
	if (object_size == 0)
		refuse(&received, IEC104_UNKNOWN_TYPE);
	else if (asdu->sequence || asdu->count != 1 || asdu->objects_size != object_size)
		iec104_session_close(&connection->session, IEC104_BAD_ASDU);
	else if (!cause_fits(asdu))
		refuse(&received, IEC104_UNKNOWN_CAUSE);
	else if (!iec104_find_device(station, asdu->ca, &device) ||
		 (asdu->ca == IEC104_CA_BROADCAST && !may_be_broadcast(asdu->type)))
		refuse(&received, IEC104_UNKNOWN_CA);
	else if (is_system_command(asdu->type) && iec104_ioa_decode(asdu->objects) != 0)
		refuse(&received, IEC104_UNKNOWN_IOA);
	else if (!may_command(station, asdu->originator))
		refuse_originator(&received);
	else
		carry_out(station, &received);
}
