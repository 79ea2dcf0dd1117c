/* SPDX-License-Identifier: GPL-3.0-or-later */
/*
 * The frame log: on standard output in the words of the report's figures 5.4, 5.5 and 5.8, and as JSON lines
 * for whoever listens on the control socket.
 */
#ifndef LINESIM_TRACE_H
#define LINESIM_TRACE_H

#include <stdbool.h>
#include <stddef.h>
#include <stdint.h>

#include "slave.h"

enum trace_kind { TRACE_RECEIVED, TRACE_SENT, TRACE_CRC_ERROR, TRACE_COLLISION };

enum trace_wish { TRACE_NOTHING, TRACE_WRITES, TRACE_ALL };

/* Takes one JSON line, newline included. writes: it is of a value that was written. */
typedef void trace_listener(const char *line, size_t size, bool writes);

void trace_to_stdout(void);
void trace_listen(trace_listener *listener, enum trace_wish wish);

/* A frame on a line. fault: what was done to it on purpose, SLAVE_HEALTHY: nothing. */
void trace_frame(uint16_t port, uint8_t unit, enum trace_kind kind, const uint8_t *bytes, size_t size,
		 enum slave_fault_kind fault);

/* The values that a request read or wrote. */
void trace_access(uint16_t port, const struct slave *slave, const struct slave_access *access);

#endif
