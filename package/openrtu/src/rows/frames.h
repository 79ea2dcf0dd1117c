/* SPDX-License-Identifier: GPL-3.0-or-later */
/* Frames of lines, put together of what went over their ports piece by piece: those of rtuctl frames and of the page. */
#ifndef OPENRTU_ROWS_FRAMES_H
#define OPENRTU_ROWS_FRAMES_H

#include <stdbool.h>
#include <stddef.h>
#include <stdint.h>

#include <jansson.h>

#include "map/map.h"
#include "modbus/frames.h"

#define FRAME_OCTETS (2 * MODBUS_PIECE_MAX)

struct frame {
	uint32_t line; /* of the configuration */
	enum modbus_direction direction;
	int64_t time_ns; /* of its first piece */
	size_t length;   /* of what is no sound frame, too */
	uint8_t octets[FRAME_OCTETS];
};

/* A line that is looked at. All zeros but the line: nothing was read of it. */
struct frame_source {
	uint32_t line;
	struct modbus_frames_reader reader;
	struct frame begun; /* length 0: none */
	int64_t last_ns;    /* of its last piece */
};

typedef void frame_taker(void *context, const struct frame *frame);

/*
 * Gives what has come since the last time, in order; at first all that is kept. What has only begun is given when its end
 * does not come any more.
 */
void frames_take(const struct map *map, struct frame_source *source, frame_taker *taker, void *context);

/* Time, port, direction, octets in hexadecimal, and text: the frame in words. A new reference, NULL without memory. */
json_t *rows_frame(const struct map *map, const struct frame *frame);

#endif
