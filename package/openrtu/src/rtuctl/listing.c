/* SPDX-License-Identifier: GPL-3.0-or-later */
#include "rtuctl/listing.h"

#include <err.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

#include "rows/rows.h"
#include "rows/words.h"
#include "rtuctl/rtuctl.h"
#include "rtuctl/terminal.h"

#define GAP       2
#define LIST_SIZE 320

static void print_json(const json_t *row)
{
	json_dumpf(row, stdout, ROWS_FORMAT);
}

void listing_print_json(json_t *row)
{
	print_json(row);
	putchar('\n');
	json_decref(row);
}

static void *need(void *memory)
{
	if (memory == NULL)
		errx(RTUCTL_FAILED, "out of memory");
	return memory;
}

static char *cell_text(const json_t *row, const json_t *value, enum listing_format format)
{
	char text[WORDS_SIZE] = "-";

	if (words_angle(row, value, text) || words_meaning(row, value, text))
		return need(strdup(text));
	if (json_is_string(value))
		return need(strdup(json_string_value(value)));
	if (format == LISTING_AGE && json_is_real(value))
		words_age(json_real_value(value), text);
	else if (json_is_real(value))
		snprintf(text, sizeof(text), "%.7g", json_real_value(value));
	else if (json_is_integer(value))
		snprintf(text, sizeof(text), "%lld", (long long)json_integer_value(value));
	else if (json_is_boolean(value))
		strcpy(text, json_is_true(value) ? "yes" : "no");
	return need(strdup(text));
}

/* Row 0 holds the titles. */
static char **row_cells(struct listing *listing, size_t row)
{
	return listing->cells + row * listing->column_count;
}

static void grow(struct listing *listing, size_t rows)
{
	listing->cells =
	    need(reallocarray(listing->cells, rows * listing->column_count, sizeof(*listing->cells)));
}

void listing_begin(struct listing *listing, const struct listing_column *columns, size_t count, bool json)
{
	*listing = (struct listing){.columns = columns, .column_count = count, .json = json, .out = stdout};
	if (json) {
		putchar('[');
		return;
	}
	grow(listing, 1);
	for (size_t i = 0; i < count; i++)
		row_cells(listing, 0)[i] = need(strdup(columns[i].title));
}

void listing_add(struct listing *listing, json_t *row)
{
	listing->rows++;
	if (listing->json) {
		fputs(listing->rows == 1 ? "\n" : ",\n", stdout);
		print_json(row);
	} else {
		grow(listing, listing->rows + 1);
		for (size_t i = 0; i < listing->column_count; i++)
			row_cells(listing, listing->rows)[i] = cell_text(
			    row, json_object_get(row, listing->columns[i].key), listing->columns[i].format);
	}
	json_decref(row);
}

static size_t column_width(struct listing *listing, size_t column)
{
	size_t width = 0;

	for (size_t row = 0; row <= listing->rows; row++) {
		size_t cell = terminal_width(row_cells(listing, row)[column]);

		width = cell > width ? cell : width;
	}
	return width;
}

static void print_cell(FILE *out, const char *text, enum listing_format format, size_t width, bool last)
{
	int padding = (int)(width - terminal_width(text));

	if (format != LISTING_TEXT)
		fprintf(out, "%*s%s%*s", padding, "", text, last ? 0 : GAP, "");
	else
		fprintf(out, "%s%*s", text, last ? 0 : padding + GAP, "");
}

static void print_table(struct listing *listing)
{
	size_t *widths = need(calloc(listing->column_count, sizeof(*widths)));

	for (size_t column = 0; column < listing->column_count; column++)
		widths[column] = column_width(listing, column);
	for (size_t row = 0; row <= listing->rows; row++) {
		for (size_t column = 0; column < listing->column_count; column++)
			print_cell(listing->out, row_cells(listing, row)[column],
				   listing->columns[column].format, widths[column],
				   column + 1 == listing->column_count);
		fputc('\n', listing->out);
	}
	free(widths);
}

static void drop(struct listing *listing)
{
	for (size_t i = 0; i < (listing->rows + 1) * listing->column_count; i++)
		free(listing->cells[i]);
	free(listing->cells);
}

void listing_end(struct listing *listing)
{
	if (listing->json) {
		puts(listing->rows == 0 ? "]" : "\n]");
		return;
	}
	print_table(listing);
	drop(listing);
}

void listing_end_found(struct listing *listing, bool found)
{
	if (found || listing->json)
		listing_end(listing);
	else
		drop(listing);
}

json_t *listing_words(const json_t *texts, const char *between, const char *none)
{
	char words[LIST_SIZE];
	size_t i, used = 0;
	const json_t *text;

	snprintf(words, sizeof(words), "%s", none);
	json_array_foreach(texts, i, text)
	{
		int length = snprintf(words + used, sizeof(words) - used, "%s%s", i > 0 ? between : "",
				      json_string_value(text));

		if (length < 0 || (size_t)length >= sizeof(words) - used)
			break;
		used += (size_t)length;
	}
	return json_string(words);
}
