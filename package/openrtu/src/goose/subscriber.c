/* SPDX-License-Identifier: GPL-3.0-or-later */
#include "goose/subscriber.h"

#include <string.h>

#include "map/time_ns.h"

#define ALIVE_MOST_MS 600000 /* of what is longer, as of a mistake: a dead publisher shall be seen */

void goose_subscriber_init(struct goose_subscriber *subscriber, const struct goose_subscription *subscription,
			   int64_t until_ns)
{
	*subscriber = (struct goose_subscriber){.subscription = subscription, .until_ns = until_ns};
}

static bool is_text(struct goose_text text, const char *wanted)
{
	return text.size == strlen(wanted) && memcmp(text.at, wanted, text.size) == 0;
}

static bool is_mine(const struct goose_stream *stream, const struct goose_message *message)
{
	return message->address.app_id == stream->app_id &&
	       memcmp(message->address.destination, stream->destination, sizeof(stream->destination)) == 0 &&
	       is_text(message->control, stream->control);
}

static bool matches(const struct goose_subscription *subscription, const struct goose_message *message)
{
	const struct goose_stream *stream = &subscription->stream;

	return !message->needs_commissioning && message->conf_rev == stream->conf_rev &&
	       message->item_count == subscription->leaf_count &&
	       (stream->data_set[0] == '\0' || is_text(message->data_set, stream->data_set));
}

/* While the last message holds, numbers go up: a publisher that begins anew is believed when that is over. */
static bool is_older(const struct goose_subscriber *subscriber, const struct goose_message *message)
{
	const int32_t states = (int32_t)(message->state - subscriber->state);

	if (!subscriber->has_taken)
		return false;
	return states < 0 || (states == 0 && (int32_t)(message->sequence - subscriber->sequence) <= 0);
}

static void count_missed(struct goose_subscriber *subscriber, const struct goose_message *message)
{
	if (!subscriber->has_taken)
		return;
	if (message->state == subscriber->state)
		subscriber->missed += message->sequence - subscriber->sequence - 1;
	else
		subscriber->missed += message->state - subscriber->state - 1 + message->sequence;
}

enum goose_verdict goose_subscriber_take(struct goose_subscriber *subscriber,
					 const struct goose_message *message, int64_t now_ns)
{
	const struct goose_subscription *subscription = subscriber->subscription;
	bool is_new;

	if (!is_mine(&subscription->stream, message))
		return GOOSE_NOT_MINE;
	if (message->simulation && !subscription->stream.simulation)
		return GOOSE_SIMULATED;
	if (!matches(subscription, message)) {
		subscriber->until_ns = earlier(subscriber->until_ns, now_ns);
		return GOOSE_MISMATCHED;
	}
	if (is_older(subscriber, message))
		return GOOSE_OUT_OF_ORDER;
	is_new = !subscriber->has_taken || message->state != subscriber->state;
	count_missed(subscriber, message);
	subscriber->has_taken = true;
	subscriber->state = message->state;
	subscriber->sequence = message->sequence;
	subscriber->time = message->time;
	subscriber->until_ns =
	    now_ns + (message->alive_ms < ALIVE_MOST_MS ? message->alive_ms : ALIVE_MOST_MS) * NS_PER_MS;
	return is_new ? GOOSE_TAKEN : GOOSE_REPEATED;
}

bool goose_subscriber_expires(struct goose_subscriber *subscriber, int64_t now_ns)
{
	if (now_ns < goose_subscriber_deadline(subscriber))
		return false;
	subscriber->until_ns = 0;
	subscriber->has_taken = false;
	return true;
}

int64_t goose_subscriber_deadline(const struct goose_subscriber *subscriber)
{
	return subscriber->until_ns == 0 ? INT64_MAX : subscriber->until_ns;
}
