/* SPDX-License-Identifier: GPL-3.0-or-later */
/* The gateway's clock. */
#include "rtuctl/rtuctl.h"

#include <jansson.h>

#include "map/time_ns.h"
#include "rows/words.h"
#include "rtuctl/listing.h"

#define COUNT(array) (sizeof(array) / sizeof((array)[0]))

static const struct listing_column columns[] = {
    {"time", "TIME", LISTING_TEXT},
    {"valid", "VALID", LISTING_TEXT},
    {"source", "SOURCE", LISTING_TEXT},
    {"since_s", "SINCE", LISTING_AGE},
    {"error_s", "ERROR", LISTING_RIGHT},
    {"left_s", "LEFT", LISTING_AGE},
    {"leap_second", "LEAP SECOND", LISTING_TEXT},
};

/* Of this day, UTC. */
static json_t *leap_second(int8_t due_s)
{
	return due_s == 0 ? json_null() : json_string(due_s > 0 ? "inserted" : "left out");
}

int rtuctl_clock(struct map *map, const struct rtuctl_request *request)
{
	const struct map_clock clock = map_clock_read(map);
	int64_t now_ns = map_now_ns();
	struct listing listing;
	json_t *row = json_object();
	char time[WORDS_SIZE];

	words_time(map_wall_ns(clock, now_ns), time);
	json_object_set_new(row, "time", json_string(time));
	json_object_set_new(row, "valid", json_boolean(clock.set));
	json_object_set_new(row, "source", json_string(words_clock_source(clock.source)));
	json_object_set_new(row, "since_s", json_real((double)(now_ns - clock.since_ns) / NS_PER_S));
	json_object_set_new(row, "error_s",
			    clock.source == MAP_CLOCK_SYNCHRONISED
				? json_real(clock.error_us / (double)US_PER_S)
				: json_null());
	json_object_set_new(row, "left_s",
			    clock.source == MAP_CLOCK_HELD
				? json_real((double)(clock.until_ns - now_ns) / NS_PER_S)
				: json_null());
	json_object_set_new(row, "leap_second", leap_second(clock.leap_due_s));
	listing_begin(&listing, columns, COUNT(columns), request->json);
	listing_add(&listing, row);
	listing_end(&listing);
	return RTUCTL_DONE;
}
