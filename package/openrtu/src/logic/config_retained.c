/* SPDX-License-Identifier: GPL-3.0-or-later */
/* Names of what programs retain: a changed configuration finds its values again in the journal. */
#include <string.h>

#include "logic/config_readers.h"
#include "map/retained.h"

/* FNV-1a */
static uint64_t add_octets(uint64_t hash, const void *octets, size_t size)
{
	const uint8_t *octet = octets;

	for (size_t i = 0; i < size; i++)
		hash = (hash ^ octet[i]) * UINT64_C(1099511628211);
	return hash;
}

static uint64_t add_number(uint64_t hash, uint16_t number)
{
	const uint8_t octets[] = {(uint8_t)number, (uint8_t)(number >> 8)};

	return add_octets(hash, octets, sizeof(octets));
}

/* The same for the same name, type and size in a program of the same name, as logic_retains_alike(). */
static uint64_t hash_of(const char *program, const char *name, const struct logic_retained *variable)
{
	uint64_t hash = UINT64_C(14695981039346656037);

	hash = add_octets(hash, program, strlen(program) + 1);
	hash = add_octets(hash, name, strlen(name) + 1);
	hash = add_number(hash, variable->type);
	return add_number(hash, variable->slots);
}

static void name_values(const struct logic_reading *reading, struct map_retained_name *names)
{
	const struct logic *logic = &reading->logic;

	for (uint16_t i = 0; i < logic->head->retained; i++) {
		const struct logic_retained *variable = &logic->retained[i];
		const uint64_t hash =
		    hash_of(reading->instance->name, logic_name(logic, variable->name), variable);

		for (uint16_t slot = 0; slot < variable->slots; slot++) {
			const uint64_t name = add_number(hash, slot);

			*names++ = (struct map_retained_name){(uint32_t)name, (uint32_t)(name >> 32)};
		}
	}
}

bool logic_name_retained(struct config_loader *loader, struct logic_readings *readings)
{
	struct map_retained_name *names;
	uint32_t count = 0;

	for (uint32_t i = 0; i < readings->count; i++) {
		readings->readings[i].instance->first_retained = count;
		count += readings->readings[i].instance->retained;
	}
	if (count == 0)
		return true;
	names = config_allocate(count, sizeof(*names));
	map_add_section(loader->config, MAP_RETAINED, sizeof(*names), count, names);
	for (uint32_t i = 0; names != NULL && i < readings->count; i++)
		name_values(&readings->readings[i], names + readings->readings[i].instance->first_retained);
	return names != NULL;
}
