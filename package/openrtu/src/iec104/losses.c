/* SPDX-License-Identifier: GPL-3.0-or-later */
/*
 * The gateway's own station: events that were lost, as points (config_own.c has their order).
 *
 * Their changes are events too, which wait in the same queues. So there is one when an episode of losses begins and one
 * when it is over, however many events are lost in it: what tells of losses must not make them.
 */
#include "iec104/station_parts.h"

/* Of a redundancy group its queue; the last one is for the queues of all addresses without a group. */
static bool is_losing(struct iec104_station *station, uint32_t group)
{
	const struct map_settings *settings = &station->config->settings;
	bool any = false;

	if (group < settings->queue_count)
		return iec104_queue_recovers(station, settings->queues[group].slot);
	for (uint32_t queue = MAP_NAMED_QUEUES_MAX; queue < MAP_QUEUES; queue++)
		any |= (station->queues & 1u << queue) != 0 && iec104_queue_recovers(station, queue);
	return any;
}

static uint32_t lost_of_group(const struct iec104_station *station, uint32_t group)
{
	struct map_queue queue;

	map_queue(station->map, station->config->settings.queues[group].slot, &queue);
	return queue.lost;
}

/* A queue without a group may be another address's by now, with a count of its own. */
static uint32_t lost_by(const struct iec104_station *station, uint32_t group)
{
	uint32_t groups = station->config->settings.queue_count;
	uint32_t others = station->stats->counters[IEC104_COUNT_EVENTS_LOST];

	if (group < groups)
		return lost_of_group(station, group);
	for (uint32_t i = 0; i < groups; i++)
		others -= lost_of_group(station, i);
	return others;
}

/* With own_ca, this module has one. */
static const struct map_set *own_set(const struct iec104_station *station)
{
	const struct map_set *set = station->config->sets;

	while (set->module != map_self(station->map))
		set++;
	return set;
}

void iec104_publish_losses(struct iec104_station *station)
{
	struct map_update updates[2 * (MAP_NAMED_QUEUES_MAX + 1)];
	uint32_t queues = station->config->settings.queue_count + 1;
	uint32_t first;

	if (station->settings->own_ca == 0 || !station->losses_changed)
		return;
	station->losses_changed = false;
	first = own_set(station)->first_point;
	for (uint32_t i = 0; i < queues; i++) {
		updates[i] = (struct map_update){
		    .point = first + i,
		    .sample = {.value.u = is_losing(station, i), .time_ns = station->now_ns}};
		updates[queues + i] = (struct map_update){
		    .point = first + queues + i,
		    .sample = {.value.u = lost_by(station, i), .time_ns = station->now_ns}};
	}
	map_publish(station->map, updates, (size_t)2 * queues);
}
