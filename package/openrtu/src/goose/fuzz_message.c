/* SPDX-License-Identifier: GPL-3.0-or-later */
/*
 * libFuzzer on frames. What must hold: a message that is understood is within its bounds, and what is encoded of it is the same
 * message once more.
 */
#include <string.h>

#include "fuzz/target.h"
#include "goose/message.h"
#include "goose/subscriber.h"
#include "goose/value.h"

static struct goose_item items[GOOSE_ITEMS_MAX], again_items[GOOSE_ITEMS_MAX];

static bool can_be_encoded(const struct goose_message *message)
{
	for (uint32_t i = 0; i < message->item_count; i++)
		if (items[i].kind == GOOSE_OTHER)
			return false;
	return message->entries == message->item_count;
}

static void encode_again(const struct goose_message *message)
{
	uint8_t frame[GOOSE_FRAME_MAX];
	struct goose_message again;
	const size_t size = goose_encode(message, frame);

	if (size == 0)
		return; /* of longer than the shortest numbers a frame holds fewer */
	CHECK(goose_decode(frame, size, &again, again_items));
	CHECK(again.state == message->state && again.sequence == message->sequence &&
	      again.conf_rev == message->conf_rev && again.simulation == message->simulation);
	CHECK(again.item_count == message->item_count && again.control.size == message->control.size);
	for (uint32_t i = 0; i < again.item_count; i++)
		CHECK(again_items[i].kind == items[i].kind);
}

static void take(const struct goose_message *message)
{
	struct goose_subscription subscription = {.leaf_count = message->item_count,
						  .alive_most_ms = UINT32_MAX};
	const struct goose_arrival arrival = {.now_ns = 1, .since_ns = 1};
	struct goose_subscriber subscriber;
	enum goose_verdict first;

	if (memchr(message->control.at, '\0', message->control.size) != NULL)
		return; /* nobody can subscribe to such a name */
	memcpy(subscription.stream.destination, message->address.destination,
	       sizeof(message->address.destination));
	memcpy(subscription.stream.control, message->control.at, message->control.size);
	subscription.stream.app_id = message->address.app_id;
	subscription.stream.conf_rev = message->conf_rev;
	goose_subscriber_init(&subscriber, &subscription, 0);
	CHECK(goose_subscriber_hears(&subscriber, message));
	first = goose_subscriber_take(&subscriber, message, true, &arrival);
	CHECK(first == GOOSE_TAKEN || first == GOOSE_SIMULATED || first == GOOSE_MISMATCHED);
	if (first == GOOSE_TAKEN && message->alive_ms > 0)
		CHECK(goose_subscriber_take(&subscriber, message, true, &arrival) == GOOSE_OUT_OF_ORDER);
	goose_subscriber_expires(&subscriber, INT64_MAX);
}

static void convert(uint32_t count)
{
	union map_value value;
	uint8_t quality;

	for (uint32_t i = 0; i < count; i++) {
		for (unsigned type = 0; type < MAP_TYPES; type++)
			goose_value_in((enum map_type)type, &items[i], &value);
		goose_quality_in(&items[i], &quality);
	}
}

int LLVMFuzzerTestOneInput(const uint8_t *data, size_t size)
{
	struct goose_message message;

	if (size > GOOSE_FRAME_MAX || !goose_decode(data, size, &message, items))
		return 0;
	CHECK(message.item_count <= GOOSE_ITEMS_MAX && message.entries <= message.item_count + size);
	CHECK(message.control.size < GOOSE_REFERENCE_SIZE && message.id.size < GOOSE_REFERENCE_SIZE);
	convert(message.item_count);
	take(&message);
	if (can_be_encoded(&message))
		encode_again(&message);
	return 0;
}
