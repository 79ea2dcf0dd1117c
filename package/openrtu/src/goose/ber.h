/* SPDX-License-Identifier: GPL-3.0-or-later */
/* The basic encoding rules (ISO/IEC 8825-1), as far as GOOSE has them: definite lengths, tags of one octet. */
#ifndef OPENRTU_GOOSE_BER_H
#define OPENRTU_GOOSE_BER_H

#include <stdbool.h>
#include <stddef.h>
#include <stdint.h>

/* ---- in ---------------------------------------------------------------------------------- */

struct ber_in {
	const uint8_t *at, *end;
};

struct ber_element {
	uint8_t tag;
	struct ber_in content;
};

/* The next element. False: there is none, or it is not whole. */
bool ber_next(struct ber_in *in, struct ber_element *out);

static inline size_t ber_size(struct ber_in in)
{
	return (size_t)(in.end - in.at);
}

/* A whole number that the content holds; false: it has no octets, or the number more than 32 bits. */
bool ber_unsigned(struct ber_in content, uint32_t *out);
bool ber_integer(struct ber_in content, int32_t *out);

/* ---- out --------------------------------------------------------------------------------- */

/* Octets are put from the end to the front: a length is known before it is put. */
struct ber_out {
	uint8_t *start, *at;
	bool full; /* something did not fit: the rest is not there either */
};

void ber_put(struct ber_out *out, const void *octets, size_t size);
/* Tag and length before what was put since the mark, which is the at of then. */
void ber_wrap(struct ber_out *out, uint8_t tag, const uint8_t *mark);
void ber_put_unsigned(struct ber_out *out, uint8_t tag, uint32_t number);
void ber_put_integer(struct ber_out *out, uint8_t tag, int32_t number);
void ber_put_boolean(struct ber_out *out, uint8_t tag, bool value);

#endif
