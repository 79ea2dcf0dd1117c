/* SPDX-License-Identifier: GPL-3.0-or-later */
/* A TCP connection, or datagrams, as a Modbus line or a receiver behind gpsd needs it. Nothing here blocks. */
#ifndef OPENRTU_CHANNEL_TCP_H
#define OPENRTU_CHANNEL_TCP_H

#include <stdint.h>

#define TCP_ERROR_SIZE 96

enum tcp_state { TCP_PENDING, TCP_CONNECTED, TCP_FAILED };

/*
 * Begins a connection to an IPv4 or IPv6 address and a port. Returns a non-blocking descriptor, which becomes writable when the
 * connection is decided, or -1 with a message in error (TCP_ERROR_SIZE bytes).
 */
int tcp_connect(const char *address, uint16_t port, char *error);

/* A socket of UDP that hears nobody but this address and port; the rest as tcp_connect. */
int udp_connect(const char *address, uint16_t port, char *error);

/* What has become of it; TCP_FAILED: with a message in error. */
enum tcp_state tcp_look(int fd, char *error);

#endif
