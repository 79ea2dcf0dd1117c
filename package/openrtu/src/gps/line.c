/* SPDX-License-Identifier: GPL-3.0-or-later */
#include "gps/line.h"

#define CHECKSUM_SIZE 3 /* "*" and two digits */

static int hex_digit(char c)
{
	if (c >= '0' && c <= '9')
		return c - '0';
	if (c >= 'A' && c <= 'F')
		return c - 'A' + 10;
	return c >= 'a' && c <= 'f' ? c - 'a' + 10 : -1;
}

/* The text lies between "$" and the line's end. */
static bool is_sound(const char *text, size_t size)
{
	uint8_t sum = 0;
	int high, low;

	if (size <= CHECKSUM_SIZE || text[size - CHECKSUM_SIZE] != '*')
		return false;
	high = hex_digit(text[size - 2]);
	low = hex_digit(text[size - 1]);
	for (size_t i = 0; i < size - CHECKSUM_SIZE; i++)
		sum ^= (uint8_t)text[i];
	return high >= 0 && low >= 0 && sum == (high << 4 | low);
}

static bool split(const char *text, size_t size, struct nmea_sentence *out)
{
	size_t begin = 0;

	out->count = 0;
	for (size_t at = 0; at <= size; at++) {
		if (at < size && text[at] != ',')
			continue;
		if (out->count == NMEA_FIELDS_MAX)
			return false;
		out->fields[out->count++] = (struct nmea_text){text + begin, at - begin};
		begin = at + 1;
	}
	return true;
}

/* What ends before a line begins, or with the line. */
static void leave(struct nmea_line *line, enum nmea_state next)
{
	line->counters[NMEA_STRAY] += line->state == NMEA_AMONG_STRAY;
	line->state = next;
}

static void drop(struct nmea_line *line)
{
	line->counters[NMEA_DAMAGED]++;
	line->state = NMEA_DROPPED;
}

static bool end_line(struct nmea_line *line, struct nmea_sentence *out)
{
	if (line->state == NMEA_INSIDE) {
		line->state = NMEA_OUTSIDE;
		if (is_sound(line->text, line->size) && split(line->text, line->size - CHECKSUM_SIZE, out))
			return true;
		line->counters[NMEA_DAMAGED]++;
	}
	leave(line, NMEA_OUTSIDE);
	return false;
}

bool nmea_line_take(struct nmea_line *line, uint8_t octet, struct nmea_sentence *out)
{
	if (octet == '\r' || octet == '\n')
		return end_line(line, out);
	if (octet == '$' || octet == '!') { /* "!" begins the lines of AIS */
		if (line->state == NMEA_INSIDE)
			drop(line);
		leave(line, NMEA_INSIDE);
		line->size = 0;
		return false;
	}
	if (line->state == NMEA_OUTSIDE)
		line->state = NMEA_AMONG_STRAY;
	if (line->state != NMEA_INSIDE)
		return false;
	if (octet < ' ' || octet > '~' || line->size == NMEA_LINE_MAX)
		drop(line);
	else
		line->text[line->size++] = (char)octet;
	return false;
}
