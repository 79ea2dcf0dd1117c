/* SPDX-License-Identifier: GPL-3.0-or-later */
/* How many lines of the log are about peers: fewer than a module may write, so that peers leave room for the rest. */
#ifndef OPENRTU_CHANNEL_LINES_H
#define OPENRTU_CHANNEL_LINES_H

#include "map/lines.h"

#define CHANNEL_LINE_PERIOD_NS (250 * NS_PER_MS)
#define CHANNEL_LINES_AT_ONCE  40 /* 16 connections come, start and are refused something */

/* Whether one more may be written now. Then withheld is to be told, in a line that takes its room, and is the caller's to set to 0. */
static inline bool channel_may_say(struct map_lines *lines, int64_t now_ns)
{
	const struct map_pace pace = {CHANNEL_LINE_PERIOD_NS, CHANNEL_LINES_AT_ONCE};

	if (!map_lines_take(lines, pace, now_ns))
		return false;
	if (lines->withheld > 0)
		lines->paid_ns += pace.period_ns;
	return true;
}

#endif
