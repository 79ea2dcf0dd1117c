/* SPDX-License-Identifier: GPL-3.0-or-later */
/* What the agent's engine needs of files: how often it has booted, and the keys. */
#ifndef OPENRTU_MODULES_SNMP_ENGINE_H
#define OPENRTU_MODULES_SNMP_ENGINE_H

#include <stdbool.h>
#include <stdint.h>

#include "map/map.h"
#include "snmp/keys.h"

/*
 * Counts a boot, and returns only when that is on the flash: an answer that was authentic before a boot never is again (RFC
 * 3414, 2.2). False: the log says why; the agent must not answer.
 */
bool engine_count_boot(struct map *map, const char *folder, uint32_t *boots);
/* Reads the keys. False: the log says why. */
bool engine_read_keys(struct map *map, const struct snmp_settings *settings, struct snmp_keyring *ring);

#endif
