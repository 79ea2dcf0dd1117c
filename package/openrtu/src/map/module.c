/* SPDX-License-Identifier: GPL-3.0-or-later */
/* Module states, the clock, the log, counters: the parts of the map that are plain words. */
#include <inttypes.h>
#include <stdarg.h>
#include <stdio.h>
#include <string.h>

#include "map/layout.h"
#include "map/supervise.h"
#include "map/time_ns.h"

#define HANG_LIMITS 20     /* a module silent for so many heartbeat limits is hung, */
#define HANG_MAX_MS 10000U /* or for so long */

static uint32_t last_beat_ms(const struct map *map, uint32_t module)
{
	return atomic_load_explicit(&map->segments[module].header->heartbeat_ms, memory_order_acquire);
}

static uint32_t heartbeat_age_ms(const struct map *map, uint32_t module)
{
	/* Before the clock: one that beats in between would come out 49.7 days old. */
	uint32_t beaten = last_beat_ms(map, module);

	return now_ms() - beaten;
}

/* Within the limit of the cycle's begin, before it or since, is young enough; of any other the clock tells. */
static bool beats(const struct map *map, uint32_t module)
{
	const uint32_t limit_ms = map_heartbeat_limit_ms(map, module);
	const uint32_t before_ms = map->cycle_ms - last_beat_ms(map, module); /* it may be below 0 */

	return (map->cycle_ns != 0 && before_ms + limit_ms <= 2 * limit_ms) ||
	       heartbeat_age_ms(map, module) <= limit_ms;
}

static bool attached(const struct map *map, uint32_t module)
{
	const struct module_status *status = &map->directory->modules[module];

	return atomic_load_explicit(&map->segments[module].header->generation, memory_order_acquire) ==
	       atomic_load_explicit(&status->generation, memory_order_acquire);
}

static bool may_run(uint32_t state)
{
	return state == MAP_MODULE_STARTING || state == MAP_MODULE_RUNNING || state == MAP_MODULE_SWITCHING;
}

bool map_alive(const struct map *map, uint32_t module)
{
	uint32_t state = atomic_load_explicit(&map->directory->modules[module].state, memory_order_acquire);

	return may_run(state) && attached(map, module) && beats(map, module);
}

uint32_t map_heartbeat_limit_ms(const struct map *map, uint32_t module)
{
	return map->modules[module].plan.heartbeat_limit_ms;
}

uint32_t map_patience_ms(const struct map *map, uint32_t module)
{
	const uint32_t limit_ms = map_heartbeat_limit_ms(map, module);

	return limit_ms < HANG_MAX_MS / HANG_LIMITS ? limit_ms * HANG_LIMITS : HANG_MAX_MS;
}

uint32_t map_module_of_kind(const struct map *map, const char *kind)
{
	for (uint32_t i = 0; i < map_module_count(map); i++)
		if (strcmp(map->modules[i].plan.kind, kind) == 0)
			return i;
	return MAP_NONE;
}

bool map_kind_alive(const struct map *map, const char *kind)
{
	const uint32_t module = map_module_of_kind(map, kind);

	return module != MAP_NONE && map_alive(map, module);
}

void map_module(const struct map *map, uint32_t index, struct map_module *out)
{
	const struct module_entry *entry = &map->modules[index];
	const struct module_status *status = &map->directory->modules[index];

	*out = (struct map_module){
	    .flags = entry->plan.flags,
	    .user = entry->plan.user,
	    .state = (uint8_t)atomic_load(&status->state),
	    .alive = map_alive(map, index),
	    .pid = (int32_t)atomic_load(&status->pid),
	    .generation = atomic_load(&status->generation),
	    .restarts = atomic_load(&status->restarts),
	    .heartbeat_age_ms = heartbeat_age_ms(map, index),
	    .point_count = entry->live_count,
	    .started_ns = (int64_t)atomic_load(&status->started_s) * NS_PER_S,
	};
	out->lost_events = atomic_load(&map->segments[index].header->lost_events);
	memcpy(out->name, entry->plan.name, sizeof(out->name));
	memcpy(out->kind, entry->plan.kind, sizeof(out->kind));
}

uint32_t map_starts(const struct map *map)
{
	return atomic_load(&map->directory->starts);
}

uint32_t *map_kept_number(struct map *map)
{
	return &map->segments[map->self].header->kept;
}

void map_note_forbidden(struct map *map, int call)
{
	atomic_store(&map->segments[map->self].header->forbidden, (uint32_t)(call + 1));
}

bool map_may_run(const struct map *map)
{
	uint32_t state = atomic_load(&map->directory->modules[map->self].state);

	return may_run(state) && attached(map, map->self);
}

/* ---- supervision ------------------------------------------------------------------------- */

void map_modules_restarting(struct map *map)
{
	atomic_fetch_add(&map->directory->starts, 1);
}

void map_module_starting(struct map *map, uint32_t module)
{
	struct module_status *status = &map->directory->modules[module];

	atomic_fetch_add(&status->generation, 1);
	atomic_store(&status->started_s, now_s());
	atomic_store(&status->state, MAP_MODULE_STARTING);
}

void map_module_started(struct map *map, uint32_t module, int32_t pid)
{
	atomic_store(&map->directory->modules[module].pid, (uint32_t)pid);
}

bool map_module_attached(const struct map *map, uint32_t module)
{
	return attached(map, module);
}

void map_module_running(struct map *map, uint32_t module)
{
	atomic_store(&map->directory->modules[module].state, MAP_MODULE_RUNNING);
}

void map_module_switching(struct map *map, uint32_t module)
{
	atomic_store(&map->directory->modules[module].state, MAP_MODULE_SWITCHING);
}

bool map_module_has_taken_over(const struct map *map, uint32_t module)
{
	return attached(map, module) && atomic_load(&map->segments[module].header->carried) == 0;
}

void map_module_ended(struct map *map, uint32_t module, bool failed)
{
	struct module_status *status = &map->directory->modules[module];

	atomic_store(&status->state, failed ? MAP_MODULE_DOWN : MAP_MODULE_STOPPED);
	atomic_store(&status->pid, 0);
	if (failed)
		atomic_fetch_add(&status->restarts, 1);
}

int map_module_forbidden(const struct map *map, uint32_t module)
{
	return (int)(atomic_load(&map->segments[module].header->forbidden) - 1);
}

void map_announce(struct map *map, enum map_event_kind kind, uint32_t module)
{
	struct map_event event = {
	    .point = module,
	    .kind = (uint8_t)kind,
	    .sample = {.quality = MAP_INVALID, .time_ns = map_now_ns()},
	};

	ring_put(&map->segments[MAP_RTUD].events, &event);
	bell_ring_event_readers(map);
}

/* ---- clock ------------------------------------------------------------------------------- */

struct map_clock map_clock_read(const struct map *map)
{
	struct directory *directory = map->directory;
	struct map_clock clock;

	if (!latch_load(&directory->clock_latch, directory->clock, &clock, sizeof(clock)))
		clock.set =
		    false; /* rtud sets it once a tick at most: not reached, and if so, not to be trusted */
	return clock;
}

void map_clock_write(struct map *map, struct map_clock clock)
{
	latch_store(&map->directory->clock_latch, map->directory->clock, &clock, sizeof(clock));
}

/* ---- log --------------------------------------------------------------------------------- */

static struct map_pace log_pace(enum map_log_level level)
{
	return (struct map_pace){.period_ns = MAP_LOG_PERIOD_NS,
				 .at_once =
				     MAP_LOG_AT_ONCE - (level <= MAP_LOG_WARNING ? 0 : MAP_LOG_RESERVED)};
}

__attribute__((format(printf, 4, 0))) static void
put_line(struct map *map, enum map_log_level level, int64_t now_ns, const char *format, va_list arguments)
{
	struct map_log_line line = {.time_ns = now_ns, .level = (uint8_t)level};

	vsnprintf(line.text, sizeof(line.text), format, arguments);
	ring_put(&map->segments[map->self].log, &line);
	bell_ring(map, MAP_RTUD);
}

__attribute__((format(printf, 4, 5))) static void put(struct map *map, enum map_log_level level,
						      int64_t now_ns, const char *format, ...)
{
	va_list arguments;

	va_start(arguments, format);
	put_line(map, level, now_ns, format, arguments);
	va_end(arguments);
}

void log_say_withheld(struct map *map, int64_t now_ns)
{
	uint32_t times;

	if (!map_lines_room(&map->lines, log_pace(MAP_LOG_WARNING), now_ns))
		return;
	if (map->lines.withheld > 0)
		times = map_repeats_happened(&map->withheld, map->lines.withheld, now_ns);
	else
		times = map_repeats_due(&map->withheld, now_ns);
	map->lines.withheld = 0;
	if (times > 0)
		put(map, MAP_LOG_WARNING, now_ns, "%" PRIu32 " lines are left out: it wrote too many at once",
		    times);
}

void map_log(struct map *map, enum map_log_level level, const char *format, ...)
{
	const int64_t now_ns = map_now_ns();
	va_list arguments;

	log_say_withheld(map, now_ns);
	if (!map_lines_take(&map->lines, log_pace(level), now_ns))
		return;
	va_start(arguments, format);
	put_line(map, level, now_ns, format, arguments);
	va_end(arguments);
}

/* A module gone wild shall not forge other modules' lines, nor speak to the reader's terminal. text: size octets. */
static void make_printable(char *text, size_t size)
{
	text[size - 1] = '\0';
	for (; *text; text++)
		if ((unsigned char)*text < ' ' || *text == 0x7f)
			*text = '?';
}

bool map_log_next(const struct map *map, uint32_t module, uint32_t *position, struct map_log_line *out,
		  uint32_t *lost)
{
	if (!ring_peek(&map->segments[module].log, position, out, lost))
		return false;
	*position += 1;
	make_printable(out->text, sizeof(out->text));
	if (!is_past(map, out->time_ns))
		out->time_ns = map_now_ns();
	return true;
}

/* ---- a module's own section --------------------------------------------------------------- */

void *map_section(const struct map *map, uint32_t module, size_t size)
{
	return map->modules[module].plan.section_size == size ? map->segments[module].own : NULL;
}

const struct map_scans *map_scans_of(const struct map *map, uint32_t module)
{
	const struct map_module_plan *plan = &map->modules[module].plan;

	if (!(plan->flags & MAP_SHOWS_SCANS) || plan->section_size < sizeof(struct map_scans))
		return NULL;
	return map->segments[module].own;
}

void map_histogram_add(struct map_histogram *histogram, int64_t duration_ns)
{
	const int64_t us = duration_ns > 0 ? duration_ns / NS_PER_US : 0;

	map_count(&histogram->counts[map_bucket_of(us)], 1);
	if (us > histogram->longest_us)
		atomic_store(&histogram->longest_us, us < UINT32_MAX ? (uint32_t)us : UINT32_MAX);
}

/* What the former process had counted under the name of this entry; what stands there of another one moves to a free entry. */
static uint32_t take_carried(struct counter_entry *entries, uint32_t count, const char *name)
{
	uint32_t value = 0, found = 0;

	while (found < count && (entries[found].place != 0 || strcmp(entries[found].name, name) != 0))
		found++;
	if (found < count)
		value = entries[found].carried;
	else
		for (found = 0; found < count && entries[found].name[0] != '\0';)
			found++;
	if (entries[0].place == 0 && found < count)
		entries[found] = entries[0];
	return value;
}

bool map_name_counter(struct map *map, const _Atomic uint32_t *counter, const char *format, ...)
{
	const struct map_module_plan *plan = &map->modules[map->self].plan;
	const struct segment *own = &map->segments[map->self];
	_Atomic uint32_t *words = own->own;
	struct counter_entry *entry;
	char name[MAP_COUNTER_SIZE];
	va_list arguments;
	uint32_t place;

	if (map->named >= plan->counters)
		return false;
	va_start(arguments, format);
	vsnprintf(name, sizeof(name), format, arguments);
	va_end(arguments);
	entry = &own->counters[map->named];
	place = (uint32_t)(counter - words);
	map_count(&words[place], take_carried(entry, plan->counters - map->named, name));
	map->named++;
	memcpy(entry->name, name, sizeof(name));
	entry->carried = 0;
	atomic_store(&entry->place, place + 1);
	return true;
}

bool map_counter(const struct map *map, uint32_t module, uint32_t number, struct map_counter *out)
{
	const struct map_module_plan *plan = &map->modules[module].plan;
	const _Atomic uint32_t *words = map->segments[module].own;
	const struct counter_entry *entry;
	uint32_t place;

	if (number >= plan->counters)
		return false;
	entry = &map->segments[module].counters[number];
	place = atomic_load(&entry->place);
	if (place == 0 || place > plan->section_size / sizeof(*words))
		return false;
	memcpy(out->name, entry->name, sizeof(out->name));
	make_printable(out->name, sizeof(out->name));
	out->value = atomic_load(&words[place - 1]);
	return true;
}

void map_count_lost_events(struct map *map, uint32_t events)
{
	map_count(&map->segments[map->self].header->lost_events, events);
}
