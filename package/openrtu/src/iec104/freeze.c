/* SPDX-License-Identifier: GPL-3.0-or-later */
/*
 * Counter interrogations that freeze or reset: one request to each owner of counters that are meant, and one
 * answer to the controlling station when all owners have answered.
 */
#include "iec104/station_parts.h"
#include "map/time_ns.h"

#include <string.h>

static bool is_meant(const struct iec104_station *station, const struct iec104_procedure *procedure,
		     uint32_t point)
{
	uint16_t ca = station->config->sets[procedure->device].ca;

	return (procedure->broadcast || iec104_device(station, point)->ca == ca) &&
	       iec104_is_counter_of(station, point, procedure->qualifier);
}

/* One point of each owner that has a counter to freeze. Returns the owners, a bit each. */
static map_modules find_owners(const struct iec104_station *station, const struct iec104_procedure *procedure,
			       uint32_t points[MAP_MODULES_MAX])
{
	map_modules owners = 0;

	for (uint32_t i = 0; i < station->config->point_count; i++) {
		uint32_t owner = map_owner(station->map, i);

		if ((owners & map_module_bit(owner)) || !is_meant(station, procedure, i))
			continue;
		owners |= map_module_bit(owner);
		points[owner] = i;
	}
	return owners;
}

static bool all_alive(const struct iec104_station *station, map_modules owners)
{
	for (uint32_t i = 0; i < MAP_MODULES_MAX; i++)
		if ((owners & map_module_bit(i)) && !map_alive(station->map, i))
			return false;
	return true;
}

static void ask_owner(struct iec104_station *station, struct iec104_freeze *freeze, uint32_t owner,
		      uint32_t point)
{
	const struct iec104_procedure *procedure = &freeze->procedure;
	uint32_t group = IEC104_QCC_GROUP(procedure->qualifier);
	struct map_module module;

	map_module(station->map, owner, &module);
	freeze->generations[owner] = module.generation;
	freeze->ids[owner] = map_request_post(
	    station->map,
	    (struct map_request){.point = point,
				 .action = MAP_FREEZE,
				 .detail = (uint8_t)IEC104_QCC_FREEZE(procedure->qualifier),
				 .value.u = group | (procedure->broadcast ? MAP_FREEZE_ALL_DEVICES : 0),
				 .time_ns = freeze->posted_ns,
				 .deadline_ns = freeze->deadline_ns});
	if (freeze->ids[owner] == 0)
		freeze->failed = true;
	else
		freeze->waiting |= map_module_bit(owner);
}

/* A positive confirmation is the procedure's own, station by station. */
static void conclude(struct iec104_freeze *freeze)
{
	struct iec104_connection *connection = freeze->connection;

	freeze->used = false;
	if (!connection->open || connection->serial != freeze->serial || !connection->session.started)
		return;
	if (freeze->failed || !iec104_add_procedure(connection, &freeze->procedure))
		iec104_mirror(connection, freeze->asdu, freeze->asdu_size, IEC104_ACTIVATION_CON, true);
}

static struct iec104_freeze *free_place(struct iec104_station *station)
{
	for (unsigned i = 0; i < IEC104_OPEN_FREEZES_MAX; i++)
		if (!station->freezes[i].used)
			return &station->freezes[i];
	return NULL;
}

bool iec104_freeze_waits(const struct iec104_station *station, const struct iec104_connection *connection)
{
	for (unsigned i = 0; i < IEC104_OPEN_FREEZES_MAX; i++)
		if (station->freezes[i].used && station->freezes[i].connection == connection &&
		    station->freezes[i].serial == connection->serial)
			return true;
	return false;
}

bool iec104_freeze(struct iec104_station *station, const struct iec104_received *received,
		   const struct iec104_procedure *procedure)
{
	struct iec104_freeze *freeze = free_place(station);
	uint32_t points[MAP_MODULES_MAX];
	map_modules owners = find_owners(station, procedure, points);

	if (freeze == NULL || !all_alive(station, owners))
		return false;
	*freeze = (struct iec104_freeze){
	    .used = true,
	    .connection = received->connection,
	    .serial = received->connection->serial,
	    .procedure = *procedure,
	    .asdu_size = received->size,
	    .posted_ns = received->now_ns,
	    .deadline_ns = received->now_ns + station->config->settings.command_timeout_s * NS_PER_S,
	};
	memcpy(freeze->asdu, received->bytes, received->size);
	for (uint32_t i = 0; i < MAP_MODULES_MAX; i++)
		if (owners & map_module_bit(i))
			ask_owner(station, freeze, i, points[i]);
	if (freeze->waiting == 0)
		conclude(freeze);
	return true;
}

static void take_end(struct iec104_freeze *freeze, uint32_t owner, bool done)
{
	freeze->waiting &= ~map_module_bit(owner);
	freeze->failed |= !done;
	if (freeze->waiting == 0)
		conclude(freeze);
}

void iec104_take_freeze_answer(struct iec104_station *station, const struct map_answer *answer)
{
	uint32_t owner;

	if (answer->point >= station->config->point_count)
		return;
	owner = map_owner(station->map, answer->point);
	for (unsigned i = 0; i < IEC104_OPEN_FREEZES_MAX; i++) {
		struct iec104_freeze *freeze = &station->freezes[i];

		if (freeze->used && (freeze->waiting & map_module_bit(owner)) &&
		    freeze->ids[owner] == answer->id)
			take_end(freeze, owner, answer->state == MAP_EXECUTED_COMMAND);
	}
}

/* Later than the deadline an answer was lost. */
static bool has_ended(const struct iec104_station *station, const struct iec104_freeze *freeze,
		      uint32_t owner, int64_t now_ns)
{
	return iec104_owner_has_ended(station, owner, freeze->generations[owner]) ||
	       now_ns >= freeze->deadline_ns;
}

void iec104_conclude_freezes(struct iec104_station *station, int64_t now_ns)
{
	for (unsigned i = 0; i < IEC104_OPEN_FREEZES_MAX; i++) {
		struct iec104_freeze *freeze = &station->freezes[i];

		for (uint32_t owner = 0; freeze->used && owner < MAP_MODULES_MAX; owner++)
			if ((freeze->waiting & map_module_bit(owner)) &&
			    has_ended(station, freeze, owner, now_ns))
				take_end(freeze, owner, false);
	}
}

int64_t iec104_freeze_deadline(const struct iec104_station *station)
{
	int64_t deadline = INT64_MAX;

	for (unsigned i = 0; i < IEC104_OPEN_FREEZES_MAX; i++)
		if (station->freezes[i].used && station->freezes[i].deadline_ns < deadline)
			deadline = station->freezes[i].deadline_ns;
	return deadline;
}
