/* SPDX-License-Identifier: GPL-3.0-or-later */
#ifndef OPENRTU_GPS_CONFIG_PART_H
#define OPENRTU_GPS_CONFIG_PART_H

#include "config/part.h"

/* "gps": an array of receivers; without it there is none. */
extern const struct config_part gps_part;

#endif
