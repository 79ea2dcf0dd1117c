/* SPDX-License-Identifier: GPL-3.0-or-later */
#include "channel/handshakes.h"

#include <stdio.h>
#include <string.h>

#include "map/time_ns.h"

#define LIMIT_S 10

static struct handshake handshakes[HANDSHAKES_MAX];

static void send_away(const struct channel_owner *owner, struct handshake *handshake, const char *why)
{
	channel_count_refused(owner);
	owner->say(MAP_LOG_WARNING, handshake->channel.peer, why);
	channel_close(&handshake->channel);
	handshake->here = false;
}

static unsigned count_from(const char *address)
{
	unsigned count = 0;

	for (unsigned i = 0; i < HANDSHAKES_MAX; i++)
		count += handshakes[i].here && strcmp(handshakes[i].address, address) == 0;
	return count;
}

/* Of the address that has most, the oldest: a flood from one address sends only itself away. */
static bool goes_before(const struct handshake *a, const struct handshake *b)
{
	unsigned from_a = count_from(a->address), from_b = count_from(b->address);

	return from_a != from_b ? from_a > from_b : a->until_ns < b->until_ns;
}

static struct handshake *find_place(void)
{
	struct handshake *first = &handshakes[0];

	for (unsigned i = 0; i < HANDSHAKES_MAX; i++) {
		if (!handshakes[i].here)
			return &handshakes[i];
		if (goes_before(&handshakes[i], first))
			first = &handshakes[i];
	}
	return first;
}

struct handshake *handshakes_place(const struct channel_owner *owner, const char *address, int64_t now_ns)
{
	struct handshake *handshake = find_place();

	if (handshake->here)
		send_away(owner, handshake, "refused, too many handshakes are under way");
	handshake->here = true;
	snprintf(handshake->address, sizeof(handshake->address), "%s", address);
	handshake->until_ns = now_ns + LIMIT_S * NS_PER_S;
	return handshake;
}

struct handshake *handshakes_at(uint32_t place)
{
	return handshakes[place].here ? &handshakes[place] : NULL;
}

uint32_t handshakes_place_of(const struct handshake *handshake)
{
	return (uint32_t)(handshake - handshakes);
}

void handshakes_watch(const struct channel_owner *owner, int64_t now_ns)
{
	for (unsigned i = 0; i < HANDSHAKES_MAX; i++)
		if (handshakes[i].here && now_ns >= handshakes[i].until_ns)
			send_away(owner, &handshakes[i], "refused, its handshake takes too long");
}

void handshakes_renew(const struct channel_owner *owner, bool (*is_listed)(const char *address))
{
	for (unsigned i = 0; i < HANDSHAKES_MAX; i++)
		if (handshakes[i].here && !is_listed(handshakes[i].address))
			send_away(owner, &handshakes[i], "refused, its address is not listed any more");
}
