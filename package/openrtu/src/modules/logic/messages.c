/* SPDX-License-Identifier: GPL-3.0-or-later */
/* What the program says, in the module's log: some lines at once, as a condition that stays would fill the log. */
#include "map/time_ns.h"
#include "modules/logic/host.h"

#define BURST     10
#define WINDOW_NS (10 * NS_PER_S)

static struct {
	int64_t begun_ns; /* 0: not yet */
	uint32_t lines;
	uint32_t left_out;
} window;

static void begin_window(struct map *map, int64_t now_ns)
{
	if (window.begun_ns != 0 && now_ns < window.begun_ns + WINDOW_NS)
		return;
	if (window.left_out > 0)
		map_log(map, MAP_LOG_WARNING, "%u messages of the program were left out", window.left_out);
	window.begun_ns = now_ns;
	window.lines = 0;
	window.left_out = 0;
}

void messages_say(const struct host *host, int64_t now_ns)
{
	begin_window(host->map, now_ns);
	for (unsigned i = 0; i < host->logic.messages; i++) {
		char text[MAP_LOG_TEXT_SIZE];

		if (window.lines == BURST) {
			window.left_out++;
			continue;
		}
		window.lines++;
		logic_message(&host->logic, i, text, sizeof(text));
		map_log(host->map, MAP_LOG_INFO, "%s", text);
	}
	window.left_out += host->logic.unsaid;
}
