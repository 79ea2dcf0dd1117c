/* SPDX-License-Identifier: GPL-3.0-or-later */
#include "convert.h"

#include <float.h>
#include <math.h>
#include <string.h>

/* IEC 60870-5-101, 7.2.6.5: value with transient state indication. */
#define VTI_TRANSIENT 0x80
#define VTI_VALUE     0x7F
#define VTI_SIGN      0x40
#define STEP_MIN      (-64)
#define STEP_MAX      63

#define DOUBLE_OFF 1
#define DOUBLE_ON  2

static uint16_t in_byte_order(const struct map_point *point, uint16_t word)
{
	if (!(point->flags & MAP_POINT_BYTES_SWAPPED))
		return word;
	return (uint16_t)((word << 8) | (word >> 8));
}

static uint32_t join(const struct map_point *point, const uint16_t raw[2])
{
	bool swapped = point->flags & MAP_POINT_WORDS_SWAPPED;
	uint32_t high = in_byte_order(point, raw[swapped ? 1 : 0]);
	uint32_t low = in_byte_order(point, raw[swapped ? 0 : 1]);

	return high << 16 | low;
}

static void split(const struct map_point *point, uint32_t both, uint16_t raw[2])
{
	bool swapped = point->flags & MAP_POINT_WORDS_SWAPPED;

	raw[swapped ? 1 : 0] = in_byte_order(point, (uint16_t)(both >> 16));
	raw[swapped ? 0 : 1] = in_byte_order(point, (uint16_t)(both & 0xFFFF));
}

/* The raw value in the unit of the value sent. */
static double scaled(const struct map_point *point, double raw)
{
	return raw * point->scale + point->offset;
}

static double unscaled(const struct map_point *point, double value)
{
	return (value - point->offset) / point->scale;
}

static int32_t rounded_within(double value, int32_t min, int32_t max, uint8_t *quality)
{
	if (value >= min && value <= max)
		return map_round(value);
	*quality |= MAP_OVERFLOW;
	return value < min ? min : max;
}

static bool rounds_within(double value, double min, double max, double *rounded)
{
	*rounded = rint(value);
	return *rounded >= min && *rounded <= max; /* false for NaN too */
}

/* ---- to the map ----------------------------------------------------------------------------- */

static uint32_t double_point(const struct map_point *point, const uint16_t raw[2])
{
	bool swapped = point->flags & MAP_POINT_BITS_SWAPPED;
	uint32_t off = raw[swapped ? 1 : 0] != 0, on = raw[swapped ? 0 : 1] != 0;

	return on << 1 | off;
}

static void step_position(const struct map_point *point, uint16_t word, struct map_sample *sample)
{
	uint8_t vti = (uint8_t)(in_byte_order(point, word) & 0xFF);
	int32_t value = vti & VTI_VALUE;

	sample->value.i = value & VTI_SIGN ? value - 2 * VTI_SIGN : value;
	sample->detail = vti & VTI_TRANSIENT ? 1 : 0;
}

static int32_t sixteen_bits(const struct map_point *point, uint16_t word, uint8_t *quality)
{
	int32_t raw = in_byte_order(point, word);

	if (point->flags & MAP_POINT_SIGNED && raw > INT16_MAX)
		raw -= UINT16_MAX + 1;
	return rounded_within(scaled(point, raw), INT16_MIN, INT16_MAX, quality);
}

static float float_value(const struct map_point *point, const uint16_t raw[2], uint8_t *quality)
{
	uint32_t bits = join(point, raw);
	float value;

	memcpy(&value, &bits, sizeof(value));
	if (!isfinite(value)) {
		*quality |= MAP_INVALID;
		return 0;
	}
	double result = scaled(point, (double)value);
	if (fabs(result) <= (double)FLT_MAX)
		return (float)result;
	*quality |= MAP_OVERFLOW;
	return result < 0 ? -FLT_MAX : FLT_MAX;
}

void convert_to_sample(const struct map_point *point, const uint16_t raw[CONVERT_WIDTH_MAX],
		       struct map_sample *sample)
{
	sample->quality = MAP_GOOD;
	sample->detail = 0;
	switch ((enum map_type)point->type) {
	case MAP_SINGLE:
		sample->value.u = raw[0] != 0;
		break;
	case MAP_DOUBLE:
		sample->value.u = double_point(point, raw);
		break;
	case MAP_STEP:
		step_position(point, raw[0], sample);
		break;
	case MAP_BITSTRING:
		sample->value.u = join(point, raw);
		break;
	case MAP_NORMALIZED:
	case MAP_SCALED:
		sample->value.i = sixteen_bits(point, raw[0], &sample->quality);
		break;
	case MAP_FLOAT:
		sample->value.f = float_value(point, raw, &sample->quality);
		break;
	case MAP_COUNTER:
		sample->value.i = rounded_within(scaled(point, (int32_t)join(point, raw)), INT32_MIN,
						 INT32_MAX, &sample->quality);
		break;
	}
}

/* ---- to the device ---------------------------------------------------------------------------- */

static bool put_double_point(const struct map_point *point, uint32_t value, uint16_t raw[2])
{
	bool swapped = point->flags & MAP_POINT_BITS_SWAPPED;

	raw[swapped ? 1 : 0] = value == DOUBLE_OFF;
	raw[swapped ? 0 : 1] = value == DOUBLE_ON;
	/* Nobody can command an intermediate or indeterminate position (IEC 60870-5-101, 7.2.6.16). */
	return value == DOUBLE_OFF || value == DOUBLE_ON;
}

static bool put_step(const struct map_point *point, int32_t value, uint8_t detail, uint16_t *word)
{
	unsigned vti = ((unsigned)value & VTI_VALUE) | (detail & 1 ? VTI_TRANSIENT : 0);

	*word = in_byte_order(point, (uint16_t)vti);
	return value >= STEP_MIN && value <= STEP_MAX;
}

static bool put_sixteen_bits(const struct map_point *point, int32_t value, uint16_t *word)
{
	bool is_signed = point->flags & MAP_POINT_SIGNED;
	double raw;

	if (value < INT16_MIN || value > INT16_MAX ||
	    !rounds_within(unscaled(point, value), is_signed ? INT16_MIN : 0,
			   is_signed ? INT16_MAX : UINT16_MAX, &raw))
		return false;
	*word = in_byte_order(point, (uint16_t)(int32_t)raw);
	return true;
}

static bool put_float(const struct map_point *point, float value, uint16_t raw[2])
{
	double result = unscaled(point, (double)value);
	uint32_t bits;

	if (!(fabs(result) <= (double)FLT_MAX)) /* false for NaN too */
		return false;
	float sent = (float)result;
	memcpy(&bits, &sent, sizeof(bits));
	split(point, bits, raw);
	return true;
}

static bool put_counter(const struct map_point *point, int32_t value, uint16_t raw[2])
{
	double result;

	if (!rounds_within(unscaled(point, value), INT32_MIN, INT32_MAX, &result))
		return false;
	split(point, (uint32_t)(int32_t)result, raw);
	return true;
}

bool convert_to_raw(const struct map_point *point, union map_value value, uint8_t detail,
		    uint16_t raw[CONVERT_WIDTH_MAX])
{
	switch ((enum map_type)point->type) {
	case MAP_SINGLE:
		raw[0] = value.u != 0;
		return value.u <= 1;
	case MAP_DOUBLE:
		return put_double_point(point, value.u, raw);
	case MAP_STEP:
		return put_step(point, value.i, detail, raw);
	case MAP_BITSTRING:
		split(point, value.u, raw);
		return true;
	case MAP_NORMALIZED:
	case MAP_SCALED:
		return put_sixteen_bits(point, value.i, raw);
	case MAP_FLOAT:
		return put_float(point, value.f, raw);
	case MAP_COUNTER:
		return put_counter(point, value.i, raw);
	}
	return false;
}
