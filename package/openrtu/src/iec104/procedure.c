/* SPDX-License-Identifier: GPL-3.0-or-later */
/* The system commands of a connection, which are carried out one after another: a queue. */
#include "iec104/station_parts.h"

struct iec104_procedure *iec104_procedure_at(struct iec104_connection *connection, unsigned place)
{
	return &connection->procedures[(connection->first_procedure + place) % IEC104_INTERROGATIONS_MAX];
}

void iec104_end_first_procedure(struct iec104_connection *connection)
{
	connection->first_procedure = (connection->first_procedure + 1) % IEC104_INTERROGATIONS_MAX;
	connection->procedure_count--;
}

unsigned iec104_find_procedure(struct iec104_connection *connection, const struct iec104_procedure *like)
{
	unsigned place = 0;

	while (place < connection->procedure_count) {
		const struct iec104_procedure *other = iec104_procedure_at(connection, place);

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
	*iec104_procedure_at(connection, connection->procedure_count++) = *procedure;
	return true;
}

void iec104_remove_procedure(struct iec104_connection *connection, unsigned place)
{
	connection->procedure_count--;
	for (; place < connection->procedure_count; place++)
		*iec104_procedure_at(connection, place) = *iec104_procedure_at(connection, place + 1);
}

bool iec104_is_counter_of(const struct iec104_station *station, uint32_t point, uint8_t qualifier)
{
	const struct map_point *object = iec104_point(station, point);
	uint32_t group = IEC104_QCC_GROUP(qualifier);

	return object->type == MAP_COUNTER && (group == 0 || object->counter_group == group);
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
