/* SPDX-License-Identifier: GPL-3.0-or-later */
/* What the gateway itself writes to a device, once all points are in their places. */
#include <stdlib.h>

#include "map/type.h"
#include "modbus/config_loader.h"
#include "modbus/config_object.h"
#include "modbus/convert.h"

/* Else nobody learns whether it is there. */
static bool is_device_read(const struct modbus_loader *loader, const struct map_set *device)
{
	for (uint32_t i = 0; i < device->point_count; i++)
		if (!(loader->entries[device->first_point + i].point.flags & MAP_POINT_NEVER_READ))
			return true;
	return false;
}

static bool can_be_written(const struct map_config *config, const struct modbus_entry *entry, double number)
{
	const struct map_point *point = &entry->point;
	uint16_t raw[CONVERT_WIDTH_MAX];
	union map_value value;

	if (point->min < point->max && !(number >= (double)point->min && number <= (double)point->max))
		return false;
	return map_value_of((enum map_type)point->type, number, &value) &&
	       convert_to_raw(&entry->wire, modbus_knots(config), convert_first_exponent(&entry->wire), value,
			      0, raw);
}

static void keep(struct modbus_loader *loader, const struct modbus_entry *entry, const json_t *value)
{
	*(struct modbus_keep *)map_next_record(loader->config, MODBUS_KEEPS) =
	    (struct modbus_keep){.value = json_number_value(value),
				 .point = (uint32_t)(entry - loader->entries),
				 .period_ms = entry->kept_every_ms,
				 .has_value = value != NULL};
}

static void keep_values(struct modbus_loader *loader, const struct config_place *object,
			const struct modbus_entry *entry)
{
	const struct config_place array = modbus_object_key(object, OBJECT_WRITE_VALUES);
	const json_t *value;
	size_t i;

	json_array_foreach(entry->kept_values, i, value)
	{
		const struct config_place here = config_element_of(&array, i);

		if (!json_is_number(value))
			config_error(loader->report, &here, "is no number");
		else if (entry->point.type != MAP_FLOAT && !map_is_whole(json_number_value(value)))
			config_error(loader->report, &here, "%g is no whole number, as type %s has them",
				     json_number_value(value), modbus_type_names[entry->point.type]);
		else if (!can_be_written(loader->config, entry, json_number_value(value)))
			config_error(loader->report, &here,
				     "%g is beyond what the object can hold, or its min and max",
				     json_number_value(value));
		keep(loader, entry, value);
	}
}

static void resolve(struct modbus_loader *loader, const struct modbus_entry *entry)
{
	struct config_place links[MODBUS_ENTRY_LINKS];
	const struct config_place *object = modbus_entry_place(entry, links);

	if (entry->kept_values == NULL)
		keep(loader, entry, NULL);
	else
		keep_values(loader, object, entry);
	if (!is_device_read(loader, &loader->config->sets[entry->point.set]))
		config_error(loader->report, object,
			     "is to be written when its slave answers, which has no object that is read, "
			     "expected one");
}

static size_t records_of(const struct modbus_entry *entry)
{
	if (!entry->is_kept)
		return 0;
	return entry->kept_values == NULL ? 1 : json_array_size(entry->kept_values);
}

/* A file without any has no such section. */
void modbus_resolve_keeps(struct modbus_loader *loader)
{
	const uint32_t points = loader->config->point_count;
	size_t count = 0;
	struct modbus_keep *keeps;

	for (uint32_t i = 0; i < points; i++)
		count += records_of(&loader->entries[i]);
	if (count == 0)
		return;
	keeps = calloc(count, sizeof(*keeps));
	map_add_section(loader->config, MODBUS_KEEPS, sizeof(*keeps), 0, keeps);
	if (keeps == NULL) {
		config_out_of_memory(loader->report);
		return;
	}
	for (uint32_t i = 0; i < points; i++)
		if (loader->entries[i].is_kept)
			resolve(loader, &loader->entries[i]);
}
