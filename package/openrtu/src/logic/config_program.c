/* SPDX-License-Identifier: GPL-3.0-or-later */
/* The compiled program of an instance. */
#include <errno.h>
#include <fcntl.h>
#include <stdlib.h>
#include <string.h>
#include <sys/stat.h>
#include <unistd.h>

#include "logic/config_readers.h"

#define SIZE_MAX_OCTETS (1u << 20)

const struct config_place *logic_place_key(struct logic_place *place, const struct logic_reading *reading,
					   const char *key)
{
	place->file = (struct config_place){.in = NULL};
	place->array = config_key_of(&place->file, LOGIC_KEY);
	place->instance = config_element_of(&place->array, reading->element);
	place->key = config_key_of(&place->instance, key);
	return &place->key;
}

const struct config_place *logic_place_point(struct logic_place *place, const struct logic_reading *reading,
					     uint32_t point)
{
	logic_place_key(place, reading, "points");
	place->point = config_element_of(&place->key, point);
	return &place->point;
}

const struct logic_point *logic_find_point(const struct logic *logic, const char *name)
{
	for (uint16_t i = 0; i < logic->head->points; i++)
		if (strcmp(logic_name(logic, logic->points[i].name), name) == 0)
			return &logic->points[i];
	return NULL;
}

bool logic_decides(const struct logic *logic, const char *name)
{
	for (uint16_t i = 0; i < logic->head->requests; i++)
		if (strcmp(logic_name(logic, logic->requests[i].name), name) == 0)
			return true;
	return false;
}

/* Relative to the folder of the configuration. NULL: no memory. */
static char *path_of(const struct config_loader *loader, const char *path)
{
	const char *slash = strrchr(loader->files[0].path, '/');
	int folder = path[0] == '/' || slash == NULL ? 0 : (int)(slash + 1 - loader->files[0].path);
	char *whole;

	return asprintf(&whole, "%.*s%s", folder, loader->files[0].path, path) < 0 ? NULL : whole;
}

/* Returns its octets, or NULL with the reason. A program is no pipe, nor endless. */
static uint8_t *read_octets(const char *path, uint32_t *size, const char **reason)
{
	struct stat status = {.st_size = 0};
	int fd = open(path, O_RDONLY | O_CLOEXEC | O_NONBLOCK | O_NOCTTY);
	uint8_t *octets = NULL;

	*reason = "is no file of at most 1 MiB";
	if (fd >= 0 && fstat(fd, &status) == 0 && S_ISREG(status.st_mode) &&
	    status.st_size <= SIZE_MAX_OCTETS)
		octets = malloc((size_t)status.st_size + 1);
	if (octets != NULL && read(fd, octets, (size_t)status.st_size) != status.st_size) {
		free(octets);
		octets = NULL;
	}
	if (fd < 0)
		*reason = strerror(errno);
	else
		close(fd);
	*size = (uint32_t)status.st_size;
	return octets;
}

static const char *load(struct logic_reading *reading)
{
	size_t memory = logic_memory(reading->file, reading->instance->size);

	if (memory == 0)
		return "it is no compiled program, or of another version";
	reading->instance->memory = (uint32_t)memory;
	reading->memory = malloc(memory);
	if (reading->memory == NULL)
		return "out of memory";
	return logic_load(&reading->logic, reading->memory, reading->file, reading->instance->size);
}

static void count_kept(struct logic_reading *reading)
{
	const struct logic *logic = &reading->logic;

	for (uint16_t i = 0; i < logic->head->retained; i++)
		*(logic->retained[i].ends_with_power ? &reading->instance->remembered
						     : &reading->instance->retained) +=
		    logic->retained[i].slots;
	reading->instance->commands = logic->head->commands;
}

bool logic_read_program(struct config_loader *loader, struct logic_reading *reading, const char *path)
{
	struct logic_place place;
	const struct config_place *here = logic_place_key(&place, reading, "program");
	char *whole = path_of(loader, path);
	const char *refusal = NULL;

	if (whole == NULL) {
		config_out_of_memory(&loader->report);
		return false;
	}
	reading->file = read_octets(whole, &reading->instance->size, &refusal);
	if (reading->file == NULL) {
		config_error(&loader->report, here, "\"%s\": %s", whole, refusal);
	} else {
		refusal = load(reading);
		if (refusal != NULL)
			config_error(&loader->report, here,
				     "\"%s\": %s, expected a file that openrtu logic compile has written",
				     whole, refusal);
		else
			count_kept(reading);
	}
	free(whole);
	return refusal == NULL;
}
