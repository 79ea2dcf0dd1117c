/* SPDX-License-Identifier: GPL-3.0-or-later */
#include "rows/frames.h"

#include <stdio.h>
#include <string.h>

#include "map/time_ns.h"
#include "modbus/config.h"
#include "modbus/describe.h"
#include "modbus/stats.h"
#include "rows/words.h"

#define GAP_NS (50 * NS_PER_MS) /* between two pieces of one frame, at the most */

struct taking {
	const struct map *map;
	struct frame_source *source;
	frame_taker *taker;
	void *context;
};

static bool describe(const struct map *map, const struct frame *frame, char words[MODBUS_WORDS_SIZE])
{
	const struct modbus_port *port = &modbus_ports(map_config(map))[frame->line];

	return modbus_describe((enum modbus_framing)port->framing, frame->direction, frame->octets,
			       frame->length, words);
}

static void end_frame(const struct taking *taking)
{
	struct frame *begun = &taking->source->begun;

	if (begun->length > 0)
		taking->taker(taking->context, begun);
	begun->length = 0;
}

static bool goes_on(const struct frame_source *source, const struct modbus_piece *piece)
{
	return source->begun.length > 0 && piece->direction == MODBUS_RECEIVED &&
	       piece->time_ns - source->last_ns < GAP_NS &&
	       source->begun.length + piece->length <= FRAME_OCTETS;
}

static bool is_whole(const struct map *map, const struct frame *frame)
{
	char words[MODBUS_WORDS_SIZE];

	return frame->direction == MODBUS_SENT || describe(map, frame, words);
}

static void take_piece(const struct taking *taking, const struct modbus_piece *piece)
{
	struct frame_source *source = taking->source;
	struct frame *begun = &source->begun;

	if (!goes_on(source, piece)) {
		end_frame(taking);
		begun->line = source->line;
		begun->direction = piece->direction;
		begun->time_ns = piece->time_ns;
	}
	memcpy(begun->octets + begun->length, piece->octets, piece->length);
	begun->length += piece->length;
	source->last_ns = piece->time_ns;
	if (is_whole(taking->map, begun))
		end_frame(taking);
}

void frames_take(const struct map *map, struct frame_source *source, frame_taker *taker, void *context)
{
	const struct taking taking = {.map = map, .source = source, .taker = taker, .context = context};
	struct modbus_piece piece;

	modbus_frames_look(modbus_line_frames(map, source->line), &source->reader);
	while (modbus_frames_next(&source->reader, &piece))
		take_piece(&taking, &piece);
	if (map_now_ns() - source->last_ns > GAP_NS)
		end_frame(&taking);
}

json_t *rows_frame(const struct map *map, const struct frame *frame)
{
	char time[WORDS_SIZE], words[MODBUS_WORDS_SIZE], octets[2 * FRAME_OCTETS + 1] = "";

	words_time_us(map_wall_ns(map_clock_read(map), frame->time_ns), time);
	describe(map, frame, words);
	for (size_t i = 0; i < frame->length; i++)
		snprintf(octets + 2 * i, 3, "%02x", frame->octets[i]);
	return json_pack("{s:s, s:i, s:s, s:s, s:s}", "time", time, "port",
			 (int)modbus_ports(map_config(map))[frame->line].port, "direction",
			 frame->direction == MODBUS_SENT ? "sent" : "received", "octets", octets, "text",
			 words);
}
