/* SPDX-License-Identifier: GPL-3.0-or-later */
/* Parameters of measured values: what a controlling station loads, and what an interrogation says of it. */
#include "iec104/carrier.h"
#include "iec104/station_parts.h"

#define QPA_CYCLIC 3 /* of the addressed object */

static const struct {
	uint8_t type;
	enum map_type point;
} forms[] = {
    {IEC104_P_ME_NA_1, MAP_NORMALIZED},
    {IEC104_P_ME_NB_1, MAP_SCALED},
    {IEC104_P_ME_NC_1, MAP_FLOAT},
};

static uint8_t type_for(const struct map_point *point)
{
	for (size_t i = 0; i < sizeof(forms) / sizeof(forms[0]); i++)
		if (forms[i].point == iec104_carrier_of(point))
			return forms[i].type;
	return 0;
}

uint32_t iec104_parameter_point(const struct iec104_station *station, const struct iec104_asdu *asdu)
{
	uint32_t point = map_find(station->map, asdu->ca, iec104_ioa_decode(asdu->objects));
	uint8_t type;

	if (point == MAP_NONE)
		return MAP_NONE;
	type = type_for(iec104_point(station, point));
	return type != 0 && (asdu->type == IEC104_P_AC_NA_1 || asdu->type == type) ? point : MAP_NONE;
}

bool iec104_parameter_request(const struct iec104_station *station, const struct iec104_asdu *asdu,
			      struct map_request *request)
{
	const uint8_t *element = asdu->objects + IEC104_IOA_SIZE;
	union map_value carried;
	uint8_t qualifier;

	if (asdu->type == IEC104_P_AC_NA_1) {
		request->detail = MAP_CYCLIC;
		request->value.u = asdu->cause == IEC104_ACTIVATION;
		return element[0] == QPA_CYCLIC;
	}
	iec104_parameter_decode(asdu->type, asdu->objects, &carried, &qualifier);
	request->detail = qualifier; /* with LPC or POP, which a controlling station has 0, it is no KPA */
	return qualifier >= MAP_THRESHOLD && qualifier <= MAP_HIGH_LIMIT &&
	       iec104_take_carried(iec104_point(station, request->point), carried, &request->value);
}

/* All that were loaded of one point are one ASDU: the same address, told apart by KPA. */
static void send_loaded(const struct iec104_station *station, struct iec104_connection *connection,
			const struct iec104_procedure *procedure, uint32_t point,
			const struct map_parameters *parameters, int64_t now_ns)
{
	enum map_type type = (enum map_type)iec104_point(station, point)->type;
	struct iec104_builder builder;

	iec104_asdu_begin(&builder, &(struct iec104_asdu){
					.type = type_for(iec104_point(station, point)),
					.cause = procedure->qualifier,
					.test = procedure->test,
					.originator = procedure->originator,
					.ca = iec104_device(station, point)->ca,
				    });
	for (uint8_t kind = MAP_THRESHOLD; kind <= MAP_HIGH_LIMIT; kind++) {
		const struct map_sample sample = {.value = parameters->values[kind - 1], .quality = kind};
		uint8_t element[IEC104_ELEMENT_MAX];
		size_t size = iec104_element_encode(element, type, &sample); /* QPM is where QDS is */

		if (parameters->loaded & 1u << kind)
			iec104_asdu_add(&builder, iec104_point(station, point)->ioa, element, size);
	}
	iec104_send(connection, &builder, now_ns);
}

static bool has_loaded(const struct map_parameters *parameters)
{
	return (parameters->loaded & ((1u << MAP_CYCLIC) - (1u << MAP_THRESHOLD))) != 0;
}

bool iec104_send_parameters(const struct iec104_station *station, struct iec104_connection *connection,
			    struct iec104_procedure *procedure, iec104_wanted *wanted, int64_t now_ns)
{
	const struct map_set *devices = station->config->sets;
	const struct map_set *last = &devices[iec104_station_end(station, procedure->device) - 1];

	while (procedure->next_parameter < last->first_point + last->point_count) {
		uint32_t point = procedure->next_parameter++;
		struct map_parameters parameters;

		if (iec104_device(station, point)->ca != last->ca ||
		    type_for(iec104_point(station, point)) == 0 || !wanted(station, connection, point))
			continue;
		map_parameters_read(station->map, point, &parameters);
		if (!has_loaded(&parameters))
			continue;
		send_loaded(station, connection, procedure, point, &parameters, now_ns);
		return true;
	}
	return false;
}
