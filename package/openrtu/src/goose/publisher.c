/* SPDX-License-Identifier: GPL-3.0-or-later */
#include "goose/publisher.h"

#include <string.h>

#include "goose/value.h"
#include "map/time_ns.h"
#include "map/type.h"

#define ALIVE_INTERVALS 3 /* of the longest: one message may be lost, and the next be late */

void goose_publisher_init(struct goose_publisher *publisher, const struct map_config *config, uint32_t number,
			  struct map_sample *samples, uint32_t state)
{
	const struct goose_publication *publication = &goose_publications(config)[number];

	*publisher = (struct goose_publisher){
	    .publication = publication,
	    .members = &goose_members(config)[publication->first_member],
	    .points = config->points,
	    .samples = samples,
	    .state = state,
	    .has_changed = true,
	};
	for (uint32_t i = 0; i < publication->member_count; i++)
		samples[i] = (struct map_sample){.quality = MAP_INVALID};
}

/* ---- changes ----------------------------------------------------------------------------- */

static bool is_same(const struct map_sample *a, const struct map_sample *b)
{
	return a->value.u == b->value.u && a->quality == b->quality;
}

bool goose_publisher_set(struct goose_publisher *publisher, uint32_t member, const struct map_sample *sample)
{
	struct map_sample *mine = &publisher->samples[member];

	if (is_same(mine, sample))
		return false;
	*mine = *sample;
	mine->reserved = 1; /* changed since the last message */
	publisher->has_changed = true;
	return true;
}

bool goose_publisher_has_changed(const struct goose_publisher *publisher, uint32_t member)
{
	return publisher->samples[member].reserved != 0;
}

int64_t goose_publisher_deadline(const struct goose_publisher *publisher)
{
	return publisher->has_changed ? INT64_MIN : publisher->due_ns;
}

/* ---- messages ---------------------------------------------------------------------------- */

static uint32_t items_a_member(const struct goose_publication *publication)
{
	return 1u + publication->with_quality + publication->with_time;
}

static struct goose_text text_of(const char *text)
{
	return (struct goose_text){text, strlen(text)};
}

/* Its items are still to be put. */
static struct goose_message message_of(const struct goose_publication *publication)
{
	const uint32_t count = publication->member_count * items_a_member(publication);
	struct goose_message message = {
	    .address = {.app_id = publication->stream.app_id,
			.tagged = publication->tagged,
			.vlan = publication->vlan,
			.vlan_priority = publication->vlan_priority},
	    .control = text_of(publication->stream.control),
	    .data_set = text_of(publication->stream.data_set),
	    .id = text_of(publication->id),
	    .alive_ms = ALIVE_INTERVALS * publication->most_ms,
	    .conf_rev = publication->stream.conf_rev,
	    .simulation = publication->stream.simulation,
	    .entries = count,
	    .item_count = count,
	};

	memcpy(message.address.destination, publication->stream.destination,
	       sizeof(message.address.destination));
	return message;
}

static void put_items(const struct goose_publisher *publisher, struct goose_item *items)
{
	const struct goose_publication *publication = publisher->publication;

	for (uint32_t i = 0; i < publication->member_count; i++) {
		const struct map_sample *sample = &publisher->samples[i];
		const enum map_type type = (enum map_type)publisher->points[publisher->members[i]].type;

		*items++ = goose_value_out(type, sample->value);
		if (publication->with_quality)
			*items++ = goose_quality_out(sample->quality);
		if (publication->with_time)
			*items++ = (struct goose_item){.kind = GOOSE_TIME, .time = publisher->time};
	}
}

/* stNum has no 0 but before the first message, sqNum none but behind a change (18.1.2.5). */
static void number(struct goose_publisher *publisher, struct goose_time time)
{
	const struct goose_publication *publication = publisher->publication;

	if (publisher->has_changed) {
		publisher->state = publisher->state == UINT32_MAX ? 1 : publisher->state + 1;
		publisher->sequence = 0;
		publisher->time = time;
		publisher->interval_ns = publication->least_ms * NS_PER_MS;
	} else {
		publisher->sequence = publisher->sequence == UINT32_MAX ? 1 : publisher->sequence + 1;
		publisher->interval_ns =
		    earlier(2 * publisher->interval_ns, publication->most_ms * NS_PER_MS);
	}
}

static void end_change(struct goose_publisher *publisher)
{
	publisher->has_changed = false;
	for (uint32_t i = 0; i < publisher->publication->member_count; i++)
		publisher->samples[i].reserved = 0;
}

size_t goose_publisher_send(struct goose_publisher *publisher, const uint8_t source[6],
			    struct goose_time time, int64_t now_ns, uint8_t frame[GOOSE_FRAME_MAX])
{
	struct goose_item items[GOOSE_ITEMS_MAX];
	struct goose_message message = message_of(publisher->publication);

	number(publisher, time);
	put_items(publisher, items);
	message.items = items;
	memcpy(message.address.source, source, sizeof(message.address.source));
	message.time = publisher->time;
	message.state = publisher->state;
	message.sequence = publisher->sequence;
	publisher->due_ns = now_ns + publisher->interval_ns;
	end_change(publisher);
	return goose_encode(&message, frame);
}

/* ---- how long it gets -------------------------------------------------------------------- */

static union map_value longest_value(enum map_type type)
{
	if (map_types[type].form == MAP_FORM_UNSIGNED)
		return (union map_value){.u = UINT32_MAX};
	return (union map_value){.i = INT32_MIN};
}

size_t goose_longest(const struct goose_publication *publication, const uint32_t *members,
		     const struct map_point *points)
{
	struct goose_item items[GOOSE_ITEMS_MAX], *at = items;
	struct goose_message message = message_of(publication);
	uint8_t frame[GOOSE_FRAME_MAX];

	if (message.item_count > GOOSE_ITEMS_MAX)
		return 0;
	for (uint32_t i = 0; i < publication->member_count; i++) {
		const enum map_type type = (enum map_type)points[members[i]].type;

		*at++ = goose_value_out(type, longest_value(type));
		if (publication->with_quality)
			*at++ = goose_quality_out(MAP_GOOD);
		if (publication->with_time)
			*at++ = (struct goose_item){.kind = GOOSE_TIME};
	}
	message.items = items;
	message.state = message.sequence = UINT32_MAX;
	return goose_encode(&message, frame);
}
