/* SPDX-License-Identifier: GPL-3.0-or-later */
#include "rtuctl/tables.h"

#include <stdio.h>
#include <string.h>

static void list(const struct map *map, const struct table *table, bool json)
{
	json_t *rows = table->rows(map), *row;
	struct listing listing;
	size_t i;

	listing_begin(&listing, table->columns, table->column_count, json);
	json_array_foreach(rows, i, row)
	{
		listing_add(&listing, json_incref(row));
	}
	listing_end(&listing);
	json_decref(rows);
}

/* One row that has the rows of each table. */
static void list_all_as_json(const struct map *map, const struct table *tables, size_t count)
{
	json_t *all = json_object();
	struct listing listing;

	for (size_t i = 0; i < count; i++)
		json_object_set_new(all, tables[i].name, tables[i].rows(map));
	listing_begin(&listing, NULL, 0, true);
	listing_add(&listing, all);
	listing_end(&listing);
}

int tables_print(const struct map *map, const struct rtuctl_request *request, const struct table *tables,
		 size_t count, const char *expected)
{
	const char *wanted = request->arguments[0];
	bool known = wanted == NULL;

	if (wanted == NULL && request->json) {
		list_all_as_json(map, tables, count);
		return RTUCTL_DONE;
	}
	for (size_t i = 0; i < count; i++) {
		if (wanted != NULL && strcmp(wanted, tables[i].name) != 0)
			continue;
		known = true;
		if (wanted == NULL && i > 0)
			putchar('\n');
		list(map, &tables[i], request->json);
	}
	if (known)
		return RTUCTL_DONE;
	fprintf(stderr, "rtuctl: no table %s: expected %s\n", wanted, expected);
	return RTUCTL_USAGE;
}
