/* SPDX-License-Identifier: GPL-3.0-or-later */
#ifndef OPENRTU_IEC104_CONFIG_OUTSTATIONS_H
#define OPENRTU_IEC104_CONFIG_OUTSTATIONS_H

#include "config/part.h"

extern const struct config_part iec104_outstations_part;

#endif
