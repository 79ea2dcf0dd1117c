/* SPDX-License-Identifier: GPL-3.0-or-later */
#ifndef OPENRTU_IEC104_CONFIG_PART_H
#define OPENRTU_IEC104_CONFIG_PART_H

#include "config/part.h"

/* "iec104", "tls", and who may connect, command and is redundant. */
extern const struct config_part iec104_part;

#endif
