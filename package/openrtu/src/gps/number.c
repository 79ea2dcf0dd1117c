/* SPDX-License-Identifier: GPL-3.0-or-later */
#include "gps/number.h"

#include <string.h>

#define WHOLE_MAX 999999999

static bool is_digit(char c)
{
	return c >= '0' && c <= '9';
}

int64_t gps_divide(int64_t numerator, int64_t denominator)
{
	int64_t half = denominator / 2;

	return numerator < 0 ? -((half - numerator) / denominator) : (numerator + half) / denominator;
}

bool gps_decimal(const char *text, size_t size, unsigned decimals, int64_t *out)
{
	size_t at = size > 0 && (text[0] == '-' || text[0] == '+') ? 1 : 0, digits = 0;
	bool negative = at == 1 && text[0] == '-', up = false;
	int64_t value = 0;

	for (; at < size && is_digit(text[at]); at++, digits++) {
		value = value * 10 + (text[at] - '0');
		if (value > WHOLE_MAX)
			return false;
	}
	if (at < size && text[at] == '.')
		at++;
	for (unsigned place = 0; place < decimals; place++) {
		bool given = at < size && is_digit(text[at]);

		value = value * 10 + (given ? text[at] - '0' : 0);
		digits += given;
		at += given;
	}
	if (at < size && is_digit(text[at]))
		up = text[at] >= '5';
	for (; at < size && is_digit(text[at]); at++)
		digits++;
	if (at != size || digits == 0)
		return false;
	value += up;
	*out = negative ? -value : value;
	return true;
}

unsigned gps_decimals_of(const char *text, size_t size)
{
	const char *point = memchr(text, '.', size);

	return point == NULL ? 0 : (unsigned)(text + size - point - 1);
}
