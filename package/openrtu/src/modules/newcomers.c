/* SPDX-License-Identifier: GPL-3.0-or-later */
#include "modules/newcomers.h"

#include <string.h>

#define LIMIT_S  10
#define NS_PER_S 1000000000LL

static struct newcomer newcomers[NEWCOMERS_MAX];

static void send_away(struct iec104_station *station, struct newcomer *newcomer, const char *why)
{
	iec104_log(station, MAP_LOG_WARNING, newcomer->channel.peer, "refused, %s", why);
	channel_close(&newcomer->channel);
	newcomer->here = false;
}

static unsigned count_from(const char *address)
{
	unsigned count = 0;

	for (unsigned i = 0; i < NEWCOMERS_MAX; i++)
		count += newcomers[i].here && strcmp(newcomers[i].peer.address, address) == 0;
	return count;
}

/* Of the address that has most, the oldest: a flood from one address sends only itself away. */
static bool goes_before(const struct newcomer *a, const struct newcomer *b)
{
	unsigned from_a = count_from(a->peer.address), from_b = count_from(b->peer.address);

	return from_a != from_b ? from_a > from_b : a->until_ns < b->until_ns;
}

static struct newcomer *find_place(void)
{
	struct newcomer *first = &newcomers[0];

	for (unsigned i = 0; i < NEWCOMERS_MAX; i++) {
		if (!newcomers[i].here)
			return &newcomers[i];
		if (goes_before(&newcomers[i], first))
			first = &newcomers[i];
	}
	return first;
}

struct newcomer *newcomers_place(struct iec104_station *station, const struct iec104_peer *peer,
				 int64_t now_ns)
{
	struct newcomer *newcomer = find_place();

	if (newcomer->here)
		send_away(station, newcomer, "too many are in their handshake");
	newcomer->here = true;
	newcomer->peer = *peer;
	newcomer->until_ns = now_ns + LIMIT_S * NS_PER_S;
	return newcomer;
}

struct newcomer *newcomers_at(uint32_t place)
{
	return newcomers[place].here ? &newcomers[place] : NULL;
}

uint32_t newcomers_place_of(const struct newcomer *newcomer)
{
	return (uint32_t)(newcomer - newcomers);
}

void newcomers_watch(struct iec104_station *station, int64_t now_ns)
{
	for (unsigned i = 0; i < NEWCOMERS_MAX; i++)
		if (newcomers[i].here && now_ns >= newcomers[i].until_ns)
			send_away(station, &newcomers[i], "its handshake takes too long");
}
