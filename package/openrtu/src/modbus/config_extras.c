/* SPDX-License-Identifier: GPL-3.0-or-later */
/* What few objects have, once all points are in their places: other points that they name, an address to write to. */
#include "modbus/config_loader.h"

#include <stdlib.h>
#include <string.h>

static int by_name(const void *left, const void *right)
{
	const struct modbus_entry *const *a = left, *const *b = right;

	return strcmp((*a)->name, (*b)->name);
}

static bool names_others(const struct modbus_entry *entry)
{
	for (unsigned i = 0; i < MODBUS_LINKS; i++)
		if (entry->links[i] != NULL)
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

static bool is_number(const struct modbus_entry *entry)
{
	return entry->point.type == MAP_SCALED || entry->point.type == MAP_FLOAT;
}

/* One of the same device, which names no other itself: so there is no order to follow, and no circle. */
static bool may_be_named(const struct modbus_entry *other, const struct modbus_entry *entry, unsigned link)
{
	return other != NULL && other != entry && other->point.set == entry->point.set &&
	       !(other->point.flags & MAP_POINT_NEVER_READ) && !names_others(other) &&
	       (link < MODBUS_STATUS_BITS ? other->point.type == MAP_SINGLE : is_number(other));
}

/* Else the value may be read first, and be without its scale for a whole period. Of two that may share a request, the plan says whether they do. */
static bool may_be_read_in_time(const struct modbus_entry *other, const struct modbus_entry *entry)
{
	const uint32_t period_ms = entry->wire.scan_period_ms, others_ms = other->wire.scan_period_ms;

	return period_ms == 0 || (others_ms > 0 && others_ms < period_ms) ||
	       (others_ms == period_ms && other->wire.table == entry->wire.table);
}

static bool has_extra(const struct modbus_entry *entry)
{
	return names_others(entry) || (entry->wire.flags & MODBUS_WRITTEN_ELSEWHERE) || entry->page != 0;
}

static void refuse(struct modbus_loader *loader, const struct config_place *here, const char *name,
		   unsigned link)
{
	if (link < MODBUS_STATUS_BITS)
		config_error(
		    loader->report, here,
		    "\"%s\" is not a status bit for this object, expected the name of another single "
		    "point of this slave that has none itself",
		    name);
	else
		config_error(loader->report, here,
			     "\"%s\" is not a number for this object, expected the name of another scaled or "
			     "float point of this slave that is read and names none itself",
			     name);
}

static void resolve_link(struct modbus_loader *loader, const struct modbus_entry *entry, unsigned link,
			 const struct modbus_entry *const *names, struct modbus_extra *extra)
{
	const struct map_config *config = loader->config;
	const char *name = entry->links[link];
	struct config_place place[MODBUS_ENTRY_LINKS];
	const struct config_place here =
	    config_key_of(modbus_entry_place(entry, place), modbus_link_keys[link]);
	const struct modbus_entry *other = find(names, config->point_count, entry->prefix, name);

	if (other == NULL) /* a default name has no prefix */
		other = find(names, config->point_count, "", name);
	if (!may_be_named(other, entry, link))
		refuse(loader, &here, name, link);
	else if (link >= MODBUS_STATUS_BITS && !may_be_read_in_time(other, entry))
		config_error(loader->report, &here, MODBUS_READ_TOO_LATE, name);
	else
		extra->links[link] =
		    (uint16_t)(1 + (other - loader->entries) - config->sets[entry->point.set].first_point);
}

static void resolve(struct modbus_loader *loader, struct modbus_entry *entry,
		    const struct modbus_entry *const *names)
{
	struct modbus_extra *extra = map_next_record(loader->config, MODBUS_EXTRAS);

	entry->wire.extra = (uint16_t)map_record_count(loader->config, MODBUS_EXTRAS);
	extra->write_address = entry->write_address;
	extra->is_paged = entry->page != 0;
	extra->page = (uint16_t)(entry->page - extra->is_paged);
	for (unsigned link = 0; link < MODBUS_LINKS; link++)
		if (entry->links[link] != NULL)
			resolve_link(loader, entry, link, names, extra);
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
