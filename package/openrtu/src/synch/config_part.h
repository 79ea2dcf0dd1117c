/* SPDX-License-Identifier: GPL-3.0-or-later */
#ifndef OPENRTU_SYNCH_CONFIG_PART_H
#define OPENRTU_SYNCH_CONFIG_PART_H

#include "config/part.h"

/* "synch", "start" and "net". */
extern const struct config_part synch_part;

#endif
