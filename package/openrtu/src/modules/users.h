/* SPDX-License-Identifier: GPL-3.0-or-later */
/* Users of modules whose number is not fixed. */
#ifndef OPENRTU_MODULES_USERS_H
#define OPENRTU_MODULES_USERS_H

#include "map/config.h"

#define LAST_FREE_USER 13 /* gps has 15, iec104m 14 */

static inline bool user_is_taken(const struct map_config *config, uint32_t user)
{
	for (uint32_t i = 0; i < config->module_count; i++)
		if (config->modules[i].user == user)
			return true;
	return false;
}

/* The highest that no module has: all others count up, and a map has too few modules for the two to meet. */
static inline uint32_t free_user(const struct map_config *config)
{
	uint32_t user = LAST_FREE_USER;

	while (user > 1 && user_is_taken(config, user))
		user--;
	return user;
}

#endif
