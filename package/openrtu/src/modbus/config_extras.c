/* SPDX-License-Identifier: GPL-3.0-or-later */
/* What few objects have, once all points are in their places: status bits that they name, an address to write to. */
#include "modbus/config_loader.h"

#include <stdlib.h>
#include <string.h>

static int by_name(const void *left, const void *right)
{
	const struct modbus_entry *const *a = left, *const *b = right;

	return strcmp((*a)->name, (*b)->name);
}

static bool names_status(const struct modbus_entry *entry)
{
	for (unsigned i = 0; i < MODBUS_STATUS_BITS; i++)
		if (entry->status[i] != NULL)
			return true;
	return false;
}

static const struct modbus_entry *find(const struct modbus_entry *const *names, uint32_t count,
				       const char *prefix, const char *name)
{
	struct modbus_entry wanted;
	const struct modbus_entry *key = &wanted;
	const struct modbus_entry *const *found;

	snprintf(wanted.name, sizeof(wanted.name), "%s%s", prefix, name);
	found = bsearch(&key, names, count, sizeof(*names), by_name);
	return found == NULL ? NULL : *found;
}

/* A bit of the same device, which nothing else says something of: so there is no order to follow, and no circle. */
static bool is_status_bit_for(const struct modbus_entry *bit, const struct modbus_entry *entry)
{
	return bit != NULL && bit != entry && bit->point.set == entry->point.set &&
	       bit->point.type == MAP_SINGLE && !names_status(bit);
}

static bool has_extra(const struct modbus_entry *entry)
{
	return names_status(entry) || (entry->wire.flags & MODBUS_WRITTEN_ELSEWHERE);
}

static void resolve(struct modbus_loader *loader, struct modbus_entry *entry,
		    const struct modbus_entry *const *names)
{
	struct modbus_extra *extra = map_next_record(loader->config, MODBUS_EXTRAS);
	const struct map_config *config = loader->config;

	entry->wire.extra = (uint16_t)map_record_count(config, MODBUS_EXTRAS);
	extra->write_address = entry->write_address;
	for (unsigned i = 0; i < MODBUS_STATUS_BITS; i++) {
		const struct modbus_entry *bit;
		struct config_place links[MODBUS_ENTRY_LINKS];
		struct config_place here;

		if (entry->status[i] == NULL)
			continue;
		bit = find(names, config->point_count, entry->prefix, entry->status[i]);
		if (bit == NULL) /* a default name has no prefix */
			bit = find(names, config->point_count, "", entry->status[i]);
		here = config_key_of(modbus_entry_place(entry, links), modbus_status_keys[i]);
		if (is_status_bit_for(bit, entry))
			extra->status[i] = (uint16_t)(1 + (bit - loader->entries) -
						      config->sets[entry->point.set].first_point);
		else
			config_error(
			    loader->report, &here,
			    "\"%s\" is not a status bit for this object, expected the name of another "
			    "single point of this slave that has none itself",
			    entry->status[i]);
	}
}

void modbus_resolve_extras(struct modbus_loader *loader)
{
	uint32_t count = loader->config->point_count, extra_count = 0;
	const struct modbus_entry **names = calloc((size_t)count + 1, sizeof(struct modbus_entry *));
	struct modbus_extra *extras;

	for (uint32_t i = 0; i < count; i++)
		extra_count += has_extra(&loader->entries[i]);
	extras = calloc((size_t)extra_count + 1, sizeof(*extras));
	map_move_section(loader->config, MODBUS_EXTRAS, extras);
	if (names == NULL || extras == NULL) {
		config_out_of_memory(loader->report);
		free(names);
		return;
	}
	for (uint32_t i = 0; i < count; i++)
		names[i] = &loader->entries[i];
	qsort(names, count, sizeof(struct modbus_entry *), by_name);
	for (uint32_t i = 0; i < count; i++)
		if (has_extra(&loader->entries[i]))
			resolve(loader, &loader->entries[i], (const struct modbus_entry *const *)names);
	free(names);
}
