/* SPDX-License-Identifier: GPL-3.0-or-later */
#include "centre/say.h"

#include <stdlib.h>

#include "map/time_ns.h"

uint32_t centre_place_of(const struct centre_station *station)
{
	return (uint32_t)(station - station->centre->stations);
}

bool centre_has_room(const struct centre *centre)
{
	return centre_batches_room(&centre->batches) >=
	       (size_t)centre->config->receive_octets + CENTRE_RECORDS_BESIDE;
}

/* Of a place in the file. */
struct centre_record *centre_record_add(struct centre *centre, uint32_t place, enum centre_kind kind)
{
	struct centre_record *record = &centre->nowhere;

	if (centre->consumer >= 0) {
		if (centre_batches_room(&centre->batches) == 0)
			abort(); /* CENTRE_RECORDS_BESIDE is wrong: nothing may be lost unnoticed */
		record = centre_batches_add(&centre->batches);
	}
	record->kind = (uint8_t)kind;
	record->station = place;
	return record;
}

static struct centre_record *say(struct centre_station *station, enum centre_kind kind)
{
	struct centre_record *record = centre_record_add(
	    station->centre, centre_config_place(station->centre->config, station->number), kind);

	record->connection = station->connection;
	record->received_ns = station->centre->now.wall_ns;
	station->last = record;
	return record;
}

struct centre_record *centre_say_asdu(struct centre_station *station, enum centre_kind kind,
				      const struct iec104_asdu *asdu)
{
	struct centre_record *record = say(station, kind);

	record->flags = (uint8_t)((asdu->test ? CENTRE_TEST : 0) | (asdu->negative ? CENTRE_NEGATIVE : 0));
	record->ca = asdu->ca;
	record->type = asdu->type;
	record->cause = asdu->cause;
	return record;
}

void centre_say_link(struct centre_station *station, enum centre_link link, uint8_t reason, int error,
		     int64_t retry_ns)
{
	struct centre_record *record = say(station, CENTRE_LINK);

	record->detail = station->number != centre_place_of(station);
	record->link.state = (uint8_t)link;
	record->link.reason = reason;
	record->link.error = (uint32_t)error;
	record->link.retry_ms = (uint32_t)(retry_ns / NS_PER_MS);
}

void centre_say_progress(struct centre_station *station, const struct iec104_controlling_request *request,
			 uint64_t id)
{
	struct centre_record *record = say(station, CENTRE_PROGRESS);

	record->ca = request->ca;
	record->ioa = request->ioa;
	record->type = request->type;
	record->cause = request->cause;
	record->progress.state = request->state;
	record->progress.result = request->result;
	record->progress.id_low = (uint32_t)id;
	record->progress.id_high = (uint32_t)(id >> 32);
}

void centre_record_time(struct centre_record *record, bool tagged, bool invalid, int64_t wall_ns)
{
	record->flags |= (uint8_t)((tagged ? CENTRE_TAGGED : 0) | (invalid ? CENTRE_TIME_INVALID : 0));
	record->wall_ns = wall_ns;
}
