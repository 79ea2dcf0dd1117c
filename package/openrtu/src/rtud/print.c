/* SPDX-License-Identifier: GPL-3.0-or-later */
#include "rtud/print.h"

#include <stdio.h>
#include <time.h>

#include "map/map.h"
#include "map/time_ns.h"

#define LINES_A_TICK 16 /* of each module's log */
#define LINES_AT_END 128

static void print_line(const struct map *map, uint32_t module, const struct map_log_line *line)
{
	static const char *const levels[] = {"error", "warning", "info", "debug"};
	int64_t wall = map_wall_ns(map_clock_read(map), line->time_ns);
	time_t seconds = (time_t)(wall / NS_PER_S);
	struct map_module description;
	struct tm utc;
	char date[32];

	map_module(map, module, &description);
	gmtime_r(&seconds, &utc);
	strftime(date, sizeof(date), "%Y-%m-%dT%H:%M:%S", &utc);
	fprintf(stderr, "%s.%03dZ %s %s: %s\n", date, (int)(wall / NS_PER_MS % MS_PER_S), description.name,
		line->level < 4 ? levels[line->level] : "?", line->text);
}

/* A module that keeps map_log's pace loses nothing. One gone wild loses lines, and fills neither the log nor rtud's time. */
static const struct map_pace print_pace = {MAP_LOG_PERIOD_NS / 2, 2 * MAP_LOG_AT_ONCE};

static void say_lost_lines(const struct supervisor *supervisor, uint32_t module, uint32_t times)
{
	struct map_module description;

	map_module(supervisor->map, module, &description);
	if (times > 0)
		map_log(supervisor->map, MAP_LOG_WARNING,
			"%u lines of %s were lost: it wrote too many at once", times, description.name);
}

static void print_log(struct supervisor *supervisor, uint32_t module, int64_t now_ns)
{
	struct log_reader *log = &supervisor->logs[module];
	struct map_log_line line;
	uint32_t lost = 0;

	for (unsigned i = 0; i < LINES_A_TICK && map_lines_room(&log->lines, print_pace, now_ns) &&
			     map_log_next(supervisor->map, module, &log->position, &line, &lost);
	     i++) {
		map_lines_take(&log->lines, print_pace, now_ns);
		print_line(supervisor->map, module, &line);
	}
	say_lost_lines(supervisor, module,
		       lost > 0 ? map_repeats_happened(&log->lost, lost, now_ns)
				: map_repeats_due(&log->lost, now_ns));
}

/* rtud's own is the last, since it says what of the others was lost. */
void print_logs(struct supervisor *supervisor)
{
	const int64_t now_ns = map_now_ns();

	for (uint32_t i = map_module_count(supervisor->map); i-- > 0;)
		print_log(supervisor, i, now_ns);
}

/* All that is left, and lost. */
void print_last_lines(struct supervisor *supervisor)
{
	struct map_log_line line;

	for (uint32_t i = map_module_count(supervisor->map); i-- > 0;) {
		struct log_reader *log = &supervisor->logs[i];
		uint32_t lost = log->lost.unsaid;

		for (unsigned printed = 0;
		     printed < LINES_AT_END && map_log_next(supervisor->map, i, &log->position, &line, &lost);
		     printed++)
			print_line(supervisor->map, i, &line);
		say_lost_lines(supervisor, i, lost);
	}
}
