/* SPDX-License-Identifier: GPL-3.0-or-later */
/* IP addresses in the file. */
#ifndef OPENRTU_CONFIG_ADDRESS_H
#define OPENRTU_CONFIG_ADDRESS_H

#include "config/keys.h"
#include "map/config.h"

bool config_is_same_address(const char *a, const char *b);
/* An IP address at a place; out is left as it is when it is none. */
void config_read_address(struct config_report *report, const struct config_place *place, const char *text,
			 char out[MAP_ADDRESS_SIZE]);
/* An array of them, for which out has room. Returns how many there are. */
uint32_t config_read_addresses(struct config_report *report, const struct config_place *array,
			       const json_t *addresses, char (*out)[MAP_ADDRESS_SIZE]);

#endif
