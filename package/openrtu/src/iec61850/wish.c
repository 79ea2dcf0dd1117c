/* SPDX-License-Identifier: GPL-3.0-or-later */
/* The parameters of a command's services: ctlVal, origin, ctlNum, T, Test, Check (IEC 61850-8-1, 20.6). */
#include <math.h>
#include <string.h>

#include "iec61850/control.h"
#include "iec61850/tags.h"
#include "map/type.h"

enum { OFF = 1, ON = 2 };                /* of a double point */
enum { STEP_LOW = -64, STEP_HIGH = 63 }; /* of a step position */
enum { CATEGORY_MAX = 8 };               /* orCat: process */

static bool read_boolean(struct ber_reader *reader, bool *out)
{
	struct ber_element element;

	if (!ber_expect(reader, IEC61850_TAG_BOOLEAN, &element) || element.size != 1)
		return false;
	*out = element.value[0] != 0;
	return true;
}

static bool read_float(struct ber_reader *reader, float *out)
{
	enum { EXPONENT_WIDTH = 8 };
	struct ber_element structure, element;
	struct ber_reader inside;
	uint32_t bits;

	if (!ber_expect(reader, IEC61850_TAG_STRUCTURE, &structure))
		return false;
	inside = ber_inside(&structure);
	if (!ber_expect(&inside, IEC61850_TAG_FLOATING_POINT, &element) || inside.at != inside.end ||
	    element.size != 5 || element.value[0] != EXPONENT_WIDTH)
		return false;
	bits = (uint32_t)element.value[1] << 24 | (uint32_t)element.value[2] << 16 |
	       (uint32_t)element.value[3] << 8 | element.value[4];
	memcpy(out, &bits, sizeof(bits));
	return true;
}

/* What a set-point is to the point. False: it cannot be. */
static bool take_real(const struct map_point *point, double number, union map_value *out)
{
	if (!isfinite(number))
		return false;
	return map_value_of(point->type, point->type == MAP_NORMALIZED ? number * 32768 : number, out);
}

static bool take_number(const struct map_point *point, int64_t number, union map_value *out)
{
	if (number < INT32_MIN || number > INT32_MAX)
		return false;
	out->i = (int32_t)number;
	return point->type != MAP_STEP || (number >= STEP_LOW && number <= STEP_HIGH);
}

static bool read_whole(const struct map_point *point, struct ber_reader *reader, struct iec61850_wish *out)
{
	struct ber_element element;
	int64_t number;

	if (!ber_expect(reader, IEC61850_TAG_INTEGER, &element) || !ber_integer(&element, &number))
		return false;
	out->out_of_range = !take_number(point, number, &out->value);
	return true;
}

static bool read_value(const struct map_point *point, struct ber_reader *reader, struct iec61850_wish *out)
{
	float real;
	bool on;

	switch (map_class_of(point)) {
	case MAP_CLASS_STATE:
		if (!read_boolean(reader, &on))
			return false;
		out->value.u = point->type == MAP_DOUBLE ? (on ? ON : OFF) : on;
		return true;
	case MAP_CLASS_POSITION:
	case MAP_CLASS_PATTERN:
		return read_whole(point, reader, out);
	case MAP_CLASS_MEASURED:
		if (iec61850_is_whole(point->type))
			return read_whole(point, reader, out);
		if (!read_float(reader, &real))
			return false;
		out->out_of_range = !take_real(point, (double)real, &out->value);
		return true;
	case MAP_CLASS_TOTAL:
		break;
	}
	return false;
}

static bool read_unsigned(struct ber_reader *reader, int64_t limit, uint8_t *out)
{
	struct ber_element element;
	int64_t number;

	if (!ber_next(reader, &element) ||
	    (element.tag != IEC61850_TAG_INTEGER && element.tag != IEC61850_TAG_UNSIGNED) ||
	    !ber_integer(&element, &number) || number < 0 || number > limit)
		return false;
	*out = (uint8_t)number;
	return true;
}

static bool read_origin(struct ber_reader *reader, struct iec61850_wish *out)
{
	struct ber_element origin, identity;
	struct ber_reader inside;

	if (!ber_expect(reader, IEC61850_TAG_STRUCTURE, &origin))
		return false;
	inside = ber_inside(&origin);
	if (!read_unsigned(&inside, CATEGORY_MAX, &out->category) ||
	    !ber_expect(&inside, IEC61850_TAG_OCTET_STRING, &identity) || inside.at != inside.end ||
	    identity.size > sizeof(out->identity))
		return false;
	memcpy(out->identity, identity.value, identity.size);
	out->identity_size = (uint8_t)identity.size;
	return true;
}

int iec61850_wish_read(const struct map_point *point, const struct iec61850_node *node,
		       const struct ber_element *data, struct iec61850_wish *out)
{
	struct ber_reader reader = ber_inside(data);
	struct ber_element element;

	*out = (struct iec61850_wish){.octet_count = (uint16_t)data->size};
	if (data->tag != IEC61850_TAG_STRUCTURE)
		return IEC61850_ACCESS_TYPE_INCONSISTENT;
	if (data->size > sizeof(out->octets))
		return IEC61850_ACCESS_VALUE_INVALID;
	memcpy(out->octets, data->value, data->size);
	if (!read_value(point, &reader, out) || !read_origin(&reader, out) ||
	    !read_unsigned(&reader, UINT8_MAX, &out->number) ||
	    !ber_expect(&reader, IEC61850_TAG_UTC_TIME, &element) || element.size != 8 ||
	    !read_boolean(&reader, &out->test))
		return IEC61850_ACCESS_TYPE_INCONSISTENT;
	if (node->leaf != IEC61850_CANCEL &&
	    (!ber_expect(&reader, IEC61850_TAG_BIT_STRING, &element) || element.size != 2))
		return IEC61850_ACCESS_TYPE_INCONSISTENT;
	return reader.at == reader.end ? 0 : IEC61850_ACCESS_TYPE_INCONSISTENT;
}

bool iec61850_wish_is_same(const struct iec61850_wish *a, const struct iec61850_wish *b)
{
	return a->value.u == b->value.u && a->number == b->number && a->category == b->category &&
	       a->test == b->test && a->identity_size == b->identity_size &&
	       memcmp(a->identity, b->identity, a->identity_size) == 0;
}
