/* SPDX-License-Identifier: GPL-3.0-or-later */
/*
 * Modbus ASCII frames: MODBUS over Serial Line V1.02, 2.5.2. A colon, two hexadecimal digits an octet, the octets' LRC, CR and LF.
 * No silence divides frames, and up to a second may pass between two characters.
 */
#ifndef OPENRTU_MODBUS_ASCII_H
#define OPENRTU_MODBUS_ASCII_H

#include <stdbool.h>
#include <stddef.h>
#include <stdint.h>

#include "frame.h"

#define MODBUS_ASCII_BODY_MAX    254          /* unit and PDU */
#define MODBUS_ASCII_REQUEST_MAX 513          /* characters of the longest frame */
#define MODBUS_ASCII_GAP_NS      1000000000LL /* between two characters; */
#define MODBUS_ASCII_GAPS_NS     5000000000LL /* all of a frame's together: who pauses has the line */

enum modbus_ascii_state {
	MODBUS_ASCII_BEGUN,
	MODBUS_ASCII_SOUND,   /* this was its end; body has it */
	MODBUS_ASCII_GARBLED, /* its LRC is wrong */
	MODBUS_ASCII_NOISE,   /* what has come is none */
};

struct modbus_ascii {
	bool begun, half;
	uint8_t high;
	size_t length;                           /* of body */
	uint8_t body[MODBUS_ASCII_BODY_MAX + 1]; /* and the LRC */
};

/* Takes a character. Behind an end, length is that of unit and PDU. */
enum modbus_ascii_state modbus_ascii_take(struct modbus_ascii *ascii, uint8_t character);

/* A body's frame, in text; returns its length. */
size_t modbus_ascii_frame(const uint8_t *body, size_t length, uint8_t text[MODBUS_ASCII_REQUEST_MAX]);

#endif
