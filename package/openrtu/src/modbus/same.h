/* SPDX-License-Identifier: GPL-3.0-or-later */
/* Whether a point of two configurations is the same to Modbus. */
#ifndef OPENRTU_MODBUS_SAME_H
#define OPENRTU_MODBUS_SAME_H

#include "map/config.h"

bool modbus_same_point(const struct map_config *a, uint32_t in_a, const struct map_config *b, uint32_t in_b);

#endif
