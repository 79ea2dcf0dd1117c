/* SPDX-License-Identifier: GPL-3.0-or-later */
/*
 * Units of time, and which of two moments is first. For all rooms.
 *
 * A duration or a moment is an int64_t in nanoseconds. (This file is not time.h: that would hide the C library's.)
 */
#ifndef OPENRTU_MAP_TIME_NS_H
#define OPENRTU_MAP_TIME_NS_H

#include <stdint.h>

#define NS_PER_US  1000LL
#define NS_PER_MS  1000000LL
#define NS_PER_S   1000000000LL
#define US_PER_MS  1000LL
#define US_PER_S   1000000LL
#define MS_PER_S   1000LL
#define S_PER_HOUR 3600LL
#define S_PER_DAY  86400LL

static inline int64_t earlier(int64_t a, int64_t b)
{
	return a < b ? a : b;
}

static inline int64_t later(int64_t a, int64_t b)
{
	return a > b ? a : b;
}

#endif
