/* SPDX-License-Identifier: GPL-3.0-or-later */
/*
 * How often something may cost time: PACE_AT_ONCE times in a row, and on average once a millisecond. What others cause in a process of
 * real-time priority has to have such a bound, since nobody else runs meanwhile. Times are arguments.
 */
#ifndef OPENRTU_GOOSE_PACE_H
#define OPENRTU_GOOSE_PACE_H

#include <stdbool.h>

#include "map/time_ns.h"

#define PACE_NS      NS_PER_MS
#define PACE_AT_ONCE 32
#define PACE_FULL_NS (PACE_AT_ONCE * PACE_NS) /* rest, after which it may be so many at once again */

struct goose_pace {
	int64_t paid_ns; /* until then it has been taken */
};

/* From when on it may be. */
static inline int64_t goose_pace_free(const struct goose_pace *pace)
{
	return pace->paid_ns - (PACE_FULL_NS - PACE_NS);
}

static inline bool goose_pace_may(const struct goose_pace *pace, int64_t now_ns)
{
	return now_ns >= goose_pace_free(pace);
}

/* Also when it may not: it happened anyway, and the next time is no later for it than PACE_NS from now. */
static inline void goose_pace_take(struct goose_pace *pace, int64_t now_ns)
{
	pace->paid_ns = earlier(later(pace->paid_ns, now_ns) + PACE_NS, now_ns + PACE_FULL_NS);
}

#endif
