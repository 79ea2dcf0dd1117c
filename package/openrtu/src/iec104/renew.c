/* SPDX-License-Identifier: GPL-3.0-or-later */
/*
 * A changed configuration: what connections are in the middle of goes on with the numbers that points and devices have now.
 * What was sent, and what waits to be, are octets and places in rings: nothing changes in those.
 */
#include "iec104/station_parts.h"

#include <string.h>

/* The same station's first device; MAP_NONE: it is gone. */
static uint32_t device_now(const struct iec104_station *station, const struct map_config *before,
			   uint32_t device)
{
	uint32_t now;

	if (device >= before->set_count)
		return station->config->set_count;
	return iec104_find_device(station, before->sets[device].ca, &now) ? now : MAP_NONE;
}

/* Those that a broadcast has not come to are all behind this one still. */
static bool order_is_kept(const struct iec104_station *station, const struct map_config *before,
			  uint32_t device, uint32_t now)
{
	for (uint32_t i = device + 1; i < before->set_count; i++)
		if (before->sets[i].ca != before->sets[device].ca && device_now(station, before, i) < now)
			return false;
	return true;
}

static uint32_t next_that_is_there(const struct iec104_station *station, const struct map_config *before,
				   uint32_t device)
{
	uint32_t now = MAP_NONE;

	while (device < before->set_count && now == MAP_NONE)
		now = device_now(station, before, device++);
	return now;
}

/* False: there is nothing left of it. What had been sent of a station's points is sent again: nobody's value is left out. */
static bool renew_procedure(const struct iec104_station *station, struct iec104_procedure *procedure,
			    const struct map_config *before)
{
	uint32_t now = device_now(station, before, procedure->device);

	if (now == MAP_NONE && procedure->broadcast) {
		now = next_that_is_there(station, before, procedure->device);
		procedure->phase = IEC104_CONFIRM;
	}
	if (now == MAP_NONE || now == station->config->set_count)
		return false;
	if (procedure->broadcast && !order_is_kept(station, before, procedure->device, now)) {
		now = 0;
		procedure->phase = IEC104_CONFIRM;
	}
	procedure->device = now;
	return true;
}

static void renew_procedures(const struct iec104_station *station, struct iec104_connection *connection,
			     const struct map_config *before)
{
	for (unsigned place = 0; place < connection->procedure_count;) {
		if (renew_procedure(station, iec104_procedure_at(connection, place), before))
			place++;
		else
			iec104_remove_procedure(connection, place);
	}
	if (connection->procedure_count > 0)
		iec104_restart_procedure(station, connection);
}

static void renew_connection(const struct iec104_station *station, struct iec104_connection *connection,
			     const struct map_config *before)
{
	renew_procedures(station, connection, before);
	if (connection->tells_initialised) {
		uint32_t next = next_that_is_there(station, before, connection->next_initialised);

		connection->next_initialised = next == MAP_NONE ? station->config->set_count : next;
	}
	memset(connection->told, 0, sizeof(connection->told));
	if (connection->down)
		iec104_begin_invalid(station, connection, connection->down_module, connection->down_ns);
	if (connection->refresh)
		iec104_begin_refresh(station, connection);
	if (connection->transfer)
		iec104_schedule_periodic(station, connection, connection->periodic_from_ns);
}

/* A point that is gone keeps its owner, which has ended: so the request ends too. */
static uint32_t point_now(const struct iec104_station *station, const struct map_config *before,
			  uint32_t point)
{
	const struct map_config *config = station->config;
	const struct map_point *object = &before->points[point];
	uint32_t now = map_number_now(station->map, before, point);

	for (uint32_t i = config->point_count;
	     now == MAP_NONE && i < config->point_count + config->gone_point_count; i++)
		if (config->points[i].ioa == object->ioa &&
		    config->sets[config->points[i].set].ca == before->sets[object->set].ca)
			now = i;
	return now;
}

static void renew_requests(struct iec104_station *station, const struct map_config *before)
{
	for (unsigned i = 0; i < IEC104_OPEN_REQUESTS_MAX; i++) {
		struct iec104_open_request *open = &station->open_requests[i];

		if ((open->request.id != 0 || open->terminating) && open->request.point != MAP_NONE)
			open->request.point = point_now(station, before, open->request.point);
	}
	for (unsigned i = 0; i < IEC104_OPEN_FREEZES_MAX; i++) {
		struct iec104_freeze *freeze = &station->freezes[i];

		if (freeze->used && !renew_procedure(station, &freeze->procedure, before))
			freeze->used = false;
	}
}

void iec104_station_renew(struct iec104_station *station, const struct map_config *before)
{
	station->settings = iec104_settings(station->config);
	station->times = iec104_times_of(station->settings);
	iec104_note_new_stations(station, before);
	iec104_adopt_groups(station, before);
	station->points_asked = 0;
	station->losses_changed = true;
	renew_requests(station, before);
	for (unsigned i = 0; i < IEC104_CONNECTIONS_MAX; i++)
		if (station->connections[i].open)
			renew_connection(station, &station->connections[i], before);
}
