/* SPDX-License-Identifier: GPL-3.0-or-later */
#include "centre/stations.h"

#include <stdlib.h>
#include <string.h>
#include <sys/epoll.h>
#include <unistd.h>

#include "centre/say.h"

bool centre_tell_next(struct centre *centre)
{
	struct centre_record *record;

	if (centre->told == centre->config->station_count)
		return false;
	record = centre_record_add(centre, centre_config_place(centre->config, centre->told), CENTRE_STATION);
	memcpy(record->name, centre->config->stations[centre->told].name, CENTRE_NAME_SIZE);
	centre->told++;
	return true;
}

void centre_stations_begin(struct centre *centre)
{
	centre_batches_reset(&centre->batches);
	centre->told = 0;
	for (uint32_t i = 0; i < centre->config->link_count; i++) {
		struct centre_station *station = &centre->stations[i];

		station->due_ns = centre->now.monotonic_ns;
		station->retry = retry_begin(centre->config->retry_ns, centre->config->retry_max_ns);
		station->failed = station->slow = station->waits = false;
		station->traced = station->gap = false;
		centre_station_schedule(station);
	}
}

void centre_stations_end(struct centre *centre)
{
	for (unsigned i = 0; i < CENTRE_WINDOWS; i++)
		centre_window_clear(&centre->windows[i]);
	for (uint32_t i = 0; i < centre->config->link_count; i++) {
		struct centre_station *station = &centre->stations[i];

		station->window = CENTRE_NO_WINDOW;
		centre_station_close(station);
		station->link = CENTRE_WAITING;
		centre_deadlines_set(&centre->deadlines, i, INT64_MAX);
	}
}

size_t centre_octets_of_station(const struct centre_config *config)
{
	return sizeof(struct centre_station) + config->receive_octets + config->send_octets +
	       config->common.times.k * sizeof(int64_t) + sizeof(int64_t) + 3 * sizeof(uint32_t) +
	       sizeof(struct centre_plan);
}

bool centre_stations_init(struct centre *centre, const struct centre_config *config)
{
	const uint32_t count = config->link_count;

	*centre = (struct centre){.config = config, .consumer = -1};
	centre->epoll = epoll_create1(EPOLL_CLOEXEC);
	centre->next = calloc(count, sizeof(*centre->next));
	centre->stations = calloc(count, sizeof(*centre->stations));
	centre->octets = calloc(count, (size_t)config->receive_octets + config->send_octets);
	centre->sent_ns = calloc((size_t)count * config->common.times.k, sizeof(*centre->sent_ns));
	if (centre->epoll < 0 || centre->next == NULL || centre->stations == NULL || centre->octets == NULL ||
	    centre->sent_ns == NULL || !centre_deadlines_init(&centre->deadlines, count) ||
	    !centre_batches_init(&centre->batches, config->batches, config->batch_records,
				 config->batches_in_flight))
		return false;
	for (unsigned i = 0; i < CENTRE_WINDOWS; i++)
		centre_window_init(&centre->windows[i],
				   i < CENTRE_POLL ? config->connections_at_once : config->polls_at_once,
				   centre->next);
	for (uint32_t i = 0; i < config->station_count; i++) {
		struct centre_station *first = &centre->stations[i];

		centre_station_init(centre, i, i);
		if (config->stations[i].address_count == 1)
			continue;
		first->partner = &centre->stations[config->stations[i].second];
		centre_station_init(centre, config->stations[i].second, i);
		first->partner->partner = first;
	}
	return true;
}

void centre_stations_free(struct centre *centre)
{
	if (centre->epoll >= 0)
		close(centre->epoll);
	centre_batches_free(&centre->batches);
	centre_deadlines_free(&centre->deadlines);
	for (uint32_t i = 0; centre->stations != NULL && i < centre->config->link_count; i++)
		channel_forget(&centre->stations[i].security);
	free(centre->next);
	free(centre->stations);
	free(centre->octets);
	free(centre->sent_ns);
}
