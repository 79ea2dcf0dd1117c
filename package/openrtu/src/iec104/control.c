/* SPDX-License-Identifier: GPL-3.0-or-later */
/* Control direction: what is received, checked, refused, carried out and answered. */
#include "iec104/station_parts.h"

#include <math.h>
#include <string.h>

#define NS_PER_S       1000000000LL
#define NS_PER_MS      1000000LL
#define QU_NONE        0
#define QU_SHORT_PULSE 1
#define QU_LONG_PULSE  2
#define QU_PERSISTENT  3
#define QRP_PROCESS    1 /* reset of the process */
#define QRP_EVENTS     2 /* of what waits with a time tag */
#define DOUBLE_OFF     1
#define DOUBLE_ON      2

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

static bool is_free(const struct iec104_open_command *open)
{
	return open->request.id == 0 && !open->terminating;
}

static bool post(struct iec104_station *station, const struct received *received, struct map_request request)
{
	struct iec104_connection *connection = received->connection;
	uint32_t owner = request.point == MAP_NONE ? MAP_RTUD : map_owner(station->map, request.point);
	struct iec104_open_command *open = station->open_commands;
	struct map_module module;

	while (open < station->open_commands + IEC104_OPEN_COMMANDS_MAX && !is_free(open))
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
	*open = (struct iec104_open_command){.request = request};
	open->generation = module.generation;
	open->connection = connection;
	open->serial = connection->serial;
	open->asdu_size = received->size;
	memcpy(open->asdu, received->bytes, received->size);
	return true;
}

/* A regulating step command has no point type of its own: objects that are configured for it take it. */
static bool takes(const struct map_point *point, const struct iec104_command *command)
{
	if (!(point->flags & MAP_POINT_COMMAND))
		return false;
	return command->type == MAP_STEP ? point->step > 0 : point->type == command->type;
}

/* QU (IEC 60870-5-101, 7.2.6.26) as a duration, 0: persistent. False: reserved, or the point has no such pulse. */
static bool pulse_of(const struct map_point *point, uint8_t qualifier, uint16_t *pulse_ms)
{
	switch (qualifier) {
	case QU_NONE:
	case QU_PERSISTENT:
		*pulse_ms = 0;
		return true;
	case QU_SHORT_PULSE:
		*pulse_ms = point->short_pulse_ms;
		return *pulse_ms != 0;
	case QU_LONG_PULSE:
		*pulse_ms = point->long_pulse_ms;
		return *pulse_ms != 0;
	default:
		return false;
	}
}

static bool value_can_be_sent(const struct map_point *point, const struct iec104_command *command)
{
	uint16_t pulse_ms;

	switch (command->type) {
	case MAP_SINGLE: /* a pulse to OFF would end with OFF */
		return pulse_of(point, command->qualifier, &pulse_ms) &&
		       (pulse_ms == 0 || command->value.u == 1);
	case MAP_DOUBLE:
		return pulse_of(point, command->qualifier, &pulse_ms) &&
		       (command->value.u == DOUBLE_OFF || command->value.u == DOUBLE_ON);
	case MAP_STEP: /* a register holds no pulse */
		return (command->qualifier == QU_NONE || command->qualifier == QU_PERSISTENT) &&
		       command->step != 0;
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

	if (!iec104_time56_decode(command->time, &station->config->settings.zone, &wall_ns))
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

static struct map_request request_of(const struct iec104_station *station, uint32_t point,
				     const struct received *received, const struct iec104_command *command)
{
	struct map_request request = {.point = point,
				      .action = (uint8_t)action_of(received, command),
				      .value = command->value,
				      .step = command->step};

	if (command->type == MAP_SINGLE || command->type == MAP_DOUBLE)
		pulse_of(iec104_point(station, point), command->qualifier, &request.pulse_ms);
	return request;
}

static void take_command(struct iec104_station *station, const struct received *received)
{
	struct iec104_command command;
	uint32_t point;

	iec104_command_decode(received->asdu.type, received->asdu.objects, &command);
	point = map_find(station->map, received->asdu.ca, command.ioa);
	if (point == MAP_NONE || !takes(iec104_point(station, point), &command)) {
		refuse(received, IEC104_UNKNOWN_IOA);
		return;
	}
	if (!value_can_be_sent(iec104_point(station, point), &command) ||
	    (command.tagged && !time_tag_is_recent(station, &command, received->now_ns))) {
		confirm(received, true);
		return;
	}
	if (received->asdu.test) {
		confirm(received, false);
		return;
	}
	if (!post(station, received, request_of(station, point, received, &command)))
		confirm(received, true);
}

static void take_parameter(struct iec104_station *station, const struct received *received)
{
	struct map_request request = {.point = iec104_parameter_point(station, &received->asdu),
				      .action = MAP_PARAMETER};

	if (request.point == MAP_NONE)
		refuse(received, IEC104_UNKNOWN_IOA);
	else if (!iec104_parameter_request(&received->asdu, &request))
		confirm(received, true);
	else if (received->asdu.test)
		confirm(received, false);
	else if (!post(station, received, request))
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
	if (!iec104_time56_decode(received->asdu.objects + IEC104_IOA_SIZE, &station->config->settings.zone,
				  &wall_ns)) {
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

/* The events of all stations wait in one row. */
static bool drop_events(const struct iec104_station *station, const struct received *received)
{
	struct iec104_connection *connection = received->connection;

	if (received->asdu.ca != IEC104_CA_BROADCAST && station->config->device_count > 1)
		return false;
	if (received->asdu.test)
		return true;
	map_cursor_to_end(station->map, &connection->cursor);
	return true;
}

static void take_reset(struct iec104_station *station, const struct received *received)
{
	uint8_t qualifier = received->asdu.objects[IEC104_IOA_SIZE];
	bool restart = qualifier == QRP_PROCESS && !received->asdu.test;
	struct iec104_procedure procedure = iec104_procedure_of(station, &received->asdu);
	bool accepted = false;

	if (restart)
		accepted =
		    post(station, received, (struct map_request){.point = MAP_NONE, .action = MAP_RESTART});
	else if (qualifier == QRP_PROCESS || (qualifier == QRP_EVENTS && drop_events(station, received)))
		accepted = iec104_add_procedure(received->connection, &procedure);
	if (!accepted)
		confirm(received, true);
}

static bool is_still_there(const struct iec104_open_command *open)
{
	return open->connection->open && open->connection->serial == open->serial;
}

static bool takes_data(const struct iec104_open_command *open)
{
	return is_still_there(open) && open->connection->session.started;
}

/* Confirms to the connection that asked, if it is still there and takes data. */
static void report(const struct iec104_station *station, const struct iec104_open_command *open,
		   bool positive)
{
	struct iec104_connection *connection = open->connection;
	struct received received = {.connection = connection, .bytes = open->asdu, .size = open->asdu_size};
	struct iec104_procedure procedure;

	if (!takes_data(open))
		return;
	iec104_asdu_decode(open->asdu, open->asdu_size, &received.asdu);
	if (positive && open->request.point == MAP_NONE) { /* confirmed by each station that is meant */
		procedure = iec104_procedure_of(station, &received.asdu);
		if (iec104_add_procedure(connection, &procedure))
			return;
		positive = false;
	}
	confirm(&received, !positive);
}

/* The device has confirmed an execution, or that and its end are told at once. Of anything else, an owner gone wild says so. */
static void report_execution(const struct iec104_station *station, struct iec104_open_command *open)
{
	if (open->confirmed || open->request.action != MAP_EXECUTE)
		return;
	report(station, open, true);
	open->confirmed = true;
}

static void begin_termination(const struct iec104_station *station, struct iec104_open_command *open,
			      bool positive)
{
	if (!takes_data(open))
		return;
	open->terminating = true;
	open->failed = !positive;
	open->events_end = iec104_events_end(station, map_owner(station->map, open->request.point));
	open->connection->terminations++;
}

static void end_termination(struct iec104_open_command *open)
{
	open->terminating = false;
	open->connection->terminations--;
}

/* Where no event waits all were sent, whatever an owner gone wild made of its ring. */
static bool return_information_was_sent(const struct iec104_station *station,
					const struct iec104_open_command *open)
{
	return iec104_events_were_sent(open->connection, map_owner(station->map, open->request.point),
				       open->events_end) ||
	       !iec104_event_waits(station, open->connection);
}

bool iec104_send_termination(struct iec104_station *station, struct iec104_connection *connection,
			     int64_t now_ns)
{
	for (unsigned i = 0; connection->terminations > 0 && i < IEC104_OPEN_COMMANDS_MAX; i++) {
		struct iec104_open_command *open = &station->open_commands[i];

		if (!open->terminating || open->connection != connection ||
		    !return_information_was_sent(station, open))
			continue;
		iec104_asdu_mirror(open->asdu, IEC104_ACTIVATION_TERM, open->failed);
		iec104_session_send(&connection->session, open->asdu, open->asdu_size, now_ns);
		end_termination(open);
		return true;
	}
	return false;
}

void iec104_drop_terminations(struct iec104_station *station, struct iec104_connection *connection)
{
	for (unsigned i = 0; connection->terminations > 0 && i < IEC104_OPEN_COMMANDS_MAX; i++)
		if (station->open_commands[i].terminating &&
		    station->open_commands[i].connection == connection)
			end_termination(&station->open_commands[i]);
}

/* Back to inactive. The owner sees to it that only the session that was last served can do that. */
static void release(struct iec104_station *station, uint32_t point, uint32_t session)
{
	map_request_post(station->map,
			 (struct map_request){.point = point, .action = MAP_RELEASE, .session = session});
}

/* It holds the point's command side until it is released. */
static bool is_command(uint8_t action)
{
	return action == MAP_SELECT || action == MAP_EXECUTE || action == MAP_CANCEL;
}

static void conclude(struct iec104_station *station, struct iec104_open_command *open, bool positive)
{
	bool selected = positive && open->request.action == MAP_SELECT && is_still_there(open);

	if (positive)
		report_execution(station, open);
	if (open->confirmed)
		begin_termination(station, open, positive);
	else
		report(station, open, positive);
	open->request.id = 0;
	if (selected)
		open->connection->selects = true;
	else if (is_command(open->request.action))
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

static void take_answer(struct iec104_station *station, const struct map_answer *answer)
{
	if (answer->action == MAP_FREEZE) {
		iec104_take_freeze_answer(station, answer);
		return;
	}
	for (unsigned i = 0; i < IEC104_OPEN_COMMANDS_MAX; i++) {
		struct iec104_open_command *open = &station->open_commands[i];

		if (open->request.id == 0 || open->request.id != answer->id)
			continue;
		if (answer->state == MAP_EXECUTING && answer->result == MAP_RESULT_DONE)
			report_execution(station, open);
		else if (answer->state != MAP_EXECUTING)
			conclude(station, open,
				 answer->state == MAP_ACCEPTED_SELECTION ||
				     answer->state == MAP_INTERRUPTED_SELECTION ||
				     answer->state == MAP_EXECUTED_COMMAND);
		return;
	}
}

bool iec104_take_answers(struct iec104_station *station)
{
	struct map_answer answer;
	bool any = false;

	for (; map_answer_next(station->map, &answer); any = true)
		take_answer(station, &answer);
	return any;
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
 * writes, and the octets take their time; as much again for a pulse and its end. Later than this, request or answer was
 * overwritten in the map unread.
 */
static int64_t last_moment(const struct iec104_open_command *open)
{
	if (!open->confirmed)
		return open->request.deadline_ns + 30 * NS_PER_S;
	return open->request.deadline_ns + 60 * NS_PER_S + open->request.pulse_ms * NS_PER_MS;
}

/* What the device has confirmed is done, unless its pulse is to be ended yet. */
static bool was_done(const struct iec104_open_command *open)
{
	return open->confirmed && open->request.pulse_ms == 0;
}

void iec104_conclude_orphans(struct iec104_station *station, int64_t now_ns)
{
	for (unsigned i = 0; i < IEC104_OPEN_COMMANDS_MAX; i++) {
		struct iec104_open_command *open = &station->open_commands[i];

		if (open->request.id != 0 && (owner_has_ended(station, open) || now_ns >= last_moment(open)))
			conclude(station, open, was_done(open));
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
	case IEC104_C_RP_NA_1:
	case IEC104_C_TS_TA_1:
	case IEC104_P_ME_NA_1:
	case IEC104_P_ME_NB_1:
	case IEC104_P_ME_NC_1:
		return asdu->cause == IEC104_ACTIVATION;
	default:
		return asdu->cause == IEC104_ACTIVATION || asdu->cause == IEC104_DEACTIVATION;
	}
}

/* IEC 60870-5-101, 7.2.4: the types of this room that may address all stations. */
static bool may_be_broadcast(uint8_t type)
{
	return type == IEC104_C_IC_NA_1 || type == IEC104_C_CI_NA_1 || type == IEC104_C_CS_NA_1 ||
	       type == IEC104_C_RP_NA_1;
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

static void take_interrogation(struct iec104_station *station, const struct received *received)
{
	bool accepted = iec104_interrogate(station, received->connection, received->bytes, received->size,
					   received->now_ns);

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
	case IEC104_C_RP_NA_1:
		take_reset(station, received);
		break;
	case IEC104_C_TS_TA_1:
		confirm(received, false);
		break;
	case IEC104_P_ME_NA_1:
	case IEC104_P_ME_NB_1:
	case IEC104_P_ME_NC_1:
	case IEC104_P_AC_NA_1:
		take_parameter(station, received);
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
