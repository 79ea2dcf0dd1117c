/* SPDX-License-Identifier: GPL-3.0-or-later */
/* A frame in words, for who looks at a line. */
#ifndef OPENRTU_MODBUS_DESCRIBE_H
#define OPENRTU_MODBUS_DESCRIBE_H

#include <stdbool.h>
#include <stddef.h>
#include <stdint.h>

#include "modbus/frame.h"
#include "modbus/frames.h"

#define MODBUS_WORDS_SIZE 160

/*
 * "unit 3: read 10 holding registers from 100", in out, of MODBUS_WORDS_SIZE; what has no room there is left out. False: the
 * octets are no sound frame, and out says that.
 */
bool modbus_describe(enum modbus_framing framing, enum modbus_direction direction, const uint8_t *octets,
		     size_t length, char *out);

#endif
