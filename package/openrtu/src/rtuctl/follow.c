/* SPDX-License-Identifier: GPL-3.0-or-later */
/* What happened and what happens: events and the log. */
#include "rtuctl/rtuctl.h"

#include <err.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <time.h>

#include <jansson.h>

#include "rows/rows.h"
#include "rows/words.h"
#include "rtuctl/listing.h"
#include "rtuctl/renew.h"

#define LINES_A_LOOK 1024 /* of each module's log; more than it keeps */

/* Nobody rings an observer's bell: it looks for events often enough for a reader's eye. */
static const struct timespec LOOK_PERIOD = {.tv_nsec = 50 * 1000 * 1000};

/* ---- events ------------------------------------------------------------------------------ */

static const char *text_of(const json_t *row, const char *key)
{
	const char *text = json_string_value(json_object_get(row, key));

	return text != NULL ? text : "";
}

static void print_change(const json_t *row)
{
	const json_t *value = json_object_get(row, "value");
	char *number = json_dumps(value, JSON_ENCODE_ANY | JSON_REAL_PRECISION(7));
	char shown[WORDS_SIZE];
	const char *text = words_meaning(row, value, shown) || words_angle(row, value, shown) ? shown
			   : json_is_string(value) ? json_string_value(value)
						   : number;

	printf("%s  %s = %s  %s%s", text_of(row, "time"), text_of(row, "name"), text, text_of(row, "quality"),
	       json_is_true(json_object_get(row, "transient")) ? ",transient" : "");
	if (strcmp(text_of(row, "cause"), words_cause(MAP_SPONTANEOUS)) != 0)
		printf("  %s", text_of(row, "cause"));
	if (json_is_true(json_object_get(row, "past")))
		fputs("  past", stdout);
	putchar('\n');
	free(number);
}

static void print_event(const struct map *map, const struct map_event *event, bool json)
{
	bool change = event->kind == MAP_EVENT_CHANGE;
	json_t *row = rows_event(map, event);

	if (json) {
		listing_print_json(row);
		return;
	}
	if (change)
		print_change(row);
	else
		printf("%s  %s %s\n", text_of(row, "time"), text_of(row, "event"), text_of(row, "name"));
	json_decref(row);
}

/* ---- lines of the log -------------------------------------------------------------------- */

static void print_log_row(json_t *row, bool json)
{
	if (json) {
		listing_print_json(row);
		return;
	}
	printf("%s  %s  %s: %s\n", text_of(row, "time"), text_of(row, "module"), text_of(row, "level"),
	       text_of(row, "text"));
	json_decref(row);
}

/* ---- watching ---------------------------------------------------------------------------- */

static bool is_wanted(const struct map *map, const struct map_event *event, const char *pattern)
{
	return event->kind != MAP_EVENT_CHANGE || rtuctl_matches(map_config(map), event->point, pattern);
}

static void report_lost(struct map_cursor *cursor)
{
	if (cursor->lost > 0)
		fprintf(stderr, "rtuctl: %u events were overwritten before they were read\n", cursor->lost);
	cursor->lost = 0;
}

static void report_lost_lines(const struct map *map, uint32_t module, uint32_t lost)
{
	struct map_module description;

	map_module(map, module, &description);
	if (lost > 0)
		fprintf(stderr, "rtuctl: %u lines of %s were overwritten before they were read\n", lost,
			description.name);
}

/* Their warnings explain the events: points that turn invalid and back, a line that is given up. */
static void follow_logs(const struct map *map, uint32_t positions[MAP_MODULES_MAX], bool shown, bool json)
{
	struct map_log_line line;

	for (uint32_t module = 0; module < map_module_count(map); module++) {
		uint32_t lost = 0;

		for (unsigned i = 0;
		     i < LINES_A_LOOK && map_log_next(map, module, &positions[module], &line, &lost); i++)
			if (shown && line.level <= MAP_LOG_WARNING) {
				json_t *row = rows_log(map, module, &line);

				json_object_set_new(row, "event", json_string("log"));
				print_log_row(row, json);
			}
		if (shown)
			report_lost_lines(map, module, lost);
	}
}

int rtuctl_watch(struct map *map, const struct rtuctl_request *request)
{
	unsigned long printed = 0;
	uint32_t positions[MAP_MODULES_MAX] = {0};
	struct map_cursor cursor;
	struct map_event event;

	setvbuf(stdout, NULL, _IOLBF, 0);
	map_cursor_to_end(map, &cursor);
	follow_logs(map, positions, false, false);
	while (map_alive(map, MAP_RTUD)) {
		renew_map(map);
		follow_logs(map, positions, true, request->json);
		while (map_event_next(map, &cursor, &event)) {
			if (!is_wanted(map, &event, request->arguments[0]))
				continue;
			print_event(map, &event, request->json);
			if (++printed == request->count)
				return RTUCTL_DONE;
		}
		report_lost(&cursor);
		nanosleep(&LOOK_PERIOD, NULL);
	}
	fputs("rtuctl: rtud has ended\n", stderr);
	return RTUCTL_FAILED;
}

static unsigned long count_events(const struct map *map)
{
	struct map_cursor cursor = {.lost = 0};
	struct map_event event;
	unsigned long count = 0;

	while (map_event_next(map, &cursor, &event))
		count++;
	return count;
}

/* A cursor of zeros is behind everything: it moves to the oldest event that is left. */
int rtuctl_events(struct map *map, const struct rtuctl_request *request)
{
	unsigned long count = count_events(map);
	unsigned long skip = request->count != 0 && count > request->count ? count - request->count : 0;
	struct map_cursor cursor = {.lost = 0};
	struct map_event event;

	for (unsigned long i = 0; i < count && map_event_next(map, &cursor, &event); i++)
		if (i >= skip)
			print_event(map, &event, request->json);
	return RTUCTL_DONE;
}

/* ---- log --------------------------------------------------------------------------------- */

struct log_entry {
	struct map_log_line line;
	uint32_t module;
};

struct log {
	struct log_entry *entries;
	size_t count;
};

static void append(struct log *log, const struct map_log_line *line, uint32_t module)
{
	log->entries = reallocarray(log->entries, log->count + 1, sizeof(*log->entries));
	if (log->entries == NULL)
		errx(RTUCTL_FAILED, "out of memory");
	log->entries[log->count++] = (struct log_entry){.line = *line, .module = module};
}

static void read_logs(const struct map *map, struct log *log)
{
	struct map_log_line line;

	for (uint32_t module = 0; module < map_module_count(map); module++) {
		uint32_t position = 0, lost = 0; /* it was printed when it was there */

		while (map_log_next(map, module, &position, &line, &lost))
			append(log, &line, module);
	}
}

static int by_time(const void *left, const void *right)
{
	const struct log_entry *a = left, *b = right;

	return (a->line.time_ns > b->line.time_ns) - (a->line.time_ns < b->line.time_ns);
}

int rtuctl_log(struct map *map, const struct rtuctl_request *request)
{
	struct log log = {.count = 0};
	size_t first = 0;

	read_logs(map, &log);
	if (log.count > 0)
		qsort(log.entries, log.count, sizeof(*log.entries), by_time);
	if (request->count != 0 && log.count > request->count)
		first = log.count - request->count;
	for (size_t i = first; i < log.count; i++)
		print_log_row(rows_log(map, log.entries[i].module, &log.entries[i].line), request->json);
	free(log.entries);
	return RTUCTL_DONE;
}
