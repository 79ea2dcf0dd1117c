/* SPDX-License-Identifier: GPL-3.0-or-later */
#include "web/hex.h"

#include <stdio.h>
#include <string.h>

static int digit(char c)
{
	if (c >= '0' && c <= '9')
		return c - '0';
	return c >= 'a' && c <= 'f' ? c - 'a' + 10 : -1;
}

uint8_t web_hex_read(const char *text, uint8_t *out, size_t most)
{
	const size_t size = strlen(text) / 2;

	if (size == 0 || size > most || strlen(text) % 2 != 0)
		return 0;
	for (size_t i = 0; i < size; i++) {
		const int high = digit(text[2 * i]), low = digit(text[2 * i + 1]);

		if (high < 0 || low < 0)
			return 0;
		out[i] = (uint8_t)(high << 4 | low);
	}
	return (uint8_t)size;
}

void web_hex_write(const uint8_t *octets, size_t size, char *out)
{
	for (size_t i = 0; i < size; i++)
		snprintf(out + 2 * i, 3, "%02x", octets[i]);
}
