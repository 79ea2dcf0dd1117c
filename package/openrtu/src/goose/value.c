/* SPDX-License-Identifier: GPL-3.0-or-later */
#include "goose/value.h"

#include "map/type.h"
#include "quality/quality.h"

#define DOUBLE_SIZE    2
#define PER_NORMALIZED 32768.0f
#define UNUSED_BITS    (16 - QUALITY_BITS)

struct goose_item goose_value_out(enum map_type type, union map_value value)
{
	switch (map_types[type].form) {
	case MAP_FORM_SINGLE:
		return (struct goose_item){.kind = GOOSE_BOOLEAN, .bits = value.u};
	case MAP_FORM_DOUBLE:
		return (struct goose_item){.kind = GOOSE_BITS, .size = DOUBLE_SIZE, .bits = value.u};
	case MAP_FORM_UNSIGNED:
		return (struct goose_item){.kind = GOOSE_UNSIGNED, .bits = value.u};
	case MAP_FORM_FLOAT:
		return (struct goose_item){.kind = GOOSE_FLOAT, .real = value.f};
	case MAP_FORM_FRACTION:
		return (struct goose_item){.kind = GOOSE_FLOAT, .real = (float)value.i / PER_NORMALIZED};
	case MAP_FORM_SIGNED:
	case MAP_FORM_DEGREES:
		break;
	}
	return (struct goose_item){.kind = GOOSE_INTEGER, .integer = value.i};
}

/* A whole number; an angle is counted in 1e-7 degree. */
static bool whole_in(enum map_type type, double number, union map_value *out)
{
	return map_value_of(type, type == MAP_ANGLE ? number / MAP_ANGLE_PER_DEGREE : number, out);
}

static bool measured_in(enum map_type type, double number, union map_value *out)
{
	if (map_types[type].form == MAP_FORM_FRACTION)
		return map_value_of(type, map_nearest(number * (double)PER_NORMALIZED), out);
	return type == MAP_FLOAT && map_value_of(type, number, out);
}

static bool is_counted(enum map_type type)
{
	return map_types[type].class != MAP_CLASS_STATE && map_types[type].form != MAP_FORM_FRACTION;
}

bool goose_value_in(enum map_type type, const struct goose_item *item, union map_value *out)
{
	switch ((enum goose_kind)item->kind) {
	case GOOSE_BOOLEAN:
		out->u = item->bits;
		return type == MAP_SINGLE;
	case GOOSE_BITS:
		out->u = item->bits;
		return (type == MAP_DOUBLE && item->size == DOUBLE_SIZE) || type == MAP_BITSTRING;
	case GOOSE_UNSIGNED:
		if (type == MAP_BITSTRING) {
			out->u = item->bits;
			return true;
		}
		return is_counted(type) && whole_in(type, item->bits, out);
	case GOOSE_INTEGER:
		return is_counted(type) && whole_in(type, item->integer, out);
	case GOOSE_FLOAT:
		return measured_in(type, (double)item->real, out);
	case GOOSE_TIME:
	case GOOSE_OTHER:
		break;
	}
	return false;
}

struct goose_item goose_quality_out(uint8_t quality)
{
	return (struct goose_item){.kind = GOOSE_BITS,
				   .size = QUALITY_BITS,
				   .bits = (uint32_t)quality_of_map(quality) >> UNUSED_BITS};
}

bool goose_quality_in(const struct goose_item *item, uint8_t *out)
{
	const uint32_t bits = item->bits << UNUSED_BITS;
	const uint32_t validity = bits & QUALITY_VALIDITY;

	if (item->kind != GOOSE_BITS || item->size != QUALITY_BITS)
		return false;
	*out = 0;
	if (validity == QUALITY_INVALID || (bits & QUALITY_TEST))
		*out |= MAP_INVALID;
	if (bits & QUALITY_OVERFLOW)
		*out |= MAP_OVERFLOW;
	/* Questionable for any other reason, and the reserved validity: no more than the last that was known. */
	if ((bits & QUALITY_OLD_DATA) || ((validity & ~QUALITY_INVALID) && !(bits & QUALITY_OVERFLOW)))
		*out |= MAP_NOT_TOPICAL;
	*out |= bits & QUALITY_SUBSTITUTED ? MAP_SUBSTITUTED : 0;
	*out |= bits & QUALITY_OPERATOR_BLOCKED ? MAP_BLOCKED : 0;
	return true;
}
