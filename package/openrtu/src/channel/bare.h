/* SPDX-License-Identifier: GPL-3.0-or-later */
/* Octets of a socket as they are: channel_receive and channel_transmit of a connection without TLS. */
#ifndef OPENRTU_CHANNEL_BARE_H
#define OPENRTU_CHANNEL_BARE_H

#include <stdint.h>
#include <sys/types.h>

ssize_t bare_receive(int fd, uint8_t *place, size_t size);
ssize_t bare_transmit(int fd, const uint8_t *bytes, size_t size);

#endif
