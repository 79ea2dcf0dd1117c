/* SPDX-License-Identifier: GPL-3.0-or-later */
/* The scan: period, frozen inputs, outputs that are published together. */
#include <errno.h>
#include <math.h>
#include <poll.h>
#include <string.h>
#include <time.h>

#include "lib/handle.h"

#define BEATS_A_LIMIT  4               /* a beat that comes late is not the last one */
#define MISSED_SAID_NS (60 * NS_PER_S) /* between two lines about periods that were missed */

/* ---- period ------------------------------------------------------------------------------ */

static void say_missed(struct openrtu *rtu, int64_t now_ns)
{
	if (rtu->missed == 0 || (rtu->missed_said_ns != 0 && now_ns - rtu->missed_said_ns < MISSED_SAID_NS))
		return;
	map_log(rtu->map, MAP_LOG_WARNING,
		"%u periods of %u ms missed: its scan, or the host, takes too long", rtu->missed,
		rtu->module->period_ms);
	rtu->missed = 0;
	rtu->missed_said_ns = now_ns;
}

/* A module that the net lets begin has one only if the file says so. */
static bool has_period(const struct openrtu *rtu)
{
	return rtu->module->period_given || !synched_waits(&rtu->synched);
}

/* The periods that it has waited for others are no missed ones: the next is the first behind them. */
static void skip_waited(struct openrtu *rtu)
{
	const int64_t period_ns = rtu->module->period_ms * NS_PER_MS;
	const int64_t late_ns = map_now_ns() - rtu->next_ns;

	if (late_ns > period_ns)
		rtu->next_ns += late_ns / period_ns * period_ns;
}

static bool begin_scan(struct openrtu *rtu)
{
	if (!synched_waits(&rtu->synched))
		return true;
	if (!synch_begin_scan(rtu))
		return false;
	skip_waited(rtu);
	return true;
}

static void plan_next(struct openrtu *rtu, int64_t now_ns)
{
	const int64_t period_ns = rtu->module->period_ms * NS_PER_MS;

	if (rtu->next_ns == 0 || !has_period(rtu)) {
		rtu->next_ns = now_ns;
		return;
	}
	rtu->next_ns += period_ns;
	if (rtu->next_ns < now_ns) {
		int64_t missed = (now_ns - rtu->next_ns) / period_ns + 1;

		rtu->missed += (uint32_t)missed;
		map_count(&rtu->scans->missed, (uint32_t)missed);
		rtu->next_ns += missed * period_ns;
	}
	say_missed(rtu, now_ns);
}

/* True: it was asked to end. */
static bool sleep_until(const struct openrtu *rtu, int64_t now_ns, int64_t until_ns)
{
	const int64_t left_ns = until_ns > now_ns ? until_ns - now_ns : 0;
	const struct timespec left = {.tv_sec = (time_t)(left_ns / NS_PER_S),
				      .tv_nsec = (long)(left_ns % NS_PER_S)};
	struct pollfd stop = {.fd = rtu->stop_fd, .events = POLLIN};

	return ppoll(&stop, 1, &left, NULL) > 0;
}

bool openrtu_wait(struct openrtu *rtu)
{
	const int64_t beat_ns = rtu->module->heartbeat_limit_ms * NS_PER_MS / BEATS_A_LIMIT;
	int64_t now_ns;

	if (rtu->synched.open) /* a scan that the program has left without its end */
		synch_end_scan(rtu);
	now_ns = map_now_ns();
	plan_next(rtu, now_ns);
	while (!rtu->stopped && map_may_run(rtu->map)) {
		int64_t wake_ns = now_ns + beat_ns;

		map_heartbeat_at(rtu->map, now_ns);
		map_totals_tick(rtu->map);
		if (sleep_until(rtu, now_ns, wake_ns < rtu->next_ns ? wake_ns : rtu->next_ns))
			break;
		now_ns = map_now_ns();
		if (now_ns < rtu->next_ns)
			continue;
		if (has_period(rtu))
			map_histogram_add(&rtu->scans->wakeups, now_ns - rtu->next_ns);
		return begin_scan(rtu);
	}
	rtu->stopped = true;
	return false;
}

/* ---- inputs ------------------------------------------------------------------------------ */

/* What was not published since the last scan is as it was then. */
static void freeze_set(struct openrtu *rtu, struct input_set *set)
{
	const uint32_t first = set->first, count = set->end - first;

	if (map_read_changed(rtu->map, &rtu->points[first], count, &set->seen, &rtu->fresh[first]))
		memcpy(&rtu->samples[first], &rtu->fresh[first], count * sizeof(*rtu->samples));
	for (uint32_t i = first; !set->seen.whole && i < set->end; i++)
		rtu->samples[i].quality |= MAP_NOT_TOPICAL;
}

void openrtu_scan_begin(struct openrtu *rtu)
{
	rtu->now_ns = map_begin_cycle(rtu->map);
	if (map_alive(rtu->map, map_self(rtu->map))) /* else its outputs are old until this scan's end */
		map_heartbeat_at(rtu->map, rtu->now_ns);
	rtu->seen = MAP_GOOD;
	map_count(&rtu->scans->count, 1);
	rtu->events_taken = 0;
	requests_take(rtu);
	commands_take(rtu);
	for (uint32_t i = 0; i < rtu->set_count; i++)
		freeze_set(rtu, &rtu->sets[i]);
	memset(rtu->outputs, 0, rtu->own_count * sizeof(*rtu->outputs));
}

static int no_sample(struct openrtu_sample *out, int error)
{
	*out = (struct openrtu_sample){.quality = OPENRTU_INVALID};
	return error;
}

int openrtu_read(struct openrtu *rtu, int point, struct openrtu_sample *out)
{
	const struct map_sample *sample;

	if (!is_point(rtu, point))
		return no_sample(out, -EINVAL);
	if ((uint32_t)point >= rtu->input_count && !is_own(rtu, point))
		return no_sample(out, -EPERM);
	sample = &rtu->samples[point];
	out->value = value_number(type_of(rtu, point), sample->value);
	out->time_ns = sample->time_ns;
	out->quality = sample->quality;
	out->reserved = 0;
	/* An own one does not count: what was invalid once would stay so where the next state follows from the last. */
	if ((uint32_t)point < rtu->input_count)
		rtu->seen |= sample->quality;
	return 0;
}

/* ---- outputs ----------------------------------------------------------------------------- */

/* What is computed from a value beyond its range is no value; not every type can say overflow. */
static uint8_t inherited(uint8_t seen)
{
	return seen & MAP_OVERFLOW ? (uint8_t)((seen & ~MAP_OVERFLOW) | MAP_INVALID) : seen;
}

static int write_sample(struct openrtu *rtu, int point, double value, uint8_t quality, int64_t time_ns)
{
	struct map_sample *sample;

	if (!is_point(rtu, point))
		return -EINVAL;
	if (!is_own(rtu, point))
		return -EPERM;
	rtu->outputs[(uint32_t)point - rtu->input_count].written = true;
	sample = &rtu->samples[point];
	sample->quality = quality;
	sample->time_ns = time_ns;
	if (value_of_number(type_of(rtu, point), value, &sample->value))
		return 0;
	sample->quality |= MAP_INVALID;
	return -ERANGE;
}

int openrtu_write(struct openrtu *rtu, int point, double value)
{
	return write_sample(rtu, point, value, inherited(rtu->seen), rtu->now_ns);
}

int openrtu_write_quality(struct openrtu *rtu, int point, double value, uint32_t quality)
{
	return openrtu_write_at(rtu, point, value, quality, rtu->now_ns);
}

int openrtu_write_at(struct openrtu *rtu, int point, double value, uint32_t quality, int64_t time_ns)
{
	if (quality & ~(uint32_t)MAP_QUALITY_BITS)
		return -EINVAL;
	return write_sample(rtu, point, value, (uint8_t)quality,
			    time_ns < rtu->now_ns ? time_ns : rtu->now_ns);
}

static struct map_update update_of(const struct openrtu *rtu, uint32_t own)
{
	const uint32_t number = rtu->input_count + own;

	return (struct map_update){.point = rtu->points[number],
				   .cause =
				       requests_want(rtu, own) ? requests_cause(rtu, own) : MAP_SPONTANEOUS,
				   .flags = rtu->outputs[own].flags,
				   .event_rule = rtu->outputs[own].event_rule,
				   .sample = rtu->samples[number]};
}

static void publish(struct openrtu *rtu)
{
	size_t count = 0;

	for (uint32_t i = 0; i < rtu->own_count; i++)
		if (rtu->outputs[i].written || requests_want(rtu, i))
			rtu->updates[count++] = update_of(rtu, i);
	map_publish(rtu->map, rtu->updates, count);
}

void openrtu_scan_end(struct openrtu *rtu)
{
	int64_t ended_ns;

	publish(rtu);
	requests_settle(rtu);
	ended_ns = map_now_ns();
	map_histogram_add(&rtu->scans->durations, ended_ns - rtu->now_ns);
	map_heartbeat_at(rtu->map, ended_ns);
	synch_end_scan(rtu);
}

/* What the journal has restored, or the former process of this generation left, nobody has seen turn invalid. */
static bool was_seen_invalid(const struct openrtu *rtu)
{
	struct map_module self;

	map_module(rtu->map, map_self(rtu->map), &self);
	return self.generation > 1;
}

/* Its value goes on, and whoever has seen it turn invalid sees that. */
static bool publish_retained(struct openrtu *rtu, uint32_t own)
{
	const uint32_t number = rtu->input_count + own;
	struct map_sample *sample = &rtu->samples[number];

	if (!(map_config(rtu->map)->points[rtu->points[number]].flags & MAP_POINT_RETAIN) ||
	    sample->time_ns == 0)
		return false;
	if (was_seen_invalid(rtu))
		sample->time_ns = rtu->now_ns; /* its end as invalid has a time before this one */
	rtu->outputs[own] = (struct output){
	    .written = true,
	    .event_rule = MAP_EVENT_ALWAYS,
	    .flags = MAP_UPDATE_KEEPS_VALUE, /* of a counter, it is the reading already */
	};
	return true;
}

void scan_publish_initial(struct openrtu *rtu)
{
	const struct foreign_point *points =
	    map_records(map_config(rtu->map), FOREIGN_POINTS, sizeof(struct foreign_point));

	rtu->now_ns = map_begin_cycle(rtu->map);
	for (uint32_t i = 0; i < rtu->own_count; i++) {
		const double initial = points[rtu->module->first_point + i].initial;

		if (!publish_retained(rtu, i) && !isnan(initial))
			write_sample(rtu, (int)(rtu->input_count + i), initial, MAP_GOOD, rtu->now_ns);
	}
	publish(rtu);
}
