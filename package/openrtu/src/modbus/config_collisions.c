/* SPDX-License-Identifier: GPL-3.0-or-later */
/* What two points must not have in common: a Modbus address, an IOA of one CA, a name. */
#include "modbus/config_loader.h"

#include <stdlib.h>
#include <string.h>

/* Negative, 0 or positive, for qsort. */
static int order(uint32_t a, uint32_t b)
{
	return (a > b) - (a < b);
}

static int by_file(const struct modbus_entry *a, const struct modbus_entry *b)
{
	int by_device = order(a->point.set, b->point.set);
	int by_table = order(a->wire.table, b->wire.table);
	int by_origin = order(a->template == NULL, b->template == NULL);

	if (by_device != 0 || by_table != 0)
		return by_device != 0 ? by_device : by_table;
	return by_origin != 0 ? by_origin : order(a->object, b->object);
}

static int by_address(const void *left, const void *right)
{
	const struct modbus_entry *a = left, *b = right;
	int by_device = order(a->point.set, b->point.set);
	int by_table = order(a->wire.table, b->wire.table);
	int by_start = order(a->wire.address, b->wire.address);
	int by_width = order(modbus_width_of(&a->wire), modbus_width_of(&b->wire));

	if (by_device != 0 || by_table != 0)
		return by_device != 0 ? by_device : by_table;
	if (by_start != 0 || by_width != 0)
		return by_start != 0 ? by_start : by_width;
	return by_file(a, b);
}

static int by_ioa(const void *left, const void *right)
{
	const struct modbus_entry *a = left, *b = right;
	int by_ca = order(a->ca, b->ca);
	int by_number = order(a->point.ioa, b->point.ioa);

	if (by_ca != 0)
		return by_ca;
	return by_number != 0 ? by_number : by_file(a, b);
}

static int by_name(const void *left, const void *right)
{
	const struct modbus_entry *a = left, *b = right;
	int by_text = strcmp(a->name, b->name);

	return by_text != 0 ? by_text : by_file(a, b);
}

const struct config_place *modbus_entry_place(const struct modbus_entry *entry,
					      struct config_place links[MODBUS_ENTRY_LINKS])
{
	const struct config_place *slave = &links[4];
	unsigned last = 4;

	links[0] = (struct config_place){.in = NULL};
	links[1] = config_key_of(&links[0], MODBUS_KEY_PORTS);
	links[2] = config_element_of(&links[1], entry->port);
	links[3] = config_key_of(&links[2], MODBUS_KEY_SLAVES);
	links[4] = config_element_of(&links[3], entry->slave);
	if (entry->template != NULL) {
		links[5] = config_template_file(entry->template, slave);
		links[6] = config_key_of(&links[5], CONFIG_KEY_TEMPLATES);
		links[7] = config_key_of(&links[6], entry->template->name);
		last = 7;
	}
	links[last + 1] = config_key_of(&links[last], modbus_table_names[entry->wire.table]);
	links[last + 2] = config_element_of(&links[last + 1], entry->object);
	return &links[last + 2];
}

/* what: how the entry collides with the other one */
static void refuse_pair(struct modbus_loader *loader, const struct modbus_entry *entry,
			const struct modbus_entry *other, const char *what)
{
	struct config_place links[MODBUS_ENTRY_LINKS], other_links[MODBUS_ENTRY_LINKS];
	char there[CONFIG_WHERE_SIZE];

	config_place_where(loader->report, modbus_entry_place(other, other_links), there);
	config_error(loader->report, modbus_entry_place(entry, links), "%s %s", what, there);
}

/* Addresses of one table that follow each other: a point covers one such range, or two when its bits lie apart. */
struct range {
	const struct modbus_entry *entry;
	uint32_t begin, end;
};

static uint32_t ranges_of(const struct modbus_entry *entry, struct range *out)
{
	const struct modbus_point *point = &entry->wire;
	uint32_t first = point->address, second = point->second_address;

	if (point->width != 2 || point->type != MAP_DOUBLE || second == first + 1) {
		out[0] = (struct range){entry, first, first + modbus_width_of(point)};
		return 1;
	}
	out[0] = (struct range){entry, first, first + 1};
	out[1] = (struct range){entry, second, second + 1};
	return 2;
}

/* A register may be a value, fields and bits at once: who covers it twice in one of these ways has mistaken an address. */
enum layer { WHOLE, FIELD, BITS };

static enum layer layer_of(const struct modbus_entry *entry)
{
	if (modbus_is_register_bit(&entry->wire))
		return BITS;
	return modbus_is_field(&entry->wire) ? FIELD : WHOLE;
}

static unsigned bits_of(const struct modbus_point *point)
{
	if (modbus_is_field(point))
		return point->field;
	return point->type == MAP_DOUBLE ? 2 : 1;
}

/* They cover different bits of a register, or of several. */
static bool share_registers(const struct modbus_entry *a, const struct modbus_entry *b)
{
	return layer_of(a) != WHOLE && (a->wire.bit + bits_of(&a->wire) <= b->wire.bit ||
					b->wire.bit + bits_of(&b->wire) <= a->wire.bit);
}

static bool in_one_layer(const struct modbus_entry *a, const struct modbus_entry *b)
{
	return a->point.set == b->point.set && a->wire.table == b->wire.table && layer_of(a) == layer_of(b) &&
	       a->page == b->page;
}

static bool overlap(const struct modbus_entry *a, const struct modbus_entry *b)
{
	struct range of_a[2], of_b[2];
	uint32_t count_a = ranges_of(a, of_a), count_b = ranges_of(b, of_b);
	bool any = false;

	for (uint32_t i = 0; i < count_a; i++)
		for (uint32_t j = 0; j < count_b; j++)
			any |= of_a[i].begin < of_b[j].end && of_b[j].begin < of_a[i].end;
	return any && in_one_layer(a, b) && !share_registers(a, b);
}

static int by_range(const void *left, const void *right)
{
	const struct range *a = left, *b = right;
	int by_device = order(a->entry->point.set, b->entry->point.set);
	int by_table = order(a->entry->wire.table, b->entry->wire.table);
	int by_layer = order(layer_of(a->entry), layer_of(b->entry));

	if (by_device != 0 || by_table != 0)
		return by_device != 0 ? by_device : by_table;
	if (by_layer != 0)
		return by_layer;
	if (a->entry->page != b->entry->page)
		return order(a->entry->page, b->entry->page);
	if (a->begin != b->begin || a->end != b->end)
		return a->begin != b->begin ? order(a->begin, b->begin) : order(a->end, b->end);
	if (a->entry->wire.bit != b->entry->wire.bit)
		return order(a->entry->wire.bit, b->entry->wire.bit);
	return by_file(a->entry, b->entry);
}

static bool ranges_overlap(const struct range *a, const struct range *b)
{
	return in_one_layer(a->entry, b->entry) && a->begin < b->end && b->begin < a->end &&
	       !share_registers(a->entry, b->entry);
}

/* In the order of beginning, end and bit: a range may overlap its neighbour, or the one that reaches farthest so far. */
static void check_overlaps(struct modbus_loader *loader, const struct modbus_entry *entries, uint32_t count)
{
	struct range *ranges = calloc(2 * (size_t)count + 1, sizeof(*ranges));
	const struct range *farthest = ranges;
	uint32_t range_count = 0;

	if (ranges == NULL) {
		config_out_of_memory(loader->report);
		return;
	}
	for (uint32_t i = 0; i < count; i++)
		range_count += ranges_of(&entries[i], &ranges[range_count]);
	qsort(ranges, range_count, sizeof(*ranges), by_range);
	for (uint32_t i = 1; i < range_count; i++) {
		const struct range *range = &ranges[i], *before = range - 1;

		if (!ranges_overlap(before, range))
			before = farthest;
		if (ranges_overlap(before, range))
			refuse_pair(loader, range->entry, before->entry, "covers an address of");
		if (!in_one_layer(farthest->entry, range->entry) || range->end > farthest->end)
			farthest = range;
	}
	free(ranges);
}

/* Two slaves of a line with one id have all in common, and that has been said. */
static bool is_one_slave(const struct map_config *config, const struct modbus_entry *a,
			 const struct modbus_entry *b)
{
	const struct modbus_slave *one = &modbus_slaves(config)[a->point.set],
				  *other = &modbus_slaves(config)[b->point.set];

	return one != other && one->port == other->port && one->unit == other->unit;
}

static void check_ioas(struct modbus_loader *loader, const struct modbus_entry *entries, uint32_t count)
{
	for (uint32_t i = 1; i < count; i++) {
		const struct modbus_entry *one = &entries[i - 1], *other = &entries[i];
		char what[64];

		if (one->ca != other->ca || one->point.ioa != other->point.ioa || overlap(one, other) ||
		    is_one_slave(loader->config, one, other))
			continue;
		snprintf(what, sizeof(what), "has the CA %u and IOA %u of", one->ca, one->point.ioa);
		refuse_pair(loader, other, one, what);
	}
}

/* Default names differ when addresses do, and what is wrong with those has been said. */
static void check_names(struct modbus_loader *loader, const struct modbus_entry *entries, uint32_t count)
{
	for (uint32_t i = 1; i < count; i++) {
		const struct modbus_entry *one = &entries[i - 1], *other = &entries[i];
		char what[MAP_NAME_SIZE + 32];

		if (strcmp(one->name, other->name) != 0 || (!one->named && !other->named))
			continue;
		snprintf(what, sizeof(what), "has the name \"%s\" of", one->name);
		refuse_pair(loader, other, one, what);
	}
}

void modbus_check_collisions(struct modbus_loader *loader)
{
	struct modbus_entry *entries = loader->entries;
	uint32_t count = loader->config->point_count;

	qsort(entries, count, sizeof(*entries), by_ioa);
	check_ioas(loader, entries, count);
	qsort(entries, count, sizeof(*entries), by_name);
	check_names(loader, entries, count);
	qsort(entries, count, sizeof(*entries), by_address);
	check_overlaps(loader, entries, count);
}
