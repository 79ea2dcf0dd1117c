/* SPDX-License-Identifier: GPL-3.0-or-later */
#include "rtuctl/renew.h"

bool renew_map(struct map *map)
{
	struct map_config before;
	char error[MAP_ERROR_SIZE];

	if (!map_is_changed(map) || map_renew(map, &before, error) < 0)
		return false; /* yet another one may just have followed: the next look has it */
	map_forget(map);
	return true;
}
