/* SPDX-License-Identifier: GPL-3.0-or-later */
/* The status bits that objects name, once all points are in their places. */
#include "rtud/config_parts.h"

#include <stdlib.h>
#include <string.h>

static int by_name(const void *left, const void *right)
{
	const struct config_entry *const *a = left, *const *b = right;

	return strcmp((*a)->name, (*b)->name);
}

static bool names_status(const struct config_entry *entry)
{
	for (unsigned i = 0; i < MAP_STATUS_BITS; i++)
		if (entry->status[i] != NULL)
			return true;
	return false;
}

static const struct config_entry *find(const struct config_entry *const *names, uint32_t count,
				       const char *prefix, const char *name)
{
	struct config_entry wanted;
	const struct config_entry *key = &wanted;
	const struct config_entry *const *found;

	snprintf(wanted.name, sizeof(wanted.name), "%s%s", prefix, name);
	found = bsearch(&key, names, count, sizeof(*names), by_name);
	return found == NULL ? NULL : *found;
}

/* A bit of the same device, which nothing else says something of: so there is no order to follow, and no circle. */
static bool is_status_bit_for(const struct config_entry *bit, const struct config_entry *entry)
{
	return bit != NULL && bit != entry && bit->point.device == entry->point.device &&
	       bit->point.type == MAP_SINGLE && !names_status(bit);
}

static void resolve(struct config_loader *loader, struct config_entry *entry,
		    const struct config_entry *const *names)
{
	const struct map_config *config = loader->config;

	for (unsigned i = 0; i < MAP_STATUS_BITS; i++) {
		const struct config_entry *bit;
		struct config_place links[CONFIG_ENTRY_LINKS];
		struct config_place here;

		if (entry->status[i] == NULL)
			continue;
		bit = find(names, config->point_count, entry->prefix, entry->status[i]);
		if (bit == NULL) /* a default name has no prefix */
			bit = find(names, config->point_count, "", entry->status[i]);
		here = config_key_of(config_entry_place(entry, links), config_status_keys[i]);
		if (is_status_bit_for(bit, entry))
			entry->point.status[i] = (uint16_t)(1 + (bit - loader->entries) -
							    config->devices[entry->point.device].first_point);
		else
			config_error(
			    &loader->report, &here,
			    "\"%s\" is not a status bit for this object, expected the name of another "
			    "single point of this slave that has none itself",
			    entry->status[i]);
	}
}

void config_resolve_status(struct config_loader *loader)
{
	uint32_t count = loader->config->point_count;
	const struct config_entry **names = calloc((size_t)count + 1, sizeof(struct config_entry *));

	if (names == NULL) {
		config_out_of_memory(loader);
		return;
	}
	for (uint32_t i = 0; i < count; i++)
		names[i] = &loader->entries[i];
	qsort(names, count, sizeof(struct config_entry *), by_name);
	for (uint32_t i = 0; i < count; i++)
		resolve(loader, &loader->entries[i], (const struct config_entry *const *)names);
	free(names);
}
