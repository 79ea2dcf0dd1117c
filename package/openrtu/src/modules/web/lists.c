/* SPDX-License-Identifier: GPL-3.0-or-later */
#include "modules/web/lists.h"

#include <stdlib.h>
#include <string.h>

#include "modbus/config.h"
#include "rows/frames.h"
#include "rows/rows.h"

#define ROWS_MAX     500
#define LOG_MAX      200
#define FRAMES_MAX   100
#define LINES_A_LOOK 1024 /* of each module's log; more than it keeps */
#define BLOCK_SIZE   2048
#define SEARCH_SIZE  MAP_NAME_SIZE

struct entry {
	struct map_log_line line;
	uint32_t module;
};

/* Of one line, the newest: a ring. */
struct frames {
	struct frame_source source;
	struct frame newest[FRAMES_MAX];
	uint32_t most, count; /* at most so many; how many there were */
};

struct list {
	struct map *map;
	json_t *(*row)(struct list *list); /* the next; NULL: there are no more */
	uint32_t next, left;               /* which may be the next row; how many more there may be */
	uint32_t of_module;                /* counters: the next of them */
	char search[SEARCH_SIZE];
	bool bad;
	struct map_cursor cursor; /* of events */
	struct entry *entries;    /* of the log */
	struct frames *frames;
	char *text; /* what is written, of which so much has gone */
	size_t size, sent;
	bool begun, ended;
};

/* ---- sending ----------------------------------------------------------------------------- */

static void forget(void *context)
{
	struct list *list = context;

	free(list->text);
	free(list->entries);
	free(list->frames);
	free(list);
}

/* The text of what comes next: a row with what is around it. False: there is no memory. */
static bool write_next(struct list *list)
{
	json_t *row = list->left > 0 ? list->row(list) : NULL;
	char *text = NULL;

	free(list->text);
	list->text = NULL;
	list->sent = 0;
	if (row == NULL) {
		list->ended = true;
		list->text = strdup(list->begun ? "]}" : "[]}");
	} else {
		list->left--;
		text = json_dumps(row, ROWS_FORMAT | JSON_COMPACT);
		json_decref(row);
		if (text == NULL || asprintf(&list->text, "%c%s", list->begun ? ',' : '[', text) < 0)
			list->text = NULL;
		free(text);
	}
	list->begun = true;
	list->size = list->text != NULL ? strlen(list->text) : 0;
	return list->text != NULL;
}

static ssize_t read_list(void *context, uint64_t position, char *out, size_t most)
{
	struct list *list = context;
	size_t filled = 0;

	(void)position;
	while (filled < most) {
		size_t size = list->size - list->sent;

		if (size == 0) {
			if (list->ended)
				break;
			if (!write_next(list))
				return MHD_CONTENT_READER_END_WITH_ERROR;
			continue;
		}
		size = size < most - filled ? size : most - filled;
		memcpy(out + filled, list->text + list->sent, size);
		list->sent += size;
		filled += size;
	}
	return filled > 0 ? (ssize_t)filled : MHD_CONTENT_READER_END_OF_STREAM;
}

static struct http_answer send_list(struct list *list, uint32_t total)
{
	struct http_answer answer = {.status = MHD_HTTP_OK};

	if (list == NULL)
		return answer;
	if (asprintf(&list->text, "{\"total\":%u,\"rows\":", total) < 0) {
		list->text = NULL;
		forget(list);
		return answer;
	}
	list->size = strlen(list->text);
	answer.response =
	    MHD_create_response_from_callback(MHD_SIZE_UNKNOWN, BLOCK_SIZE, read_list, list, forget);
	if (answer.response == NULL)
		forget(list);
	else
		MHD_add_response_header(answer.response, MHD_HTTP_HEADER_CONTENT_TYPE, "application/json");
	return answer;
}

/* NULL: there is no memory. */
static struct list *new_list(const struct http_site *site, const struct http_request *request,
			     json_t *(*row)(struct list *))
{
	struct list *list = calloc(1, sizeof(*list));

	if (list == NULL)
		return NULL;
	list->map = site->map;
	list->row = row;
	list->left = request_number(request, "count", ROWS_MAX, ROWS_MAX);
	snprintf(list->search, sizeof(list->search), "%s", request_text(request, "search"));
	list->bad = request_number(request, "bad", 1, 0) == 1;
	return list;
}

/* ---- points and commands ----------------------------------------------------------------- */

bool list_is_bad(const struct map *map, uint32_t point)
{
	const struct map_config *config = map_config(map);
	struct map_sample sample;

	if (config->points[point].flags & MAP_POINT_NEVER_READ)
		return false;
	return !map_read(map, point, &sample) || sample.quality != MAP_GOOD;
}

static bool is_wanted(const struct list *list, uint32_t point)
{
	const struct map_config *config = map_config(list->map);
	char name[MAP_NAME_SIZE];

	if (list->search[0] != '\0') {
		map_point_name(config, &config->points[point], name);
		if (strcasestr(name, list->search) == NULL)
			return false;
	}
	return !list->bad || list_is_bad(list->map, point);
}

static json_t *next_point(struct list *list)
{
	while (list->next < map_config(list->map)->point_count) {
		const uint32_t point = list->next++;

		if (is_wanted(list, point))
			return rows_point(list->map, point);
	}
	return NULL;
}

struct http_answer list_points(struct http_site *site, struct http_request *request)
{
	const uint32_t from = request_number(request, "from", UINT32_MAX, 0);
	struct list *list = new_list(site, request, next_point);
	uint32_t total = 0;

	if (list == NULL)
		return send_list(NULL, 0);
	for (uint32_t i = 0; i < map_config(site->map)->point_count; i++)
		if (is_wanted(list, i) && total++ < from)
			list->next = i + 1;
	return send_list(list, total);
}

static bool is_commandable(const struct list *list, uint32_t point)
{
	return (map_config(list->map)->points[point].flags & MAP_POINT_COMMAND) != 0 &&
	       is_wanted(list, point);
}

static json_t *next_command(struct list *list)
{
	while (list->next < map_config(list->map)->point_count) {
		const uint32_t point = list->next++;

		if (is_commandable(list, point))
			return rows_command(list->map, point);
	}
	return NULL;
}

struct http_answer list_commands(struct http_site *site, struct http_request *request)
{
	struct list *list = new_list(site, request, next_command);
	uint32_t total = 0;

	for (uint32_t i = 0; list != NULL && i < map_config(site->map)->point_count; i++)
		total += is_commandable(list, i);
	return send_list(list, total);
}

/* ---- lines, modules, counters ------------------------------------------------------------ */

static json_t *next_line(struct list *list)
{
	return list->next < modbus_port_count(map_config(list->map)) ? rows_line(list->map, list->next++)
								     : NULL;
}

struct http_answer list_lines(struct http_site *site, struct http_request *request)
{
	return send_list(new_list(site, request, next_line), modbus_port_count(map_config(site->map)));
}

static json_t *next_module(struct list *list)
{
	while (list->next < map_module_count(list->map)) {
		struct map_module module;

		map_module(list->map, list->next++, &module);
		if (!(module.flags & MAP_IS_GONE))
			return rows_module(list->map, list->next - 1);
	}
	return NULL;
}

struct http_answer list_modules(struct http_site *site, struct http_request *request)
{
	return send_list(new_list(site, request, next_module), map_module_count(site->map));
}

static json_t *next_counter(struct list *list)
{
	struct map_counter counter;
	struct map_module module;

	for (; list->next < map_module_count(list->map); list->next++, list->of_module = 0)
		if (map_counter(list->map, list->next, list->of_module, &counter)) {
			list->of_module++;
			map_module(list->map, list->next, &module);
			return rows_counter(module.name, &counter);
		}
	return NULL;
}

struct http_answer list_counters(struct http_site *site, struct http_request *request)
{
	return send_list(new_list(site, request, next_counter), 0);
}

/* ---- what happened ----------------------------------------------------------------------- */

static json_t *next_event(struct list *list)
{
	struct map_event event;

	return map_event_next(list->map, &list->cursor, &event) ? rows_event(list->map, &event) : NULL;
}

/* A cursor of zeros moves to the oldest event that is left. */
struct http_answer list_events(struct http_site *site, struct http_request *request)
{
	struct list *list = new_list(site, request, next_event);
	struct map_cursor cursor = {.lost = 0};
	struct map_event event;
	const uint32_t most = map_events_behind(site->map, &cursor); /* a module may go on and on */
	uint32_t total = 0;

	if (list == NULL)
		return send_list(NULL, 0);
	while (total < most && map_event_next(site->map, &cursor, &event))
		total++;
	for (uint32_t i = 0; i + list->left < total; i++)
		map_event_next(site->map, &list->cursor, &event);
	return send_list(list, total);
}

static json_t *next_entry(struct list *list)
{
	const struct entry *entry = &list->entries[list->next++];

	return rows_log(list->map, entry->module, &entry->line);
}

/* Keeps the newest: entries are in order of time, of which count are in use. */
static uint32_t put_entry(struct entry *entries, uint32_t count, uint32_t most, const struct entry *entry)
{
	uint32_t place = count;

	while (place > 0 && entries[place - 1].line.time_ns > entry->line.time_ns)
		place--;
	if (count == most) {
		if (place == 0)
			return count;
		place--;
		memmove(&entries[0], &entries[1], place * sizeof(*entries));
	} else {
		memmove(&entries[place + 1], &entries[place], (count - place) * sizeof(*entries));
		count++;
	}
	entries[place] = *entry;
	return count;
}

struct http_answer list_log(struct http_site *site, struct http_request *request)
{
	struct list *list = new_list(site, request, next_entry);
	const uint32_t most = request_number(request, "count", LOG_MAX, LOG_MAX);
	struct entry entry;
	uint32_t total = 0;

	if (list == NULL)
		return send_list(NULL, 0);
	list->entries = calloc(most + 1, sizeof(*list->entries));
	list->left = 0;
	for (uint32_t module = 0; list->entries != NULL && module < map_module_count(site->map); module++) {
		uint32_t position = 0, lines = 0, lost = 0;

		entry.module = module;
		while (most > 0 && lines++ < LINES_A_LOOK &&
		       map_log_next(site->map, module, &position, &entry.line, &lost)) {
			list->left = put_entry(list->entries, list->left, most, &entry);
			total++;
		}
	}
	return send_list(list, total);
}

/* ---- what went over a line --------------------------------------------------------------- */

static void keep_frame(void *context, const struct frame *frame)
{
	struct frames *frames = context;

	frames->newest[frames->count++ % frames->most] = *frame;
}

static json_t *next_frame(struct list *list)
{
	const struct frames *frames = list->frames;

	return list->next < frames->count
		   ? rows_frame(list->map, &frames->newest[list->next++ % frames->most])
		   : NULL;
}

/* The place of the line of that port; MAP_NONE: there is none. */
static uint32_t line_of(const struct map_config *config, uint32_t port)
{
	for (uint32_t i = 0; i < modbus_port_count(config); i++)
		if (modbus_ports(config)[i].port == port)
			return i;
	return MAP_NONE;
}

/* NULL: there is no memory. */
static struct frames *frames_of(const struct map *map, uint32_t line, uint32_t most)
{
	struct frames *frames = calloc(1, sizeof(*frames));

	if (frames == NULL)
		return NULL;
	frames->source.line = line;
	frames->most = most;
	frames_take(map, &frames->source, keep_frame, frames);
	return frames;
}

struct http_answer list_frames(struct http_site *site, struct http_request *request)
{
	const uint32_t line = line_of(map_config(site->map), request_number(request, "port", UINT16_MAX, 0));
	const uint32_t most = request_number(request, "count", FRAMES_MAX, FRAMES_MAX);
	struct list *list = new_list(site, request, next_frame);

	if (list == NULL)
		return send_list(NULL, 0);
	if (line != MAP_NONE && most > 0)
		list->frames = frames_of(site->map, line, most);
	if (list->frames == NULL) {
		list->left = 0;
		return send_list(list, 0);
	}
	if (list->frames->count > most)
		list->next = list->frames->count - most;
	return send_list(list, list->frames->count);
}
