/* SPDX-License-Identifier: GPL-3.0-or-later */
#include "modbus/ascii.h"

#define NO_DIGIT 16

static uint8_t digit_of(uint8_t character)
{
	if (character >= '0' && character <= '9')
		return (uint8_t)(character - '0');
	if (character >= 'A' && character <= 'F')
		return (uint8_t)(character - 'A' + 10);
	if (character >= 'a' && character <= 'f') /* some devices */
		return (uint8_t)(character - 'a' + 10);
	return NO_DIGIT;
}

/* MODBUS over Serial Line, 6.2.1: with it, all octets add up to 0. */
static uint8_t lrc(const uint8_t *octets, size_t length)
{
	uint8_t sum = 0;

	for (size_t i = 0; i < length; i++)
		sum = (uint8_t)(sum + octets[i]);
	return (uint8_t)(0u - sum);
}

static enum modbus_ascii_state give_up(struct modbus_ascii *ascii)
{
	ascii->begun = false;
	return MODBUS_ASCII_NOISE;
}

static enum modbus_ascii_state end(struct modbus_ascii *ascii)
{
	if (!ascii->begun || ascii->half || ascii->length < 3) /* unit, function, LRC */
		return give_up(ascii);
	ascii->begun = false;
	ascii->length--;
	return lrc(ascii->body, ascii->length + 1) == 0 ? MODBUS_ASCII_SOUND : MODBUS_ASCII_GARBLED;
}

static enum modbus_ascii_state take_digit(struct modbus_ascii *ascii, uint8_t digit)
{
	if (digit == NO_DIGIT || (!ascii->half && ascii->length == sizeof(ascii->body)))
		return give_up(ascii);
	if (ascii->half)
		ascii->body[ascii->length++] = (uint8_t)(ascii->high << 4 | digit);
	ascii->high = digit;
	ascii->half = !ascii->half;
	return MODBUS_ASCII_BEGUN;
}

enum modbus_ascii_state modbus_ascii_take(struct modbus_ascii *ascii, uint8_t character)
{
	switch (character) {
	case ':': /* whatever came before: 2.5.2 */
		*ascii = (struct modbus_ascii){.begun = true};
		return MODBUS_ASCII_BEGUN;
	case '\r':
		return ascii->begun ? MODBUS_ASCII_BEGUN : MODBUS_ASCII_NOISE;
	case '\n':
		return end(ascii);
	default:
		return ascii->begun ? take_digit(ascii, digit_of(character)) : MODBUS_ASCII_NOISE;
	}
}

static size_t put_octet(uint8_t *text, size_t at, uint8_t octet)
{
	static const char digits[] = "0123456789ABCDEF";

	text[at] = (uint8_t)digits[octet >> 4];
	text[at + 1] = (uint8_t)digits[octet & 15];
	return at + 2;
}

size_t modbus_ascii_frame(const uint8_t *body, size_t length, uint8_t text[MODBUS_ASCII_REQUEST_MAX])
{
	size_t at = 0;

	_Static_assert(MODBUS_ASCII_REQUEST_MAX == 1 + 2 * (MODBUS_ASCII_BODY_MAX + 1) + 2,
		       "the colon, the body, the LRC, CR and LF");
	text[at++] = ':';
	for (size_t i = 0; i < length; i++)
		at = put_octet(text, at, body[i]);
	at = put_octet(text, at, lrc(body, length));
	text[at++] = '\r';
	text[at++] = '\n';
	return at;
}
