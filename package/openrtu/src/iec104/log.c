/* SPDX-License-Identifier: GPL-3.0-or-later */
#include "iec104/station_parts.h"

#include <inttypes.h>
#include <stdarg.h>
#include <stdio.h>

/*
 * What a peer does can make a line, and a peer may do it without end. rtud prints the lines, above the priority of
 * the Modbus lines, to where they may fill a disk.
 */
#define LINE_PERIOD_NS 250000000LL
#define LINES_AT_ONCE  40 /* 16 connections come, start and are refused something */

static bool may_log(struct iec104_station *station)
{
	int64_t now_ns = station->now_ns;

	if (station->log_paid_ns < now_ns)
		station->log_paid_ns = now_ns;
	if (station->log_paid_ns > now_ns + (LINES_AT_ONCE - 1) * LINE_PERIOD_NS) {
		station->log_withheld++;
		return false;
	}
	station->log_paid_ns += LINE_PERIOD_NS;
	return true;
}

void iec104_log(struct iec104_station *station, enum map_log_level level, const char *peer,
		const char *format, ...)
{
	char text[MAP_LOG_TEXT_SIZE];
	va_list arguments;

	if (!may_log(station))
		return;
	if (station->log_withheld > 0)
		map_log(station->map, MAP_LOG_WARNING, "%" PRIu32 " lines about connections are left out",
			station->log_withheld);
	station->log_withheld = 0;
	va_start(arguments, format);
	vsnprintf(text, sizeof(text), format, arguments);
	va_end(arguments);
	map_log(station->map, level, "%s: %s", peer, text);
}
