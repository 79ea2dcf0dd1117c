/* SPDX-License-Identifier: GPL-3.0-or-later */
#include "config/index.h"

#include <stdlib.h>
#include <string.h>

#include "map/hash.h"

#define LEAST 1024u
#define NONE  UINT32_MAX

static uint32_t hash_of_address(uint32_t set, uint32_t ioa)
{
	const uint32_t address[] = {set, ioa};

	return map_hash_octets(MAP_HASH_BASIS, address, sizeof(address));
}

static void put(uint32_t *table, uint32_t size, uint32_t hash, uint32_t point)
{
	uint32_t place = hash & (size - 1);

	while (table[place] != 0)
		place = (place + 1) & (size - 1);
	table[place] = point + 1;
}

static void add(struct config_index *index, const struct map_config *config, uint32_t point)
{
	const struct map_point *object = &config->points[point];
	char name[MAP_NAME_SIZE];

	map_point_name(config, object, name);
	put(index->by_name, index->size, map_hash_octets(MAP_HASH_BASIS, name, strlen(name)), point);
	put(index->by_ioa, index->size, hash_of_address(object->set, object->ioa), point);
}

/* Never more than half full, so that looking for what is not there ends soon. */
static bool make_room(struct config_index *index, uint32_t points)
{
	uint32_t size = index->size == 0 ? LEAST : index->size;

	while (size / 2 < points)
		size *= 2;
	if (size == index->size)
		return true;
	config_index_free(index);
	index->by_name = calloc(size, sizeof(*index->by_name));
	index->by_ioa = calloc(size, sizeof(*index->by_ioa));
	index->size = size;
	return index->by_name != NULL && index->by_ioa != NULL;
}

bool config_index_renew(struct config_index *index, const struct map_config *config)
{
	if (!make_room(index, config->point_count)) {
		config_index_free(index);
		return false;
	}
	for (; index->count < config->point_count; index->count++)
		add(index, config, index->count);
	return true;
}

uint32_t config_index_name(const struct config_index *index, const struct map_config *config,
			   const char *name)
{
	char other[MAP_NAME_SIZE];

	for (uint32_t place = map_hash_octets(MAP_HASH_BASIS, name, strlen(name));; place++) {
		const uint32_t point = index->size == 0 ? 0 : index->by_name[place & (index->size - 1)];

		if (point == 0)
			return NONE;
		map_point_name(config, &config->points[point - 1], other);
		if (strcmp(other, name) == 0)
			return point - 1;
	}
}

uint32_t config_index_ioa(const struct config_index *index, const struct map_config *config, uint32_t set,
			  uint32_t ioa)
{
	for (uint32_t place = hash_of_address(set, ioa);; place++) {
		const uint32_t point = index->size == 0 ? 0 : index->by_ioa[place & (index->size - 1)];

		if (point == 0)
			return NONE;
		if (config->points[point - 1].set == set && config->points[point - 1].ioa == ioa)
			return point - 1;
	}
}

void config_index_free(struct config_index *index)
{
	free(index->by_name);
	free(index->by_ioa);
	*index = (struct config_index){.size = 0};
}
