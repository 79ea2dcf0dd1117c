/* SPDX-License-Identifier: GPL-3.0-or-later */
#ifndef OPENRTU_FOREIGN_CONFIG_PART_H
#define OPENRTU_FOREIGN_CONFIG_PART_H

#include "config/part.h"

/* "modules". Behind all parts that add points, since its modules read them. */
extern const struct config_part foreign_part;

#endif
