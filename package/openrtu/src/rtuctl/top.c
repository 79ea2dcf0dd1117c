/* SPDX-License-Identifier: GPL-3.0-or-later */
/* The gateway at a glance, refreshed each second. */
#include "rtuctl/rtuctl.h"

#include <err.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <time.h>

#include <jansson.h>

#include "map/time_ns.h"
#include "modbus/config.h"
#include "modbus/stats.h"
#include "rows/rows.h"
#include "rows/words.h"
#include "rtuctl/listing.h"
#include "rtuctl/rates.h"
#include "rtuctl/renew.h"
#include "rtuctl/terminal.h"

#define COUNT(array) (sizeof(array) / sizeof((array)[0]))

#define PERIOD_MS 1000

#define RED    "\033[31m"
#define GREEN  "\033[32m"
#define YELLOW "\033[33m"
#define BOLD   "\033[1m"
#define PLAIN  "\033[0m"

struct top {
	struct map *map;
	const char *pattern;
	struct rates rates;
	uint32_t *shown; /* points that match, of them those that are not good when only_bad */
	uint32_t shown_count, matching, good;
	uint32_t first; /* of those shown, the one at the top */
	bool only_bad;
	bool colours;
};

static const struct listing_column module_columns[] = {
    {"name", "MODULE", LISTING_TEXT},
    {"state", "STATE", LISTING_TEXT},
    {"heartbeat", "HEARTBEAT", LISTING_RIGHT},
    {"cpu", "CPU", LISTING_RIGHT},
    {"up_s", "UP", LISTING_AGE},
    {"restarts", "RESTARTS", LISTING_RIGHT},
    {"points", "POINTS", LISTING_RIGHT},
};

static const struct listing_column line_columns[] = {
    {"port", "PORT", LISTING_RIGHT},         {"device", "DEVICE", LISTING_TEXT},
    {"open", "OPEN", LISTING_TEXT},          {"requests_s", "REQUESTS/S", LISTING_RIGHT},
    {"errors_s", "ERRORS/S", LISTING_RIGHT}, {"scan_ms", "SCAN MS", LISTING_RIGHT},
    {"alive", "DEVICES", LISTING_RIGHT},
};

static const struct listing_column point_columns[] = {
    {"name", "POINT", LISTING_TEXT}, {"ca", "CA", LISTING_RIGHT},       {"ioa", "IOA", LISTING_RIGHT},
    {"type", "TYPE", LISTING_TEXT},  {"value", "VALUE", LISTING_RIGHT}, {"coloured", "QUALITY", LISTING_TEXT},
    {"age_s", "AGE", LISTING_AGE},
};

static json_t *in_colour(const struct top *top, const char *colour, const char *text)
{
	return top->colours ? json_sprintf("%s%s" PLAIN, colour, text) : json_string(text);
}

static void begin(struct listing *listing, const struct listing_column *columns, size_t count, FILE *out)
{
	listing_begin(listing, columns, count, false);
	listing->out = out;
}

/* ---- the gateway ------------------------------------------------------------------------- */

static void print_head(const struct top *top, FILE *out)
{
	const struct map_clock clock = map_clock_read(top->map);
	char time[WORDS_SIZE];

	words_time(map_wall_ns(clock, map_now_ns()), time);
	fprintf(out, "%s%s%s  %s  %u points%s%s: %u good, %u not  %.0f events/s\n\n",
		top->colours ? BOLD : "", time, top->colours ? PLAIN : "",
		clock.set ? "clock valid" : "clock not valid", top->matching,
		top->pattern != NULL ? " of " : "", top->pattern != NULL ? top->pattern : "", top->good,
		top->matching - top->good, top->rates.events_s);
}

static json_t *module_row(const struct top *top, uint32_t index)
{
	double cpu = top->rates.modules[index].cpu_percent;
	struct map_module module;
	json_t *row = json_object();

	map_module(top->map, index, &module);
	json_object_set_new(row, "name", json_string(module.name));
	json_object_set_new(row, "state",
			    in_colour(top, module.alive ? GREEN : RED,
				      module.state == MAP_MODULE_RUNNING && !module.alive
					  ? "silent"
					  : words_module_state(module.state)));
	json_object_set_new(row, "heartbeat",
			    module.pid != 0 ? json_sprintf("%u ms", module.heartbeat_age_ms) : json_null());
	json_object_set_new(row, "cpu", cpu >= 0 ? json_sprintf("%.1f %%", cpu) : json_null());
	json_object_set_new(row, "up_s",
			    module.alive ? json_real((double)(map_now_ns() - module.started_ns) / 1e9)
					 : json_null());
	json_object_set_new(row, "restarts", json_integer(module.restarts));
	json_object_set_new(row, "points", json_integer(module.point_count));
	return row;
}

/* rtuctl is one only while it commands. */
static void print_modules(const struct top *top, FILE *out)
{
	struct listing listing;
	struct map_module module;

	begin(&listing, module_columns, COUNT(module_columns), out);
	for (uint32_t i = 0; i < map_module_count(top->map); i++) {
		map_module(top->map, i, &module);
		if (!(module.flags & MAP_IS_LOCAL))
			listing_add(&listing, module_row(top, i));
	}
	listing_end(&listing);
	fputc('\n', out);
}

static json_t *devices_alive(const struct map *map, const struct modbus_port *line)
{
	unsigned alive = 0;

	for (uint32_t i = 0; i < line->device_count; i++)
		alive += modbus_device_answers(map, line->first_device + i);
	return json_sprintf("%u of %u", alive, line->device_count);
}

static json_t *line_row(const struct top *top, uint32_t index)
{
	const struct modbus_port *line = &modbus_ports(map_config(top->map))[index];
	const struct modbus_line_stats *stats = modbus_line_stats(top->map, index);
	const struct rates_line *rates = &top->rates.lines[index];
	const bool open = modbus_line_is_open(top->map, index);
	json_t *row = json_object();

	json_object_set_new(row, "port", json_integer(line->port));
	json_object_set_new(row, "device", json_string(line->device));
	json_object_set_new(row, "open", in_colour(top, open ? GREEN : RED, open ? "yes" : "no"));
	json_object_set_new(row, "requests_s", json_sprintf("%.1f", rates->requests_s));
	json_object_set_new(row, "errors_s",
			    rates->errors_s > 0 && top->colours
				? json_sprintf(RED "%.1f" PLAIN, rates->errors_s)
				: json_sprintf("%.1f", rates->errors_s));
	json_object_set_new(row, "scan_ms", json_sprintf("%.0f", stats->scan_us / 1e3));
	json_object_set_new(row, "alive", devices_alive(top->map, line));
	return row;
}

static void print_lines(const struct top *top, FILE *out)
{
	uint32_t count = modbus_port_count(map_config(top->map));
	struct listing listing;

	if (count == 0)
		return;
	begin(&listing, line_columns, COUNT(line_columns), out);
	for (uint32_t i = 0; i < count; i++)
		listing_add(&listing, line_row(top, i));
	listing_end(&listing);
	fputc('\n', out);
}

/* ---- points ------------------------------------------------------------------------------ */

static uint8_t quality_of(const struct map *map, uint32_t point)
{
	struct map_sample sample = {.quality = MAP_INVALID};

	map_read(map, point, &sample);
	return sample.quality;
}

static void choose_points(struct top *top)
{
	const struct map_config *config = map_config(top->map);

	top->shown_count = top->matching = top->good = 0;
	for (uint32_t i = 0; i < config->point_count; i++) {
		bool good;

		if (!rtuctl_matches(config, i, top->pattern))
			continue;
		good = quality_of(top->map, i) == 0;
		top->matching++;
		top->good += good;
		if (!good || !top->only_bad)
			top->shown[top->shown_count++] = i;
	}
}

static json_t *point_row(const struct top *top, uint32_t index)
{
	json_t *row = rows_point(top->map, index);
	const char *quality = json_string_value(json_object_get(row, "quality"));
	const char *colour = strcmp(quality, "good") == 0 ? GREEN : strstr(quality, "invalid") ? RED : YELLOW;

	json_object_set_new(row, "coloured", in_colour(top, colour, quality));
	return row;
}

static void print_points(const struct top *top, uint32_t count, FILE *out)
{
	struct listing listing;

	begin(&listing, point_columns, COUNT(point_columns), out);
	for (uint32_t i = 0; i < count && top->first + i < top->shown_count; i++)
		listing_add(&listing, point_row(top, top->shown[top->first + i]));
	listing_end(&listing);
}

/* ---- on a terminal ----------------------------------------------------------------------- */

static size_t lines_of(const char *text)
{
	size_t lines = 0;

	while ((text = strchr(text, '\n')) != NULL) {
		lines++;
		text++;
	}
	return lines;
}

static void print_gateway(const struct top *top, FILE *out)
{
	print_head(top, out);
	rtuctl_print_forces(top->map, out);
	print_modules(top, out);
	print_lines(top, out);
}

/* Points that fit below the rest, their titles apart: one at least. */
static uint32_t room_below(const char *above)
{
	size_t rows = terminal_size().rows, used = lines_of(above) + 2; /* titles, keys */

	return rows > used ? (uint32_t)(rows - used) : 1;
}

static void keep_in_view(struct top *top, uint32_t room)
{
	uint32_t last = top->shown_count > room ? top->shown_count - room : 0;

	top->first = top->first < last ? top->first : last;
}

/* Returns how many points a page has. */
static uint32_t draw(struct top *top)
{
	char *text = NULL;
	size_t size = 0;
	FILE *out = open_memstream(&text, &size);
	uint32_t room;

	if (out == NULL)
		errx(RTUCTL_FAILED, "out of memory");
	choose_points(top);
	print_gateway(top, out);
	fflush(out);
	room = room_below(text);
	keep_in_view(top, room);
	print_points(top, room, out);
	fprintf(
	    out, "q quit  i %s  arrows, page up, page down: points %u to %u of %u",
	    top->only_bad ? "all points" : "only what is not good", top->shown_count > 0 ? top->first + 1 : 0,
	    top->first + room < top->shown_count ? top->first + room : top->shown_count, top->shown_count);
	fclose(out);
	terminal_draw(text);
	free(text);
	return room;
}

static void obey(struct top *top, enum terminal_key key, uint32_t page)
{
	switch (key) {
	case TERMINAL_UP:
		top->first -= top->first > 0;
		break;
	case TERMINAL_DOWN:
		top->first++;
		break;
	case TERMINAL_PAGE_UP:
		top->first -= top->first < page ? top->first : page;
		break;
	case TERMINAL_PAGE_DOWN:
		top->first += page;
		break;
	case TERMINAL_HOME:
		top->first = 0;
		break;
	case TERMINAL_FILTER:
		top->only_bad = !top->only_bad;
		top->first = 0;
		break;
	default:
		break;
	}
}

static int left_ms(int64_t since_ns)
{
	int64_t passed_ms = (map_now_ns() - since_ns) / NS_PER_MS;

	return passed_ms < PERIOD_MS ? (int)(PERIOD_MS - passed_ms) : 0;
}

static void begin_top(struct top *top)
{
	top->shown = calloc(map_config(top->map)->point_count + 1u, sizeof(*top->shown));
	if (top->shown == NULL)
		errx(RTUCTL_FAILED, "out of memory");
	choose_points(top);
	rates_begin(&top->rates, top->map);
}

static void end_top(struct top *top)
{
	rates_end(&top->rates);
	free(top->shown);
}

/* Modules, lines and points may be others now. */
static void follow(struct top *top)
{
	if (!renew_map(top->map))
		return;
	end_top(top);
	begin_top(top);
}

static int show(struct top *top)
{
	enum terminal_key key = TERMINAL_NONE;

	top->colours = getenv("NO_COLOR") == NULL;
	while (key != TERMINAL_QUIT && map_alive(top->map, MAP_RTUD)) {
		uint32_t page;

		follow(top);
		page = draw(top);
		key = terminal_key(left_ms(top->rates.at_ns));
		obey(top, key, page);
		if (left_ms(top->rates.at_ns) == 0)
			rates_look(&top->rates);
	}
	terminal_close();
	if (key == TERMINAL_QUIT)
		return RTUCTL_DONE;
	fputs("rtuctl: rtud has ended\n", stderr);
	return RTUCTL_FAILED;
}

/* ---- once -------------------------------------------------------------------------------- */

static int print_once(struct top *top)
{
	const struct timespec period = {.tv_sec = PERIOD_MS / 1000};

	nanosleep(&period, NULL);
	rates_look(&top->rates);
	choose_points(top);
	print_gateway(top, stdout);
	print_points(top, top->shown_count, stdout);
	return RTUCTL_DONE;
}

int rtuctl_top(struct map *map, const struct rtuctl_request *request)
{
	struct top top = {.map = map, .pattern = request->arguments[0]};
	int result = RTUCTL_FAILED;

	begin_top(&top);
	if (top.pattern != NULL && top.matching == 0)
		fprintf(stderr, "rtuctl: no point matches \"%s\": \"rtuctl points\" lists them all\n",
			top.pattern);
	else
		result = !request->once && terminal_open() ? show(&top) : print_once(&top);
	end_top(&top);
	return result;
}
