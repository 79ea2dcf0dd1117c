/* SPDX-License-Identifier: GPL-3.0-or-later */
/* The key "ln" of a point: "Q1XCBR1.Pos", the data object that it is instead of one of GGIO1. */
#include <ctype.h>
#include <stdlib.h>
#include <string.h>

#include "iec61850/config.h"
#include "iec61850/config_part.h"
#include "iec61850/ln_class.h"
#include "map/type.h"

#define CLASS_LETTERS 4
#define AROUND_MAX    12 /* characters of prefix and instance (IEC 61850-7-2, 22.2) */
#define LIST_SIZE     512

/* ---- one point --------------------------------------------------------------------------- */

/* What the words are of which one was expected, as far as they fit. */
static void list(char out[LIST_SIZE], size_t count, const char *(*word)(const void *of, size_t i),
		 const void *of)
{
	size_t size = 0;

	out[0] = '\0';
	for (size_t i = 0; i < count && size < LIST_SIZE - AROUND_MAX - 3; i++)
		if (word(of, i) != NULL)
			size += (size_t)snprintf(out + size, LIST_SIZE - size, "%s%s", size == 0 ? "" : ", ",
						 word(of, i));
}

/* The logical device's own nodes are not for points. */
static bool is_for_points(size_t class)
{
	return class != IEC61850_CLASS_LLN0 && class != IEC61850_CLASS_LPHD;
}

static const char *class_word(const void *of, size_t i)
{
	(void)of;
	return is_for_points(i) ? iec61850_ln_classes[i].name : NULL;
}

static const char *data_word(const void *of, size_t i)
{
	const struct iec61850_ln_class *class = of;

	return strcmp(class->data[i].name, "Beh") == 0 ? NULL : class->data[i].name;
}

/* The letters before the number with which a name ends. False: that is none, or as 01. */
static bool split_number(const char *text, size_t size, size_t digits_max, size_t *letters, unsigned *number)
{
	*letters = size;
	while (*letters > 0 && isdigit((unsigned char)text[*letters - 1]))
		--*letters;
	if (*letters == size || size - *letters > digits_max || text[*letters] == '0')
		return false;
	*number = (unsigned)strtoul(text + *letters, NULL, 10);
	return true;
}

static bool is_identifier(const char *text, size_t size)
{
	for (size_t i = 0; i < size; i++)
		if (!isalnum((unsigned char)text[i]) && text[i] != '_')
			return false;
	return isalpha((unsigned char)text[0]);
}

static bool read_ln(struct config_loader *loader, const struct config_place *place, const char *text,
		    struct iec61850_assignment *out)
{
	const size_t size = (size_t)(strchr(text, '.') - text);
	char known[LIST_SIZE];
	unsigned instance;
	size_t letters;

	if (size >= IEC61850_LN_SIZE || !is_identifier(text, size) ||
	    !split_number(text, size, AROUND_MAX, &letters, &instance) || letters < CLASS_LETTERS) {
		config_error(
		    &loader->report, place,
		    "\"%.*s\" is no name of a logical node, expected one as Q1XCBR1: a prefix or none, "
		    "a class, and a number; prefix and number have %d characters at most",
		    (int)size, text, AROUND_MAX);
		return false;
	}
	snprintf(out->ln, sizeof(out->ln), "%.*s", (int)size, text);
	for (out->class = 0; out->class < iec61850_ln_class_count; out->class ++)
		if (is_for_points(out->class) && memcmp(iec61850_ln_classes[out->class].name,
							text + letters - CLASS_LETTERS, CLASS_LETTERS) == 0)
			return true;
	list(known, iec61850_ln_class_count, class_word, NULL);
	config_error(&loader->report, place, "\"%s\" is of no class that is known, expected one of %s",
		     out->ln, known);
	return false;
}

/* A name is a data object's, with a number behind it if there may be several. */
static bool read_data(struct config_loader *loader, const struct config_place *place, const char *name,
		      struct iec61850_assignment *out)
{
	const struct iec61850_ln_class *class = &iec61850_ln_classes[out->class];
	size_t letters = strlen(name);
	char known[LIST_SIZE];
	unsigned number = 0;

	for (out->data = 0; out->data < class->count; out->data++) {
		const struct iec61850_data *data = &class->data[out->data];

		if (strcmp(data->name, "Beh") == 0)
			continue;
		if (!(data->presence & IEC61850_MULTI) && strcmp(name, data->name) == 0)
			return true;
		if ((data->presence & IEC61850_MULTI) &&
		    split_number(name, strlen(name), 4, &letters, &number) && strlen(data->name) == letters &&
		    memcmp(name, data->name, letters) == 0) {
			out->number = (uint16_t)number;
			return true;
		}
	}
	list(known, class->count, data_word, class);
	config_error(&loader->report, place, "%s has no data object \"%s\" for a point, expected one of %s%s",
		     class->name, name, known,
		     out->class == IEC61850_CLASS_GGIO ? ", those from IntIn on with a number, as Ind1" : "");
	return false;
}

static void check_type(struct config_loader *loader, const struct config_place *place, const char *text,
		       const struct iec61850_assignment *assigned)
{
	const struct map_point *point = &loader->config->points[assigned->point];
	const enum iec61850_cdc cdc =
	    (enum iec61850_cdc)iec61850_ln_classes[assigned->class].data[assigned->data].cdc;
	char types[LIST_SIZE] = "";

	if (iec61850_cdc_takes(cdc, point->type))
		return;
	for (unsigned type = 0; type < MAP_TYPES; type++)
		if (iec61850_cdc_takes(cdc, type))
			snprintf(types + strlen(types), sizeof(types) - strlen(types), "%s%s",
				 types[0] == '\0' ? "" : ", ", map_types[type].name);
	config_error(&loader->report, place,
		     "%s is a %s, which no point of type %s can be, expected one of %s", text,
		     iec61850_cdc_names[cdc], map_types[point->type].name, types);
}

/* Room for one more, doubled when there is none. NULL: no memory, which is reported. */
static struct iec61850_assignment *next(struct config_loader *loader)
{
	const uint32_t count = map_record_count(loader->config, IEC61850_ASSIGNMENTS);

	if ((count & (count - 1)) == 0) { /* it has as much room as the power of two says */
		struct iec61850_assignment *all =
		    realloc(iec61850_assignments(loader->config),
			    (count == 0 ? 1 : 2 * (size_t)count) * sizeof(*all));

		if (all == NULL) {
			config_out_of_memory(&loader->report);
			return NULL;
		}
		map_move_section(loader->config, IEC61850_ASSIGNMENTS, all);
	}
	return map_next_record(loader->config, IEC61850_ASSIGNMENTS);
}

void iec61850_take_ln(struct config_loader *loader, const struct config_place *place, uint32_t point,
		      const char *text)
{
	struct iec61850_assignment assigned = {.point = point}, *kept;

	if (strchr(text, '.') == NULL) {
		config_error(&loader->report, place,
			     "\"%s\" is no data object of a logical node, expected one as XCBR1.Pos", text);
		return;
	}
	if (!read_ln(loader, place, text, &assigned) ||
	    !read_data(loader, place, strchr(text, '.') + 1, &assigned))
		return;
	if (strcmp(assigned.ln, "GGIO1") == 0)
		config_error(
		    &loader->report, place,
		    "\"%s\" is of GGIO1, which has the points without ln: expected GGIO2 or another one",
		    text);
	check_type(loader, place, text, &assigned);
	kept = next(loader);
	if (kept != NULL)
		*kept = assigned;
}

/* ---- all points -------------------------------------------------------------------------- */

static uint16_t ca_of(const struct map_config *config, const struct iec61850_assignment *assigned)
{
	return config->sets[config->points[assigned->point].set].ca;
}

static int by_object(const void *a, const void *b, void *context)
{
	const struct iec61850_assignment *one = a, *other = b;
	const uint16_t ca = ca_of(context, one), other_ca = ca_of(context, other);
	const int by_ln = strcmp(one->ln, other->ln);

	if (ca != other_ca)
		return ca < other_ca ? -1 : 1;
	if (by_ln != 0)
		return by_ln;
	if (one->data != other->data)
		return one->data < other->data ? -1 : 1;
	return (one->number > other->number) - (one->number < other->number);
}

static bool is_same_ln(const struct map_config *config, const struct iec61850_assignment *one,
		       const struct iec61850_assignment *other)
{
	return ca_of(config, one) == ca_of(config, other) && strcmp(one->ln, other->ln) == 0;
}

static void check_twice(struct config_loader *loader, const struct config_place *place,
			const struct iec61850_assignment *one, const struct iec61850_assignment *other)
{
	const struct map_config *config = loader->config;
	char first[MAP_NAME_SIZE], second[MAP_NAME_SIZE];

	if (by_object(one, other, loader->config) != 0)
		return;
	map_point_name(config, &config->points[one->point], first);
	map_point_name(config, &config->points[other->point], second);
	config_error(&loader->report, place,
		     "\"%s\" and \"%s\" of CA %u are both %s.%s: expected another \"ln\" for one of them",
		     first, second, (unsigned)ca_of(config, one), one->ln,
		     iec61850_ln_classes[one->class].data[one->data].name);
}

/* Of what a class has one of at least, the points of a logical node are one. */
static void check_ln(struct config_loader *loader, const struct config_place *place,
		     const struct iec61850_assignment *points, uint32_t count)
{
	const struct iec61850_ln_class *class = &iec61850_ln_classes[points->class];
	char wanted[LIST_SIZE] = "";
	bool there = false;

	for (unsigned i = 0; i < class->count; i++)
		if (class->data[i].presence & IEC61850_ONE_OF)
			snprintf(wanted + strlen(wanted), sizeof(wanted) - strlen(wanted), "%s%s",
				 wanted[0] == '\0' ? "" : ", ", class->data[i].name);
	for (uint32_t i = 0; i < count; i++)
		there |= (class->data[points[i].data].presence & IEC61850_ONE_OF) != 0;
	if (!there && wanted[0] != '\0')
		config_error(&loader->report, place,
			     "%s of CA %u needs one of %s: give it to a point with \"ln\"", points->ln,
			     (unsigned)ca_of(loader->config, points), wanted);
}

bool iec61850_check_lns(struct config_loader *loader, const struct config_place *place)
{
	const uint32_t count = map_record_count(loader->config, IEC61850_ASSIGNMENTS);
	struct iec61850_assignment *sorted = calloc((size_t)count + 1, sizeof(*sorted));
	uint32_t first = 0;

	if (sorted == NULL)
		return false;
	if (count > 0)
		memcpy(sorted, iec61850_assignments(loader->config), count * sizeof(*sorted));
	qsort_r(sorted, count, sizeof(*sorted), by_object, loader->config);
	for (uint32_t i = 0; i < count; i++) {
		if (i > 0)
			check_twice(loader, place, &sorted[i - 1], &sorted[i]);
		if (i + 1 < count && is_same_ln(loader->config, &sorted[i], &sorted[i + 1]))
			continue;
		check_ln(loader, place, &sorted[first], i + 1 - first);
		first = i + 1;
	}
	free(sorted);
	return true;
}
