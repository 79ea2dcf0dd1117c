/* SPDX-License-Identifier: GPL-3.0-or-later */
#ifndef OPENRTU_MODBUS_CONFIG_PART_H
#define OPENRTU_MODBUS_CONFIG_PART_H

#include "config/page.h"
#include "config/part.h"

/* "port" and "modbus", and the devices of "templates"; its own is struct modbus_loader. */
extern const struct config_part modbus_part;

/* Of each device in "templates". */
extern const struct config_table modbus_template_table;
/* What the gateway's page may change of them. */
extern const struct config_inside modbus_templates_inside;

#endif
