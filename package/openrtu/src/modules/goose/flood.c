/* SPDX-License-Identifier: GPL-3.0-or-later */
#include "modules/goose/flood.h"

#include <strings.h>

#include "goose/pace.h"
#include "modules/goose/filter.h"

#define SAID_AGAIN_NS (60 * NS_PER_S)

/* Of a subscription; those with the same APPID have the same. */
struct flow {
	struct goose_pace pace;
	int64_t until_ns; /* it is silenced */
	int64_t said_ns;  /* not before this again */
};

static struct wire *wire;
static const struct map_config *config;
static struct flow flows[GOOSE_SUBSCRIBED_MAX];
static uint32_t silenced; /* a bit for each subscription */

void flood_begin(struct wire *of_wire)
{
	wire = of_wire;
	config = map_config(wire->map);
}

/* The subscriptions with the APPID of a message. */
static uint32_t subscriptions_of(const uint8_t *frame, size_t size)
{
	const struct goose_subscription *subscriptions = goose_subscriptions(config);
	uint32_t found = 0;

	if (size < GOOSE_APP_ID_AT + 2)
		return 0;
	for (uint32_t i = 0; i < map_record_count(config, GOOSE_SUBSCRIPTIONS); i++)
		if (subscriptions[i].stream.app_id ==
		    (frame[GOOSE_APP_ID_AT] << 8 | frame[GOOSE_APP_ID_AT + 1]))
			found |= UINT32_C(1) << i;
	return found;
}

static struct flow *first_of(uint32_t subscriptions)
{
	return &flows[ffs((int)subscriptions) - 1];
}

static void say(struct flow *flow, int64_t now_ns)
{
	if (now_ns < flow->said_ns)
		return;
	flow->said_ns = now_ns + SAID_AGAIN_NS;
	map_log(wire->map, MAP_LOG_WARNING, "a flood of messages of APPID %04x: not all of them are taken",
		goose_subscriptions(config)[flow - flows].stream.app_id);
}

static void silence(uint32_t subscriptions, int64_t now_ns)
{
	for (uint32_t i = 0; i < GOOSE_SUBSCRIBED_MAX; i++) {
		if ((subscriptions >> i & 1) == 0)
			continue;
		flows[i].until_ns = now_ns + PACE_FULL_NS;
		map_count(&wire->stats->subscribed[i].floods, 1);
	}
	silenced |= subscriptions;
	(void)goose_filter(wire->fd, config, silenced); /* what comes nevertheless is dropped here */
	say(first_of(subscriptions), now_ns);
}

bool flood_admits(const uint8_t *frame, size_t size, int64_t now_ns)
{
	const uint32_t subscriptions = subscriptions_of(frame, size);
	struct goose_pace *pace;

	if (subscriptions == 0)
		return true;
	if (silenced & subscriptions) /* it was in the queue already */
		return false;
	pace = &first_of(subscriptions)->pace;
	if (!goose_pace_may(pace, now_ns)) {
		silence(subscriptions, now_ns);
		return false;
	}
	goose_pace_take(pace, now_ns);
	return true;
}

void flood_run(int64_t now_ns)
{
	uint32_t over = 0;

	for (uint32_t i = 0; i < GOOSE_SUBSCRIBED_MAX; i++)
		if (silenced >> i & 1 && now_ns >= flows[i].until_ns) {
			over |= UINT32_C(1) << i;
			/* If the kernel has no memory for the filter now. */
			flows[i].until_ns = now_ns + PACE_FULL_NS;
		}
	if (over != 0 && goose_filter(wire->fd, config, silenced & ~over) == 0)
		silenced &= ~over;
}

int64_t flood_deadline(void)
{
	int64_t deadline_ns = INT64_MAX;

	for (uint32_t i = 0; i < GOOSE_SUBSCRIBED_MAX; i++)
		if (silenced >> i & 1)
			deadline_ns = earlier(deadline_ns, flows[i].until_ns);
	return deadline_ns;
}
