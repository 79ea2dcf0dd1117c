/* SPDX-License-Identifier: GPL-3.0-or-later */
/* Interrogations, and confirmations of a clock synchronisation: procedures that go from station to station. */
#include "iec104/station_parts.h"

#define QOI_STATION    20
#define QOI_GROUP_LAST 36
#define RQT_FIRST      1
#define RQT_GENERAL    5

static struct iec104_procedure *procedure_at(struct iec104_connection *connection, unsigned place)
{
	return &connection->procedures[(connection->first_procedure + place) % IEC104_INTERROGATIONS_MAX];
}

static void end_first_procedure(struct iec104_connection *connection)
{
	connection->first_procedure = (connection->first_procedure + 1) % IEC104_INTERROGATIONS_MAX;
	connection->procedure_count--;
}

/* The place of a procedure like this one; procedure_count: there is none. */
static unsigned find_procedure(struct iec104_connection *connection, const struct iec104_procedure *like)
{
	unsigned place = 0;

	while (place < connection->procedure_count) {
		const struct iec104_procedure *other = procedure_at(connection, place);

		if (other->type == like->type && other->broadcast == like->broadcast &&
		    (like->broadcast || other->device == like->device))
			break;
		place++;
	}
	return place;
}

bool iec104_add_procedure(struct iec104_connection *connection, const struct iec104_procedure *procedure)
{
	if (connection->procedure_count == IEC104_INTERROGATIONS_MAX)
		return false;
	*procedure_at(connection, connection->procedure_count++) = *procedure;
	return true;
}

static void remove_procedure(struct iec104_connection *connection, unsigned place)
{
	connection->procedure_count--;
	for (; place < connection->procedure_count; place++)
		*procedure_at(connection, place) = *procedure_at(connection, place + 1);
}

bool iec104_is_counter_of(const struct iec104_station *station, uint32_t point, uint8_t qualifier)
{
	const struct map_point *object = iec104_point(station, point);
	uint32_t group = IEC104_QCC_GROUP(qualifier);

	return object->type == MAP_COUNTER && (group == 0 || object->counter_group == group);
}

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
					.ca = station->config->devices[procedure->device].ca,
				    });
	iec104_asdu_add(&builder, 0, element, size);
	iec104_send(connection, &builder, now_ns);
}

static void next_station(const struct iec104_station *station, struct iec104_connection *connection,
			 struct iec104_procedure *procedure)
{
	procedure->phase = IEC104_CONFIRM;
	procedure->device = iec104_next_station(station, procedure->device);
	if (!procedure->broadcast || procedure->device == station->config->device_count)
		end_first_procedure(connection);
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
		procedure->next_parameter = station->config->devices[procedure->device].first_point;
	}
	return progress != IEC104_SWEEP_TRY_LATER;
}

bool iec104_advance_procedure(const struct iec104_station *station, struct iec104_connection *connection,
			      int64_t now_ns)
{
	struct iec104_procedure *procedure = procedure_at(connection, 0);

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

bool iec104_find_device(const struct iec104_station *station, uint16_t ca, uint32_t *device)
{
	for (*device = 0; *device < station->config->device_count; ++*device)
		if (ca == IEC104_CA_BROADCAST || station->config->devices[*device].ca == ca)
			return true;
	return false;
}

uint32_t iec104_next_station(const struct iec104_station *station, uint32_t device)
{
	const struct map_device *devices = station->config->devices;
	uint32_t first;

	do {
		if (++device >= station->config->device_count)
			break;
		for (first = 0; devices[first].ca != devices[device].ca;)
			first++;
	} while (first != device);
	return device;
}

uint32_t iec104_station_end(const struct iec104_station *station, uint32_t device)
{
	const struct map_device *devices = station->config->devices;
	uint32_t last = station->config->device_count - 1;

	while (devices[last].ca != devices[device].ca)
		last--;
	return last + 1;
}

struct iec104_procedure iec104_procedure_of(const struct iec104_station *station,
					    const struct iec104_asdu *asdu)
{
	struct iec104_procedure procedure = {
	    .type = asdu->type,
	    .qualifier = asdu->objects[IEC104_IOA_SIZE],
	    .originator = asdu->originator,
	    .test = asdu->test,
	    .broadcast = asdu->ca == IEC104_CA_BROADCAST,
	};

	iec104_find_device(station, asdu->ca, &procedure.device);
	return procedure;
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
	unsigned place = find_procedure(connection, &procedure);
	bool found = place < connection->procedure_count;

	if (received->asdu.cause == IEC104_DEACTIVATION) {
		if (found)
			remove_procedure(connection, place);
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
