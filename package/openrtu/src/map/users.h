/* SPDX-License-Identifier: GPL-3.0-or-later */
/* Users of modules whose number is not fixed. */
#ifndef OPENRTU_MAP_USERS_H
#define OPENRTU_MAP_USERS_H

#include "map/config.h"

/*
 * 1 to 20 are of our kinds: 3 to 8 of the first lines, 14 and on of kinds with one module. From 21 on those of others count up,
 * and from the end the free ones count down, once the few below 14 are given away.
 */
#define FIRST_FREE_USER    9
#define LAST_FREE_USER     13
#define FIRST_FOREIGN_USER 21
#define LAST_USER          (FIRST_FOREIGN_USER + MAP_MODULES_MAX - 1)

/* A module that is gone has no process. */
static inline bool user_is_taken(const struct map_config *config, uint32_t user)
{
	for (uint32_t i = 0; i < config->module_count; i++)
		if (config->modules[i].user == user && !(config->modules[i].flags & MAP_IS_GONE))
			return true;
	return false;
}

/* A map has too few modules for all of them to be taken. */
static inline uint32_t free_user(const struct map_config *config)
{
	uint32_t user = LAST_FREE_USER;

	while (user_is_taken(config, user))
		user = user == FIRST_FREE_USER ? LAST_USER : user - 1;
	return user;
}

#endif
