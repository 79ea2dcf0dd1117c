/* SPDX-License-Identifier: GPL-3.0-or-later */
#include "rtud/clock.h"

#include <errno.h>
#include <stdlib.h>
#include <string.h>
#include <time.h>

#include "map/supervise.h"
#include "map/time_ns.h"

#define LATEST_NS (INT64_MAX / 2) /* in 2116; CP56Time2a ends with 2099 */

#define ATTEMPTS     3         /* at reading two clocks at once: the process may lose the core in between */
#define MOVED_NS     NS_PER_MS /* less is in no time tag, nor worth a line in the log */
#define LEAP_NEAR_NS (NS_PER_S / 10)

/* ---- the system's clock ------------------------------------------------------------------ */

static void bracket(struct clock_reading *reading)
{
	struct timespec wall;
	int64_t before = map_now_ns(), wall_ns;

	clock_gettime(CLOCK_REALTIME, &wall);
	wall_ns = (int64_t)wall.tv_sec * NS_PER_S + wall.tv_nsec;
	reading->now_ns = map_now_ns();
	reading->earliest_ns = wall_ns - reading->now_ns;
	reading->latest_ns = wall_ns - before;
}

struct clock_reading clock_read(int (*kernel)(struct timex *))
{
	struct clock_reading best = {.latest_ns = INT64_MAX};
	struct timex state = {0};

	for (int i = 0; i < ATTEMPTS; i++) {
		struct clock_reading reading = {0};

		bracket(&reading);
		if (reading.latest_ns - reading.earliest_ns < best.latest_ns - best.earliest_ns)
			best = reading;
	}
	best.state = kernel(&state);
	best.synchronised = best.state >= 0 && best.state != TIME_ERROR && !(state.status & STA_UNSYNC) &&
			    state.maxerror < CLOCK_ERROR_MAX_US;
	best.error_us = (uint32_t)state.maxerror;
	return best;
}

/* ---- what is said of it ------------------------------------------------------------------ */

static double seconds(int64_t ns)
{
	return (double)ns / NS_PER_S;
}

static void say_begin(struct map *map, const struct map_clock *clock, const struct clock_reading *system)
{
	time_t wall = (time_t)((system->now_ns + clock->offset_ns) / NS_PER_S);
	struct tm utc;
	char date[32];

	gmtime_r(&wall, &utc);
	strftime(date, sizeof(date), "%Y-%m-%dT%H:%M:%SZ", &utc);
	if (clock->set)
		map_log(map, MAP_LOG_INFO,
			"the clock starts with the system's, which is synchronised to %.3f s",
			(double)clock->error_us / US_PER_S);
	else
		map_log(map, MAP_LOG_WARNING,
			"the clock starts with the system's, %s: time tags are invalid until it is set",
			date);
}

/* ---- following it ------------------------------------------------------------------------ */

static void set_source(struct map_clock *clock, enum map_clock_source source, int64_t now_ns)
{
	clock->source = (uint8_t)source;
	clock->since_ns = now_ns;
	clock->set = source != MAP_CLOCK_UNSET;
}

/*
 * Both clocks are slewed alike, so what lies between them changes by steps only: an offset that may still be right is
 * right, and the moment at which the two were read adds nothing to it. Returns by how much it has moved.
 */
static int64_t track(struct map_clock *clock, const struct clock_reading *system)
{
	int64_t before_ns = clock->offset_ns;

	if (before_ns < system->earliest_ns || before_ns > system->latest_ns)
		clock->offset_ns = system->earliest_ns + (system->latest_ns - system->earliest_ns) / 2;
	return clock->offset_ns - before_ns;
}

/* adjtimex tells of a leap from the second's end on (__do_adjtimex), a tick before the clock takes it: it is due until then. */
static int8_t leap_due(const struct map_clock *clock, const struct clock_reading *system)
{
	switch (system->state) {
	case TIME_INS:
		return 1;
	case TIME_DEL:
		return -1;
	case TIME_OOP:
	case TIME_WAIT:
		return clock->leap_due_s;
	default:
		return 0;
	}
}

/* The kernel has stepped its clock for the leap second that was due. */
static bool is_leap(const struct map_clock *clock, const struct clock_reading *system, int64_t moved_ns)
{
	bool over = system->state == TIME_OOP || system->state == TIME_WAIT;

	return over && clock->leap_due_s != 0 &&
	       llabs(moved_ns + clock->leap_due_s * NS_PER_S) < LEAP_NEAR_NS;
}

/* At a whole second, a tick ago at most: what happened before it keeps its time. */
static void take_leap(struct map *map, struct map_clock *clock, const struct clock_reading *system)
{
	clock->leap_s = clock->leap_due_s;
	clock->leap_due_s = 0;
	clock->leap_ns = system->now_ns - (system->now_ns + clock->offset_ns) % NS_PER_S;
	map_log(map, MAP_LOG_INFO, "a leap second was %s", clock->leap_s > 0 ? "inserted" : "left out");
}

static void say_due(struct map *map, const struct map_clock *clock)
{
	if (clock->leap_due_s != 0)
		map_log(map, MAP_LOG_INFO, "a leap second is %s at the end of this day, UTC",
			clock->leap_due_s > 0 ? "inserted" : "left out");
}

static void take_synchronised(struct map *map, struct map_clock *clock, const struct clock_reading *system)
{
	int64_t moved_ns = track(clock, system);

	clock->error_us = system->error_us;
	clock->seen_ns = system->now_ns;
	if (clock->source != MAP_CLOCK_SYNCHRONISED) {
		set_source(clock, MAP_CLOCK_SYNCHRONISED, system->now_ns);
		map_log(map, MAP_LOG_INFO,
			"the system's clock is synchronised to %.3f s: the clock follows it, moved by %.3f s",
			(double)clock->error_us / US_PER_S, seconds(moved_ns));
	} else if (is_leap(clock, system, moved_ns)) {
		take_leap(map, clock, system);
	} else if (llabs(moved_ns) >= MOVED_NS) {
		map_log(map, MAP_LOG_INFO, "the clock follows the system's, moved by %.3f s",
			seconds(moved_ns));
	}
	if (clock->leap_due_s != leap_due(clock, system)) {
		clock->leap_due_s = leap_due(clock, system);
		say_due(map, clock);
	}
}

/* Until the clock may be wrong by more than it may. */
static int64_t hold_ns(const struct map_clock *clock)
{
	return (CLOCK_ERROR_MAX_US - clock->error_us) * US_PER_S / CLOCK_DRIFT_PPM * NS_PER_US;
}

static void hold(struct map *map, struct map_clock *clock, const struct clock_reading *system)
{
	/* One that is synchronised all the same is not to be followed any more: clock_mode_changed. */
	if (clock->source == MAP_CLOCK_SYNCHRONISED &&
	    (system->synchronised || system->now_ns - clock->seen_ns > CLOCK_LOST_NS)) {
		set_source(clock, MAP_CLOCK_HELD, system->now_ns);
		clock->until_ns = clock->seen_ns + hold_ns(clock);
		clock->leap_due_s = 0;
		map_log(map, MAP_LOG_WARNING,
			"the system's clock is no longer %s: time tags are valid for %.1f h more",
			system->synchronised ? "followed" : "synchronised",
			seconds(hold_ns(clock)) / S_PER_HOUR);
	}
	if (clock->source == MAP_CLOCK_HELD && system->now_ns > clock->until_ns) {
		set_source(clock, MAP_CLOCK_UNSET, system->now_ns);
		map_log(map, MAP_LOG_WARNING,
			"the clock may be wrong by more than %lld s: time tags are invalid until it is set",
			CLOCK_ERROR_MAX_US / US_PER_S);
	}
}

void clock_begin(struct map *map, const struct clock_reading *system)
{
	bool vouched = system->synchronised && map_config(map)->settings.clock != MAP_CLOCK_MASTERS;
	struct map_clock clock = {.error_us = system->error_us, .seen_ns = system->now_ns};

	track(&clock, system);
	clock.leap_due_s = vouched ? leap_due(&clock, system) : 0;
	set_source(&clock, vouched ? MAP_CLOCK_SYNCHRONISED : MAP_CLOCK_UNSET, system->now_ns);
	map_clock_write(map, clock);
	say_begin(map, &clock, system);
	say_due(map, &clock);
}

static bool is_news(const struct map_clock *before, const struct map_clock *clock)
{
	return before->source != clock->source || llabs(before->offset_ns - clock->offset_ns) >= MOVED_NS;
}

void clock_follow(struct map *map, const struct clock_reading *system)
{
	const struct map_clock before = map_clock_read(map);
	enum map_clock_mode mode = (enum map_clock_mode)map_config(map)->settings.clock;
	struct map_clock clock = before;

	if (system->synchronised && mode != MAP_CLOCK_MASTERS) {
		take_synchronised(map, &clock, system);
	} else {
		if (mode == MAP_CLOCK_SYSTEM)
			track(&clock, system);
		hold(map, &clock, system);
	}
	map_clock_write(map, clock);
	if (is_news(&before, &clock))
		map_announce(map, MAP_EVENT_CLOCK, MAP_RTUD);
}

/* ---- a controlling station sets it ------------------------------------------------------- */

static int set_system_clock(int64_t wall_ns)
{
	const struct timespec wall = {.tv_sec = (time_t)(wall_ns / NS_PER_S),
				      .tv_nsec = (long)(wall_ns % NS_PER_S)};

	return clock_settime(CLOCK_REALTIME, &wall);
}

void clock_mode_changed(struct map *map, enum map_clock_mode before)
{
	const enum map_clock_mode mode = (enum map_clock_mode)map_config(map)->settings.clock;
	struct map_clock clock = map_clock_read(map);

	if (mode == before || mode != MAP_CLOCK_SYSTEM || clock.source != MAP_CLOCK_BY_MASTER ||
	    set_system_clock(map_now_ns() + clock.offset_ns) == 0)
		return;
	map_log(map, MAP_LOG_WARNING,
		"cannot set the system's clock: %s: time tags are invalid until it is set", strerror(errno));
	set_source(&clock, MAP_CLOCK_UNSET, map_now_ns());
	map_clock_write(map, clock);
	map_announce(map, MAP_EVENT_CLOCK, MAP_RTUD);
}

/* No sum with such an offset overflows. */
static bool is_possible(const struct map_request *request)
{
	return request->time_ns >= 0 && request->time_ns <= map_now_ns() && request->wall_ns >= 0 &&
	       request->wall_ns <= LATEST_NS;
}

/* MAP_RESULT_NONE: it may be set to this. */
static enum map_command_result refusal(struct map *map, const struct map_request *request,
				       const struct map_clock *clock, const char *requester)
{
	if (!is_possible(request))
		return MAP_RESULT_OUT_OF_RANGE;
	if (clock->source == MAP_CLOCK_SYNCHRONISED) {
		map_log(map, MAP_LOG_INFO, "%s may not set the clock: the system's is synchronised",
			requester);
		return MAP_RESULT_INTERLOCK;
	}
	if (map_config(map)->settings.clock == MAP_CLOCK_SYSTEM &&
	    set_system_clock(request->wall_ns + map_now_ns() - request->time_ns) < 0) {
		map_log(map, MAP_LOG_ERROR, "cannot set the system's clock for %s: %s", requester,
			strerror(errno));
		return MAP_RESULT_NOT_COMMANDABLE;
	}
	return MAP_RESULT_NONE;
}

void clock_set(struct map *map, const struct map_request *request)
{
	struct map_clock clock = map_clock_read(map);
	int64_t before_ns = clock.offset_ns;
	enum map_command_result refused;
	struct map_module requester;

	map_module(map, request->requester, &requester);
	refused = refusal(map, request, &clock, requester.name);
	if (refused != MAP_RESULT_NONE) {
		map_request_answer(map, request, refused);
		return;
	}
	clock.offset_ns = request->wall_ns - request->time_ns;
	set_source(&clock, MAP_CLOCK_BY_MASTER, map_now_ns());
	map_log(map, MAP_LOG_INFO, "clock set by %s, moved by %.3f s", requester.name,
		seconds(clock.offset_ns - before_ns));
	map_clock_write(map, clock);
	map_announce(map, MAP_EVENT_CLOCK, request->requester);
	map_request_answer(map, request, MAP_RESULT_DONE);
}
