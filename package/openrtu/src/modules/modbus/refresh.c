/* SPDX-License-Identifier: GPL-3.0-or-later */
#include "modules/modbus/refresh.h"

#include "map/time_ns.h"

#define MARGIN_NS (250 * NS_PER_MS) /* rtud looks each 50 ms, and may itself be late */

/* A scan in which this process was stopped says nothing of how long one takes. */
static void begin(struct refresh *refresh, int64_t beaten_ns, int64_t limit_ns, int64_t now_ns)
{
	const int64_t patience_ns = map_patience_ms(refresh->map, map_self(refresh->map)) * NS_PER_MS;

	refresh->until_ns = earlier(now_ns + REFRESH_NS, beaten_ns + patience_ns - MARGIN_NS);
	for (uint32_t i = 0; i < refresh->line_count; i++)
		line_results_note_scan(&refresh->lines[i], refresh->back_ns, beaten_ns + limit_ns);
	refresh->back_ns = now_ns;
}

static bool any_is_old(const struct refresh *refresh, int64_t now_ns)
{
	for (uint32_t i = 0; i < refresh->line_count; i++)
		if (line_results_are_old(&refresh->lines[i], now_ns))
			return true;
	return false;
}

bool refresh_holds(struct refresh *refresh, int64_t beaten_ns, int64_t now_ns)
{
	const int64_t limit_ns = map_heartbeat_limit_ms(refresh->map, map_self(refresh->map)) * NS_PER_MS;

	if (now_ns - beaten_ns <= limit_ns)
		return false;
	if (refresh->until_ns == 0)
		begin(refresh, beaten_ns, limit_ns, now_ns);
	if (now_ns < refresh->until_ns && any_is_old(refresh, now_ns))
		return true;
	for (uint32_t i = 0; i < refresh->line_count; i++)
		line_results_give_up_old(&refresh->lines[i], now_ns);
	refresh->until_ns = 0;
	return false;
}
