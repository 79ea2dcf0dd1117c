/* SPDX-License-Identifier: GPL-3.0-or-later */
/* The list of what devices say that they are. */
#include "rtuctl/identity_list.h"

#include <stdio.h>

#include "modbus/config.h"
#include "modbus/identity.h"
#include "rows/rows.h"
#include "rtuctl/listing.h"

#define COUNT(array) (sizeof(array) / sizeof((array)[0]))
#define DIFFERS_SIZE 160

static const struct listing_column columns[] = {
    {"port", "PORT", LISTING_RIGHT},
    {"id", "ID", LISTING_RIGHT},
    {"identified", "IDENTIFICATION", LISTING_TEXT},
    {"differs", "DIFFERS IN", LISTING_TEXT},
};

static json_t *differs(const json_t *names)
{
	char text[DIFFERS_SIZE] = "";
	size_t used = 0, i;
	json_t *name;

	json_array_foreach(names, i, name)
	{
		int length = snprintf(text + used, sizeof(text) - used, "%s%s", i > 0 ? ", " : "",
				      json_string_value(name));

		if (length < 0 || (size_t)length >= sizeof(text) - used)
			break;
		used += (size_t)length;
	}
	return json_string(text);
}

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

		json_object_set_new(row, "differs", differs(json_object_get(row, "identification_differs")));
		if (has_something(row))
			listing_add(&listing, row);
		else
			json_decref(row);
	}
	listing_end_found(&listing, listing.rows > 0);
}
