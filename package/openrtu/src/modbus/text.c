/* SPDX-License-Identifier: GPL-3.0-or-later */
#include "modbus/text.h"

#include <stdbool.h>
#include <stddef.h>

#define DELETE     0x7F
#define LATIN_HIGH 0xA0 /* from DELETE to here are control characters */
#define ERASED     0xFF /* of flash memory that nobody wrote */

/* Of string two characters a register, of string16 one. */
_Static_assert(2 * 2 * MODBUS_TEXT_MAX < MAP_TEXT_SIZE, "each takes two octets of UTF-8 at most");

static unsigned characters_of(const struct modbus_point *point)
{
	return modbus_width_of(point) * (point->format == MODBUS_FORMAT_STRING ? 2u : 1u);
}

/* A character of two octets is none of Latin-1. */
static unsigned character(const struct modbus_point *point, const uint8_t *octets, unsigned i)
{
	const bool swapped = (point->flags & MODBUS_BYTES_SWAPPED) != 0;
	const size_t high = 2 * (size_t)i + swapped, low = 2 * (size_t)i + !swapped;

	if (point->format == MODBUS_FORMAT_STRING)
		return octets[swapped ? i ^ 1u : i];
	return (unsigned)octets[high] << 8 | octets[low];
}

static bool is_filling(unsigned character)
{
	return character == ' ' || character == ERASED || character == (ERASED << 8 | ERASED);
}

static char *put(char *out, unsigned character)
{
	if (character < ' ' || (character >= DELETE && character < LATIN_HIGH) || character > UINT8_MAX)
		character = '?';
	if (character >= LATIN_HIGH)
		*out++ = (char)(0xC0 | character >> 6);
	*out++ = (char)(character >= LATIN_HIGH ? 0x80 | (character & 0x3F) : character);
	return out;
}

void modbus_text(const struct modbus_point *point, const uint8_t *octets, char out[MAP_TEXT_SIZE])
{
	unsigned count = 0;

	while (count < characters_of(point) && character(point, octets, count) != 0)
		count++;
	while (count > 0 && is_filling(character(point, octets, count - 1)))
		count--;
	for (unsigned i = 0; i < count; i++)
		out = put(out, character(point, octets, i));
	*out = '\0';
}
