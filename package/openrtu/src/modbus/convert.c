/* SPDX-License-Identifier: GPL-3.0-or-later */
#include "modbus/convert.h"

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

#define WORD_BITS    16
#define WORD_MASK    0xFFFF
#define DIGIT_BITS   4
#define DIGIT_MASK   0xF
#define TEN_THOUSAND 10000 /* of MOD10: a register is less */
#define WORD_SIGN    0x8000
/* A double, as the greatest 64-bit integer is not. */
#define TWO_TO_63 0x1p63
/* From here on doubles are 2 apart. */
#define TWO_TO_53 0x1p53

static bool has(const struct modbus_point *point, enum modbus_point_flag flag)
{
	return (point->flags & flag) != 0;
}

/* ---- words ----------------------------------------------------------------------------------- */

static uint16_t in_byte_order(const struct modbus_point *point, uint16_t word)
{
	const uint32_t swapped = (uint32_t)word << 8 | word >> 8;

	return has(point, MODBUS_BYTES_SWAPPED) ? (uint16_t)(swapped & UINT16_MAX) : word;
}

/* Which register has the word of this rank; 0 is the high one. */
static unsigned place_of(const struct modbus_point *point, unsigned rank)
{
	return has(point, MODBUS_WORDS_SWAPPED) ? point->width - 1u - rank : rank;
}

static uint64_t join(const struct modbus_point *point, const uint16_t raw[CONVERT_WIDTH_MAX])
{
	uint64_t all = 0;

	for (unsigned rank = 0; rank < point->width; rank++)
		all = all << WORD_BITS | in_byte_order(point, raw[place_of(point, rank)]);
	return all;
}

static void split(const struct modbus_point *point, uint64_t all, uint16_t raw[CONVERT_WIDTH_MAX])
{
	for (unsigned rank = point->width; rank-- > 0; all >>= WORD_BITS)
		raw[place_of(point, rank)] = in_byte_order(point, (uint16_t)(all & UINT16_MAX));
}

/* ---- fields ---------------------------------------------------------------------------------- */

static unsigned bits_of(const struct modbus_point *point)
{
	return modbus_is_field(point) ? point->field : WORD_BITS * point->width;
}

static uint64_t sign_bit(const struct modbus_point *point)
{
	return 1ull << (bits_of(point) - 1);
}

static uint64_t greatest(const struct modbus_point *point)
{
	return sign_bit(point) | (sign_bit(point) - 1);
}

/* All that the registers hold of the point. */
static uint64_t gather(const struct modbus_point *point, const uint16_t raw[CONVERT_WIDTH_MAX])
{
	return join(point, raw) >> (modbus_is_field(point) ? point->bit : 0) & greatest(point);
}

/* The registers with this and no other bits set. False: it has more bits. */
static bool scatter(const struct modbus_point *point, uint64_t all, uint16_t raw[CONVERT_WIDTH_MAX])
{
	split(point, all << (modbus_is_field(point) ? point->bit : 0), raw);
	return all <= greatest(point);
}

/* ---- numbers --------------------------------------------------------------------------------- */

static const struct modbus_format_row *format_of(const struct modbus_point *point)
{
	return &modbus_formats[point->format];
}

static bool is_floating(const struct modbus_point *point)
{
	return format_of(point)->coding == MODBUS_FLOATING;
}

static bool is_unsigned(const struct modbus_point *point)
{
	return format_of(point)->coding == MODBUS_UNSIGNED;
}

static uint64_t sign_extended(const struct modbus_point *point, uint64_t all)
{
	return (all ^ sign_bit(point)) - sign_bit(point);
}

/* What SunSpec calls unimplemented, of an integer; its floats are NaN. */
static bool is_unimplemented(const struct modbus_point *point, uint64_t all)
{
	return has(point, MODBUS_UNIMPLEMENTED) &&
	       all == (is_unsigned(point) ? greatest(point) : sign_bit(point));
}

static bool from_bcd(uint64_t all, uint64_t *whole)
{
	*whole = 0;
	for (unsigned shift = 64; shift > 0;) {
		uint64_t digit = all >> (shift -= DIGIT_BITS) & DIGIT_MASK;

		if (digit > 9)
			return false;
		*whole = *whole * 10 + digit;
	}
	return true;
}

static uint64_t to_bcd(uint64_t whole)
{
	uint64_t all = 0;

	for (unsigned shift = 0; shift < 64; shift += DIGIT_BITS, whole /= 10)
		all |= whole % 10 << shift;
	return all;
}

static bool from_mod10(const struct modbus_point *point, uint64_t all, uint64_t *whole)
{
	int64_t sum = 0;

	for (unsigned rank = point->width; rank-- > 0;) {
		int part = (int)((all >> (WORD_BITS * rank) & WORD_MASK) ^ WORD_SIGN) - WORD_SIGN;

		if (part <= -TEN_THOUSAND || part >= TEN_THOUSAND)
			return false;
		sum = sum * TEN_THOUSAND + part;
	}
	*whole = (uint64_t)sum;
	return true;
}

/* Each register has the sign of the number. */
static uint64_t to_mod10(const struct modbus_point *point, int64_t whole)
{
	uint64_t all = 0;

	for (unsigned rank = 0; rank < point->width; rank++, whole /= TEN_THOUSAND)
		all |= (uint64_t)((uint16_t)(whole % TEN_THOUSAND)) << (WORD_BITS * rank);
	return all;
}

/* The integer that the registers hold, modulo 2^64. False: they hold none. */
static bool whole_of(const struct modbus_point *point, uint64_t all, uint64_t *whole)
{
	switch ((enum modbus_coding)format_of(point)->coding) {
	case MODBUS_SIGNED:
		*whole = sign_extended(point, all);
		return !is_unimplemented(point, all);
	case MODBUS_UNSIGNED:
		*whole = all;
		return !is_unimplemented(point, all);
	case MODBUS_BCD:
		return from_bcd(all, whole);
	case MODBUS_MOD10:
		return from_mod10(point, all, whole);
	case MODBUS_FLOATING:
	case MODBUS_NO_NUMBER:
	case MODBUS_CHARACTERS:
		break;
	}
	return false;
}

static double floating_of(const struct modbus_point *point, uint64_t all)
{
	uint32_t half = (uint32_t)all;
	float number;
	double twice;

	memcpy(&number, &half, sizeof(number));
	memcpy(&twice, &all, sizeof(twice));
	return point->width == 2 ? (double)number : twice;
}

/* The number that the registers hold. False: they hold none. */
static bool number_of(const struct modbus_point *point, uint64_t all, double *number)
{
	uint64_t whole;

	if (is_floating(point)) {
		*number = floating_of(point, all);
		return isfinite(*number);
	}
	if (!whole_of(point, all, &whole))
		return false;
	*number = (is_unsigned(point) ? (double)whole : (double)(int64_t)whole) * format_of(point)->one;
	return true;
}

static bool put_floating(const struct modbus_point *point, double number, uint16_t raw[CONVERT_WIDTH_MAX])
{
	float short_number;
	uint32_t half;
	uint64_t all;

	if (point->width == 2) {
		if (fabs(number) > (double)FLT_MAX)
			return false;
		short_number = (float)number;
		memcpy(&half, &short_number, sizeof(half));
		all = half;
	} else {
		memcpy(&all, &number, sizeof(all));
	}
	return scatter(point, all, raw);
}

/* Not pow(): a line process would lock the library of mathematics in memory for it. */
static double power(unsigned base, unsigned exponent)
{
	double product = 1;

	while (exponent-- > 0)
		product *= base;
	return product;
}

/* From the least integer that a format holds to the first that is beyond it. */
static void range_of(const struct modbus_point *point, double *least, double *beyond)
{
	double half = (double)sign_bit(point);

	*least = 0;
	*beyond = 2 * half;
	if (format_of(point)->coding == MODBUS_SIGNED) {
		*least = -half;
		*beyond = half;
	} else if (format_of(point)->coding == MODBUS_MOD10) {
		*beyond = power(TEN_THOUSAND, point->width);
		*least = (*beyond > TWO_TO_53 ? 2 : 1) - *beyond; /* the next one that a double has */
	} else if (format_of(point)->coding == MODBUS_BCD) {
		*beyond = power(10, (bits_of(point) + DIGIT_BITS - 1) / DIGIT_BITS);
	}
}

/* The registers that hold a finite number, an integer the nearest one. False: it is out of their range. */
static bool registers_of(const struct modbus_point *point, double number, uint16_t raw[CONVERT_WIDTH_MAX])
{
	double least, beyond;
	uint64_t whole;

	if (is_floating(point))
		return put_floating(point, number, raw);
	range_of(point, &least, &beyond);
	number = map_nearest(number / format_of(point)->one);
	if (number < least || number >= beyond)
		return false;
	whole = number < 0 ? (uint64_t)(int64_t)number : (uint64_t)number;
	if (format_of(point)->coding == MODBUS_BCD)
		whole = to_bcd(whole);
	else if (format_of(point)->coding == MODBUS_MOD10)
		whole = to_mod10(point, (int64_t)whole);
	return scatter(
	    point, whole & (format_of(point)->coding == MODBUS_SIGNED ? greatest(point) : UINT64_MAX), raw);
}

/* ---- powers of ten --------------------------------------------------------------------------- */

int8_t convert_first_exponent(const struct modbus_point *point)
{
	return modbus_has_scale_register(point) ? CONVERT_NO_EXPONENT : 0;
}

int8_t convert_exponent(const struct modbus_point *point, uint16_t word)
{
	int exponent = (in_byte_order(point, word) ^ WORD_SIGN) - WORD_SIGN;

	return exponent >= -CONVERT_EXPONENT_MAX && exponent <= CONVERT_EXPONENT_MAX ? (int8_t)exponent
										     : CONVERT_NO_EXPONENT;
}

/* Divides where the power is negative: 0.1 is no binary number, 10 is. */
static double times_ten_to(double number, int exponent)
{
	static const double powers[CONVERT_EXPONENT_MAX + 1] = {1,   1e1, 1e2, 1e3, 1e4, 1e5,
								1e6, 1e7, 1e8, 1e9, 1e10};

	return exponent < 0 ? number / powers[-exponent] : number * powers[exponent];
}

/* ---- scaling --------------------------------------------------------------------------------- */

static double between(double x, double x1, double y1, double x2, double y2)
{
	return y1 + (x - x1) / (x2 - x1) * (y2 - y1);
}

static double from_table(const struct modbus_knot *knots, unsigned count, double raw, uint8_t *quality)
{
	unsigned next = 1;

	if (raw < knots[0].raw || raw > knots[count - 1].raw) {
		*quality |= MAP_OVERFLOW;
		return raw < knots[0].raw ? knots[0].value : knots[count - 1].value;
	}
	while (next < count - 1 && raw > knots[next].raw)
		next++;
	return between(raw, knots[next - 1].raw, knots[next - 1].value, knots[next].raw, knots[next].value);
}

/* The values of a table that is written through rise or fall all the way. False: the value is beyond them. */
static bool to_table(const struct modbus_knot *knots, unsigned count, double value, double *raw)
{
	for (unsigned next = 1; next < count; next++) {
		double a = knots[next - 1].value, b = knots[next].value;

		if ((value < a && value < b) || (value > a && value > b))
			continue;
		*raw = between(value, a, knots[next - 1].raw, b, knots[next].raw);
		return true;
	}
	return false;
}

/* The raw value in the unit of the value sent. */
static double scaled(const struct modbus_point *point, const struct modbus_knot *knots, double raw,
		     uint8_t *quality)
{
	if (point->knot_count > 0)
		return from_table(&knots[point->first_knot], point->knot_count, raw, quality);
	return raw * point->scale + point->offset;
}

static bool unscaled(const struct modbus_point *point, const struct modbus_knot *knots, double value,
		     double *raw)
{
	if (point->knot_count > 0)
		return to_table(&knots[point->first_knot], point->knot_count, value, raw);
	*raw = (value - point->offset) / point->scale;
	return true;
}

static bool is_scaled(const struct modbus_point *point)
{
	return point->knot_count > 0 || point->scale < 1 || point->scale > 1 || point->offset < 0 ||
	       point->offset > 0;
}

/* ---- to the map ------------------------------------------------------------------------------ */

static uint32_t double_point(const struct modbus_point *point, bool first, bool second)
{
	bool swapped = has(point, MODBUS_BITS_SWAPPED), inverted = has(point, MODBUS_INVERTED);
	uint32_t off = (swapped ? second : first) != inverted, on = (swapped ? first : second) != inverted;

	return on << 1 | off;
}

static uint32_t bits_value(const struct modbus_point *point, const uint16_t raw[CONVERT_WIDTH_MAX])
{
	uint32_t first = raw[0] != 0, second = raw[1] != 0;

	if (modbus_is_register_bit(point)) {
		uint32_t word = in_byte_order(point, raw[0]);

		first = word >> point->bit & 1;
		second = word >> (point->bit + 1) & 1;
	}
	if (point->type == MAP_DOUBLE)
		return double_point(point, first, second);
	return first != has(point, MODBUS_INVERTED);
}

static void step_position(uint64_t word, struct map_sample *sample)
{
	int32_t value = (int32_t)(word & VTI_VALUE);

	sample->value.i = value & VTI_SIGN ? value - 2 * VTI_SIGN : value;
	sample->detail = word & VTI_TRANSIENT ? 1 : 0;
}

static int32_t rounded_within(double value, int32_t min, int32_t max, uint8_t *quality)
{
	if (value >= min && value <= max)
		return map_round(value);
	*quality |= MAP_OVERFLOW;
	return value < min ? min : max;
}

static float short_float(double value, uint8_t *quality)
{
	if (fabs(value) <= (double)FLT_MAX)
		return (float)value;
	*quality |= MAP_OVERFLOW;
	return value < 0 ? -FLT_MAX : FLT_MAX;
}

/* An integer without a scale keeps all its bits. */
static bool counted(const struct modbus_point *point, uint64_t all, double number, uint32_t *count)
{
	double whole = map_nearest(number * point->scale + point->offset);
	uint64_t integer;

	if (!is_scaled(point) && !modbus_has_scale_register(point) && whole_of(point, all, &integer))
		*count = (uint32_t)integer;
	else if (whole >= -TWO_TO_63 && whole < TWO_TO_63)
		*count = (uint32_t)(int64_t)whole;
	else
		return false;
	return true;
}

static void measured(const struct modbus_point *point, const struct modbus_knot *knots, double number,
		     struct map_sample *sample)
{
	double value = scaled(point, knots, number, &sample->quality);

	if (point->type == MAP_FLOAT)
		sample->value.f = short_float(value, &sample->quality);
	else
		sample->value.i = rounded_within(value, INT16_MIN, INT16_MAX, &sample->quality);
}

static void numeric(const struct modbus_point *point, const struct modbus_knot *knots, int8_t exponent,
		    uint64_t all, struct map_sample *sample)
{
	double number;
	bool is = exponent != CONVERT_NO_EXPONENT && number_of(point, all, &number);

	if (is)
		number = times_ten_to(number, exponent);
	if (is && point->type == MAP_COUNTER)
		is = counted(point, all, number, &sample->value.u);
	else if (is)
		measured(point, knots, number, sample);
	if (!is)
		*sample = (struct map_sample){.quality = MAP_INVALID, .time_ns = sample->time_ns};
}

void convert_to_sample(const struct modbus_point *point, const struct modbus_knot *knots, int8_t exponent,
		       const uint16_t raw[CONVERT_WIDTH_MAX], struct map_sample *sample)
{
	sample->quality = MAP_GOOD;
	sample->detail = 0;
	switch ((enum map_type)point->type) {
	case MAP_SINGLE:
	case MAP_DOUBLE:
		sample->value.u = bits_value(point, raw);
		break;
	case MAP_STEP:
		step_position(gather(point, raw), sample);
		break;
	case MAP_BITSTRING:
		sample->value.u = (uint32_t)gather(point, raw);
		break;
	case MAP_NORMALIZED:
	case MAP_SCALED:
	case MAP_FLOAT:
	case MAP_COUNTER:
		numeric(point, knots, exponent, gather(point, raw), sample);
		break;
		MAP_OWN_TYPES(MAP_CASE) /* no object has them: modbus_type_names */
		*sample = (struct map_sample){.quality = MAP_INVALID, .time_ns = sample->time_ns};
		break;
	}
}

/* ---- to the device --------------------------------------------------------------------------- */

uint16_t convert_register_mask(const struct modbus_point *point)
{
	unsigned bits = modbus_is_field(point)      ? (unsigned)greatest(point)
			: point->type == MAP_DOUBLE ? 3u
						    : 1u;

	return in_byte_order(point, (uint16_t)(bits << point->bit));
}

static bool put_bits(const struct modbus_point *point, uint32_t value, uint16_t raw[CONVERT_WIDTH_MAX])
{
	bool swapped = has(point, MODBUS_BITS_SWAPPED), inverted = has(point, MODBUS_INVERTED);
	bool first = (value != 0) != inverted, second = false;

	if (point->type == MAP_DOUBLE) {
		first = (value == (swapped ? DOUBLE_ON : DOUBLE_OFF)) != inverted;
		second = (value == (swapped ? DOUBLE_OFF : DOUBLE_ON)) != inverted;
		/* Nobody can command an intermediate or indeterminate position (IEC 60870-5-101, 7.2.6.16). */
		if (value != DOUBLE_OFF && value != DOUBLE_ON)
			return false;
	} else if (value > 1) {
		return false;
	}
	if (modbus_is_register_bit(point)) {
		raw[0] = in_byte_order(point, (uint16_t)((first | (unsigned)second << 1) << point->bit));
		return true;
	}
	raw[0] = first;
	if (point->type == MAP_DOUBLE)
		raw[1] = second;
	return true;
}

static bool put_step(const struct modbus_point *point, int32_t value, uint8_t detail,
		     uint16_t raw[CONVERT_WIDTH_MAX])
{
	unsigned vti = ((unsigned)value & VTI_VALUE) | (detail & 1 ? VTI_TRANSIENT : 0);

	split(point, vti, raw);
	return value >= STEP_MIN && value <= STEP_MAX;
}

static bool put_number(const struct modbus_point *point, const struct modbus_knot *knots, int8_t exponent,
		       double value, uint16_t raw[CONVERT_WIDTH_MAX])
{
	double number;

	if (!isfinite(value) || !unscaled(point, knots, value, &number))
		return false;
	number = times_ten_to(number, -exponent);
	return isfinite(number) && registers_of(point, number, raw);
}

bool convert_to_raw(const struct modbus_point *point, const struct modbus_knot *knots, int8_t exponent,
		    union map_value value, uint8_t detail, uint16_t raw[CONVERT_WIDTH_MAX])
{
	switch ((enum map_type)point->type) {
	case MAP_SINGLE:
	case MAP_DOUBLE:
		return put_bits(point, value.u, raw);
	case MAP_STEP:
		return put_step(point, value.i, detail, raw);
	case MAP_BITSTRING:
		return scatter(point, value.u, raw);
	case MAP_NORMALIZED:
	case MAP_SCALED:
		return value.i >= INT16_MIN && value.i <= INT16_MAX &&
		       put_number(point, knots, exponent, value.i, raw);
	case MAP_FLOAT:
		return put_number(point, knots, exponent, (double)value.f, raw);
	case MAP_COUNTER:
		return put_number(point, knots, exponent, value.i, raw);
		MAP_OWN_TYPES(MAP_CASE)
		break;
	}
	return false;
}
