/* SPDX-License-Identifier: GPL-3.0-or-later */
/* A serial port as a Modbus line needs it. */
#ifndef OPENRTU_MODULES_MODBUS_SERIAL_H
#define OPENRTU_MODULES_MODBUS_SERIAL_H

#include <stdbool.h>
#include <stddef.h>

#include "map/config.h"
#include "modbus/config.h"

#define SERIAL_ERROR_SIZE 96

/*
 * Opens the port for us alone, raw, non-blocking, 8 data bits, with the line's baud rate, parity and
 * stop bits, and RS-485 mode, and checks what it took. *carries_parity is false for a pseudo-terminal, which has none to
 * carry. Returns the descriptor, or -1 with a message in error (SERIAL_ERROR_SIZE bytes).
 */
int serial_open(const char *path, const struct modbus_port *line, bool *carries_parity, char *error);

/*
 * Whether the port still has what serial_open set: another program that may open it, as root may in spite of us, may
 * have set something else. A pseudo-terminal always has: its settings are those of its other side as well.
 */
bool serial_is_as_set(int fd, const struct modbus_port *line);

/* Forgets what was written and has not been sent. */
void serial_discard_output(int fd);

/* Closes the port at once: close alone waits up to 30 s for what a stuck port has not sent. */
void serial_close(int fd);

#endif
