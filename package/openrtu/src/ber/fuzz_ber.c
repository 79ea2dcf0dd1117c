/* SPDX-License-Identifier: GPL-3.0-or-later */
/*
 * libFuzzer on BER: elements lie inside what they are read from, at any depth, and what is written of one is the same one once
 * more, or is not written at all where there is too little room.
 */
#include "ber/fuzz_element.h"

#define DEPTH_MAX  64
#define OCTETS_MAX 1024 /* what is looked for is looked for from the beginning each time */

static uint8_t octets[OCTETS_MAX + 8];

static bool has_children(uint32_t tag)
{
	return (tag > UINT8_MAX ? tag >> 8 & 0x20 : tag & 0x20) != 0;
}

static void write_again(const struct ber_element *element)
{
	struct ber_writer writer = {.octets = octets, .at = sizeof(octets)};
	struct ber_element again, whole;
	struct ber_reader reader;
	size_t size;

	ber_put(&writer, element->tag, element->value, element->size);
	whole = written(&writer, sizeof(octets));
	reader = ber_inside(&whole);
	CHECK(ber_expect(&reader, element->tag, &again) && reader.at == reader.end);
	check_same(&again, element);
	size = whole.size;
	writer = (struct ber_writer){.octets = octets, .at = size - 1};
	ber_put(&writer, element->tag, element->value, element->size);
	CHECK(writer.full && writer.at < size);
}

static void write_integer(const struct ber_element *element)
{
	struct ber_writer writer = {.octets = octets, .at = sizeof(octets)};
	struct ber_element whole, again;
	struct ber_reader reader;
	int64_t value, same;

	if (!ber_integer(element, &value))
		return;
	ber_put_integer(&writer, BER_INTEGER, value);
	whole = written(&writer, sizeof(octets));
	reader = ber_inside(&whole);
	CHECK(ber_expect(&reader, BER_INTEGER, &again) && again.size <= element->size);
	CHECK(ber_integer(&again, &same) && same == value);
}

static void read_all(const struct ber_element *in, unsigned depth)
{
	struct ber_reader reader = ber_inside(in);
	struct ber_element element, first;

	while (ber_next(&reader, &element)) {
		check_inside(&element, in);
		CHECK(ber_find(in, element.tag, &first) && first.value <= element.value);
		write_again(&element);
		write_integer(&element);
		if (has_children(element.tag) && depth < DEPTH_MAX)
			read_all(&element, depth + 1);
	}
	CHECK(reader.at <= reader.end);
}

int LLVMFuzzerTestOneInput(const uint8_t *data, size_t size)
{
	if (size <= OCTETS_MAX)
		read_all(&(struct ber_element){.value = data, .size = size}, 0);
	return 0;
}
