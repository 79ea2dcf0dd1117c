/* SPDX-License-Identifier: GPL-3.0-or-later */
#include "map/trouble.h"

#include <inttypes.h>
#include <stdio.h>
#include <string.h>

#include "map/hash.h"

#define S_PER_MIN  60
#define IN_SECONDS (5 * S_PER_MIN) /* less is told in seconds */
#define IN_MINUTES (5 * S_PER_HOUR)

static uint32_t hash_of(const char *text)
{
	return map_hash_octets(MAP_HASH_BASIS, text, strlen(text));
}

/* Another reason is news, once between two lines: some have two, in turn. */
static bool is_news(struct map_trouble *trouble, const char *reason)
{
	const uint32_t hash = hash_of(reason);

	if (!trouble->said || trouble->another_said || hash == trouble->reason)
		return false;
	trouble->another_said = true;
	trouble->reason = hash;
	return true;
}

bool map_trouble_failed(struct map_trouble *trouble, const char *reason, int64_t now_ns)
{
	trouble->well_ns = 0;
	if (map_repeats_are_over(&trouble->repeats, now_ns))
		trouble->ended = false;
	if (!trouble->is) {
		trouble->is = true;
		trouble->since_ns = now_ns;
		trouble->failures = 0;
	}
	trouble->failures++;
	if (map_repeats_happened(&trouble->repeats, 1, now_ns) == 0)
		return is_news(trouble, reason);
	trouble->said = true;
	trouble->another_said = false;
	trouble->reason = hash_of(reason);
	return true;
}

/* It comes and goes: it is well when that has lasted. */
static bool is_settled(const struct map_trouble *trouble, int64_t now_ns)
{
	return !trouble->ended || now_ns - trouble->well_ns >= trouble->repeats.pause_ns;
}

bool map_trouble_well(struct map_trouble *trouble, int64_t now_ns)
{
	if (!trouble->is)
		return false;
	if (trouble->well_ns == 0)
		trouble->well_ns = now_ns;
	if (!is_settled(trouble, now_ns))
		return false;
	trouble->is = trouble->said = false;
	trouble->ended = true;
	return true;
}

const char *map_duration(int64_t ns, char text[MAP_DURATION_SIZE])
{
	const long long s = ns / NS_PER_S;

	if (ns < NS_PER_S)
		snprintf(text, MAP_DURATION_SIZE, "%lld ms", (long long)(ns / NS_PER_MS));
	else if (s < IN_SECONDS)
		snprintf(text, MAP_DURATION_SIZE, "%lld s", s);
	else if (s < IN_MINUTES)
		snprintf(text, MAP_DURATION_SIZE, "%lld min", s / S_PER_MIN);
	else
		snprintf(text, MAP_DURATION_SIZE, "%lld h", s / S_PER_HOUR);
	return text;
}

const char *map_trouble_times(const struct map_trouble *trouble, int64_t now_ns, char text[MAP_TROUBLE_SIZE])
{
	char so_far[MAP_DURATION_SIZE];

	text[0] = '\0';
	if (trouble->failures > 1)
		snprintf(text, MAP_TROUBLE_SIZE, "; %" PRIu32 " times in %s", trouble->failures,
			 map_duration(now_ns - trouble->since_ns, so_far));
	return text;
}

const char *map_trouble_ended(const struct map_trouble *trouble, int64_t now_ns, char text[MAP_TROUBLE_SIZE])
{
	char so_far[MAP_DURATION_SIZE];

	snprintf(text, MAP_TROUBLE_SIZE, ", again after %" PRIu32 " failure%s in %s", trouble->failures,
		 trouble->failures == 1 ? "" : "s", map_duration(now_ns - trouble->since_ns, so_far));
	return text;
}
