/* SPDX-License-Identifier: GPL-3.0-or-later */
/* The consumer's requests, as they come from the socket. */
#ifndef OPENRTU_CENTRE_REQUEST_H
#define OPENRTU_CENTRE_REQUEST_H

#include <stdbool.h>
#include <stddef.h>

#include "centre/records.h"
#include "iec104/asdu.h"

/*
 * Reads the request at an octet of a packet. False: what is there is none: too short, an unknown kind, octets that are to be
 * zero and are not. Who sends that speaks another protocol.
 */
bool centre_request_read(const uint8_t *octets, size_t size, struct centre_request *out);

/* A command as a station takes it. False: its value or its qualifier is none of its type. */
bool centre_request_command(const struct centre_request *request, struct iec104_command *out);

#endif
