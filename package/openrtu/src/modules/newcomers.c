/* SPDX-License-Identifier: GPL-3.0-or-later */
#include "modules/newcomers.h"

#define LIMIT_S  10
#define NS_PER_S 1000000000LL

static struct newcomer newcomers[NEWCOMERS_MAX];

static void send_away(struct iec104_station *station, struct newcomer *newcomer, const char *why)
{
	iec104_log(station, MAP_LOG_WARNING, newcomer->channel.peer, "refused, %s", why);
	channel_close(&newcomer->channel);
	newcomer->here = false;
}

static struct newcomer *find_place(void)
{
	struct newcomer *oldest = &newcomers[0];

	for (unsigned i = 0; i < NEWCOMERS_MAX; i++) {
		if (!newcomers[i].here)
			return &newcomers[i];
		if (newcomers[i].until_ns < oldest->until_ns)
			oldest = &newcomers[i];
	}
	return oldest;
}

struct newcomer *newcomers_place(struct iec104_station *station, int64_t now_ns)
{
	struct newcomer *newcomer = find_place();

	if (newcomer->here)
		send_away(station, newcomer, "too many are in their handshake");
	newcomer->here = true;
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
