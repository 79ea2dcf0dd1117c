/* SPDX-License-Identifier: GPL-3.0-or-later */
#include "modules/goose/subscribe.h"

#include "goose/subscriber.h"
#include "goose/value.h"
#include "map/time_ns.h"

#define TAKEN_OVER_NS   (2 * NS_PER_S) /* after a reload: until a message of this process holds */
#define TIME_TRUSTED_NS (5 * NS_PER_S) /* of a new state, before its first message came */
#define SAID_AGAIN_NS   (60 * NS_PER_S)

static struct map *map;
static struct goose_stats *stats;
static struct goose_subscriber subscribers[GOOSE_SUBSCRIBED_MAX];
static int64_t said_ns[GOOSE_SUBSCRIBED_MAX]; /* nothing before this again */
static uint32_t count;

/* ---- a state as samples ------------------------------------------------------------------- */

/* When it was, by the publisher's clock where the two agree; a state that is older than its first message here was not seen begin. */
static int64_t moment_of(const struct goose_time *time, int64_t now_ns)
{
	const struct map_clock clock = map_clock_read(map);
	const int64_t late_ns = map_wall_ns(clock, now_ns) - time->utc_ns;

	if (!clock.set || (time->quality & (GOOSE_TIME_FAILED | GOOSE_TIME_UNSET)) != 0 || late_ns < 0 ||
	    late_ns > TIME_TRUSTED_NS)
		return now_ns;
	return now_ns - late_ns;
}

/* False: the item is not what the configuration says of it. */
static bool put_leaf(const struct goose_leaf *leaf, const struct goose_item *item, enum map_type type,
		     struct map_update *update, int64_t now_ns)
{
	uint8_t quality = MAP_GOOD;

	switch ((enum goose_use)leaf->use) {
	case GOOSE_VALUE:
		return goose_value_in(type, item, &update->sample.value);
	case GOOSE_QUALITY:
		if (!goose_quality_in(item, &quality))
			return false;
		update->sample.quality |= quality;
		return true;
	case GOOSE_MOMENT:
		if (item->kind != GOOSE_TIME)
			return false;
		update->sample.time_ns = moment_of(&item->time, now_ns);
		return true;
	case GOOSE_UNUSED:
		break;
	}
	return true;
}

static bool convert(const struct goose_subscriber *subscriber, const struct goose_message *message,
		    struct map_update *updates, int64_t now_ns)
{
	const struct goose_subscription *subscription = subscriber->subscription;
	const struct map_config *config = map_config(map);
	const struct goose_leaf *leaves = &goose_leaves(config)[subscription->first_leaf];
	const struct map_set *set = &config->sets[subscription->set];

	if (message->item_count != subscription->leaf_count)
		return false;
	for (uint32_t i = 0; i < set->point_count; i++)
		updates[i] = (struct map_update){.point = set->first_point + i,
						 .sample.time_ns = moment_of(&message->time, now_ns)};
	for (uint32_t i = 0; i < subscription->leaf_count; i++) {
		const struct goose_leaf *leaf = &leaves[i];

		if (leaf->use == GOOSE_UNUSED)
			continue;
		if (!put_leaf(leaf, &message->items[i],
			      (enum map_type)config->points[set->first_point + leaf->place].type,
			      &updates[leaf->place], now_ns))
			return false;
	}
	return true;
}

/* The values stay to be looked at. */
static void invalidate(const struct goose_subscriber *subscriber, int64_t now_ns)
{
	const struct map_set *set = &map_config(map)->sets[subscriber->subscription->set];
	struct map_update updates[GOOSE_ITEMS_MAX];

	for (uint32_t i = 0; i < set->point_count; i++)
		updates[i] = (struct map_update){
		    .point = set->first_point + i,
		    .flags = MAP_UPDATE_KEEPS_VALUE,
		    .sample = {.quality = MAP_INVALID, .time_ns = now_ns},
		};
	map_publish(map, updates, set->point_count);
}

/* ---- messages ---------------------------------------------------------------------------- */

static void end_state(uint32_t number, int64_t now_ns)
{
	atomic_store(&stats->subscribed[number].holds, 0);
	invalidate(&subscribers[number], now_ns);
}

/* One that holds no longer is there to be looked at. */
static void put_state(uint32_t number, struct map_update *updates, int64_t now_ns)
{
	const uint32_t points = map_config(map)->sets[subscribers[number].subscription->set].point_count;
	const bool holds = goose_subscriber_holds(&subscribers[number], now_ns);

	for (uint32_t i = 0; i < points && !holds; i++)
		updates[i].sample.quality |= MAP_INVALID;
	atomic_store(&stats->subscribed[number].holds, holds);
	map_publish(map, updates, points);
}

static _Atomic uint32_t *counter_of(struct goose_subscribed *of, enum goose_verdict verdict)
{
	switch (verdict) {
	case GOOSE_REPEATED:
		return &of->repeated;
	case GOOSE_OUT_OF_ORDER:
		return &of->out_of_order;
	case GOOSE_JUMPED:
		return &of->jumps;
	case GOOSE_SIMULATED:
		return &of->simulated;
	case GOOSE_REAL:
		return &of->real;
	case GOOSE_MISMATCHED:
		return &of->mismatched;
	case GOOSE_TAKEN:
		break;
	}
	return &of->states;
}

/* What an engineer must know of numbers that do not follow; not more often than once a minute. */
static void alarm(uint32_t number, const struct goose_last *before, const struct goose_message *message,
		  bool believed, int64_t now_ns)
{
	const char *name = subscribers[number].subscription->stream.name;

	if (now_ns < said_ns[number])
		return;
	said_ns[number] = now_ns + SAID_AGAIN_NS;
	if (believed)
		map_log(map, MAP_LOG_WARNING, "%s: its publisher begins anew with stNum %u behind %u", name,
			message->state, before->state);
	else
		map_log(map, MAP_LOG_WARNING,
			"%s: stNum %u, sqNum %u do not follow %u, %u and are not believed: if its publisher "
			"is right, restart it, or rtu-goose",
			name, message->state, message->sequence, before->state, before->sequence);
}

/* What only this message of all is to its points. */
static void judge(uint32_t number, const struct goose_message *message, int64_t now_ns, int64_t since_ns)
{
	struct goose_subscriber *subscriber = &subscribers[number];
	struct goose_subscribed *of = &stats->subscribed[number];
	const struct goose_last before = subscriber->last;
	const uint32_t restarts = subscriber->restarts;
	const struct map_clock clock = map_clock_read(map);
	struct map_update updates[GOOSE_ITEMS_MAX];
	const bool fits = convert(subscriber, message, updates, now_ns);
	const struct goose_arrival arrival = {now_ns, since_ns, clock.set ? map_wall_ns(clock, now_ns) : 0};
	const enum goose_verdict verdict = goose_subscriber_take(subscriber, message, fits, &arrival);

	map_count(counter_of(of, verdict), 1);
	atomic_store(&of->missed, subscriber->missed);
	atomic_store(&of->restarts, subscriber->restarts);
	if (verdict == GOOSE_TAKEN)
		put_state(number, updates, now_ns);
	if (verdict == GOOSE_JUMPED || subscriber->restarts != restarts)
		alarm(number, &before, message, verdict != GOOSE_JUMPED, now_ns);
}

void subscribe_take(const uint8_t *frame, size_t size, int64_t now_ns, int64_t since_ns)
{
	struct goose_item items[GOOSE_ITEMS_MAX];
	struct goose_message message;
	bool known = false;

	if (!goose_decode(frame, size, &message, items)) {
		map_count(&stats->damaged, 1);
		return;
	}
	/* Several may have one control block, with other points. */
	for (uint32_t i = 0; i < count; i++) {
		if (!goose_subscriber_hears(&subscribers[i], &message))
			continue;
		known = true;
		judge(i, &message, now_ns, since_ns);
	}
	if (!known)
		map_count(&stats->unknown, 1);
}

void subscribe_run(int64_t now_ns)
{
	for (uint32_t i = 0; i < count; i++) {
		if (!goose_subscriber_expires(&subscribers[i], now_ns))
			continue;
		if (atomic_load(&stats->subscribed[i].holds))
			map_count(&stats->subscribed[i].expired, 1);
		end_state(i, now_ns);
	}
}

int64_t subscribe_deadline(void)
{
	int64_t deadline_ns = INT64_MAX;

	for (uint32_t i = 0; i < count; i++)
		deadline_ns = earlier(deadline_ns, goose_subscriber_deadline(&subscribers[i]));
	return deadline_ns;
}

/* ------------------------------------------------------------------------------------------ */

static void name_counters(const char *name, const struct goose_subscribed *of)
{
	map_name_counter(map, &of->holds, "%s.holds", name);
	map_name_counter(map, &of->states, "%s.states", name);
	map_name_counter(map, &of->repeated, "%s.repeated", name);
	map_name_counter(map, &of->missed, "%s.missed", name);
	map_name_counter(map, &of->out_of_order, "%s.out_of_order", name);
	map_name_counter(map, &of->mismatched, "%s.mismatched", name);
	map_name_counter(map, &of->simulated, "%s.simulated", name);
	map_name_counter(map, &of->real, "%s.real", name);
	map_name_counter(map, &of->jumps, "%s.jumps", name);
	map_name_counter(map, &of->restarts, "%s.restarts", name);
	map_name_counter(map, &of->expired, "%s.expired", name);
	map_name_counter(map, &of->floods, "%s.floods", name);
}

bool subscribe_begin(struct map *of_map, struct goose_stats *of_stats)
{
	const struct map_config *config = map_config(of_map);

	map = of_map;
	stats = of_stats;
	count = map_record_count(config, GOOSE_SUBSCRIPTIONS);
	for (uint32_t i = 0; i < count; i++) {
		const struct goose_subscription *subscription = &goose_subscriptions(config)[i];

		goose_subscriber_init(&subscribers[i], subscription, map_now_ns() + TAKEN_OVER_NS);
		atomic_store(&stats->subscribed[i].holds, 0);
		name_counters(subscription->stream.name, &stats->subscribed[i]);
	}
	return true;
}
