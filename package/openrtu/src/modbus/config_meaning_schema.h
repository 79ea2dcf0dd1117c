/* SPDX-License-Identifier: GPL-3.0-or-later */
/* What of the schema of a slave's objects comes from modbus_meanings: functions for `add` of a struct config_table. */
#ifndef OPENRTU_MODBUS_CONFIG_MEANING_SCHEMA_H
#define OPENRTU_MODBUS_CONFIG_MEANING_SCHEMA_H

#include "modbus/config_object.h"

/* Each adds to the schema of an object. False: there is no memory. */

/* Of bits, in a table of bits or in a register: what their type gives no meaning. */
bool modbus_put_bit_meanings(json_t *schema);
/* The same of what fills registers. */
bool modbus_put_register_meanings(json_t *schema);
/* What is only written has no keys of what is read. */
bool modbus_put_write_only(json_t *schema);
/* Where nothing but a write_address makes something to command, no other key of commands means anything. */
bool modbus_put_commands(json_t *schema);

#endif
