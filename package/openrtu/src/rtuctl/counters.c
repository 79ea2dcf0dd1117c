/* SPDX-License-Identifier: GPL-3.0-or-later */
/* The counters that modules have named, whatever module it is. */
#include <string.h>

#include "rows/rows.h"
#include "rtuctl/listing.h"
#include "rtuctl/rtuctl.h"

static const struct listing_column columns[] = {
    {"module", "MODULE", LISTING_TEXT},
    {"counter", "COUNTER", LISTING_TEXT},
    {"value", "VALUE", LISTING_RIGHT},
};

static void list_module(const struct map *map, uint32_t index, const char *name, struct listing *listing)
{
	struct map_counter counter;

	for (uint32_t i = 0; map_counter(map, index, i, &counter); i++)
		listing_add(listing, rows_counter(name, &counter));
}

int rtuctl_counters(struct map *map, const struct rtuctl_request *request)
{
	const char *wanted = request->arguments[0];
	struct listing listing;
	bool found = wanted == NULL;

	listing_begin(&listing, columns, sizeof(columns) / sizeof(columns[0]), request->json);
	for (uint32_t i = 0; i < map_module_count(map); i++) {
		struct map_module module;

		map_module(map, i, &module);
		if (wanted != NULL && strcmp(module.name, wanted) != 0)
			continue;
		found = true;
		list_module(map, i, module.name, &listing);
	}
	listing_end_found(&listing, found);
	if (found)
		return RTUCTL_DONE;
	fprintf(stderr, "rtuctl: there is no module \"%s\": \"rtuctl modules\" lists all\n", wanted);
	return RTUCTL_FAILED;
}
