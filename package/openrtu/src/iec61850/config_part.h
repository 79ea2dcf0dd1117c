/* SPDX-License-Identifier: GPL-3.0-or-later */
#ifndef OPENRTU_IEC61850_CONFIG_PART_H
#define OPENRTU_IEC61850_CONFIG_PART_H

#include "config/part.h"

/* "iec61850": an object; without it there is no server. */
extern const struct config_part iec61850_part;

#endif
