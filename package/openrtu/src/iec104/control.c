/* SPDX-License-Identifier: GPL-3.0-or-later */
/* Control direction: what is received, checked, refused or carried out. Commands are in command.c. */
#include "iec104/station_parts.h"

#define QRP_PROCESS 1 /* reset of the process */
#define QRP_EVENTS  2 /* of what waits with a time tag */

static void take_parameter(struct iec104_station *station, const struct iec104_received *received)
{
	struct map_request request = {.point = iec104_parameter_point(station, &received->asdu),
				      .action = MAP_PARAMETER};

	if (request.point == MAP_NONE)
		iec104_refuse(received, IEC104_UNKNOWN_IOA);
	else if (!iec104_parameter_request(station, &received->asdu, &request))
		iec104_confirm(received, true);
	else if (received->asdu.test)
		iec104_confirm(received, false);
	else if (!iec104_post(station, received, request))
		iec104_confirm(received, true);
}

static void take_clock(struct iec104_station *station, const struct iec104_received *received)
{
	struct iec104_procedure procedure = iec104_procedure_of(station, &received->asdu);
	int64_t wall_ns;

	if (!received->connection->clock_master) {
		iec104_log(station, MAP_LOG_WARNING, received->connection->peer, "may not set the clock");
		iec104_confirm(received, true);
		return;
	}
	if (!iec104_take_time(station, received, received->asdu.objects + IEC104_IOA_SIZE, &wall_ns)) {
		iec104_confirm(received, true);
		return;
	}
	if (received->asdu.test) {
		if (!iec104_add_procedure(received->connection, &procedure))
			iec104_confirm(received, true);
		return;
	}
	if (!iec104_post(
		station, received,
		(struct map_request){.point = MAP_NONE, .action = MAP_SET_CLOCK, .wall_ns = wall_ns}))
		iec104_confirm(received, true);
}

/* The events of all stations wait in one row. */
static bool drop_events(const struct iec104_station *station, const struct iec104_received *received)
{
	struct iec104_connection *connection = received->connection;

	if (received->asdu.ca != IEC104_CA_BROADCAST &&
	    iec104_next_station(station, 0) != station->config->set_count)
		return false;
	if (received->asdu.test)
		return true;
	map_cursor_to_end(station->map, &connection->cursor);
	return true;
}

static void take_reset(struct iec104_station *station, const struct iec104_received *received)
{
	uint8_t qualifier = received->asdu.objects[IEC104_IOA_SIZE];
	bool restart = qualifier == QRP_PROCESS && !received->asdu.test;
	struct iec104_procedure procedure = iec104_procedure_of(station, &received->asdu);
	bool accepted = false;

	if (restart)
		accepted = iec104_post(station, received,
				       (struct map_request){.point = MAP_NONE, .action = MAP_RESTART});
	else if (qualifier == QRP_PROCESS || (qualifier == QRP_EVENTS && drop_events(station, received)))
		accepted = iec104_add_procedure(received->connection, &procedure);
	if (!accepted)
		iec104_confirm(received, true);
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
	return !(station->settings->originators_refused[originator / 32] & 1u << originator % 32);
}

/* A read command knows no confirmation: it comes back with its own cause. */
static void confirm_negatively(const struct iec104_received *received)
{
	if (received->asdu.type == IEC104_C_RD_NA_1)
		iec104_refuse(received, IEC104_REQUEST);
	else
		iec104_confirm(received, true);
}

static void refuse_originator(const struct iec104_received *received)
{
	map_count(&received->connection->session.counters[IEC104_COUNT_ORIGINATOR], 1);
	confirm_negatively(received);
}

/* What the objects take, by SQ and their number (IEC 60870-5-101, 7.2.2.1). */
static size_t size_of_objects(const struct iec104_asdu *asdu, size_t object_size)
{
	if (asdu->sequence)
		return IEC104_IOA_SIZE + asdu->count * (object_size - IEC104_IOA_SIZE);
	return asdu->count * object_size;
}

/* Each type in control direction has one information object, SQ = 0 (7.3.2, 7.3.4, 7.3.5). */
static bool has_one_object(const struct iec104_asdu *asdu, size_t object_size)
{
	return !asdu->sequence && asdu->count == 1 && asdu->objects_size == object_size;
}

static void take_interrogation(struct iec104_station *station, const struct iec104_received *received)
{
	bool accepted = iec104_interrogate(station, received);

	if (!accepted || received->asdu.cause == IEC104_DEACTIVATION)
		iec104_confirm(received, !accepted);
}

static void take_read(const struct iec104_station *station, const struct iec104_received *received)
{
	if (map_find(station->map, received->asdu.ca, iec104_ioa_decode(received->asdu.objects)) == MAP_NONE)
		iec104_refuse(received, IEC104_UNKNOWN_IOA);
	else
		iec104_mirror(received->connection, received->bytes, received->size, IEC104_REQUEST, false);
}

static void carry_out(struct iec104_station *station, const struct iec104_received *received)
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
		iec104_confirm(received, false);
		break;
	case IEC104_P_ME_NA_1:
	case IEC104_P_ME_NB_1:
	case IEC104_P_ME_NC_1:
	case IEC104_P_AC_NA_1:
		take_parameter(station, received);
		break;
	default:
		iec104_take_command(station, received);
		break;
	}
}

void iec104_take_asdu(struct iec104_station *station, struct iec104_connection *connection,
		      const uint8_t *bytes, size_t size, int64_t now_ns)
{
	struct iec104_received received = {
	    .connection = connection, .bytes = bytes, .size = size, .now_ns = now_ns};
	const struct iec104_asdu *asdu = &received.asdu;
	size_t object_size, objects_size;
	uint32_t device;

	if (!iec104_asdu_decode(bytes, size, &received.asdu)) {
		iec104_session_close(&connection->session, IEC104_BAD_ASDU);
		return;
	}
	object_size = iec104_control_object_size(asdu->type);
	if (object_size == 0) {
		iec104_refuse(&received, IEC104_UNKNOWN_TYPE);
		return;
	}
	objects_size = size_of_objects(asdu, object_size);
	if (asdu->count == 0 || asdu->objects_size < objects_size) {
		iec104_session_close(&connection->session, IEC104_BAD_ASDU);
		return;
	}
	received.size = IEC104_ASDU_HEADER + objects_size; /* what is behind them is not mirrored */
	if (!cause_fits(asdu))
		iec104_refuse(&received, IEC104_UNKNOWN_CAUSE);
	else if (!iec104_find_device(station, asdu->ca, &device) ||
		 (asdu->ca == IEC104_CA_BROADCAST && !may_be_broadcast(asdu->type)))
		iec104_refuse(&received, IEC104_UNKNOWN_CA);
	else if (!has_one_object(asdu, object_size))
		confirm_negatively(&received);
	else if (is_system_command(asdu->type) && iec104_ioa_decode(asdu->objects) != 0)
		iec104_refuse(&received, IEC104_UNKNOWN_IOA);
	else if (!may_command(station, asdu->originator))
		refuse_originator(&received);
	else
		carry_out(station, &received);
}
