/* SPDX-License-Identifier: GPL-3.0-or-later */
/*
 * What a line makes of Modbus ASCII: it gives each frame that has come whole to what reads RTU, with a CRC for its LRC. Late answers,
 * echoes and strangers are told apart there, for both.
 */
#include "line_parts.h"

static void abandon(struct modbus_line *line, size_t characters)
{
	line->counters.noise_bytes += (uint32_t)characters;
}

/* Characters of the frame that has begun. */
static size_t begun(const struct modbus_ascii *ascii)
{
	return ascii->begun ? 1 + 2 * ascii->length + ascii->half : 0;
}

static void take_frame(struct modbus_line *line, bool is_sound, int64_t now_ns)
{
	const uint16_t crc = modbus_crc(line->ascii.body, line->ascii.length);
	const uint16_t sealed = is_sound ? crc : (uint16_t)~crc;
	const uint8_t end[MODBUS_CRC_LENGTH] = {(uint8_t)(sealed & 0xFF), (uint8_t)(sealed >> 8)};

	modbus_take_octets(line, line->ascii.body, line->ascii.length, line->ascii_began_ns, now_ns);
	modbus_take_octets(line, end, sizeof(end), line->ascii_began_ns, now_ns);
}

static void take_character(struct modbus_line *line, uint8_t character, int64_t now_ns)
{
	const size_t before = begun(&line->ascii);

	switch (modbus_ascii_take(&line->ascii, character)) {
	case MODBUS_ASCII_BEGUN:
		if (character != ':')
			return;
		abandon(line, before);
		line->ascii_began_ns = now_ns;
		return;
	case MODBUS_ASCII_SOUND:
		take_frame(line, true, now_ns);
		return;
	case MODBUS_ASCII_GARBLED:
		take_frame(line, false, now_ns);
		return;
	case MODBUS_ASCII_NOISE:
		abandon(line, before + 1);
		return;
	}
}

static bool receive(struct modbus_line *line, const uint8_t *bytes, size_t length, int64_t now_ns)
{
	if (line->ascii.begun && now_ns - line->last_byte_ns > MODBUS_ASCII_GAP_NS) {
		abandon(line, begun(&line->ascii));
		line->ascii.begun = false;
	}
	line->last_byte_ns = now_ns;
	line->listen_ns = 0;
	if (line->state != MODBUS_WAITING)
		modbus_note_unrest(line, now_ns);
	for (size_t i = 0; i < length; i++)
		take_character(line, bytes[i], now_ns);
	return true;
}

static size_t encode(const struct modbus_line *line, uint8_t text[MODBUS_ASCII_REQUEST_MAX])
{
	return modbus_ascii_frame(line->frame, line->frame_length - MODBUS_CRC_LENGTH, text);
}

const struct modbus_framer modbus_ascii_framer = {.build = modbus_build_rtu,
						  .encode = encode,
						  .receive = receive,
						  .remember_unanswered = modbus_remember_unanswered,
						  .rest_ns = MODBUS_GAP_NS,
						  .answers_are_alike = true};
