/* SPDX-License-Identifier: GPL-3.0-or-later */
#include "channel/attempts.h"

#include <inttypes.h>
#include <stdio.h>
#include <string.h>

#include "map/hash.h"

#define S_PER_MIN    60
#define DURATION_MAX 24
#define IN_SECONDS   (5 * S_PER_MIN) /* less is told in seconds */
#define IN_MINUTES   (5 * S_PER_HOUR)

struct attempts attempts_begin(int64_t first_ns, int64_t most_ns)
{
	return (struct attempts){.retry = retry_begin(first_ns, most_ns)};
}

static uint32_t hash_of(const char *text)
{
	return map_hash_octets(MAP_HASH_BASIS, text, strlen(text));
}

/* Another reason is news, once between two lines: some peers have two, in turn. */
static bool is_news(struct attempts *attempts, const char *reason)
{
	const uint32_t hash = hash_of(reason);

	if (!attempts->said || attempts->another_said || hash == attempts->reason)
		return false;
	attempts->another_said = true;
	attempts->reason = hash;
	return true;
}

bool attempts_failed(struct attempts *attempts, const char *reason, int64_t now_ns)
{
	attempts->pause_ns = retry_failed(&attempts->retry);
	attempts->useful_ns = 0;
	if (map_repeats_are_over(&attempts->repeats, now_ns))
		attempts->ended = false;
	if (!attempts->failing) {
		attempts->failing = true;
		attempts->since_ns = now_ns;
		attempts->failures = 0;
	}
	attempts->failures++;
	if (map_repeats_happened(&attempts->repeats, 1, now_ns) == 0)
		return is_news(attempts, reason);
	attempts->said = true;
	attempts->another_said = false;
	attempts->reason = hash_of(reason);
	return true;
}

/* It comes and goes: it is there when it has lasted. */
static bool is_settled(const struct attempts *attempts, int64_t now_ns)
{
	return !attempts->ended || now_ns - attempts->useful_ns >= attempts->repeats.pause_ns;
}

bool attempts_useful(struct attempts *attempts, int64_t now_ns)
{
	if (!attempts->failing)
		return false;
	if (attempts->useful_ns == 0)
		attempts->useful_ns = now_ns;
	if (!is_settled(attempts, now_ns))
		return false;
	attempts->failing = attempts->said = false;
	attempts->ended = true;
	return true;
}

static void put_duration(char text[DURATION_MAX], int64_t ns)
{
	const int64_t s = ns / NS_PER_S;

	if (ns < NS_PER_S)
		snprintf(text, DURATION_MAX, "%lld ms", (long long)(ns / NS_PER_MS));
	else if (s < IN_SECONDS)
		snprintf(text, DURATION_MAX, "%lld s", (long long)s);
	else if (s < IN_MINUTES)
		snprintf(text, DURATION_MAX, "%lld min", (long long)(s / S_PER_MIN));
	else
		snprintf(text, DURATION_MAX, "%lld h", (long long)(s / S_PER_HOUR));
}

const char *attempts_failure(const struct attempts *attempts, int64_t now_ns, char text[ATTEMPTS_TEXT_SIZE])
{
	char next[DURATION_MAX], so_far[DURATION_MAX];

	put_duration(next, attempts->pause_ns);
	put_duration(so_far, now_ns - attempts->since_ns);
	if (attempts->failures == 1)
		snprintf(text, ATTEMPTS_TEXT_SIZE, "; trying again in %s", next);
	else
		snprintf(text, ATTEMPTS_TEXT_SIZE, "; %" PRIu32 " times in %s, trying again in %s",
			 attempts->failures, so_far, next);
	return text;
}

const char *attempts_success(const struct attempts *attempts, int64_t now_ns, char text[ATTEMPTS_TEXT_SIZE])
{
	char so_far[DURATION_MAX];

	put_duration(so_far, now_ns - attempts->since_ns);
	snprintf(text, ATTEMPTS_TEXT_SIZE, ", again after %" PRIu32 " failure%s in %s", attempts->failures,
		 attempts->failures == 1 ? "" : "s", so_far);
	return text;
}
