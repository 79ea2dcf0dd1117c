/* SPDX-License-Identifier: GPL-3.0-or-later */
#include "goose/subscriber.h"

#include <string.h>

#include "goose/pace.h"

#define FIRST_STATE 1 /* IEC 61850-8-1, 18.1: stNum of a publisher that starts */
#define UNSET_UNTIL                                                                                          \
	(1577836800 *                                                                                        \
	 NS_PER_S) /* 2020: a clock that counts from 1970 or 2000 was not set, whatever it says */

void goose_subscriber_init(struct goose_subscriber *subscriber, const struct goose_subscription *subscription,
			   int64_t until_ns)
{
	*subscriber = (struct goose_subscriber){.subscription = subscription, .until_ns = until_ns};
}

static bool is_text(struct goose_text text, const char *wanted)
{
	return text.size == strlen(wanted) && memcmp(text.at, wanted, text.size) == 0;
}

bool goose_subscriber_hears(const struct goose_subscriber *subscriber, const struct goose_message *message)
{
	const struct goose_stream *stream = &subscriber->subscription->stream;

	return message->address.app_id == stream->app_id &&
	       memcmp(message->address.destination, stream->destination, sizeof(stream->destination)) == 0 &&
	       is_text(message->control, stream->control);
}

static bool matches(const struct goose_subscription *subscription, const struct goose_message *message)
{
	const struct goose_stream *stream = &subscription->stream;

	return !message->needs_commissioning && message->conf_rev == stream->conf_rev &&
	       (stream->data_set[0] == '\0' || is_text(message->data_set, stream->data_set));
}

/* ---- numbers ----------------------------------------------------------------------------- */

/* How many numbers a publisher can have gone on since the last message: as many as are taken of one (pace.h). */
static uint32_t plausible(const struct goose_last *last, int64_t now_ns)
{
	const int64_t passed = (now_ns - last->came_ns) / PACE_NS + PACE_AT_ONCE;

	return passed < INT32_MAX ? (uint32_t)passed : INT32_MAX;
}

/* How far a number has gone on. Neither has a 0 where it goes round (IEC 61850-8-1, 18.1); who sends one nevertheless is borne. */
static uint32_t step_of(uint32_t from, uint32_t to)
{
	const uint32_t step = to - from;

	return to < from && step > 1 ? step - 1 : step;
}

static enum goose_verdict judge_step(uint32_t step, uint32_t most, enum goose_verdict good)
{
	if (step == 0 || step > INT32_MAX)
		return GOOSE_OUT_OF_ORDER;
	return step > most ? GOOSE_JUMPED : good;
}

/* stNum counts changes, and sqNum the messages of a state, from 0. Both go round. */
static enum goose_verdict judge_numbers(const struct goose_last *last, const struct goose_message *message,
					int64_t now_ns)
{
	const uint32_t most = plausible(last, now_ns);

	if (message->state == last->state)
		return judge_step(step_of(last->sequence, message->sequence), most, GOOSE_REPEATED);
	return judge_step(step_of(last->state, message->state), most,
			  message->sequence <= most ? GOOSE_TAKEN : GOOSE_JUMPED);
}

static uint32_t missed(const struct goose_last *last, const struct goose_message *message)
{
	if (message->state == last->state)
		return step_of(last->sequence, message->sequence) - 1;
	return step_of(last->state, message->state) - 1 + message->sequence;
}

/* ---- time -------------------------------------------------------------------------------- */

/* Of the state, where the publisher's clock was set. A time ahead of ours would rule out all that comes before it. */
static int64_t time_of(const struct goose_message *message, int64_t utc_ns)
{
	if ((message->time.quality & (GOOSE_TIME_FAILED | GOOSE_TIME_UNSET)) != 0 ||
	    message->time.utc_ns < UNSET_UNTIL)
		return 0;
	return utc_ns == 0 ? message->time.utc_ns : earlier(message->time.utc_ns, utc_ns);
}

/*
 * A publisher that is not heard any more may begin anew: with the first state, or where both times are known, with a state that is
 * later than the last one. What was recorded is not later.
 */
static bool begins_anew(const struct goose_last *last, const struct goose_message *message, int64_t now_ns,
			int64_t utc_ns)
{
	const int64_t time_ns = time_of(message, utc_ns);

	if (now_ns < last->alive_ns)
		return false;
	return time_ns != 0 && last->utc_ns != 0 ? time_ns > last->utc_ns : message->state == FIRST_STATE;
}

/* ---- a message --------------------------------------------------------------------------- */

static enum goose_verdict judge(struct goose_subscriber *subscriber, const struct goose_message *message,
				int64_t now_ns, int64_t utc_ns)
{
	const struct goose_last *last = &subscriber->last;
	enum goose_verdict verdict;

	if (!last->known)
		return GOOSE_TAKEN;
	verdict = judge_numbers(last, message, now_ns);
	if (verdict == GOOSE_TAKEN || verdict == GOOSE_REPEATED) {
		subscriber->missed += missed(last, message);
		return verdict;
	}
	if (begins_anew(last, message, now_ns, utc_ns)) {
		subscriber->restarts++;
		return GOOSE_TAKEN;
	}
	return now_ns < last->alive_ns ? verdict : GOOSE_JUMPED;
}

static void keep(struct goose_subscriber *subscriber, const struct goose_message *message,
		 const struct goose_arrival *arrival)
{
	const uint32_t most_ms = subscriber->subscription->alive_most_ms;
	const uint32_t alive_ms = message->alive_ms < most_ms ? message->alive_ms : most_ms;

	subscriber->last = (struct goose_last){.known = true,
					       .state = message->state,
					       .sequence = message->sequence,
					       .utc_ns = time_of(message, arrival->utc_ns),
					       .came_ns = arrival->now_ns,
					       .alive_ns = arrival->since_ns + alive_ms * NS_PER_MS};
	subscriber->until_ns = subscriber->last.alive_ns;
}

/* As LPHD.Sim of IEC 61850-7-4: from the first simulated message on, the others are not taken. */
static void turn_to_simulated(struct goose_subscriber *subscriber)
{
	subscriber->simulated = true;
	subscriber->last.known = false;
}

enum goose_verdict goose_subscriber_take(struct goose_subscriber *subscriber,
					 const struct goose_message *message, bool fits,
					 const struct goose_arrival *arrival)
{
	const struct goose_subscription *subscription = subscriber->subscription;
	const bool held = subscriber->until_ns != 0 && subscriber->last.known;
	enum goose_verdict verdict;

	if (message->simulation && !subscription->stream.simulation)
		return GOOSE_SIMULATED;
	if (!message->simulation && subscriber->simulated)
		return GOOSE_REAL;
	if (!fits || !matches(subscription, message)) {
		subscriber->until_ns = earlier(subscriber->until_ns, arrival->now_ns);
		return GOOSE_MISMATCHED;
	}
	if (message->simulation && !subscriber->simulated)
		turn_to_simulated(subscriber);
	verdict = judge(subscriber, message, arrival->now_ns, arrival->utc_ns);
	if (verdict != GOOSE_TAKEN && verdict != GOOSE_REPEATED)
		return verdict;
	keep(subscriber, message, arrival);
	return held ? verdict : GOOSE_TAKEN;
}

bool goose_subscriber_holds(const struct goose_subscriber *subscriber, int64_t now_ns)
{
	return now_ns < subscriber->until_ns;
}

bool goose_subscriber_expires(struct goose_subscriber *subscriber, int64_t now_ns)
{
	if (now_ns < goose_subscriber_deadline(subscriber))
		return false;
	subscriber->until_ns = 0;
	return true;
}

int64_t goose_subscriber_deadline(const struct goose_subscriber *subscriber)
{
	return subscriber->until_ns == 0 ? INT64_MAX : subscriber->until_ns;
}
