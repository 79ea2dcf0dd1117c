/* SPDX-License-Identifier: GPL-3.0-or-later */
/* A line of the configuration as this room knows it: rtu-modbus polls it, rtud --check computes its limit. */
#ifndef OPENRTU_MODBUS_CONFIGURED_H
#define OPENRTU_MODBUS_CONFIGURED_H

#include <stdbool.h>
#include <stdint.h>

#include "line.h"
#include "map/config.h"
#include "modbus/config.h"

/* Bits of one character of a serial line: start, data, parity, stop. */
unsigned modbus_bits_per_char(const struct modbus_port *line);

/* Durations of a line in ns, what its port takes to switch the direction included; of a TCP connection, too. */
struct modbus_wire modbus_wire_of(const struct modbus_port *line);

/* That of what is in the table. */
uint8_t modbus_read_function(enum modbus_table table);

/* What the file says that a device takes. */
struct modbus_limits modbus_limits_of(const struct modbus_slave *slave);

/*
 * Makes line number of the configuration: its devices with their objects, whose tags are the indices of their
 * points, its durations, room for its commands; and plans its reads (modbus_line_init). Events and context stay as
 * they are. False without memory; modbus_line_release frees what there is either way.
 */
bool modbus_line_configure(struct modbus_line *line, const struct map_config *config, uint32_t number);
void modbus_line_release(struct modbus_line *line);

#endif
