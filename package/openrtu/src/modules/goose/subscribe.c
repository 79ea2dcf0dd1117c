/* SPDX-License-Identifier: GPL-3.0-or-later */
#include "modules/goose/subscribe.h"

#include "goose/subscriber.h"
#include "goose/value.h"
#include "map/time_ns.h"

#define TAKEN_OVER_NS   (2 * NS_PER_S) /* after a reload: until a message of this process holds */
#define TIME_TRUSTED_NS (5 * NS_PER_S) /* of a new state, before its first message came */

static struct map *map;
static struct goose_stats *stats;
static struct goose_subscriber subscribers[GOOSE_SUBSCRIBED_MAX];
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

static void take_state(uint32_t number, const struct goose_message *message, int64_t now_ns)
{
	struct goose_subscribed *of = &stats->subscribed[number];
	const struct goose_subscriber *subscriber = &subscribers[number];
	struct map_update updates[GOOSE_ITEMS_MAX];

	map_count(&of->states, 1);
	if (!convert(subscriber, message, updates, now_ns)) {
		map_count(&of->mismatched, 1);
		end_state(number, now_ns);
		return;
	}
	atomic_store(&of->holds, 1);
	map_publish(map, updates, map_config(map)->sets[subscriber->subscription->set].point_count);
}

static void count_verdict(struct goose_subscribed *of, enum goose_verdict verdict)
{
	switch (verdict) {
	case GOOSE_REPEATED:
		map_count(&of->repeated, 1);
		break;
	case GOOSE_OUT_OF_ORDER:
		map_count(&of->out_of_order, 1);
		break;
	case GOOSE_SIMULATED:
		map_count(&of->simulated, 1);
		break;
	case GOOSE_MISMATCHED:
		map_count(&of->mismatched, 1);
		break;
	case GOOSE_TAKEN:
	case GOOSE_NOT_MINE:
		break;
	}
}

/* Several may have one control block, with other points. True: it is one of this subscription. */
static bool offer(uint32_t number, const struct goose_message *message, int64_t now_ns)
{
	const enum goose_verdict verdict = goose_subscriber_take(&subscribers[number], message, now_ns);

	count_verdict(&stats->subscribed[number], verdict);
	atomic_store(&stats->subscribed[number].missed, subscribers[number].missed);
	if (verdict == GOOSE_TAKEN)
		take_state(number, message, now_ns);
	return verdict != GOOSE_NOT_MINE;
}

void subscribe_take(const uint8_t *frame, size_t size, int64_t now_ns)
{
	struct goose_item items[GOOSE_ITEMS_MAX];
	struct goose_message message;
	bool known = false;

	if (!goose_decode(frame, size, &message, items)) {
		map_count(&stats->damaged, 1);
		return;
	}
	for (uint32_t i = 0; i < count; i++)
		known |= offer(i, &message, now_ns);
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
