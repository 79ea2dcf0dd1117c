/* SPDX-License-Identifier: GPL-3.0-or-later */
#include "centre/order.h"

#include "centre/request.h"
#include "centre/say.h"

static void say_not_sent(struct centre *centre, const struct centre_request *request, uint8_t result)
{
	struct centre_record *record = centre_record_add(centre, request->station, CENTRE_PROGRESS);
	bool selects = request->kind == CENTRE_COMMAND && (request->flags & CENTRE_SELECT) != 0;

	record->received_ns = centre->now.wall_ns;
	record->ca = request->ca;
	record->ioa = request->ioa;
	record->progress.state = selects ? MAP_REFUSED_SELECTION : MAP_REFUSED_COMMAND;
	record->progress.result = result;
	record->progress.id_low = (uint32_t)request->id;
	record->progress.id_high = (uint32_t)(request->id >> 32);
}

static const struct iec104_controlling_request *request_of(const struct centre_station *station, uint32_t id)
{
	for (unsigned i = 0; i < IEC104_CONTROLLING_REQUESTS_MAX; i++)
		if (station->controlling.requests[i].id == id)
			return &station->controlling.requests[i];
	return NULL;
}

static struct centre_order *order_of_id(struct centre_station *station, uint64_t id)
{
	for (unsigned i = 0; i < IEC104_CONTROLLING_REQUESTS_MAX; i++)
		if (station->orders[i].request != 0 && station->orders[i].id == id)
			return &station->orders[i];
	return NULL;
}

/* Executes or cancels what was selected. */
static bool go_on(struct centre_station *station, const struct centre_request *request)
{
	struct centre_order *order = order_of_id(station, request->id);
	struct iec104_moment now = station->centre->now;

	if (order == NULL)
		return false;
	return request->kind == CENTRE_EXECUTE
		   ? iec104_controlling_execute(&station->controlling, order->request, now)
		   : iec104_controlling_cancel(&station->controlling, order->request, now);
}

static uint32_t post_order(struct centre_station *station, const struct centre_request *request,
			   const struct iec104_command *command)
{
	struct iec104_controlling *controlling = &station->controlling;
	struct iec104_moment now = station->centre->now;

	switch (request->kind) {
	case CENTRE_COMMAND:
		return iec104_controlling_command(controlling, request->ca, command, now);
	case CENTRE_INTERROGATE:
		return iec104_controlling_interrogate(controlling, request->ca, request->qualifier, now);
	case CENTRE_COUNTERS:
		return iec104_controlling_interrogate_counters(controlling, request->ca, request->qualifier,
							       now);
	case CENTRE_READ:
		return iec104_controlling_read(controlling, request->ca, request->ioa, now);
	case CENTRE_TEST_COMMAND:
		return iec104_controlling_test(controlling, request->ca, (uint16_t)request->value.u, now);
	case CENTRE_RESET:
		return iec104_controlling_reset(controlling, request->ca, request->qualifier, now);
	default:
		return iec104_controlling_set_clock(controlling, request->ca, now);
	}
}

/* MAP_RESULT_NONE: it was sent. */
static uint8_t try_order(struct centre_station *station, const struct centre_request *request)
{
	struct centre_order *order = centre_order_of(station, 0);
	struct iec104_command command = {0};
	bool goes_on = request->kind == CENTRE_EXECUTE || request->kind == CENTRE_CANCEL;

	if (station->link != CENTRE_UP)
		return CENTRE_NOT_UP;
	if (!centre_has_room(station->centre))
		return CENTRE_BUSY; /* nor would the answer be read now */
	if (goes_on && !go_on(station, request))
		return CENTRE_NOT_KNOWN;
	if (goes_on)
		return MAP_RESULT_NONE;
	if (order_of_id(station, request->id) != NULL)
		return MAP_RESULT_INTERLOCK;
	if (request->kind == CENTRE_COMMAND && !centre_request_command(request, &command))
		return MAP_RESULT_OUT_OF_RANGE;
	if (order == NULL)
		return CENTRE_BUSY;
	order->request = post_order(station, request, &command);
	order->id = request->id;
	if (order->request == 0)
		return CENTRE_BUSY;
	return MAP_RESULT_NONE;
}

void centre_station_order(struct centre *centre, const struct centre_request *request)
{
	struct centre_station *station;
	uint32_t number;
	uint8_t result;

	if (!centre_config_station(centre->config, request->station, &number)) {
		say_not_sent(centre, request, CENTRE_NOT_KNOWN);
		return;
	}
	station = &centre->stations[number];
	if (request->kind == CENTRE_TRACE) {
		station->traced = request->value.u == 1;
		if (station->partner != NULL)
			station->partner->traced = station->traced;
		return;
	}
	if (station->partner != NULL && station->partner->link == CENTRE_UP)
		station = station->partner;
	result = try_order(station, request);
	if (result != MAP_RESULT_NONE) {
		say_not_sent(centre, request, result);
		return;
	}
	centre_say_progress(station, request_of(station, order_of_id(station, request->id)->request),
			    request->id);
	centre_station_transmit(station);
	centre_station_schedule(station);
}
