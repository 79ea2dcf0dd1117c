/* SPDX-License-Identifier: GPL-3.0-or-later */
/* A configuration that follows another while the modules run: what rtud does to the map (docs/reload.md). */
#include <errno.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <sys/mman.h>
#include <unistd.h>

#include "map/layout.h"
#include "map/supervise.h"

/* ---- what is compared -------------------------------------------------------------------- */

const struct map_module_plan *map_plan_of(const struct map *map, uint32_t module)
{
	return &map->modules[module].plan;
}

int map_prepare(const struct map *map, const struct map_config *config, map_modules kept, uint32_t group,
		char *error)
{
	const uint32_t epoch = map->file->epoch + 1;
	uint32_t made[MAP_MODULES_MAX];

	for (uint32_t i = 0; i < MAP_MODULES_MAX; i++)
		made[i] = kept & map_module_bit(i) ? map->modules[i].made : epoch;
	return config_create(map->directory_fd, config, epoch, made, group, error);
}

bool map_is_made_for(const struct map *next, uint32_t module)
{
	return next->modules[module].made == next->file->epoch;
}

bool map_is_gone(const struct map *map, uint32_t module)
{
	return (map->modules[module].plan.flags & MAP_IS_GONE) != 0;
}

bool map_module_is_ready(const struct map *next, uint32_t module)
{
	return atomic_load(&next->segments[module].header->ready) != 0;
}

bool map_has_commands_under_way(const struct map *map, uint32_t module)
{
	struct map_command command;

	for (uint32_t i = 0; i < map->modules[module].point_count; i++)
		if (map_command_read(map, point_in(map, module, i), &command) &&
		    (command.state == MAP_EXECUTING || command.off_ns != 0))
			return true;
	return false;
}

void map_unlink_former(const struct map *map, const struct map *next)
{
	char name[FILE_NAME_SIZE];

	for (uint32_t i = 0; i < map_module_count(map); i++) {
		if (next->modules[i].made == map->modules[i].made)
			continue;
		segment_file(name, map->modules[i].plan.name, map->modules[i].made);
		unlinkat(map->directory_fd, name, 0);
		if (strcmp(map->modules[i].plan.name, next->modules[i].plan.name) == 0)
			continue;
		bell_file(name, map->modules[i].plan.name);
		unlinkat(map->directory_fd, name, 0);
	}
	config_file(name, map->file->epoch);
	unlinkat(map->directory_fd, name, 0);
}

void map_abandon(const struct map *map)
{
	char mark[16];

	snprintf(mark, sizeof(mark), "+%u.", map->file->epoch + 1);
	map_sweep(map->directory_fd, mark);
}

/* ---- what passes over to a module's new segment ------------------------------------------- */

struct carriage {
	const struct map *map, *next;
	uint32_t module;
	bool another;      /* it has the number of one that is gone */
	bool valid;        /* its points are, so far as their samples say */
	struct segment to; /* writable */
	uint32_t *slots;   /* by the former one; MAP_NONE: there is none */
	int64_t time_ns;   /* of what ends */
};

/* A point that is gone has the addresses that it had, and they may be another's by now. */
static uint32_t find_gone(const struct map *next, const struct map_config *before, uint32_t point)
{
	const struct map_config *config = &next->config;
	const struct map_point *object = &before->points[point];

	for (uint32_t i = config->point_count; i < config->point_count + config->gone_point_count; i++)
		if (config->points[i].ioa == object->ioa && config->points[i].type == object->type &&
		    config->sets[config->points[i].set].ca == before->sets[object->set].ca)
			return i;
	return MAP_NONE;
}

static uint32_t new_slot(const struct carriage *carriage, uint32_t slot)
{
	const struct map *map = carriage->map, *next = carriage->next;
	const uint32_t point = point_in(map, carriage->module, slot);
	uint32_t now = MAP_NONE;

	if (carriage->another)
		return MAP_NONE;
	if (point < map->config.point_count)
		now = map_number_now(next, &map->config, point);
	if (now == MAP_NONE || map_owner(next, now) != carriage->module)
		now = find_gone(next, &map->config, point);
	return now != MAP_NONE && map_owner(next, now) == carriage->module ? slot_of(next, now) : MAP_NONE;
}

static uint32_t *find_slots(const struct carriage *carriage)
{
	const uint32_t count = carriage->map->modules[carriage->module].point_count;
	uint32_t *slots = calloc(count + 1, sizeof(*slots));

	for (uint32_t i = 0; slots && i < count; i++)
		slots[i] = new_slot(carriage, i);
	return slots;
}

static int open_segment(const struct map *map, uint32_t module, struct segment *out)
{
	const struct layout layout = layout_of(&map->modules[module]);
	int fd = map_segment_open(map, module);
	void *memory;

	if (fd < 0)
		return -1;
	memory = mmap(NULL, layout.size, PROT_READ | PROT_WRITE, MAP_SHARED, fd, 0);
	close(fd);
	if (memory == MAP_FAILED)
		return -1;
	segment_place(out, memory, &layout);
	return 0;
}

static void change_slot(const struct carriage *carriage, uint32_t *slot)
{
	*slot =
	    *slot < carriage->map->modules[carriage->module].point_count ? carriage->slots[*slot] : MAP_NONE;
}

static void change_event(const struct carriage *carriage, void *record)
{
	struct map_event *event = record;

	if (carriage->another) /* who has not read it, has lost it */
		event->kind = EVENT_OVERWRITTEN;
	else if (event->kind == MAP_EVENT_CHANGE)
		change_slot(carriage, &event->point);
}

static void change_line(const struct carriage *carriage, void *record)
{
	struct map_log_line *line = record;
	char text[MAP_NAME_SIZE + 2 + MAP_LOG_TEXT_SIZE];

	if (!carriage->another)
		return;
	snprintf(text, sizeof(text), "%s: %.*s", carriage->map->modules[carriage->module].plan.name,
		 MAP_LOG_TEXT_SIZE - 1, line->text);
	snprintf(line->text, sizeof(line->text), "%.*s", MAP_LOG_TEXT_SIZE - 1, text);
}

/* Of a ring that was smaller, a reader who was too late for these has lost them. */
static void put_void_events(const struct ring *to, uint32_t from, uint32_t end)
{
	const struct map_event nothing = {.point = MAP_NONE, .kind = EVENT_OVERWRITTEN};

	atomic_store(to->head, from);
	while (ring_head(to) != end)
		ring_put(to, &nothing);
}

/* Numbers go on: readers keep their places. change: what becomes of a record; NULL: it stays. */
static void carry_ring(const struct carriage *carriage, const struct ring *from, const struct ring *to,
		       void (*change)(const struct carriage *carriage, void *record))
{
	union {
		struct map_event event;
		struct map_answer answer;
		struct map_request request;
		struct map_log_line line;
	} record;
	uint32_t next = ring_head(from) - from->capacity, lost = 0;

	if (ring_head(from) < from->capacity)
		next = 0;
	if (next != 0 && change == change_event && to->capacity > from->capacity)
		put_void_events(to, ring_head(from) - to->capacity, next + 1);
	atomic_store(to->head, next);
	while (ring_peek(from, &next, &record, &lost)) {
		if (change)
			change(carriage, &record);
		atomic_store(to->head, next);
		ring_put(to, &record);
		next++;
	}
	atomic_store(to->head, ring_head(from));
}

static void change_answer(const struct carriage *carriage, void *record)
{
	struct map_answer *answer = record;

	change_slot(carriage, &answer->point);
}

static void carry_rings(const struct carriage *carriage)
{
	const struct segment *from = &carriage->map->segments[carriage->module], *to = &carriage->to;

	carry_ring(carriage, &from->requests, &to->requests, NULL);
	carry_ring(carriage, &from->answers, &to->answers, change_answer);
	carry_ring(carriage, &from->events, &to->events, change_event);
	carry_ring(carriage, &from->log, &to->log, change_line);
}

static void carry_header(const struct carriage *carriage)
{
	const struct segment_header *from = carriage->map->segments[carriage->module].header;
	struct segment_header *to = carriage->to.header;

	atomic_store(&to->generation, atomic_load(&from->generation));
	atomic_store(&to->heartbeat_ms, atomic_load(&from->heartbeat_ms));
	atomic_store(&to->next_request, atomic_load(&from->next_request));
	atomic_store(&to->lost_events, atomic_load(&from->lost_events));
	to->kept = carriage->another ? 0 : from->kept;
	memcpy(to->request_next, from->request_next, sizeof(to->request_next));
	memcpy(to->answer_next, from->answer_next, sizeof(to->answer_next));
}

static void carry_cells(const struct carriage *carriage, const struct map_point *before,
			const struct map_point *now)
{
	const struct segment *from = &carriage->map->segments[carriage->module], *to = &carriage->to;

	if ((before->flags & MAP_POINT_COMMAND) && (now->flags & MAP_POINT_COMMAND)) {
		struct command_cell *cell = &from->commands[before->command];

		to->commands[now->command].copies[0] = to->commands[now->command].copies[1] =
		    cell->copies[latch_whole_copy(&cell->latch)];
	}
	if (before->type == MAP_COUNTER) {
		struct total_cell *cell = &from->totals[before->extra];

		to->totals[now->extra].copies[0] = to->totals[now->extra].copies[1] =
		    cell->copies[latch_whole_copy(&cell->latch)];
	} else if (is_measured(before)) {
		memcpy(&to->parameters[now->extra], &from->parameters[before->extra],
		       sizeof(*to->parameters));
	} else if ((before->flags & MAP_POINT_TEXT) && (now->flags & MAP_POINT_TEXT)) {
		to->texts[now->extra] = from->texts[before->extra];
	}
}

/* The value stays to be looked at. Whoever knows the point hears of it before it is unknown. */
static void end_point(const struct segment *segment, uint32_t slot, int64_t time_ns)
{
	struct map_sample *sample = &segment->samples[0][slot];
	struct map_event event = {.point = slot, .kind = MAP_EVENT_CHANGE};

	sample->quality |= MAP_INVALID;
	sample->time_ns = time_ns;
	segment->samples[1][slot] = *sample;
	event.sample = *sample;
	ring_put(&segment->events, &event);
}

/* What its owner has published last, whether it is forced or not. */
static struct map_sample owners_sample(const struct segment *segment, uint32_t slot, unsigned whole)
{
	const struct cover *cover = cover_in(segment, slot);

	return cover != NULL ? cover->below[whole] : segment->samples[whole][slot];
}

static void carry_cover(const struct carriage *carriage, uint32_t slot, unsigned whole)
{
	const struct cover *from = cover_in(&carriage->map->segments[carriage->module], slot);
	struct cover *to;

	if (from == NULL)
		return;
	to = &carriage->to.covers[from - carriage->map->segments[carriage->module].covers];
	*to = (struct cover){.since_ns = from->since_ns, .shown = from->shown};
	to->below[0] = from->below[whole];
	if (!carriage->valid)
		to->below[0].quality |= MAP_INVALID;
	to->below[1] = to->below[0];
	atomic_store(&to->slot, carriage->slots[slot] + 1);
}

static void carry_point(const struct carriage *carriage, uint32_t slot)
{
	const struct map *map = carriage->map, *next = carriage->next;
	const uint32_t before = point_in(map, carriage->module, slot);
	const uint32_t to = carriage->slots[slot], now = point_in(next, carriage->module, to);
	const struct segment *from = &map->segments[carriage->module];
	const unsigned whole = latch_whole_copy(latch_of(map, before));
	const bool gone = now >= next->config.point_count;
	struct map_sample sample = gone ? owners_sample(from, slot, whole) : from->samples[whole][slot];

	if (!carriage->valid)
		sample.quality |= MAP_INVALID;
	carriage->to.samples[0][to] = carriage->to.samples[1][to] = sample;
	carry_cells(carriage, &map->config.points[before], &next->config.points[now]);
	if (!gone)
		carry_cover(carriage, slot, whole);
	if (before < map->config.point_count && gone)
		end_point(&carriage->to, to, carriage->time_ns);
}

static void carry_points(const struct carriage *carriage)
{
	const uint32_t count = carriage->next->modules[carriage->module].point_count;

	for (uint32_t i = 0; i < count; i++)
		carriage->to.samples[0][i].quality = carriage->to.samples[1][i].quality = MAP_INVALID;
	for (uint32_t i = 0; i < carriage->map->modules[carriage->module].point_count; i++)
		if (carriage->slots[i] != MAP_NONE)
			carry_point(carriage, i);
}

/* The new process finds them by their names. */
static void carry_counters(const struct carriage *carriage)
{
	const uint32_t room = carriage->next->modules[carriage->module].plan.counters;
	struct map_counter counter;

	if (carriage->another)
		return;
	for (uint32_t i = 0; i < room && map_counter(carriage->map, carriage->module, i, &counter); i++) {
		memcpy(carriage->to.counters[i].name, counter.name, sizeof(counter.name));
		carriage->to.counters[i].carried = counter.value;
	}
}

static int carry_module(const struct map *map, const struct map *next, uint32_t module,
			const struct map_switching *how)
{
	struct carriage carriage = {
	    .map = map,
	    .next = next,
	    .module = module,
	    .another = strcmp(map->modules[module].plan.name, next->modules[module].plan.name) != 0,
	    .valid = (how->valid & map_module_bit(module)) != 0,
	    .time_ns = map_now_ns()};

	carriage.slots = find_slots(&carriage);
	if (!carriage.slots)
		return -1;
	if (open_segment(next, module, &carriage.to) < 0) {
		free(carriage.slots);
		return -1;
	}
	carry_header(&carriage);
	carry_rings(&carriage);
	carry_points(&carriage);
	carry_counters(&carriage);
	if (how->carry != NULL)
		how->carry(map, next, module, map->segments[module].own, carriage.to.own);
	atomic_store(&carriage.to.header->carried, (how->seamless & map_module_bit(module)) != 0);
	munmap(carriage.to.header, carriage.to.size);
	free(carriage.slots);
	return 0;
}

/* A module that is gone keeps its segment, and its points their slots. */
static int end_module(const struct map *map, uint32_t module)
{
	const int64_t time_ns = map_now_ns(); /* one, as of what is published together */
	struct segment segment = {.header = NULL};

	if (open_segment(map, module, &segment) < 0)
		return -1;
	for (uint32_t i = 0; i < map->modules[module].point_count; i++) {
		const uint32_t point = point_in(map, module, i);

		if (point >= map->config.point_count)
			continue;
		segment.samples[0][i] = owners_sample(&segment, i, latch_whole_copy(latch_of(map, point)));
		end_point(&segment, i, time_ns);
	}
	munmap(segment.header, segment.size);
	return 0;
}

/* Its process has ended, and the next one finds the same segment. */
static int renew_section(const struct map *map, const struct map *next, uint32_t module,
			 const struct map_switching *how)
{
	struct segment segment = {.header = NULL};

	if (how->carry == NULL)
		return 0;
	if (open_segment(map, module, &segment) < 0)
		return -1;
	how->carry(map, next, module, segment.own, segment.own);
	munmap(segment.header, segment.size);
	return 0;
}

static bool is_carried(const struct map *map, const struct map *next, uint32_t module)
{
	return module < map_module_count(map) && map_is_made_for(next, module);
}

static uint32_t renumber(const void *context, uint32_t module, uint32_t slot)
{
	struct carriage carriage = *(const struct carriage *)context;
	const uint32_t point = point_in(carriage.map, module, slot);
	uint32_t now;

	carriage.module = module;
	if (point == MAP_NONE || map_is_gone(carriage.next, module))
		return MAP_NONE;
	if (!is_carried(carriage.map, carriage.next, module))
		return slot;
	now = new_slot(&carriage, slot);
	return now != MAP_NONE && point_in(carriage.next, module, now) < carriage.next->config.point_count
		   ? now
		   : MAP_NONE;
}

int map_switch(const struct map *map, const struct map *next, const struct map_switching *how, char *error)
{
	for (uint32_t i = MAP_RTUD + 1; i < map_module_count(next); i++) {
		int result = 0;

		if (is_carried(map, next, i))
			result = carry_module(map, next, i, how);
		else if (how->again & map_module_bit(i))
			result = renew_section(map, next, i, how);
		else if (map_is_gone(next, i) && !map_is_gone(map, i))
			result = end_module(map, i);
		if (result < 0)
			return map_fail(error, "cannot carry %s over: %s", next->modules[i].plan.name,
					strerror(errno));
	}
	forces_renumber(map, renumber, &(const struct carriage){.map = map, .next = next});
	settings_put(map, &next->config.settings);
	atomic_store_explicit(&map->directory->epoch, next->file->epoch, memory_order_release);
	for (uint32_t i = MAP_RTUD + 1; i < map_module_count(map); i++)
		bell_ring(map, i);
	return 0;
}
