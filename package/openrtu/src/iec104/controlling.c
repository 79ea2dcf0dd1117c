/* SPDX-License-Identifier: GPL-3.0-or-later */
#include "iec104/controlling.h"

#include <string.h>

#include "map/time_ns.h"

#define IOA_END (1u << 24)

void iec104_controlling_open(struct iec104_controlling *controlling,
			     const struct iec104_controlling_settings *settings,
			     const struct iec104_controlling_listener *listener,
			     const struct iec104_memory *memory, struct iec104_moment now)
{
	memset(controlling, 0, offsetof(struct iec104_controlling, session));
	controlling->settings = settings;
	controlling->listener = listener;
	iec104_session_open(&controlling->session, &settings->times, IEC104_CONTROLLING,
			    controlling->counters, memory, now.monotonic_ns);
}

/* ---- progress ---------------------------------------------------------------------------- */

/* Tells of the request's new state. The place of one that has ended is free for what the listener asks next. */
static void tell(struct iec104_controlling *controlling, struct iec104_controlling_request *request)
{
	struct iec104_controlling_request told = *request;

	if (iec104_controlling_has_ended(request->state))
		request->id = 0;
	controlling->listener->progress(controlling->listener->context, &told);
}

static void advance(struct iec104_controlling *controlling, struct iec104_controlling_request *request,
		    enum map_command_state state, int64_t deadline_ns)
{
	request->state = (uint8_t)state;
	request->deadline_ns = deadline_ns;
	tell(controlling, request);
}

static void execute_done(struct iec104_controlling *controlling, struct iec104_controlling_request *request)
{
	request->result = MAP_RESULT_DONE;
	advance(controlling, request, MAP_EXECUTED_COMMAND, INT64_MAX);
}

/* Ends the request where it stands. */
static void fail(struct iec104_controlling *controlling, struct iec104_controlling_request *request,
		 enum map_command_result result)
{
	request->result = (uint8_t)result;
	switch (request->state) {
	case MAP_SELECTION_REQUEST:
		advance(controlling, request, MAP_REFUSED_SELECTION, INT64_MAX);
		break;
	case MAP_ACCEPTED_SELECTION:
	case MAP_INTERRUPTION_REQUEST:
		advance(controlling, request, MAP_INTERRUPTED_SELECTION, INT64_MAX);
		break;
	default:
		advance(controlling, request, MAP_REFUSED_COMMAND, INT64_MAX);
		break;
	}
}

static void refuse(struct iec104_controlling *controlling, struct iec104_controlling_request *request,
		   uint8_t cause)
{
	request->cause = cause;
	fail(controlling, request, MAP_RESULT_EXCEPTION);
}

static bool is_interrogation(uint8_t type)
{
	return type == IEC104_C_IC_NA_1 || type == IEC104_C_CI_NA_1;
}

/* How long a confirmed execution may take; 0: it has ended. */
static int64_t execution_ns(const struct iec104_controlling *controlling, uint8_t type)
{
	if (type == IEC104_C_CS_NA_1 || type == IEC104_C_TS_TA_1 || type == IEC104_C_RP_NA_1)
		return 0;
	return is_interrogation(type) ? controlling->settings->interrogation_ns
				      : controlling->settings->termination_ns;
}

static bool take_confirmation(struct iec104_controlling *controlling,
			      struct iec104_controlling_request *request, int64_t now_ns)
{
	int64_t more_ns = execution_ns(controlling, request->type);

	if (request->type == IEC104_C_RD_NA_1)
		return false; /* the value is the answer */
	if (request->state == MAP_SELECTION_REQUEST)
		advance(controlling, request, MAP_ACCEPTED_SELECTION,
			now_ns + controlling->settings->selection_ns);
	else if (request->state != MAP_EXECUTION_REQUEST)
		return false;
	else if (more_ns == 0)
		execute_done(controlling, request);
	else
		advance(controlling, request, MAP_EXECUTING, now_ns + more_ns);
	return true;
}

static bool take_deactivation(struct iec104_controlling *controlling,
			      struct iec104_controlling_request *request)
{
	if (request->state != MAP_INTERRUPTION_REQUEST)
		return false;
	request->result = MAP_RESULT_DONE;
	advance(controlling, request, MAP_INTERRUPTED_SELECTION, INT64_MAX);
	return true;
}

static bool take_termination(struct iec104_controlling *controlling,
			     struct iec104_controlling_request *request)
{
	if (request->state != MAP_EXECUTING)
		return false;
	execute_done(controlling, request);
	return true;
}

/* ---- receiving --------------------------------------------------------------------------- */

static struct iec104_controlling_request *find_open(struct iec104_controlling *controlling, uint8_t type,
						    uint16_t ca, uint32_t ioa)
{
	for (unsigned i = 0; i < controlling->settings->requests_max; i++) {
		struct iec104_controlling_request *request = &controlling->requests[i];

		if (request->id != 0 && request->type == type && request->ca == ca && request->ioa == ioa)
			return request;
	}
	return NULL;
}

static bool is_refusal(const struct iec104_controlling_request *request, const struct iec104_asdu *asdu)
{
	switch (asdu->cause) {
	case IEC104_UNKNOWN_TYPE:
	case IEC104_UNKNOWN_CAUSE:
	case IEC104_UNKNOWN_CA:
	case IEC104_UNKNOWN_IOA:
		return true;
	case IEC104_REQUEST: /* of a read command, which knows no confirmation */
	case IEC104_ACTIVATION_CON:
		return asdu->negative && request->state != MAP_EXECUTING &&
		       request->state != MAP_INTERRUPTION_REQUEST;
	case IEC104_DEACTIVATION_CON:
		return asdu->negative && request->state == MAP_INTERRUPTION_REQUEST;
	case IEC104_ACTIVATION_TERM:
		return asdu->negative && request->state == MAP_EXECUTING;
	default:
		return false;
	}
}

/* Another value, qualifier or S/E than was sent is no answer to it. Time tags may differ. */
static bool mirrors(const struct iec104_controlling_request *request, const struct iec104_asdu *asdu)
{
	return memcmp(asdu->objects + IEC104_IOA_SIZE, request->element, request->element_size) == 0;
}

static bool take_answer(struct iec104_controlling *controlling, struct iec104_controlling_request *request,
			const struct iec104_asdu *asdu, int64_t now_ns)
{
	if (request->state == MAP_ACCEPTED_SELECTION)
		return false; /* nothing of it is open */
	if (is_refusal(request, asdu)) {
		refuse(controlling, request, asdu->cause);
		return true;
	}
	if (asdu->negative || !mirrors(request, asdu))
		return false;
	switch (asdu->cause) {
	case IEC104_ACTIVATION_CON:
		return take_confirmation(controlling, request, now_ns);
	case IEC104_DEACTIVATION_CON:
		return take_deactivation(controlling, request);
	case IEC104_ACTIVATION_TERM:
		return take_termination(controlling, request);
	default:
		return false;
	}
}

/* A type in control direction: the station mirrors a request. */
static void take_mirror(struct iec104_controlling *controlling, const struct iec104_asdu *asdu,
			int64_t now_ns)
{
	struct iec104_controlling_request *request;

	if (asdu->sequence || asdu->count != 1 ||
	    asdu->objects_size != iec104_control_object_size(asdu->type)) {
		iec104_session_close(&controlling->session, IEC104_BAD_ASDU);
		return;
	}
	request = find_open(controlling, asdu->type, asdu->ca, iec104_ioa_decode(asdu->objects));
	if (request == NULL || asdu->test || !take_answer(controlling, request, asdu, now_ns))
		controlling->unexpected++;
}

/* A value with the cause "requested" ends the read command of its address. */
static void end_read(struct iec104_controlling *controlling, const struct iec104_asdu *asdu, uint32_t ioa)
{
	struct iec104_controlling_request *request;

	if (asdu->cause != IEC104_REQUEST || asdu->negative || asdu->test)
		return;
	request = find_open(controlling, IEC104_C_RD_NA_1, asdu->ca, ioa);
	if (request != NULL)
		execute_done(controlling, request);
}

static void take_information(struct iec104_controlling *controlling, const struct iec104_asdu *asdu,
			     int64_t wall_ns)
{
	const struct iec104_controlling_listener *listener = controlling->listener;
	struct iec104_information information;
	unsigned place;

	for (place = 0;
	     iec104_information_decode(asdu, place, &controlling->settings->zone, wall_ns, &information);
	     place++) {
		listener->information(listener->context, asdu, &information);
		end_read(controlling, asdu, information.ioa);
	}
	if (place == 0) /* none, or not as long as their number says */
		iec104_session_close(&controlling->session, IEC104_BAD_ASDU);
}

/* The type is private: what does not hold a position by its length or its place on the Earth is another's. */
static void take_positions(struct iec104_controlling *controlling, const struct iec104_asdu *asdu)
{
	const struct iec104_controlling_listener *listener = controlling->listener;
	struct iec104_geoposition position;
	unsigned known = 0;

	for (unsigned place = 0; place < asdu->count; place++) {
		uint32_t ioa;
		const uint8_t *element = iec104_object(asdu, IEC104_GEOPOSITION_SIZE, place, &ioa);

		if (element == NULL ||
		    !iec104_geoposition_decode(element, &controlling->settings->zone, &position))
			continue;
		known++;
		listener->position(listener->context, asdu, ioa, &position);
		end_read(controlling, asdu, ioa);
	}
	if (known < asdu->count || known == 0)
		controlling->unknown_types++;
}

static void take_asdu(struct iec104_controlling *controlling, const uint8_t *bytes, size_t size,
		      struct iec104_moment now)
{
	struct iec104_asdu asdu;

	if (!iec104_asdu_decode(bytes, size, &asdu)) {
		iec104_session_close(&controlling->session, IEC104_BAD_ASDU);
		return;
	}
	if (iec104_information_size(asdu.type) > 0)
		take_information(controlling, &asdu, now.wall_ns);
	else if (iec104_control_object_size(asdu.type) > 0)
		take_mirror(controlling, &asdu, now.monotonic_ns);
	else if (iec104_is_private(asdu.type) && asdu.type == controlling->settings->position_type)
		take_positions(controlling, &asdu);
	else
		controlling->unknown_types++;
	if (controlling->listener->looked_at != NULL)
		controlling->listener->looked_at(controlling->listener->context, &asdu);
}

static void end_late(struct iec104_controlling *controlling, int64_t now_ns)
{
	for (unsigned i = 0; i < controlling->settings->requests_max; i++)
		if (controlling->requests[i].id != 0 && now_ns >= controlling->requests[i].deadline_ns)
			fail(controlling, &controlling->requests[i], MAP_RESULT_TIMEOUT);
}

static void end_all(struct iec104_controlling *controlling)
{
	for (unsigned i = 0; i < controlling->settings->requests_max; i++)
		if (controlling->requests[i].id != 0)
			fail(controlling, &controlling->requests[i], MAP_RESULT_UNKNOWN_FATE);
}

void iec104_controlling_run(struct iec104_controlling *controlling, struct iec104_moment now)
{
	struct iec104_session *session = &controlling->session;
	const uint8_t *asdu;
	size_t size;

	while (iec104_session_next(session, now.monotonic_ns, &asdu, &size)) {
		if (asdu != NULL)
			take_asdu(controlling, asdu, size, now);
		iec104_session_run(session, now.monotonic_ns);
	}
	iec104_session_run(session, now.monotonic_ns);
	end_late(controlling, now.monotonic_ns);
	if (session->closing != IEC104_OPEN)
		end_all(controlling);
}

int64_t iec104_controlling_deadline(const struct iec104_controlling *controlling)
{
	int64_t deadline = iec104_session_deadline(&controlling->session);

	for (unsigned i = 0; i < controlling->settings->requests_max; i++)
		if (controlling->requests[i].id != 0)
			deadline = earlier(deadline, controlling->requests[i].deadline_ns);
	return deadline;
}

/* ---- sending ----------------------------------------------------------------------------- */

static void send_request(struct iec104_controlling *controlling, struct iec104_controlling_request *request,
			 enum iec104_cause cause, struct iec104_moment now)
{
	const struct iec104_asdu header = {.type = request->type,
					   .cause = (uint8_t)cause,
					   .originator = controlling->settings->originator,
					   .ca = request->ca};
	uint8_t element[IEC104_ELEMENT_MAX];
	size_t size = request->element_size;
	struct iec104_builder builder;

	memcpy(element, request->element, size);
	if (request->tagged) {
		iec104_time56_encode(element + size, now.wall_ns, false, &controlling->settings->zone);
		size += IEC104_TIME56_SIZE;
	}
	iec104_asdu_begin(&builder, &header);
	iec104_asdu_add(&builder, request->ioa, element, size);
	iec104_session_send(&controlling->session, builder.bytes, builder.size, now.monotonic_ns);
	request->deadline_ns = now.monotonic_ns + controlling->settings->confirmation_ns;
}

static struct iec104_controlling_request *free_place(struct iec104_controlling *controlling)
{
	for (unsigned i = 0; i < controlling->settings->requests_max; i++)
		if (controlling->requests[i].id == 0)
			return &controlling->requests[i];
	return NULL;
}

static uint32_t post(struct iec104_controlling *controlling, const struct iec104_controlling_request *wanted,
		     enum iec104_cause cause, struct iec104_moment now)
{
	struct iec104_controlling_request *request = free_place(controlling);

	if (request == NULL || !iec104_session_may_send(&controlling->session) || wanted->ca == 0 ||
	    wanted->ca == IEC104_CA_BROADCAST || wanted->ioa >= IOA_END ||
	    find_open(controlling, wanted->type, wanted->ca, wanted->ioa) != NULL)
		return 0;
	*request = *wanted;
	request->id = ++controlling->next_id;
	if (request->id == 0) /* 0 is none */
		request->id = ++controlling->next_id;
	request->state = wanted->command.select ? MAP_SELECTION_REQUEST : MAP_EXECUTION_REQUEST;
	send_request(controlling, request, cause, now);
	return request->id;
}

uint32_t iec104_controlling_interrogate(struct iec104_controlling *controlling, uint16_t ca, uint8_t qoi,
					struct iec104_moment now)
{
	const struct iec104_controlling_request wanted = {
	    .type = IEC104_C_IC_NA_1, .ca = ca, .element = {qoi}, .element_size = 1};

	return post(controlling, &wanted, IEC104_ACTIVATION, now);
}

uint32_t iec104_controlling_interrogate_counters(struct iec104_controlling *controlling, uint16_t ca,
						 uint8_t qcc, struct iec104_moment now)
{
	const struct iec104_controlling_request wanted = {
	    .type = IEC104_C_CI_NA_1, .ca = ca, .element = {qcc}, .element_size = 1};

	return post(controlling, &wanted, IEC104_ACTIVATION, now);
}

uint32_t iec104_controlling_read(struct iec104_controlling *controlling, uint16_t ca, uint32_t ioa,
				 struct iec104_moment now)
{
	const struct iec104_controlling_request wanted = {.type = IEC104_C_RD_NA_1, .ca = ca, .ioa = ioa};

	return post(controlling, &wanted, IEC104_REQUEST, now);
}

uint32_t iec104_controlling_set_clock(struct iec104_controlling *controlling, uint16_t ca,
				      struct iec104_moment now)
{
	const struct iec104_controlling_request wanted = {.type = IEC104_C_CS_NA_1, .ca = ca, .tagged = true};

	return post(controlling, &wanted, IEC104_ACTIVATION, now);
}

uint32_t iec104_controlling_test(struct iec104_controlling *controlling, uint16_t ca, uint16_t pattern,
				 struct iec104_moment now)
{
	const struct iec104_controlling_request wanted = {
	    .type = IEC104_C_TS_TA_1,
	    .ca = ca,
	    .element = {(uint8_t)pattern, (uint8_t)(pattern >> 8)},
	    .element_size = 2,
	    .tagged = true,
	};

	return post(controlling, &wanted, IEC104_ACTIVATION, now);
}

uint32_t iec104_controlling_reset(struct iec104_controlling *controlling, uint16_t ca, uint8_t qrp,
				  struct iec104_moment now)
{
	const struct iec104_controlling_request wanted = {
	    .type = IEC104_C_RP_NA_1, .ca = ca, .element = {qrp}, .element_size = 1};

	return post(controlling, &wanted, IEC104_ACTIVATION, now);
}

uint32_t iec104_controlling_command(struct iec104_controlling *controlling, uint16_t ca,
				    const struct iec104_command *command, struct iec104_moment now)
{
	struct iec104_controlling_request wanted = {
	    .ca = ca, .ioa = command->ioa, .command = *command, .tagged = command->tagged};

	if ((command->type == MAP_BITSTRING && command->select) ||
	    (command->type == MAP_STEP && command->step != -1 && command->step != 1))
		return 0;
	wanted.command.time = NULL;
	wanted.element_size = iec104_command_encode(wanted.element, command, &wanted.type);
	if (wanted.element_size == 0)
		return 0;
	return post(controlling, &wanted, IEC104_ACTIVATION, now);
}

/* An accepted selection that may go on; NULL: there is none, or nothing may be sent. */
static struct iec104_controlling_request *selection(struct iec104_controlling *controlling, uint32_t id)
{
	if (id == 0 || !iec104_session_may_send(&controlling->session))
		return NULL;
	for (unsigned i = 0; i < controlling->settings->requests_max; i++)
		if (controlling->requests[i].id == id &&
		    controlling->requests[i].state == MAP_ACCEPTED_SELECTION)
			return &controlling->requests[i];
	return NULL;
}

bool iec104_controlling_execute(struct iec104_controlling *controlling, uint32_t id, struct iec104_moment now)
{
	struct iec104_controlling_request *request = selection(controlling, id);

	if (request == NULL)
		return false;
	request->command.select = false;
	iec104_command_encode(request->element, &request->command, &request->type);
	request->state = MAP_EXECUTION_REQUEST;
	send_request(controlling, request, IEC104_ACTIVATION, now);
	return true;
}

bool iec104_controlling_cancel(struct iec104_controlling *controlling, uint32_t id, struct iec104_moment now)
{
	struct iec104_controlling_request *request = selection(controlling, id);

	if (request == NULL)
		return false;
	request->state = MAP_INTERRUPTION_REQUEST;
	send_request(controlling, request, IEC104_DEACTIVATION, now);
	return true;
}
