/* SPDX-License-Identifier: GPL-3.0-or-later */
#include "channel/attempts.h"

#include <stdio.h>

struct attempts attempts_begin(int64_t first_ns, int64_t most_ns)
{
	return (struct attempts){.retry = retry_begin(first_ns, most_ns)};
}

bool attempts_failed(struct attempts *attempts, const char *reason, int64_t now_ns)
{
	attempts->pause_ns = retry_failed(&attempts->retry);
	return map_trouble_failed(&attempts->trouble, reason, now_ns);
}

const char *attempts_failure(const struct attempts *attempts, int64_t now_ns, char text[ATTEMPTS_TEXT_SIZE])
{
	char times[MAP_TROUBLE_SIZE], next[MAP_DURATION_SIZE];

	snprintf(text, ATTEMPTS_TEXT_SIZE, "%s; trying again in %s",
		 map_trouble_times(&attempts->trouble, now_ns, times),
		 map_duration(attempts->pause_ns, next));
	return text;
}
