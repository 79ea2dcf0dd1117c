/* SPDX-License-Identifier: GPL-3.0-or-later */
#include "modules/gps/publish.h"

#include "map/time_ns.h"

#define TIME_TRUSTED_NS (5 * NS_PER_S) /* of a fix, from its arrival: it left the receiver a burst ago */
#define MM_PER_M        1000.0f
#define PER_DEGREE      100.0f
#define PER_ONE         100.0f

void publisher_init(struct publisher *publisher, struct map *map, const struct gps_settings *settings,
		    struct gps_stats *stats)
{
	const struct gps_fence *fences = gps_fences(map_config(map));
	const struct map_set *set = &map_config(map)->sets[settings->set];

	*publisher = (struct publisher){
	    .map = map,
	    .settings = settings,
	    .fences = fences == NULL ? NULL : &fences[settings->first_fence],
	    .stats = stats,
	};
	for (uint32_t i = 0; i < set->point_count; i++)
		if ((map_own_sample(map, set->first_point + i).quality & MAP_INVALID) == 0)
			publisher->taken_over_ns = map_now_ns();
}

/* ---- one fix as samples ------------------------------------------------------------------ */

/* When the receiver was there, by its own time; by its arrival where the two clocks do not agree. */
static int64_t moment_of(const struct map *map, const struct gps_fix *fix)
{
	const struct map_clock clock = map_clock_read(map);
	const int64_t late_ns = map_wall_ns(clock, fix->arrival_ns) - fix->time_ns;

	if (!clock.set || (fix->known & GPS_TIME) == 0 || late_ns < 0 || late_ns > TIME_TRUSTED_NS)
		return fix->arrival_ns;
	return fix->arrival_ns - late_ns;
}

static union map_value value_of(const struct gps_fix *fix, enum gps_point point)
{
	switch (point) {
	case GPS_POINT_LATITUDE:
		return (union map_value){.i = fix->latitude};
	case GPS_POINT_LONGITUDE:
		return (union map_value){.i = fix->longitude};
	case GPS_POINT_ALTITUDE:
		return (union map_value){.f = (float)fix->altitude_mm / MM_PER_M};
	case GPS_POINT_SPEED:
		return (union map_value){.f = (float)fix->speed_mm_s / MM_PER_M};
	case GPS_POINT_COURSE:
		return (union map_value){.f = (float)fix->course / PER_DEGREE};
	case GPS_POINT_HDOP:
		return (union map_value){.f = (float)fix->hdop / PER_ONE};
	case GPS_POINT_ERROR:
		return (union map_value){.f = (float)fix->error_mm / MM_PER_M};
	case GPS_POINT_FIX:
		return (union map_value){.i = (fix->known & GPS_POSITION) ? fix->method : GPS_NO_FIX};
	case GPS_POINT_SATELLITES:
		return (union map_value){.i = fix->satellites};
	case GPS_POINTS:
		break;
	}
	return (union map_value){.i = 0};
}

/* What a receiver says without a fix too. */
static bool is_of_receiver(enum gps_point point)
{
	return point == GPS_POINT_FIX || point == GPS_POINT_SATELLITES;
}

/* Which field of a fix a point is of; 0: it is always known. */
static uint32_t needs(enum gps_point point)
{
	static const uint32_t fields[GPS_POINTS] = {
	    [GPS_POINT_LATITUDE] = GPS_POSITION, [GPS_POINT_LONGITUDE] = GPS_POSITION,
	    [GPS_POINT_ALTITUDE] = GPS_ALTITUDE, [GPS_POINT_SPEED] = GPS_SPEED,
	    [GPS_POINT_COURSE] = GPS_COURSE,     [GPS_POINT_HDOP] = GPS_HDOP,
	    [GPS_POINT_ERROR] = GPS_ERROR,       [GPS_POINT_SATELLITES] = GPS_SATELLITES,
	};

	return fields[point];
}

static uint8_t keeps(const struct gps_fix *fix, uint32_t field)
{
	return (fix->known & field) == field ? 0 : MAP_UPDATE_KEEPS_VALUE;
}

/* What MAP_POINT_POSITION says beside the three points behind it. */
static uint32_t fix_and_satellites(const struct gps_fix *fix)
{
	const uint32_t most = 15, satellites = fix->satellites < most ? fix->satellites : most;

	return value_of(fix, GPS_POINT_FIX).u | satellites << 4;
}

/* quality: of the position. That the receiver itself says is as good without one. */
static uint8_t quality_of(const struct gps_fix *fix, enum gps_point point, uint8_t quality)
{
	const uint32_t field = needs(point);
	const uint8_t known = is_of_receiver(point) ? quality & MAP_NOT_TOPICAL : quality;

	return keeps(fix, field) ? known | MAP_INVALID : known;
}

/* One of the set's points, by its place in it. Where the fix does not say it, the last value stays, which is invalid then. */
static struct map_update update_of(const struct publisher *publisher, const struct gps_fix *fix,
				   uint8_t quality, uint32_t place)
{
	const uint32_t point = place - publisher->settings->whole, fence = point - GPS_POINTS;
	struct map_update update = {.sample.quality = quality};

	if (place < publisher->settings->whole) {
		update.sample.value.u = fix_and_satellites(fix);
		update.sample.quality = quality_of(fix, GPS_POINT_LATITUDE, quality);
	} else if (point < GPS_POINTS) {
		update.sample.value = value_of(fix, point);
		update.sample.quality = quality_of(fix, point, quality);
		update.flags = keeps(fix, needs(point));
	} else {
		update.sample.value.u = gps_fence_holds(&publisher->fences[fence],
							(struct gps_place){fix->latitude, fix->longitude});
		update.flags = keeps(fix, GPS_POSITION);
	}
	return update;
}

static void publish(struct publisher *publisher, const struct gps_fix *fix, int64_t now_ns,
		    enum map_event_rule rule)
{
	const uint32_t fences = publisher->settings->whole + GPS_POINTS;
	const uint8_t quality = gps_quality(fix, now_ns, publisher->settings->topical_ns);
	const struct map_set *set = &map_config(publisher->map)->sets[publisher->settings->set];
	const int64_t moment_ns = moment_of(publisher->map, fix);
	struct map_update updates[1 + GPS_POINTS + GPS_FENCES_MAX];

	for (uint32_t i = 0; i < set->point_count; i++) {
		updates[i] = update_of(publisher, fix, quality, i);
		updates[i].point = set->first_point + i;
		updates[i].sample.time_ns = moment_ns;
		/* In or out is an event by itself, whenever it is seen. */
		updates[i].event_rule = i < fences ? (uint8_t)rule : MAP_EVENT_BY_CHANGE;
	}
	map_publish(publisher->map, updates, set->point_count);
}

/* ---- one after the other ----------------------------------------------------------------- */

static void show(struct publisher *publisher)
{
	struct gps_stats *stats = publisher->stats;

	map_count(&stats->fixes, 1);
	atomic_store(&stats->jumps, publisher->track.jumps);
	atomic_store(&stats->too_fast, publisher->track.too_fast);
	atomic_store(&stats->clock_steps, publisher->track.clock_steps);
	latch_store(&stats->latch, stats->copies, &publisher->last, sizeof(publisher->last));
}

/*
 * A fix is an event as a whole or not at all: what changes the quality of a part of the position does for all of it. The other points
 * may be known or not from fix to fix.
 */
static bool is_due(const struct publisher *publisher, const struct gps_fix *fix)
{
	return publisher->is_stale || !publisher->has_sent ||
	       ((publisher->sent.known ^ fix->known) & GPS_ALTITUDE) != 0 ||
	       gps_due(&publisher->settings->rule, &publisher->sent, fix) != GPS_NOT_DUE;
}

void publisher_take(struct publisher *publisher, struct gps_fix *fix)
{
	bool due;

	gps_track_judge(&publisher->track, &publisher->settings->limits, fix);
	due = is_due(publisher, fix);
	publish(publisher, fix, fix->arrival_ns, due ? MAP_EVENT_ALWAYS : MAP_EVENT_BY_QUALITY);
	publisher->last = *fix;
	publisher->has_last = true;
	publisher->is_stale = false;
	if (due) {
		publisher->sent = *fix;
		publisher->has_sent = true;
		map_count(&publisher->stats->events, 1);
	}
	show(publisher);
}

/* The fix is a former process's: its values stay. */
static void age(struct publisher *publisher, int64_t now_ns)
{
	const struct map_set *set = &map_config(publisher->map)->sets[publisher->settings->set];
	struct map_update updates[1 + GPS_POINTS + GPS_FENCES_MAX];

	for (uint32_t i = 0; i < set->point_count; i++) {
		const uint32_t point = set->first_point + i;
		const uint8_t quality = map_own_sample(publisher->map, point).quality;

		updates[i] = (struct map_update){
		    .point = point,
		    .flags = MAP_UPDATE_KEEPS_VALUE,
		    .event_rule = MAP_EVENT_BY_QUALITY,
		    .sample = {.quality = quality | MAP_NOT_TOPICAL, .time_ns = now_ns},
		};
	}
	map_publish(publisher->map, updates, set->point_count);
}

void publisher_run(struct publisher *publisher, int64_t now_ns)
{
	if (now_ns < publisher_deadline(publisher))
		return;
	publisher->is_stale = true;
	if (publisher->has_last)
		publish(publisher, &publisher->last, now_ns, MAP_EVENT_ALWAYS);
	else
		age(publisher, now_ns);
}

int64_t publisher_deadline(const struct publisher *publisher)
{
	const int64_t known_ns = publisher->has_last ? publisher->last.arrival_ns : publisher->taken_over_ns;

	if (known_ns == 0 || publisher->is_stale)
		return INT64_MAX;
	return known_ns + publisher->settings->topical_ns + 1;
}
