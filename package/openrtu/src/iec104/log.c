/* SPDX-License-Identifier: GPL-3.0-or-later */
#include "iec104/station_parts.h"

#include <inttypes.h>
#include <stdarg.h>
#include <stdio.h>

void iec104_log(struct iec104_station *station, enum map_log_level level, const char *peer,
		const char *format, ...)
{
	char text[MAP_LOG_TEXT_SIZE];
	va_list arguments;

	if (!channel_may_say(&station->lines, station->now_ns))
		return;
	if (station->lines.withheld > 0)
		map_log(station->map, MAP_LOG_WARNING, "%" PRIu32 " lines about connections are left out",
			station->lines.withheld);
	station->lines.withheld = 0;
	va_start(arguments, format);
	vsnprintf(text, sizeof(text), format, arguments);
	va_end(arguments);
	map_log(station->map, level, "%s: %s", peer, text);
}
