/* SPDX-License-Identifier: GPL-3.0-or-later */
#include "rtud/clock.h"

#include <errno.h>
#include <string.h>
#include <sys/timex.h>
#include <time.h>

#include "map/supervise.h"

#define SECOND_NS 1000000000LL
#define LATEST_NS (INT64_MAX / 2) /* in 2116; CP56Time2a ends with 2099 */

static int64_t system_offset_ns(void)
{
	struct timespec wall;
	int64_t now = map_now_ns();

	clock_gettime(CLOCK_REALTIME, &wall);
	return (int64_t)wall.tv_sec * SECOND_NS + wall.tv_nsec - now;
}

static bool system_is_synchronised(void)
{
	struct timex state = {0};

	return adjtimex(&state) != TIME_ERROR && !(state.status & STA_UNSYNC);
}

void clock_begin(struct map *map)
{
	struct map_clock clock = {.offset_ns = system_offset_ns(), .set = system_is_synchronised()};

	map_clock_write(map, clock);
}

void clock_follow(struct map *map)
{
	struct map_clock clock = map_clock_read(map);

	if (map_config(map)->settings.clock != MAP_CLOCK_SYSTEM)
		return;
	clock.offset_ns = system_offset_ns();
	clock.set = clock.set || system_is_synchronised();
	map_clock_write(map, clock);
}

static int set_system_clock(int64_t wall_ns)
{
	const struct timespec wall = {.tv_sec = (time_t)(wall_ns / SECOND_NS),
				      .tv_nsec = (long)(wall_ns % SECOND_NS)};

	return clock_settime(CLOCK_REALTIME, &wall);
}

/* No sum with such an offset overflows. */
static bool is_possible(const struct map_request *request)
{
	return request->time_ns >= 0 && request->time_ns <= map_now_ns() && request->wall_ns >= 0 &&
	       request->wall_ns <= LATEST_NS;
}

void clock_set(struct map *map, const struct map_request *request)
{
	struct map_clock clock = {.set = true};
	struct map_module requester;

	if (!is_possible(request)) {
		map_request_answer(map, request, MAP_RESULT_OUT_OF_RANGE);
		return;
	}
	clock.offset_ns = request->wall_ns - request->time_ns;
	map_module(map, request->requester, &requester);
	if (map_config(map)->settings.clock == MAP_CLOCK_SYSTEM &&
	    set_system_clock(map_now_ns() + clock.offset_ns) < 0) {
		map_log(map, MAP_LOG_ERROR, "cannot set the system's clock for %s: %s", requester.name,
			strerror(errno));
		map_request_answer(map, request, MAP_RESULT_NOT_COMMANDABLE);
		return;
	}
	map_log(map, MAP_LOG_INFO, "clock set by %s, moved by %.3f s", requester.name,
		(double)(clock.offset_ns - map_clock_read(map).offset_ns) / SECOND_NS);
	map_clock_write(map, clock);
	map_announce(map, MAP_EVENT_CLOCK, request->requester);
	map_request_answer(map, request, MAP_RESULT_DONE);
}
