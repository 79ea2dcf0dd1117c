/* SPDX-License-Identifier: GPL-3.0-or-later */
/* Requests to the owners of points and to rtud, and what their answers become: ACT_CON, ACT_TERM, a selection. */
#include "iec104/station_parts.h"
#include "map/time_ns.h"

#include <string.h>

/* Selections are told apart by connection and originator. */
static uint32_t session_of(const struct iec104_connection *connection, uint8_t originator)
{
	return connection->serial << 8 | originator;
}

static bool is_session_of(const struct iec104_connection *connection, uint32_t session)
{
	return session_of(connection, (uint8_t)session) == session;
}

static bool is_free(const struct iec104_open_request *open)
{
	return open->request.id == 0 && !open->terminating;
}

bool iec104_post(struct iec104_station *station, const struct iec104_received *received,
		 struct map_request request)
{
	struct iec104_connection *connection = received->connection;
	uint32_t owner = request.point == MAP_NONE ? MAP_RTUD : map_owner(station->map, request.point);
	struct iec104_open_request *open = station->open_requests;
	struct map_module module;

	while (open < station->open_requests + IEC104_OPEN_REQUESTS_MAX && !is_free(open))
		open++;
	if (open == station->open_requests + IEC104_OPEN_REQUESTS_MAX)
		return false;
	map_module(station->map, owner, &module);
	request.session = session_of(connection, received->asdu.originator);
	request.time_ns = received->now_ns;
	request.deadline_ns = received->now_ns + station->config->settings.command_timeout_s * NS_PER_S;
	request.id = map_request_post(station->map, request);
	if (request.id == 0)
		return false;
	*open = (struct iec104_open_request){.request = request};
	open->generation = module.generation;
	open->connection = connection;
	open->serial = connection->serial;
	open->asdu_size = received->size;
	memcpy(open->asdu, received->bytes, received->size);
	return true;
}

static bool is_still_there(const struct iec104_open_request *open)
{
	return open->connection->open && open->connection->serial == open->serial;
}

static bool takes_data(const struct iec104_open_request *open)
{
	return is_still_there(open) && open->connection->session.started;
}

/* Confirms to the connection that asked, if it is still there and takes data. */
static void report(const struct iec104_station *station, const struct iec104_open_request *open,
		   bool positive)
{
	struct iec104_connection *connection = open->connection;
	struct iec104_received received = {
	    .connection = connection, .bytes = open->asdu, .size = open->asdu_size};
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
	iec104_confirm(&received, !positive);
}

/* The device has confirmed an execution, or that and its end are told at once. Of anything else, an owner gone wild says so. */
static void report_execution(const struct iec104_station *station, struct iec104_open_request *open)
{
	if (open->confirmed || open->request.action != MAP_EXECUTE)
		return;
	report(station, open, true);
	open->confirmed = true;
}

static void begin_termination(const struct iec104_station *station, struct iec104_open_request *open,
			      bool positive)
{
	if (!takes_data(open))
		return;
	open->terminating = true;
	open->failed = !positive;
	open->events_end = iec104_events_end(station, map_owner(station->map, open->request.point));
	open->connection->terminations++;
}

static void end_termination(struct iec104_open_request *open)
{
	open->terminating = false;
	open->connection->terminations--;
}

/* Where no event waits all were sent, whatever an owner gone wild made of its ring. */
static bool return_information_was_sent(const struct iec104_station *station,
					const struct iec104_open_request *open)
{
	return iec104_events_were_sent(open->connection, map_owner(station->map, open->request.point),
				       open->events_end) ||
	       !iec104_event_waits(station, open->connection);
}

bool iec104_send_termination(struct iec104_station *station, struct iec104_connection *connection,
			     int64_t now_ns)
{
	for (unsigned i = 0; connection->terminations > 0 && i < IEC104_OPEN_REQUESTS_MAX; i++) {
		struct iec104_open_request *open = &station->open_requests[i];

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
	for (unsigned i = 0; connection->terminations > 0 && i < IEC104_OPEN_REQUESTS_MAX; i++)
		if (station->open_requests[i].terminating &&
		    station->open_requests[i].connection == connection)
			end_termination(&station->open_requests[i]);
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

static void conclude(struct iec104_station *station, struct iec104_open_request *open, bool positive)
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

void iec104_take_request_answer(struct iec104_station *station, const struct map_answer *answer)
{
	for (unsigned i = 0; i < IEC104_OPEN_REQUESTS_MAX; i++) {
		struct iec104_open_request *open = &station->open_requests[i];

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

bool iec104_owner_has_ended(const struct iec104_station *station, uint32_t owner, uint32_t generation)
{
	struct map_module module;

	map_module(station->map, owner, &module);
	return module.state == MAP_MODULE_DOWN || module.state == MAP_MODULE_STOPPED ||
	       module.generation != generation;
}

/* rtud, which is asked where there is no point, is not outlived by this process. */
static bool owner_has_ended(const struct iec104_station *station, const struct iec104_open_request *open)
{
	return open->request.point != MAP_NONE &&
	       iec104_owner_has_ended(station, map_owner(station->map, open->request.point),
				      open->generation);
}

/*
 * No command begins after its deadline; then its device has at most 10 s (response_timeout_ms), twice for two
 * writes, and the octets take their time; as much again for a pulse and its end. Later than this, request or answer was
 * overwritten in the map unread.
 */
static int64_t last_moment(const struct iec104_open_request *open)
{
	if (!open->confirmed)
		return open->request.deadline_ns + 30 * NS_PER_S;
	return open->request.deadline_ns + 60 * NS_PER_S + open->request.pulse_ms * NS_PER_MS;
}

/* What the device has confirmed is done, unless its pulse is to be ended yet. */
static bool was_done(const struct iec104_open_request *open)
{
	return open->confirmed && open->request.pulse_ms == 0;
}

void iec104_conclude_orphans(struct iec104_station *station, int64_t now_ns)
{
	for (unsigned i = 0; i < IEC104_OPEN_REQUESTS_MAX; i++) {
		struct iec104_open_request *open = &station->open_requests[i];

		if (open->request.id != 0 && (owner_has_ended(station, open) || now_ns >= last_moment(open)))
			conclude(station, open, was_done(open));
	}
}

int64_t iec104_orphan_deadline(const struct iec104_station *station)
{
	int64_t deadline = INT64_MAX;

	for (unsigned i = 0; i < IEC104_OPEN_REQUESTS_MAX; i++) {
		const struct iec104_open_request *open = &station->open_requests[i];

		if (open->request.id != 0 && last_moment(open) < deadline)
			deadline = last_moment(open);
	}
	return deadline;
}
