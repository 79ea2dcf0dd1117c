/* SPDX-License-Identifier: GPL-3.0-or-later */
#ifndef OPENRTU_LOGIC_CONFIG_PART_H
#define OPENRTU_LOGIC_CONFIG_PART_H

#include "config/part.h"

/* "logic": the programs that the gateway runs. */
extern const struct config_part logic_part;

#endif
