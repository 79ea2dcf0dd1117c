/* SPDX-License-Identifier: GPL-3.0-or-later */
/* What the fuzzers of the layers on BER check of an element. */
#ifndef OPENRTU_BER_FUZZ_ELEMENT_H
#define OPENRTU_BER_FUZZ_ELEMENT_H

#include "ber/ber.h"
#include "fuzz/target.h"

static inline void check_inside(const struct ber_element *element, const struct ber_element *whole)
{
	CHECK(element->value >= whole->value && element->size <= whole->size);
	CHECK((size_t)(element->value - whole->value) <= whole->size - element->size);
}

static inline void check_same(const struct ber_element *one, const struct ber_element *other)
{
	CHECK(ber_is(one, other->value, other->size));
}

/* What a writer holds. */
static inline struct ber_element written(const struct ber_writer *writer, size_t size)
{
	CHECK(!writer->full && writer->at <= size);
	return (struct ber_element){.value = writer->octets + writer->at, .size = size - writer->at};
}

#endif
