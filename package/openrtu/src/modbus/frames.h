/* SPDX-License-Identifier: GPL-3.0-or-later */
/*
 * What went over a line last, in both directions: a ring of octets with their times, always written, so that whoever looks for
 * a fault sees what was before it. Its owner writes; others read without being noticed.
 */
#ifndef OPENRTU_MODBUS_FRAMES_H
#define OPENRTU_MODBUS_FRAMES_H

#include <stdatomic.h>
#include <stdbool.h>
#include <stddef.h>
#include <stdint.h>

#define MODBUS_FRAMES_SIZE 8192U /* of a ring; a power of two: some 200 short requests and their answers */
#define MODBUS_PIECE_MAX   512U  /* octets that are kept of a piece */

enum modbus_direction { MODBUS_SENT, MODBUS_RECEIVED };

/* Positions count octets and wrap. oldest..ended: whole pieces. */
struct modbus_frames {
	_Atomic uint32_t oldest, ended;
	uint8_t octets[MODBUS_FRAMES_SIZE];
};

/* What was given to a port, or taken from it, at once. An answer may come in several. */
struct modbus_piece {
	int64_t time_ns; /* CLOCK_MONOTONIC */
	enum modbus_direction direction;
	size_t length;
	uint8_t octets[MODBUS_PIECE_MAX];
};

/* Owner. Of more than MODBUS_PIECE_MAX octets the first are kept. */
void modbus_frames_add(struct modbus_frames *frames, enum modbus_direction direction, const uint8_t *octets,
		       size_t length, int64_t time_ns);

/* All zeros: it has read nothing. */
struct modbus_frames_reader {
	bool has_begun;
	bool has_lost;    /* some were overwritten before they were read; the caller's to clear */
	uint32_t at, end; /* what is copied and not yet taken */
	uint8_t octets[MODBUS_FRAMES_SIZE];
};

/* Anybody: copies what has come since the last time, at first all that is kept. */
void modbus_frames_look(const struct modbus_frames *frames, struct modbus_frames_reader *reader);
/* The next piece of what was copied; false: there is none. */
bool modbus_frames_next(struct modbus_frames_reader *reader, struct modbus_piece *piece);

#endif
