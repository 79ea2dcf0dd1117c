/* SPDX-License-Identifier: GPL-3.0-or-later */
#ifndef OPENRTU_WEB_CONFIG_PART_H
#define OPENRTU_WEB_CONFIG_PART_H

#include "config/part.h"

extern const struct config_part web_part;

#endif
