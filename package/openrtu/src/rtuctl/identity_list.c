/* SPDX-License-Identifier: GPL-3.0-or-later */
/* The list of what devices say that they are. */
#include "rtuctl/identity_list.h"

#include "modbus/config.h"
#include "modbus/identity.h"
#include "rows/rows.h"
#include "rtuctl/listing.h"

#define COUNT(array) (sizeof(array) / sizeof((array)[0]))

static const struct listing_column columns[] = {
    {"port", "PORT", LISTING_RIGHT},
    {"id", "ID", LISTING_RIGHT},
    {"identified", "IDENTIFICATION", LISTING_TEXT},
    {"differs", "DIFFERS IN", LISTING_TEXT},
};

static bool has_something(const json_t *row)
{
	return json_object_size(json_object_get(row, "identification")) > 0;
}

void identity_list(const struct map *map)
{
	struct listing listing;

	listing_begin(&listing, columns, COUNT(columns), false);
	for (uint32_t i = 0; i < modbus_slave_count(map_config(map)); i++) {
		json_t *row = rows_device(map, i);

		json_object_set_new(row, "differs",
				    listing_words(json_object_get(row, "identification_differs"), ", ", ""));
		if (has_something(row))
			listing_add(&listing, row);
		else
			json_decref(row);
	}
	listing_end_found(&listing, listing.rows > 0);
}
