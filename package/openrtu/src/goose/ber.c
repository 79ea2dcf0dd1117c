/* SPDX-License-Identifier: GPL-3.0-or-later */
#include "goose/ber.h"

#include <string.h>

#define LONG_LENGTH 0x80
#define MORE_TAG    0x1f

/* ---- in ---------------------------------------------------------------------------------- */

static bool read_length(struct ber_in *in, size_t *out)
{
	size_t length, octets;

	if (in->at == in->end)
		return false;
	length = *in->at++;
	if (length < LONG_LENGTH) {
		*out = length;
		return true;
	}
	octets = length - LONG_LENGTH;
	if (octets == 0 || octets > 2 || octets > ber_size(*in)) /* no frame is longer than 65 535 */
		return false;
	for (length = 0; octets > 0; octets--)
		length = length << 8 | *in->at++;
	*out = length;
	return true;
}

bool ber_next(struct ber_in *in, struct ber_element *out)
{
	size_t length;

	if (in->at == in->end || (*in->at & MORE_TAG) == MORE_TAG)
		return false;
	out->tag = *in->at++;
	if (!read_length(in, &length) || length > ber_size(*in))
		return false;
	out->content = (struct ber_in){in->at, in->at + length};
	in->at += length;
	return true;
}

bool ber_unsigned(struct ber_in content, uint32_t *out)
{
	uint64_t number = 0;

	/* Five octets: a leading 0 keeps the highest bit from being a sign. */
	if (ber_size(content) == 0 || ber_size(content) > 5)
		return false;
	while (content.at < content.end)
		number = number << 8 | *content.at++;
	*out = (uint32_t)number;
	return number <= UINT32_MAX;
}

bool ber_integer(struct ber_in content, int32_t *out)
{
	uint64_t number;

	if (ber_size(content) == 0 || ber_size(content) > 8)
		return false;
	number = *content.at & 0x80 ? UINT64_MAX : 0;
	while (content.at < content.end)
		number = number << 8 | *content.at++;
	*out = (int32_t)number;
	return (int64_t)number >= INT32_MIN && (int64_t)number <= INT32_MAX;
}

/* ---- out --------------------------------------------------------------------------------- */

void ber_put(struct ber_out *out, const void *octets, size_t size)
{
	if (out->full || size > (size_t)(out->at - out->start)) {
		out->full = true;
		return;
	}
	out->at -= size;
	if (size > 0) /* an empty text may be nowhere */
		memcpy(out->at, octets, size);
}

void ber_wrap(struct ber_out *out, uint8_t tag, const uint8_t *mark)
{
	const size_t length = (size_t)(mark - out->at);
	const uint8_t shortest[] = {tag, (uint8_t)length};
	const uint8_t one[] = {tag, LONG_LENGTH | 1, (uint8_t)length};
	const uint8_t two[] = {tag, LONG_LENGTH | 2, (uint8_t)(length >> 8), (uint8_t)length};

	if (length < LONG_LENGTH)
		ber_put(out, shortest, sizeof(shortest));
	else if (length <= UINT8_MAX)
		ber_put(out, one, sizeof(one));
	else
		ber_put(out, two, sizeof(two));
}

/* The fewest octets that keep the number and its sign (ISO/IEC 8825-1, 8.3.2). */
static void put_number(struct ber_out *out, uint8_t tag, int64_t number)
{
	const uint8_t *mark = out->at;
	int64_t rest = number;

	do {
		const uint8_t octet = (uint8_t)rest;

		ber_put(out, &octet, 1);
		rest >>= 8;
	} while (!out->full && rest != (*out->at & 0x80 ? -1 : 0));
	ber_wrap(out, tag, mark);
}

void ber_put_unsigned(struct ber_out *out, uint8_t tag, uint32_t number)
{
	put_number(out, tag, number);
}

void ber_put_integer(struct ber_out *out, uint8_t tag, int32_t number)
{
	put_number(out, tag, number);
}

void ber_put_boolean(struct ber_out *out, uint8_t tag, bool value)
{
	const uint8_t octets[] = {tag, 1, value ? 0xff : 0};

	ber_put(out, octets, sizeof(octets));
}
