/* SPDX-License-Identifier: GPL-3.0-or-later */
/*
 * The sine, the cosine and the angle of a vector by CORDIC (Volder, 1959): a vector is turned by angles whose tangents are
 * powers of two, so that additions and shifts do it. Angles in radians and lengths are in 2^-36.
 */
#include "gps/sphere.h"

#define ONE_BITS     36
#define TURNS        36
#define GAIN_INVERSE 41730103940LL /* the product of the cosines of all turns */
#define HALF_CIRCLE  1800000000
#define QUARTER      900000000
/* Radians of 1e-7 degree, times 2^(36 + 24). */
#define RADIANS_SHIFTED 2012227627LL
#define RADIANS_SHIFT   24
#define COORDINATE_BITS 30 /* of a place on the sphere of radius 1: 6 mm on the Earth */
#define EARTH_RADIUS_M  6371009LL

/* atan(2^-i) */
static const int64_t turns[TURNS] = {
    53972150818, 31861621080, 16834805542, 8545610155, 4289387961, 2146785007, 1073654455, 536859990,
    268434091,   134217557,   67108843,    33554429,   16777216,   8388608,    4194304,    2097152,
    1048576,     524288,      262144,      131072,     65536,      32768,      16384,      8192,
    4096,        2048,        1024,        512,        256,        128,        64,         32,
    16,          8,           4,           2,
};

/* Turns (x, y) by the angle, or with angle NULL until y is 0; returns by how much. */
static int64_t rotate(int64_t *x, int64_t *y, const int64_t *angle)
{
	int64_t turned = 0;

	for (int i = 0; i < TURNS; i++) {
		bool left = angle != NULL ? turned < *angle : *y < 0;
		int64_t dx = *y >> i, dy = *x >> i;

		*x += left ? -dx : dx;
		*y += left ? dy : -dy;
		turned += left ? turns[i] : -turns[i];
	}
	return turned;
}

/* Of an angle of -90..90 degrees. */
static void sine_and_cosine(int32_t angle_e7, int64_t *sine, int64_t *cosine)
{
	int64_t angle = angle_e7 * RADIANS_SHIFTED >> RADIANS_SHIFT;

	*cosine = GAIN_INVERSE;
	*sine = 0;
	rotate(cosine, sine, &angle);
}

/* The angle of a vector with x >= 0. */
static int64_t angle_of(int64_t x, int64_t y)
{
	return -rotate(&x, &y, NULL);
}

struct vector {
	int64_t x, y, z;
};

static int64_t coordinate(int64_t value)
{
	return (value + (1 << (ONE_BITS - COORDINATE_BITS - 1))) >> (ONE_BITS - COORDINATE_BITS);
}

static struct vector place(int32_t latitude, int32_t longitude)
{
	bool far = longitude > QUARTER || longitude < -QUARTER;
	int64_t sine_lat, cosine_lat, sine_lon, cosine_lon;
	int32_t near = longitude;

	if (far)
		near = longitude > 0 ? HALF_CIRCLE - longitude : -HALF_CIRCLE - longitude;
	sine_and_cosine(latitude, &sine_lat, &cosine_lat);
	sine_and_cosine(near, &sine_lon, &cosine_lon);
	cosine_lat = coordinate(cosine_lat);
	return (struct vector){
	    .x = cosine_lat * coordinate(far ? -cosine_lon : cosine_lon) >> COORDINATE_BITS,
	    .y = cosine_lat * coordinate(sine_lon) >> COORDINATE_BITS,
	    .z = coordinate(sine_lat),
	};
}

static uint64_t square_root(uint64_t value)
{
	uint64_t root = 0, bit = 1ULL << 62;

	while (bit > value)
		bit >>= 2;
	for (; bit != 0; bit >>= 2) {
		bool above = value >= root + bit;

		if (above)
			value -= root + bit;
		root = (root >> 1) + (above ? bit : 0);
	}
	return root;
}

static int64_t length(int64_t x, int64_t y, int64_t z)
{
	return (int64_t)square_root((uint64_t)(x * x) + (uint64_t)(y * y) + (uint64_t)(z * z));
}

int64_t gps_distance_mm(int32_t latitude_a, int32_t longitude_a, int32_t latitude_b, int32_t longitude_b)
{
	struct vector a = place(latitude_a, longitude_a), b = place(latitude_b, longitude_b);
	int64_t apart = length(a.x - b.x, a.y - b.y, a.z - b.z),
		sum = length(a.x + b.x, a.y + b.y, a.z + b.z);
	/* Half the angle between two vectors of one length has the tangent |a - b| / |a + b| (Kahan). */
	int64_t angle = 2 * angle_of(sum << 5, apart << 5);

	/* metres in 2^-26, then times 1 000 = 125 * 2^3 */
	return ((angle >> (ONE_BITS - 32)) * EARTH_RADIUS_M >> 6) * 125 >> 23;
}

int32_t gps_longitude_apart(int32_t from, int32_t to)
{
	int64_t apart = (int64_t)to - from;

	if (apart > HALF_CIRCLE)
		apart -= 2LL * HALF_CIRCLE;
	if (apart < -HALF_CIRCLE)
		apart += 2LL * HALF_CIRCLE;
	return (int32_t)apart;
}
