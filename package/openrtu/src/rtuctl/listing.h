/* SPDX-License-Identifier: GPL-3.0-or-later */
/* Rows of named values, printed as an aligned table or as JSON: an array with one row a line, or JSON lines. */
#ifndef OPENRTU_RTUCTL_LISTING_H
#define OPENRTU_RTUCTL_LISTING_H

#include <stdbool.h>
#include <stddef.h>
#include <stdio.h>

#include <jansson.h>

enum listing_format {
	LISTING_TEXT,  /* left-aligned */
	LISTING_RIGHT, /* right-aligned: numbers */
	LISTING_AGE,   /* seconds, in words */
};

struct listing_column {
	const char *key; /* in the row; a row may have more */
	const char *title;
	enum listing_format format;
};

struct listing {
	const struct listing_column *columns;
	size_t column_count;
	size_t rows;
	char **cells; /* rows + 1 times column_count; NULL for JSON */
	bool json;
	FILE *out; /* of a table: standard output, unless it is changed before listing_end */
};

void listing_begin(struct listing *listing, const struct listing_column *columns, size_t count, bool json);
/* Takes over the row. */
void listing_add(struct listing *listing, json_t *row);
/* Prints the table, or ends the JSON array, and frees everything. */
void listing_end(struct listing *listing);
/* The same of rows that were asked for by name or pattern: a head without any says nothing. JSON has its end. */
void listing_end_found(struct listing *listing, bool found);

/* One line of JSON. Takes over the row. */
void listing_print_json(json_t *row);

/* The texts of a list with `between` between them, as far as there is room; `none` of an empty one. */
json_t *listing_words(const json_t *texts, const char *between, const char *none);

#endif
