/* SPDX-License-Identifier: GPL-3.0-or-later */
#include "process/module.h"

#include <errno.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <sys/prctl.h>

#include "process/confine.h"

struct map *module_begin(int argc, char **argv, struct options *options)
{
	char error[MAP_ERROR_SIZE];
	struct map *map;

	if (!options_parse(argc, argv, options))
		exit(MODULE_USAGE);
	if (map_attach(&map, options->map, options->module, error) < 0) {
		fprintf(stderr, "%s: %s: %s\n", options->module, options->map, error);
		exit(MODULE_FAILED);
	}
	prctl(PR_SET_NAME, options->module); /* rtud executes a descriptor, whose number would be its name */
	return map;
}

int module_is_of_another_build(struct map *map)
{
	map_log(map, MAP_LOG_ERROR,
		"the map has records of other sizes: restart rtud and all modules with the same version");
	return MODULE_FAILED;
}

bool module_confine(struct map *map, const struct options *options, size_t file_size)
{
	if (confine(map, options->filter_fd, file_size) == 0)
		return true;
	map_log(map, MAP_LOG_ERROR, "cannot be confined: %s", strerror(errno));
	return false;
}
