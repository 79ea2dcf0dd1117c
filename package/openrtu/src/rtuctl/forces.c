/* SPDX-License-Identifier: GPL-3.0-or-later */
/* The forced points, with what is below. */
#include <stdio.h>

#include <jansson.h>

#include "rows/rows.h"
#include "rtuctl/listing.h"
#include "rtuctl/rtuctl.h"

#define COUNT(array) (sizeof(array) / sizeof((array)[0]))

static const struct listing_column columns[] = {
    {"name", "FORCED", LISTING_TEXT},  {"value", "VALUE", LISTING_RIGHT},
    {"below", "BELOW", LISTING_RIGHT}, {"below_quality", "QUALITY", LISTING_TEXT},
    {"left_s", "LEFT", LISTING_AGE},
};

static void list_forces(const struct map *map, bool json, FILE *out)
{
	struct map_force forces[MAP_FORCES_MAX];
	const unsigned count = map_forces(map, forces);
	struct listing listing;

	listing_begin(&listing, columns, COUNT(columns), json);
	listing.out = out;
	for (unsigned i = 0; i < count; i++)
		listing_add(&listing, rows_force(map, &forces[i]));
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

int rtuctl_forces(struct map *map, const struct rtuctl_request *request)
{
	list_forces(map, request->json, stdout);
	return RTUCTL_DONE;
}
