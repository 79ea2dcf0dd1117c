/* SPDX-License-Identifier: GPL-3.0-or-later */
/* A command that has several tables, of which it prints one or all; as JSON, all are one row that has their rows. */
#ifndef OPENRTU_RTUCTL_TABLES_H
#define OPENRTU_RTUCTL_TABLES_H

#include "rtuctl/listing.h"
#include "rtuctl/rtuctl.h"

struct table {
	const char *name;
	const struct listing_column *columns;
	size_t column_count;
	json_t *(*rows)(const struct map *map); /* an array, a new reference */
};

/* The first argument names one of them. expected: all names, in words. Returns an exit code. */
int tables_print(const struct map *map, const struct rtuctl_request *request, const struct table *tables,
		 size_t count, const char *expected);

#endif
