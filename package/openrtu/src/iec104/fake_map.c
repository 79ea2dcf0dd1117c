/* SPDX-License-Identifier: GPL-3.0-or-later */
#include "iec104/fake_map.h"

#include <stdio.h>
#include <string.h>

struct map fake;
int64_t now;

const struct map_config *map_config(const struct map *map)
{
	return &map->config;
}

uint32_t map_owner(const struct map *map, uint32_t point)
{
	return map->config.sets[map->config.points[point].set].module;
}

bool map_alive(const struct map *map, uint32_t module)
{
	return !map->dead[module] && !map->silent[module];
}

void map_module(const struct map *map, uint32_t index, struct map_module *out)
{
	*out = (struct map_module){.state = MAP_MODULE_RUNNING, .generation = map->generation[index]};
	if (map->dead[index])
		out->state = MAP_MODULE_DOWN;
	else if (map->starting[index])
		out->state = MAP_MODULE_STARTING;
}

uint32_t map_find(const struct map *map, uint16_t ca, uint32_t ioa)
{
	for (uint32_t i = 0; i < map->config.point_count; i++)
		if (points[i].ioa == ioa && devices[points[i].set].ca == ca)
			return i;
	return MAP_NONE;
}

/* Its configuration does not change. */
uint32_t map_number_now(const struct map *map, const struct map_config *before, uint32_t point)
{
	(void)map, (void)before;
	return point;
}

bool map_read(const struct map *map, uint32_t point, struct map_sample *out)
{
	if (fake.unreadable > 0) {
		fake.unreadable--;
		return false;
	}
	*out = map->samples[point];
	if (!map_alive(map, map_owner(map, point)))
		out->quality |= MAP_INVALID;
	if (map->on_read != NULL)
		map->on_read(point);
	return true;
}

bool map_read_together(const struct map *map, const uint32_t *together, size_t count, struct map_sample *out)
{
	bool whole = true;

	for (size_t i = 0; i < count; i++)
		whole = whole && map_read(map, together[i], &out[i]);
	return whole;
}

bool map_total_read(const struct map *map, uint32_t point, struct map_sample *out)
{
	if (map->totals[point].time_ns == 0)
		return map_read(map, point, out);
	*out = map->totals[point];
	return true;
}

void map_parameters_read(const struct map *map, uint32_t point, struct map_parameters *out)
{
	*out = map->parameters[point];
	out->cyclic = points[point].send_period_ms != 0 && !(out->loaded & 1u << MAP_CYCLIC);
}

uint32_t map_starts(const struct map *map)
{
	return map->starts;
}

uint32_t *map_kept_number(struct map *map)
{
	return &map->note;
}

void map_queue(const struct map *map, unsigned slot, struct map_queue *out)
{
	const struct map_settings *settings = &map->config.settings;

	*out = map->queues[slot];
	out->limit = map_queue_limit(settings, slot);
	out->waiting = map_events_behind(map, &map->places[slot].cursor);
	if (map_queue_plan(settings, slot) != NULL)
		snprintf(out->name, sizeof(out->name), "%s", map_queue_plan(settings, slot)->name);
}

void map_queue_place(const struct map *map, unsigned slot, struct map_queue_place *out)
{
	*out = map->places[slot];
}

void map_queue_move(struct map *map, unsigned slot, const struct map_queue_place *place)
{
	map->places[slot] = *place;
}

void map_queue_assign(struct map *map, unsigned slot, const char *address,
		      const struct map_queue_place *place)
{
	map->queues[slot] = (struct map_queue){.lost = 0};
	snprintf(map->queues[slot].name, sizeof(map->queues[slot].name), "%s", address);
	map->places[slot] = *place;
}

/* Its groups are what the configuration says. */
void map_queue_adopt(struct map *map, unsigned slot, const struct map_queue_place *anew)
{
	(void)map, (void)slot, (void)anew;
}

void map_queue_free(struct map *map, unsigned slot)
{
	map->queues[slot] = (struct map_queue){.used = 0};
}

void map_queue_use(struct map *map, unsigned slot)
{
	map->queues[slot].used = ++map->turns;
}

void map_queue_count_lost(struct map *map, unsigned slot, uint32_t events)
{
	map->queues[slot].lost += events;
}

void map_queue_set_unacknowledged(struct map *map, unsigned slot, uint32_t events)
{
	map->queues[slot].unacknowledged = events;
}

void *map_section(const struct map *map, uint32_t module, size_t size)
{
	(void)map;
	return module == 0 && size == sizeof(fake.stats) ? &fake.stats : NULL;
}

uint32_t map_module_of_kind(const struct map *map, const char *kind)
{
	(void)map;
	return strcmp(kind, IEC104_KIND) == 0 ? 0 : MAP_NONE;
}

void map_count_lost_events(struct map *map, uint32_t events)
{
	map->lost_events += events;
}

uint32_t map_events_behind(const struct map *map, const struct map_cursor *cursor)
{
	return map->event_count - cursor->next[0];
}

/* One ring stands for those of all modules. */
static void move_cursor(struct map_cursor *cursor, uint32_t to)
{
	for (unsigned i = 0; i < RINGS; i++)
		cursor->next[i] = to;
}

void map_cursor_to_end(const struct map *map, struct map_cursor *cursor)
{
	move_cursor(cursor, map->event_count);
	cursor->lost = 0;
}

bool map_event_next(const struct map *map, struct map_cursor *cursor, struct map_event *out)
{
	uint32_t behind = map->event_count - cursor->next[0];

	if (behind == 0)
		return false;
	if (behind > map->event_capacity) {
		cursor->lost += behind - map->event_capacity;
		cursor->next[0] = map->event_count - map->event_capacity;
	}
	*out = map->events[cursor->next[0] % EVENTS];
	move_cursor(cursor, cursor->next[0] + 1);
	return true;
}

bool map_event_next_of(const struct map *map, struct map_cursor *cursor, uint32_t module,
		       struct map_event *out)
{
	while (map_event_next(map, cursor, out))
		if (out->kind == MAP_EVENT_CHANGE && map_owner(map, out->point) == module)
			return true;
	return false;
}

void map_publish(struct map *map, const struct map_update *updates, size_t count)
{
	for (size_t i = 0; i < count; i++) {
		struct map_sample *held = &map->samples[updates[i].point];
		bool changed =
		    held->value.u != updates[i].sample.value.u || held->quality != updates[i].sample.quality;

		*held = updates[i].sample;
		if (changed)
			put_event(MAP_EVENT_CHANGE, updates[i].point, *held);
	}
}

uint32_t map_request_post(struct map *map, struct map_request request)
{
	uint32_t owner = request.point == MAP_NONE ? MAP_RTUD : map_owner(map, request.point);

	if (!map_alive(map, owner))
		return 0;
	request.id = map->request_count + 1;
	map->requests[map->request_count++ % REQUESTS] = request;
	return request.id;
}

uint32_t map_self(const struct map *map)
{
	(void)map;
	return 0;
}

bool map_command_read(const struct map *map, uint32_t point, struct map_command *out)
{
	*out = map->commands[point];
	return true;
}

bool map_answer_next(struct map *map, struct map_answer *out)
{
	if (map->answers_read == map->answer_count) {
		void (*happens)(void) = map->on_last_answer;

		map->on_last_answer = NULL;
		if (happens != NULL)
			happens();
		return false;
	}
	*out = map->answers[map->answers_read++ % ANSWERS];
	return true;
}

struct map_clock map_clock_read(const struct map *map)
{
	return map->clock;
}

void map_log(struct map *map, enum map_log_level level, const char *format, ...)
{
	(void)level;
	(void)format;
	map->log_count++;
}

void put_event(enum map_event_kind kind, uint32_t point, struct map_sample sample)
{
	fake.events[fake.event_count++ % EVENTS] =
	    (struct map_event){.point = point, .kind = (uint8_t)kind, .sample = sample};
}

void publish(uint32_t point, int32_t value)
{
	fake.samples[point] = (struct map_sample){.value.i = value, .time_ns = now};
	put_event(MAP_EVENT_CHANGE, point, fake.samples[point]);
}

void fake_own_station(void)
{
	fake.settings.own_ca = 900;
	fake.config.settings.queue_count = 1;
	fake.config.set_count = DEVICES + 1;
	fake.config.point_count = POINTS + OWN;
	for (uint32_t i = POINTS; i < POINTS + OWN; i++)
		fake.samples[i] = (struct map_sample){.quality = MAP_INVALID};
}

void fake_receiver(void)
{
	fake.config.set_count = DEVICES + 2;
	fake.config.point_count = ALL;
}

void return_information(uint32_t point, int32_t value)
{
	publish(point, value);
	fake.events[(fake.event_count - 1) % EVENTS].cause = MAP_RETURN_REMOTE;
}

void answer(uint32_t id, enum map_command_state state, enum map_command_result result)
{
	const struct map_request *request = &fake.requests[(id - 1) % REQUESTS];

	fake.answers[fake.answer_count++ % ANSWERS] = (struct map_answer){.id = id,
									  .point = request->point,
									  .action = request->action,
									  .state = (uint8_t)state,
									  .result = (uint8_t)result};
}

void fake_begin(void)
{
	memset(&fake, 0, sizeof(fake));
	fake.settings = (struct iec104_settings){.position_type = 201,
						 .k = 12,
						 .w = 8,
						 .t1_s = 15,
						 .t2_s = 10,
						 .t3_s = 20,
						 .max_connections = 3,
						 .connections_per_address = 3};
	fake.config = (struct map_config){
	    .settings = {.command_timeout_s = 10, .event_ring = EVENTS},
	    .set_count = DEVICES,
	    .point_count = POINTS,
	    .sets = devices,
	    .sections = {{IEC104_SETTINGS, sizeof(fake.settings), 1, &fake.settings}},
	    .section_count = 1,
	    .points = points,
	};
	fake.event_capacity = EVENTS;
	now = 500 * S + 1;
	fake.clock = (struct map_clock){.offset_ns = WALL_NS - now, .set = true};
	for (uint32_t i = 0; i < POINTS; i++)
		fake.samples[i].value.i = (int32_t)i & 1;
	fake.samples[FLOAT].value.f = 1.5f;
}
