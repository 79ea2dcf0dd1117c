/* SPDX-License-Identifier: GPL-3.0-or-later */
/* What the gateway itself writes to devices: the constants of the configuration, as requests. */
#ifndef OPENRTU_MODULES_MODBUS_CONSTANTS_H
#define OPENRTU_MODULES_MODBUS_CONSTANTS_H

#include "map/config.h"
#include "modbus/line.h"

/* Fills in the requests of the device's constants, as a command of their points would be written. */
void constants_make(const struct map_config *config, struct modbus_device *device);

#endif
