/* SPDX-License-Identifier: GPL-3.0-or-later */
/* The basic encoding rules (ISO/IEC 8825-1), as the layers of MMS and GOOSE use them. Nothing is copied or allocated. */
#ifndef OPENRTU_BER_BER_H
#define OPENRTU_BER_BER_H

#include <stdbool.h>
#include <stddef.h>
#include <stdint.h>

/* Tags that several layers use. */
enum {
	BER_INTEGER = 0x02,
	BER_OBJECT_IDENTIFIER = 0x06,
	BER_VISIBLE_STRING = 0x1a,
	BER_SEQUENCE = 0x30,
};

/* An element; tag: its identifier octets as one number. */
struct ber_element {
	uint32_t tag;
	const uint8_t *value;
	size_t size;
};

struct ber_reader {
	const uint8_t *at, *end;
};

static inline struct ber_reader ber_inside(const struct ber_element *element)
{
	return (struct ber_reader){element->value, element->value + element->size};
}

/* The next element. False: there is none, or it is not whole, or of a form that MMS does not use. */
bool ber_next(struct ber_reader *reader, struct ber_element *out);
/* The next element, which must have this tag. */
bool ber_expect(struct ber_reader *reader, uint32_t tag, struct ber_element *out);
/* The first element of this tag inside another. */
bool ber_find(const struct ber_element *in, uint32_t tag, struct ber_element *out);
/* A path of tags, one inside the other. */
bool ber_follow(const struct ber_element *in, const uint32_t *tags, size_t count, struct ber_element *out);
/* The value of an INTEGER. False: it needs more than 32 bits. */
bool ber_integer(const struct ber_element *element, int64_t *out);
bool ber_is(const struct ber_element *element, const void *octets, size_t size);

/*
 * Writes from the end of its octets to their beginning, so that each length is known when it is written. What does not fit sets
 * full, and nothing more is written.
 */
struct ber_writer {
	uint8_t *octets;
	size_t floor; /* nothing is written before this place */
	size_t at;    /* the first octet written */
	bool full;
};

/* octets may lie in what is not written yet. */
void ber_put_octets(struct ber_writer *writer, const void *octets, size_t size);
void ber_put(struct ber_writer *writer, uint32_t tag, const void *octets, size_t size);
/* In as few octets as an INTEGER needs. */
void ber_put_integer(struct ber_writer *writer, uint32_t tag, int64_t value);
void ber_put_text(struct ber_writer *writer, uint32_t tag, const char *text);
/* Puts a tag and a length around all that was written since writer->at was end. */
void ber_close(struct ber_writer *writer, uint32_t tag, size_t end);

#endif
