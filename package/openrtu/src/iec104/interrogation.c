/* SPDX-License-Identifier: GPL-3.0-or-later */
/* Interrogations, and confirmations of a clock synchronisation: procedures that go from station to station. */
#include "iec104/station_parts.h"

#define QOI_STATION    20
#define QOI_GROUP_LAST 36
#define RQT_FIRST      1
#define RQT_GENERAL    5

static bool interrogated(const struct iec104_station *station, const struct iec104_connection *connection,
			 uint32_t point)
{
	const struct iec104_procedure *procedure = &connection->procedures[connection->first_procedure];
	const struct map_point *object = iec104_point(station, point);

	if (procedure->type == IEC104_C_CI_NA_1)
		return iec104_is_counter_of(station, point, procedure->qualifier);
	return object->type != MAP_COUNTER &&
	       (procedure->qualifier == QOI_STATION || object->group == procedure->qualifier - QOI_STATION);
}

/* The system command itself, as this station confirms and terminates it. */
static void send_procedure(const struct iec104_station *station, struct iec104_connection *connection,
			   const struct iec104_procedure *procedure, enum iec104_cause cause, int64_t now_ns)
{
	struct iec104_builder builder;
	uint8_t element[IEC104_TIME56_SIZE] = {procedure->qualifier};
	size_t size = 1;

	if (procedure->type == IEC104_C_CS_NA_1) { /* the station's own time, now that it is synchronised */
		struct map_clock clock = map_clock_read(station->map);

		iec104_time56_encode(element, now_ns + clock.offset_ns, !clock.set,
				     &station->config->settings.zone);
		size = IEC104_TIME56_SIZE;
	}
	iec104_asdu_begin(&builder, &(struct iec104_asdu){
					.type = procedure->type,
					.cause = (uint8_t)cause,
					.test = procedure->test,
					.originator = procedure->originator,
					.ca = station->config->sets[procedure->device].ca,
				    });
	iec104_asdu_add(&builder, 0, element, size);
	iec104_send(connection, &builder, now_ns);
}

static void next_station(const struct iec104_station *station, struct iec104_connection *connection,
			 struct iec104_procedure *procedure)
{
	procedure->phase = IEC104_CONFIRM;
	procedure->device = iec104_next_station(station, procedure->device);
	if (!procedure->broadcast || procedure->device == station->config->set_count)
		iec104_end_first_procedure(connection);
}

static bool is_freeze(const struct iec104_procedure *procedure)
{
	return procedure->type == IEC104_C_CI_NA_1 && IEC104_QCC_FREEZE(procedure->qualifier) != 0;
}

static void begin_procedure(const struct iec104_station *station, struct iec104_connection *connection,
			    struct iec104_procedure *procedure, int64_t now_ns)
{
	send_procedure(station, connection, procedure, IEC104_ACTIVATION_CON, now_ns);
	if (procedure->type == IEC104_C_CS_NA_1 || procedure->type == IEC104_C_RP_NA_1) {
		next_station(station, connection, procedure);
		return;
	}
	if (is_freeze(procedure)) { /* carried out already; the readings are read later (101, 7.4.8) */
		procedure->phase = IEC104_TERMINATE;
		return;
	}
	procedure->phase = IEC104_DATA;
	iec104_begin_sweep_of_station(station, connection, &procedure->sweep, procedure->device,
				      interrogated);
}

static uint8_t cause_of_data(const struct iec104_procedure *procedure)
{
	if (procedure->type != IEC104_C_CI_NA_1)
		return procedure->qualifier; /* QOI has the cause's numbers */
	return (uint8_t)(IEC104_COUNTERS_REQUESTED + IEC104_QCC_GROUP(procedure->qualifier));
}

static bool continue_procedure(const struct iec104_station *station, struct iec104_connection *connection,
			       struct iec104_procedure *procedure, int64_t now_ns)
{
	const struct iec104_manner manner = {
	    .wanted = interrogated,
	    .cause = cause_of_data(procedure),
	    .totals = procedure->type == IEC104_C_CI_NA_1,
	    .originator = procedure->originator,
	    .test = procedure->test,
	};
	enum iec104_progress progress =
	    iec104_send_points(station, connection, &procedure->sweep, &manner, now_ns);

	if (progress == IEC104_SWEEP_DONE) {
		procedure->phase = procedure->type == IEC104_C_IC_NA_1 ? IEC104_PARAMETERS : IEC104_TERMINATE;
		procedure->next_parameter = station->config->sets[procedure->device].first_point;
	}
	return progress != IEC104_SWEEP_TRY_LATER;
}

bool iec104_advance_procedure(const struct iec104_station *station, struct iec104_connection *connection,
			      int64_t now_ns)
{
	struct iec104_procedure *procedure = iec104_procedure_at(connection, 0);

	if (connection->procedure_count == 0)
		return false;
	switch (procedure->phase) {
	case IEC104_CONFIRM:
		begin_procedure(station, connection, procedure, now_ns);
		return true;
	case IEC104_DATA:
		return continue_procedure(station, connection, procedure, now_ns);
	case IEC104_PARAMETERS:
		if (!iec104_send_parameters(station, connection, procedure, interrogated, now_ns))
			procedure->phase = IEC104_TERMINATE;
		return true;
	case IEC104_TERMINATE:
		send_procedure(station, connection, procedure, IEC104_ACTIVATION_TERM, now_ns);
		next_station(station, connection, procedure);
		return true;
	}
	return false;
}

/* The first one's points have other numbers: those of its station from the beginning. */
void iec104_restart_procedure(const struct iec104_station *station, struct iec104_connection *connection)
{
	struct iec104_procedure *procedure = iec104_procedure_at(connection, 0);

	procedure->next_parameter = station->config->sets[procedure->device].first_point;
	if (procedure->phase == IEC104_DATA)
		iec104_begin_sweep_of_station(station, connection, &procedure->sweep, procedure->device,
					      interrogated);
}

static bool can_interrogate(const struct iec104_procedure *procedure)
{
	if (procedure->type == IEC104_C_CI_NA_1)
		return IEC104_QCC_REQUEST(procedure->qualifier) >= RQT_FIRST &&
		       IEC104_QCC_REQUEST(procedure->qualifier) <= RQT_GENERAL;
	return procedure->qualifier >= QOI_STATION && procedure->qualifier <= QOI_GROUP_LAST;
}

bool iec104_interrogate(struct iec104_station *station, const struct iec104_received *received)
{
	struct iec104_connection *connection = received->connection;
	struct iec104_procedure procedure = iec104_procedure_of(station, &received->asdu);
	unsigned place = iec104_find_procedure(connection, &procedure);
	bool found = place < connection->procedure_count;

	if (received->asdu.cause == IEC104_DEACTIVATION) {
		if (found)
			iec104_remove_procedure(connection, place);
		return found;
	}
	if (found || !can_interrogate(&procedure))
		return false;
	if (procedure.type == IEC104_C_CI_NA_1 && iec104_freeze_waits(station, connection))
		return false;
	if (is_freeze(&procedure) && !procedure.test)
		return iec104_freeze(station, received, &procedure);
	return iec104_add_procedure(connection, &procedure);
}
