/* SPDX-License-Identifier: GPL-3.0-or-later */
/*
 * Modbus TCP frames: MODBUS Messaging on TCP/IP Implementation Guide V1.0b, 3.1. The MBAP header, which is transaction,
 * protocol, length and unit, stands before the PDU; there is no CRC.
 */
#ifndef OPENRTU_MODBUS_MBAP_H
#define OPENRTU_MODBUS_MBAP_H

#include <stddef.h>
#include <stdint.h>

#include "frame.h"

#define MODBUS_MBAP_PREFIX    6 /* transaction, protocol, length: two octets each */
#define MODBUS_MBAP_FRAME_MAX 260

/* Puts the header before a body that stands behind its place in the frame. Returns the frame's length. */
size_t modbus_mbap_seal(uint8_t *frame, uint16_t transaction, size_t body);

/*
 * Length of the whole frame that begins with these octets: at most MODBUS_MBAP_FRAME_MAX, and more than
 * there are until its length field has come. 0: no frame of Modbus begins so, and where the next one does is unknown.
 */
size_t modbus_mbap_length(const uint8_t *bytes, size_t length);

#endif
