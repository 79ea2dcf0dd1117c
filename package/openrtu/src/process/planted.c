/* SPDX-License-Identifier: GPL-3.0-or-later */
/*
 * A module that somebody else's code runs in, for tests/gateway/test_supervise.py: it starts as all do, works for a moment, and
 * executes a program.
 */
#include <unistd.h>

#include "process/module.h"

int main(int argc, char **argv)
{
	struct options options;
	struct map *map = module_begin(argc, argv, &options);

	if (!module_confine(map, &options, 0))
		return MODULE_FAILED;
	map_log(map, MAP_LOG_INFO, "works");
	execl("/bin/true", "true", NULL);
	map_log(map, MAP_LOG_ERROR, "execve has returned");
	return MODULE_FAILED;
}
