/* SPDX-License-Identifier: GPL-3.0-or-later */
#include "process/heartbeat.h"

#include <fcntl.h>
#include <stdio.h>
#include <stdlib.h>
#include <unistd.h>

#include "map/time_ns.h"

#define PAUSE_NS     (10 * NS_PER_S) /* between two lines of the log */
#define FIGURES_SIZE 80              /* three decimal numbers of 64 bits */

static int64_t waited_ns(const struct heartbeat *heartbeat)
{
	char figures[FIGURES_SIZE], *second;
	ssize_t length = -1;

	if (heartbeat->schedstat_fd >= 0)
		length = pread(heartbeat->schedstat_fd, figures, sizeof(figures) - 1, 0);
	if (length <= 0)
		return HEARTBEAT_UNKNOWN;
	figures[length] = '\0';
	strtoull(figures, &second, 10);
	return (int64_t)strtoull(second, NULL, 10);
}

void heartbeat_begin(struct heartbeat *heartbeat, struct map *map)
{
	*heartbeat = (struct heartbeat){.schedstat_fd = open("/proc/self/schedstat", O_RDONLY | O_CLOEXEC)};
	heartbeat->waited_ns = waited_ns(heartbeat);
	heartbeat->beaten_ns = map_now_ns();
	map_heartbeat(map);
}

void heartbeat_words(char *out, size_t size, int64_t silent_ms, uint32_t limit_ms, int64_t waited_ms,
		     unsigned unsaid)
{
	char reason[64] = "the host gave this process no time, or somebody stopped it";
	char more[40] = "";

	if (waited_ms >= silent_ms / 2)
		snprintf(reason, sizeof(reason), "the host gave this process no time for %lld ms",
			 (long long)waited_ms);
	else if (waited_ms != HEARTBEAT_UNKNOWN)
		snprintf(reason, sizeof(reason), "this process was stopped or busy all the time");
	if (unsaid > 0)
		snprintf(more, sizeof(more), "; %u times more", unsaid);
	snprintf(out, size, "silent for %lld ms (limit %u): %s%s", (long long)silent_ms, limit_ms, reason,
		 more);
}

static void say_why(struct heartbeat *heartbeat, struct map *map, int64_t silent_ns, int64_t waited_ms,
		    int64_t now_ns)
{
	char words[MAP_LOG_TEXT_SIZE];

	if (heartbeat->said_ns != 0 && now_ns - heartbeat->said_ns < PAUSE_NS) {
		heartbeat->unsaid++;
		return;
	}
	heartbeat_words(words, sizeof(words), silent_ns / NS_PER_MS,
			map_heartbeat_limit_ms(map, map_self(map)), waited_ms, heartbeat->unsaid);
	map_log(map, MAP_LOG_WARNING, "%s", words);
	heartbeat->said_ns = now_ns;
	heartbeat->unsaid = 0;
}

/* Of the silence, as far as the scheduler counted it. What it counted between the clock and this question is of the next
 * silence. */
static int64_t waited_of_ms(struct heartbeat *heartbeat, int64_t silent_ns)
{
	int64_t counted = waited_ns(heartbeat), waited = counted - heartbeat->waited_ns;

	if (counted == HEARTBEAT_UNKNOWN)
		return HEARTBEAT_UNKNOWN;
	if (waited > silent_ns)
		waited = silent_ns;
	heartbeat->waited_ns += waited;
	return waited / NS_PER_MS;
}

void heartbeat_beat(struct heartbeat *heartbeat, struct map *map, int64_t now_ns)
{
	int64_t limit_ns = map_heartbeat_limit_ms(map, map_self(map)) * NS_PER_MS;
	int64_t silent_ns = now_ns - heartbeat->beaten_ns, waited_ms = waited_of_ms(heartbeat, silent_ns);

	map_heartbeat(map);
	if (silent_ns > limit_ns)
		say_why(heartbeat, map, silent_ns, waited_ms, now_ns);
	heartbeat->beaten_ns = now_ns;
}
