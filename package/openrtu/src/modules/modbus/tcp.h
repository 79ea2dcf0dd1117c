/* SPDX-License-Identifier: GPL-3.0-or-later */
/* A TCP connection as a Modbus line needs it. Nothing here blocks. */
#ifndef OPENRTU_MODULES_MODBUS_TCP_H
#define OPENRTU_MODULES_MODBUS_TCP_H

#include "map/config.h"
#include "modbus/config.h"

#define TCP_ERROR_SIZE 96

enum tcp_state { TCP_PENDING, TCP_CONNECTED, TCP_FAILED };

/*
 * Begins a connection to the line's address and port. Returns a non-blocking descriptor, which becomes writable when the
 * connection is decided, or -1 with a message in error (TCP_ERROR_SIZE bytes).
 */
int tcp_connect(const struct modbus_port *line, char *error);

/* What has become of it; TCP_FAILED: with a message in error. */
enum tcp_state tcp_look(int fd, char *error);

#endif
