/* SPDX-License-Identifier: GPL-3.0-or-later */
#include "ber/ber.h"

#include <string.h>

#define LENGTH_OCTETS_MAX 3 /* no message of ours has 16 MiB */

/* ---- reading ----------------------------------------------------------------------------- */

/* Of one octet, or of two (8.1.2.4): MMS has no number above 127. */
static bool read_tag(struct ber_reader *reader, uint32_t *out)
{
	if (reader->at == reader->end)
		return false;
	*out = *reader->at++;
	if ((*out & 0x1f) != 0x1f)
		return true;
	if (reader->at == reader->end || (*reader->at & 0x80) != 0)
		return false;
	*out = *out << 8 | *reader->at++;
	return true;
}

static bool read_length(struct ber_reader *reader, size_t *out)
{
	unsigned count;

	if (reader->at == reader->end)
		return false;
	*out = *reader->at++;
	if (*out < 0x80)
		return true;
	count = *out & 0x7f;
	if (count == 0 || count > LENGTH_OCTETS_MAX || (size_t)(reader->end - reader->at) < count)
		return false; /* 0 is the indefinite form */
	for (*out = 0; count > 0; count--)
		*out = *out << 8 | *reader->at++;
	return true;
}

bool ber_next(struct ber_reader *reader, struct ber_element *out)
{
	if (!read_tag(reader, &out->tag) || !read_length(reader, &out->size) ||
	    (size_t)(reader->end - reader->at) < out->size)
		return false;
	out->value = reader->at;
	reader->at += out->size;
	return true;
}

bool ber_expect(struct ber_reader *reader, uint32_t tag, struct ber_element *out)
{
	return ber_next(reader, out) && out->tag == tag;
}

bool ber_find(const struct ber_element *in, uint32_t tag, struct ber_element *out)
{
	struct ber_reader reader = ber_inside(in);

	while (ber_next(&reader, out))
		if (out->tag == tag)
			return true;
	return false;
}

bool ber_follow(const struct ber_element *in, const uint32_t *tags, size_t count, struct ber_element *out)
{
	struct ber_element element = *in;

	for (size_t i = 0; i < count; i++) {
		if (!ber_find(&element, tags[i], out))
			return false;
		element = *out;
	}
	return true;
}

bool ber_integer(const struct ber_element *element, int64_t *out)
{
	int64_t value;

	if (element->size == 0 || element->size > 5)
		return false;
	value = (element->value[0] & 0x80) != 0 ? -1 : 0;
	for (size_t i = 0; i < element->size; i++)
		value = (int64_t)((uint64_t)value << 8 | element->value[i]);
	*out = value;
	return true;
}

bool ber_is(const struct ber_element *element, const void *octets, size_t size)
{
	return element->size == size && memcmp(element->value, octets, size) == 0;
}

/* ---- writing ----------------------------------------------------------------------------- */

void ber_put_octets(struct ber_writer *writer, const void *octets, size_t size)
{
	if (writer->full || writer->at - writer->floor < size) {
		writer->full = true;
		return;
	}
	writer->at -= size;
	if (size > 0)
		memmove(writer->octets + writer->at, octets, size);
}

static void put_header(struct ber_writer *writer, uint32_t tag, size_t size)
{
	uint8_t header[3 + LENGTH_OCTETS_MAX];
	size_t at = 0, count = 0;

	if (tag > UINT8_MAX) /* a number above 30 */
		header[at++] = (uint8_t)(tag >> 8);
	header[at++] = (uint8_t)tag;
	if (size < 0x80) {
		header[at++] = (uint8_t)size;
	} else {
		while (size >> 8 * count != 0)
			count++;
		header[at++] = (uint8_t)(0x80 | count);
		for (size_t i = 0; i < count && i < LENGTH_OCTETS_MAX; i++)
			header[at++] = (uint8_t)(size >> 8 * (count - 1 - i));
	}
	ber_put_octets(writer, header, at);
}

void ber_put(struct ber_writer *writer, uint32_t tag, const void *octets, size_t size)
{
	ber_put_octets(writer, octets, size);
	put_header(writer, tag, size);
}

void ber_put_integer(struct ber_writer *writer, uint32_t tag, int64_t value)
{
	uint8_t octets[8];
	size_t first = 0;

	for (unsigned i = 0; i < 8; i++)
		octets[i] = (uint8_t)((uint64_t)value >> (56 - 8 * i));
	while (first < 7 && ((octets[first] == 0 && octets[first + 1] < 0x80) ||
			     (octets[first] == 0xff && octets[first + 1] >= 0x80)))
		first++;
	ber_put(writer, tag, octets + first, 8 - first);
}

void ber_put_text(struct ber_writer *writer, uint32_t tag, const char *text)
{
	ber_put(writer, tag, text, strlen(text));
}

void ber_close(struct ber_writer *writer, uint32_t tag, size_t end)
{
	put_header(writer, tag, end - writer->at);
}
