/* SPDX-License-Identifier: GPL-3.0-or-later */
#include "real.h"

#include <float.h>
#include <stddef.h>
#include <string.h>

_Static_assert(FLT_EVAL_METHOD == 0, "REAL and LREAL are computed in their own precision");

#define MANTISSA_BITS 52
#define BIAS          1023
#define PI_2          1.57079632679489655800e+00
#define PI_2_REST     6.12323399573676603587e-17 /* pi / 2 - PI_2 */
#define LN2_HIGH      6.93147180369123816490e-01 /* its low 32 bits are 0: exact times any exponent */
#define LN2_LOW       1.90821492927058770002e-10
#define ANGLE_MAX     1048576.0 /* beyond, the rest after whole turns has lost its digits */

static uint64_t bits_of(double x)
{
	uint64_t bits;

	memcpy(&bits, &x, sizeof(bits));
	return bits;
}

static double of_bits(uint64_t bits)
{
	double x;

	memcpy(&x, &bits, sizeof(x));
	return x;
}

static double not_finite(void)
{
	return of_bits(UINT64_C(0x7ff) << MANTISSA_BITS);
}

bool logic_finite(double x)
{
	return (bits_of(x) >> MANTISSA_BITS & 0x7ff) != 0x7ff;
}

static double absolute(double x)
{
	return x < 0 ? -x : x;
}

static double power_of_2(int exponent)
{
	return of_bits((uint64_t)(exponent + BIAS) << MANTISSA_BITS);
}

/* x * 2^exponent, for exponents within twice a double's. */
static double scale(double x, int exponent)
{
	int half = exponent / 2;

	return x * power_of_2(half) * power_of_2(exponent - half);
}

/* x = mantissa * 2^exponent with a mantissa of 53 bits; x is positive. */
static uint64_t split(double x, int *exponent)
{
	if (x < DBL_MIN) {
		uint64_t mantissa = split(x * power_of_2(64), exponent);

		*exponent -= 64;
		return mantissa;
	}
	*exponent = (int)(bits_of(x) >> MANTISSA_BITS) - BIAS - MANTISSA_BITS;
	return (bits_of(x) & ((UINT64_C(1) << MANTISSA_BITS) - 1)) | UINT64_C(1) << MANTISSA_BITS;
}

double logic_round(double x)
{
	const double shift = 4503599627370496.0; /* 2^52: what is added to it has no fraction left */

	if (absolute(x) >= shift)
		return x;
	return x < 0 ? -(shift - x - shift) : x + shift - shift;
}

/* The root digit by digit, to 54 bits; the last one rounds. No tie is possible: the square of an odd number is odd. */
static double square_root(double x)
{
	int exponent;
	uint64_t mantissa, rest = 0, root = 0;

	if (x < 0)
		return not_finite();
	if (x == 0)
		return 0;
	mantissa = split(x, &exponent);
	if (exponent & 1) {
		mantissa <<= 1;
		exponent--;
	}
	for (int digit = 0; digit < 54; digit++) {
		rest = rest << 2 | (digit < 27 ? mantissa >> (52 - 2 * digit) & 3 : 0);
		root <<= 1;
		if (rest >= 2 * root + 1) {
			rest -= 2 * root + 1;
			root |= 1;
		}
	}
	return scale((double)((root >> 1) + (root & 1)), exponent / 2 - 26);
}

/* The sum of term[i] * x^i, by Horner. */
static double polynomial(double x, const double *term, size_t terms)
{
	double sum = 0;

	for (size_t i = terms; i-- > 0;)
		sum = sum * x + term[i];
	return sum;
}

/* 2 artanh(s) with s = (m - 1) / (m + 1) of the mantissa m between the roots of 1/2 and 2. */
static double logarithm(double x)
{
	static const double odd[] = {0,        1.0 / 3,  1.0 / 5,  1.0 / 7,  1.0 / 9, 1.0 / 11,
				     1.0 / 13, 1.0 / 15, 1.0 / 17, 1.0 / 19, 1.0 / 21};
	int exponent;
	double m, f, s, square;

	if (x <= 0)
		return not_finite();
	m = scale((double)split(x, &exponent), -MANTISSA_BITS);
	exponent += MANTISSA_BITS;
	if (m > 1.4142135623730951) {
		m *= 0.5;
		exponent++;
	}
	f = m - 1;
	s = f / (2 + f);
	square = s * s;
	/* 2 s = f - s f: f is exact, and so the first term of the sum. */
	return exponent * LN2_HIGH +
	       (f -
		(s * f - 2 * s * polynomial(square, odd, sizeof(odd) / sizeof(odd[0])) - exponent * LN2_LOW));
}

static double exponential(double x)
{
	static const double factorial[] = {
	    1.0 / 2,     1.0 / 6,      1.0 / 24,      1.0 / 120,       1.0 / 720,        1.0 / 5040,
	    1.0 / 40320, 1.0 / 362880, 1.0 / 3628800, 1.0 / 39916800., 1.0 / 479001600., 1.0 / 6227020800.};
	double k, r;

	if (x > 710)
		return not_finite();
	if (x < -746)
		return 0;
	k = logic_round(x * 1.44269504088896338700);
	r = x - k * LN2_HIGH - k * LN2_LOW;
	return scale(1 + (r + r * r * polynomial(r, factorial, sizeof(factorial) / sizeof(factorial[0]))),
		     (int)k);
}

static double small_sine(double x)
{
	static const double term[] = {
	    -1.0 / 6,         1.0 / 120,         -1.0 / 5040,           1.0 / 362880,
	    -1.0 / 39916800., 1.0 / 6227020800., -1.0 / 1307674368000., 1.0 / 355687428096000.};
	double square = x * x;

	return x + x * square * polynomial(square, term, sizeof(term) / sizeof(term[0]));
}

static double small_cosine(double x)
{
	static const double term[] = {
	    1.0 / 24,         -1.0 / 720,          1.0 / 40320,          -1.0 / 3628800,
	    1.0 / 479001600., -1.0 / 87178291200., 1.0 / 20922789888000.};
	double square = x * x;

	return 1 - (square / 2 - square * square * polynomial(square, term, sizeof(term) / sizeof(term[0])));
}

/* sin(x + quarters * pi / 2); pi / 2 in three parts, of which the first two have 33 bits (Cody and Waite). */
static double sine(double x, int quarters)
{
	double k, r;
	int quadrant;

	if (absolute(x) > ANGLE_MAX)
		return not_finite();
	k = logic_round(x / PI_2);
	r = x - k * 1.57079632673412561417e+00;
	r -= k * 6.07710050630396597660e-11;
	r -= k * 2.02226624879595063154e-21;
	quadrant = (int)k + quarters;
	r = quadrant & 1 ? small_cosine(r) : small_sine(r);
	return quadrant & 2 ? -r : r;
}

/* Twice the half of the angle, until the series is short. */
static double arc_tangent(double x)
{
	static const double term[] = {-1.0 / 3,  1.0 / 5,  -1.0 / 7,  1.0 / 9,
				      -1.0 / 11, 1.0 / 13, -1.0 / 15, 1.0 / 17};
	double square;

	if (x < 0)
		return -arc_tangent(-x);
	if (x > 1)
		return PI_2 - (arc_tangent(1 / x) - PI_2_REST);
	if (x > 0.105)
		return 2 * arc_tangent(x / (1 + square_root(1 + x * x)));
	square = x * x;
	return x + x * square * polynomial(square, term, sizeof(term) / sizeof(term[0]));
}

static double arc_sine(double x)
{
	if (absolute(x) > 1)
		return not_finite();
	if (absolute(x) == 1)
		return x * PI_2;
	return arc_tangent(x / square_root((1 - x) * (1 + x)));
}

static double arc_cosine(double x)
{
	if (absolute(x) > 1)
		return not_finite();
	if (x == -1)
		return 2 * PI_2;
	return 2 * arc_tangent(square_root((1 - x) / (1 + x)));
}

double logic_real(enum logic_function function, double x)
{
	switch (function) {
	case LOGIC_SQRT:
		return square_root(x);
	case LOGIC_LN:
		return logarithm(x);
	case LOGIC_LOG:
		return logarithm(x) / 2.30258509299404590109;
	case LOGIC_EXP:
		return exponential(x);
	case LOGIC_SIN:
		return sine(x, 0);
	case LOGIC_COS:
		return sine(x, 1);
	case LOGIC_TAN:
		return sine(x, 0) / sine(x, 1);
	case LOGIC_ASIN:
		return arc_sine(x);
	case LOGIC_ACOS:
		return arc_cosine(x);
	case LOGIC_ATAN:
		return arc_tangent(x);
	case LOGIC_FUNCTIONS:
		break;
	}
	return not_finite();
}

/* By squaring: exact as long as the products are. */
static double whole_power(double base, uint32_t exponent)
{
	double power = 1;

	for (; exponent; exponent >>= 1) {
		if (exponent & 1)
			power *= base;
		base *= base;
	}
	return power;
}

double logic_expt(double base, double exponent)
{
	if (exponent == logic_round(exponent) && absolute(exponent) <= 1024) {
		if (exponent >= 0)
			return whole_power(base, (uint32_t)exponent);
		return base == 0 ? not_finite() : 1 / whole_power(base, (uint32_t)-exponent);
	}
	if (base == 0)
		return exponent > 0 ? 0 : not_finite();
	return base < 0 ? not_finite() : exponential(exponent * logarithm(base));
}
