/* SPDX-License-Identifier: GPL-3.0-or-later */
/*
 * How many lines of the log are about peers. What a peer does can make a line, and a peer may do it without end. rtud prints the
 * lines, above the priority of the Modbus lines, to where they may fill a disk.
 */
#ifndef OPENRTU_CHANNEL_LINES_H
#define OPENRTU_CHANNEL_LINES_H

#include <stdbool.h>
#include <stdint.h>

#define CHANNEL_LINE_PERIOD_NS 250000000LL
#define CHANNEL_LINES_AT_ONCE  40 /* 16 connections come, start and are refused something */

/* Begins with zeros. */
struct channel_lines {
	int64_t paid_ns;   /* each line moves it on; far in the future, lines are left out */
	uint32_t withheld; /* lines left out since the last one */
};

/* Whether one more may be written now. Then withheld is to be told, and is the caller's to set to 0. */
static inline bool channel_may_say(struct channel_lines *lines, int64_t now_ns)
{
	if (lines->paid_ns < now_ns)
		lines->paid_ns = now_ns;
	if (lines->paid_ns > now_ns + (CHANNEL_LINES_AT_ONCE - 1) * CHANNEL_LINE_PERIOD_NS) {
		lines->withheld++;
		return false;
	}
	lines->paid_ns += CHANNEL_LINE_PERIOD_NS;
	return true;
}

#endif
