/* SPDX-License-Identifier: GPL-3.0-or-later */
/*
 * A module that somebody else's code runs in, for tests/test_supervise.py: it starts as all do, works for a moment, and
 * executes a program.
 */
#include <stdlib.h>
#include <sys/prctl.h>
#include <unistd.h>

#include "map/map.h"
#include "modules/confine.h"
#include "modules/options.h"

int main(int argc, char **argv)
{
	struct options options;
	char error[MAP_ERROR_SIZE];
	struct map *map;

	if (!options_parse(argc, argv, &options) || map_attach(&map, options.map, options.module, error) < 0)
		return EXIT_FAILURE;
	prctl(PR_SET_NAME, options.module);
	if (confine(map, options.filter_fd, 0) < 0)
		return EXIT_FAILURE;
	map_log(map, MAP_LOG_INFO, "works");
	execl("/bin/true", "true", NULL);
	map_log(map, MAP_LOG_ERROR, "execve has returned");
	return EXIT_FAILURE;
}
