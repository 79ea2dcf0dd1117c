/* SPDX-License-Identifier: GPL-3.0-or-later */
/* Distances on the Earth, in integers: the modules map no mathematical library, and the board has no floating-point unit. */
#ifndef OPENRTU_GPS_SPHERE_H
#define OPENRTU_GPS_SPHERE_H

#include <stdbool.h>
#include <stddef.h>
#include <stdint.h>

/*
 * The distance of two places in 1e-7 degree, in mm, on a sphere of 6 371 009 m. It is within 30 mm of what floating point gives,
 * anywhere. The sphere itself is up to 0.6 % off the ellipsoid of WGS 84.
 */
int64_t gps_distance_mm(int32_t latitude_a, int32_t longitude_a, int32_t latitude_b, int32_t longitude_b);

/* How far east it is, the short way: -180..180 degrees in 1e-7 degree. */
int32_t gps_longitude_apart(int32_t from, int32_t to);

#endif
