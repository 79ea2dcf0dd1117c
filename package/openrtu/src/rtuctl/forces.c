/* SPDX-License-Identifier: GPL-3.0-or-later */
/* The forced points, with what is below. */
#include <stdio.h>

#include <jansson.h>

#include "map/time_ns.h"
#include "rtuctl/listing.h"
#include "rtuctl/rtuctl.h"
#include "rtuctl/words.h"

#define COUNT(array) (sizeof(array) / sizeof((array)[0]))

static const struct listing_column columns[] = {
    {"name", "FORCED", LISTING_TEXT},  {"value", "VALUE", LISTING_RIGHT},
    {"below", "BELOW", LISTING_RIGHT}, {"below_quality", "QUALITY", LISTING_TEXT},
    {"left_s", "LEFT", LISTING_AGE},
};

static json_t *row_of(const struct map *map, const struct map_force *force)
{
	const struct map_config *config = map_config(map);
	const enum map_type type = config->points[force->point].type;
	const int64_t left_ns = force->until_ns - map_now_ns();
	struct map_sample below = {.quality = MAP_INVALID};
	char quality[WORDS_SIZE], name[MAP_NAME_SIZE];
	json_t *row = json_object();

	map_read_below(map, force->point, &below);
	words_quality(below.quality, quality);
	map_point_name(config, &config->points[force->point], name);
	json_object_set_new(row, "name", json_string(name));
	json_object_set_new(row, "value", words_value(type, &force->value));
	json_object_set_new(row, "below", below.time_ns != 0 ? words_value(type, &below.value) : json_null());
	json_object_set_new(row, "below_quality", json_string(quality));
	json_object_set_new(row, "left_s", json_real(left_ns > 0 ? (double)left_ns / NS_PER_S : 0));
	return row;
}

static void list_forces(const struct map *map, bool json, FILE *out)
{
	struct map_force forces[MAP_FORCES_MAX];
	const unsigned count = map_forces(map, forces);
	struct listing listing;

	listing_begin(&listing, columns, COUNT(columns), json);
	listing.out = out;
	for (unsigned i = 0; i < count; i++)
		listing_add(&listing, row_of(map, &forces[i]));
	listing_end(&listing);
}

void rtuctl_print_forces(const struct map *map, FILE *out)
{
	struct map_force forces[MAP_FORCES_MAX];

	if (map_forces(map, forces) == 0)
		return;
	list_forces(map, false, out);
	fputc('\n', out);
}

json_t *rtuctl_force_row(const struct map *map, uint32_t point)
{
	struct map_force forces[MAP_FORCES_MAX];
	const unsigned count = map_forces(map, forces);

	for (unsigned i = 0; i < count; i++)
		if (forces[i].point == point)
			return row_of(map, &forces[i]);
	return json_null();
}

int rtuctl_forces(struct map *map, const struct rtuctl_request *request)
{
	list_forces(map, request->json, stdout);
	return RTUCTL_DONE;
}
