/* SPDX-License-Identifier: GPL-3.0-or-later */
#include "synch/coordinator.h"

#include <string.h>

#include "map/time_ns.h"

#define SCANS_A_TURN 255              /* of a line: what it has ended while the coordinator was away */
#define STAND_IN_NS  (10 * NS_PER_MS) /* between two scans of a dead module, unless a living one fires */

void synch_begin(struct synch_coordinator *coordinator, const struct synch_net *net,
		 const struct synch_state *state)
{
	*coordinator = (struct synch_coordinator){.net = *net, .state = *state};
	if (state->begun)
		return;
	coordinator->state = (struct synch_state){.begun = 1};
	for (uint32_t i = 0; i < net->place_count; i++)
		coordinator->state.tokens[i] = net->places[i].tokens;
}

static const struct synch_participant *participant_of(const struct synch_coordinator *coordinator,
						      uint32_t number)
{
	return &coordinator->net.participants[number];
}

static bool can_fire(const struct synch_coordinator *coordinator, uint8_t transition)
{
	return synch_enabled(&coordinator->net, coordinator->state.tokens, transition);
}

static void fire(struct synch_coordinator *coordinator, uint8_t transition, int16_t *changes)
{
	synch_fire(&coordinator->net, coordinator->state.tokens, transition, changes,
		   coordinator->counts.lost);
	coordinator->counts.firings[transition]++;
}

static void end_scan(struct synch_coordinator *coordinator, uint32_t number, enum synch_phase phase)
{
	memset(coordinator->state.changes[number], 0, sizeof(coordinator->state.changes[number]));
	coordinator->state.phases[number] = (uint8_t)phase;
}

static void answer(struct synch_coordinator *coordinator, uint32_t number, enum synch_result result)
{
	coordinator->state.answers[number] = synch_answer_to(coordinator->open[number], result);
	coordinator->open[number] = 0;
	coordinator->rung |= 1u << number;
}

/* ---- the dead ---------------------------------------------------------------------------- */

/* Within a scan. is_new: the next process is there; else it may wake and know nothing of it. */
static void die(struct synch_coordinator *coordinator, uint32_t number, bool is_new)
{
	struct synch_state *state = &coordinator->state;

	switch (participant_of(coordinator, number)->on_death) {
	case SYNCH_HOLD:
		if (!is_new)
			return; /* it goes on if it wakes */
		state->phases[number] = SYNCH_HELD;
		break;
	case SYNCH_FIRE:
		end_scan(coordinator, number, SYNCH_OWES);
		break;
	default:
		synch_undo(&coordinator->net, state->tokens, state->changes[number]);
		end_scan(coordinator, number, is_new ? SYNCH_IDLE : SYNCH_LOST);
	}
	coordinator->counts.deaths[number]++;
}

/* What became of the scan of a process before is nothing to the next one. */
static void begin_process(struct synch_coordinator *coordinator, uint32_t number)
{
	if (coordinator->state.phases[number] == SYNCH_SCANS)
		die(coordinator, number, true);
	if (coordinator->state.phases[number] == SYNCH_LOST)
		end_scan(coordinator, number, SYNCH_IDLE);
}

static void pay_end(struct synch_coordinator *coordinator, uint32_t number)
{
	const uint8_t end = participant_of(coordinator, number)->end;

	if (end != SYNCH_NOTHING && !can_fire(coordinator, end))
		return;
	if (end != SYNCH_NOTHING)
		fire(coordinator, end, NULL);
	end_scan(coordinator, number, SYNCH_LOST);
}

static bool stands_in_for(const struct synch_coordinator *coordinator, uint32_t number)
{
	const struct synch_participant *participant = participant_of(coordinator, number);
	const uint8_t phase = coordinator->state.phases[number];

	return participant->on_death == SYNCH_FIRE && participant->begin != SYNCH_NOTHING &&
	       coordinator->state.answers[number] != 0 && (phase == SYNCH_IDLE || phase == SYNCH_LOST);
}

static bool is_due(const struct synch_coordinator *coordinator, uint32_t number, int64_t now_ns)
{
	return coordinator->stood_at[number] != coordinator->fired ||
	       now_ns - coordinator->stood_ns[number] >= STAND_IN_NS;
}

/* A scan in the stead of a dead module, once in a while. True: it has begun. */
static bool stand_in(struct synch_coordinator *coordinator, uint32_t number, int64_t now_ns)
{
	const uint8_t begin = participant_of(coordinator, number)->begin;

	if (!stands_in_for(coordinator, number))
		return false;
	coordinator->stands_in = true;
	if (!is_due(coordinator, number, now_ns) || !can_fire(coordinator, begin))
		return false;
	coordinator->stood_ns[number] = now_ns;
	coordinator->stood_at[number] = coordinator->fired;
	coordinator->counts.stood_in[number]++;
	fire(coordinator, begin, NULL);
	end_scan(coordinator, number, SYNCH_OWES);
	return true;
}

/* ---- wishes ------------------------------------------------------------------------------ */

static bool is_begin(const struct synch_coordinator *coordinator, uint32_t number)
{
	const uint32_t word = coordinator->open[number];

	return (synch_wish_of(word) == SYNCH_ASK || synch_wish_of(word) == SYNCH_TRY) &&
	       synch_transition_of(word) == participant_of(coordinator, number)->begin;
}

/* What it asks is of a scan that was ended or undone in its stead. */
static bool is_late(const struct synch_coordinator *coordinator, uint32_t number)
{
	const uint8_t phase = coordinator->state.phases[number];

	return (phase == SYNCH_LOST || phase == SYNCH_OWES) && !is_begin(coordinator, number);
}

/* The scan's end, of a module without one that fires, or of one that was ended in its stead, needs no token. */
static bool grant_end(struct synch_coordinator *coordinator, uint32_t number)
{
	const uint8_t end = participant_of(coordinator, number)->end;
	const uint8_t phase = coordinator->state.phases[number];

	if (is_late(coordinator, number)) {
		if (phase == SYNCH_LOST)
			end_scan(coordinator, number, SYNCH_IDLE);
		answer(coordinator, number, SYNCH_LATE);
		return true;
	}
	if (end != SYNCH_NOTHING && !can_fire(coordinator, end))
		return false;
	if (end != SYNCH_NOTHING) {
		fire(coordinator, end, NULL);
		coordinator->fired++;
	}
	end_scan(coordinator, number, SYNCH_IDLE);
	answer(coordinator, number, SYNCH_FIRED);
	return true;
}

static bool grant_transition(struct synch_coordinator *coordinator, uint32_t number)
{
	const uint8_t transition = synch_transition_of(coordinator->open[number]);
	struct synch_state *state = &coordinator->state;

	if (is_late(coordinator, number)) {
		answer(coordinator, number, SYNCH_LATE);
		return true;
	}
	if (state->phases[number] == SYNCH_OWES)
		return false;
	if (state->phases[number] != SYNCH_HELD || !is_begin(coordinator, number)) {
		if (!can_fire(coordinator, transition))
			return false;
		fire(coordinator, transition, state->changes[number]);
		coordinator->fired++;
	}
	state->phases[number] = SYNCH_SCANS;
	answer(coordinator, number, SYNCH_FIRED);
	return true;
}

/* Of a module that waits for its scans: it begins one, fires points in it, ends it. */
static bool is_in_order(const struct synch_coordinator *coordinator, uint32_t number, bool begins)
{
	const uint8_t phase = coordinator->state.phases[number];

	if (participant_of(coordinator, number)->begin == SYNCH_NOTHING)
		return true;
	return begins ? phase != SYNCH_SCANS : phase != SYNCH_IDLE;
}

static bool may_say(const struct synch_coordinator *coordinator, uint32_t number, uint32_t word)
{
	const uint8_t transition = synch_transition_of(word);

	if (synch_wish_of(word) == SYNCH_HELLO)
		return true;
	if (synch_wish_of(word) == SYNCH_END)
		return is_in_order(coordinator, number, false);
	return synch_is_of(&coordinator->net, number, transition) &&
	       transition != participant_of(coordinator, number)->end &&
	       is_in_order(coordinator, number, is_begin(coordinator, number));
}

/* True: it was answered. */
static bool grant(struct synch_coordinator *coordinator, uint32_t number)
{
	const uint32_t word = coordinator->open[number];

	if (word & SYNCH_NEW)
		begin_process(coordinator, number);
	if (word & SYNCH_NEW && coordinator->state.phases[number] == SYNCH_OWES)
		return false;
	if (!may_say(coordinator, number, word)) {
		coordinator->counts.refused++;
		answer(coordinator, number, SYNCH_REFUSED);
		return true;
	}
	switch (synch_wish_of(word)) {
	case SYNCH_HELLO:
		answer(coordinator, number, SYNCH_FIRED);
		return true;
	case SYNCH_END:
		return grant_end(coordinator, number);
	default:
		return grant_transition(coordinator, number);
	}
}

/* Of those that are open and may be granted, the one that waits longest; SYNCH_PARTICIPANTS_MAX: none. */
static uint32_t grant_first(struct synch_coordinator *coordinator, const struct synch_seen *seen)
{
	uint32_t tried = 0;

	for (;;) {
		uint32_t first = SYNCH_PARTICIPANTS_MAX;

		for (uint32_t i = 0; i < coordinator->net.participant_count; i++)
			if (coordinator->open[i] != 0 && seen[i].alive && !(tried & 1u << i) &&
			    (first == SYNCH_PARTICIPANTS_MAX ||
			     (int32_t)(coordinator->places[i] - coordinator->places[first]) < 0))
				first = i;
		if (first == SYNCH_PARTICIPANTS_MAX || grant(coordinator, first))
			return first;
		tried |= 1u << first;
	}
}

/* ---- a turn ------------------------------------------------------------------------------ */

static void hear_word(struct synch_coordinator *coordinator, uint32_t number, uint32_t word, int64_t now_ns)
{
	if (coordinator->open[number] != word) {
		coordinator->open[number] = word;
		coordinator->places[number] = coordinator->next_place++;
		coordinator->since_ns[number] = now_ns;
	}
	if (word & SYNCH_NEW)
		begin_process(coordinator, number);
}

static void hear(struct synch_coordinator *coordinator, uint32_t number, const struct synch_seen *seen,
		 int64_t now_ns)
{
	if (!seen->alive && coordinator->state.phases[number] == SYNCH_SCANS)
		die(coordinator, number, false);
	if (synch_is_answered(seen->word, coordinator->state.answers[number]))
		coordinator->open[number] = 0;
	else if (seen->alive)
		hear_word(coordinator, number, seen->word, now_ns);
}

static void hear_line(struct synch_coordinator *coordinator, uint32_t number, const struct synch_seen *seen)
{
	const uint8_t end = participant_of(coordinator, number)->end;
	uint32_t scans = seen->word - coordinator->state.answers[number];

	coordinator->state.answers[number] = seen->word;
	if (end == SYNCH_NOTHING)
		return;
	if (scans > SCANS_A_TURN) {
		coordinator->counts.left_out[number] += scans - SCANS_A_TURN;
		scans = SCANS_A_TURN;
	}
	for (; scans > 0; scans--)
		if (can_fire(coordinator, end)) {
			fire(coordinator, end, NULL);
			coordinator->fired++;
		} else {
			coordinator->counts.left_out[number]++;
		}
}

/* Each wish is answered once, and each dead module's scan is fired once: it ends. */
static void settle(struct synch_coordinator *coordinator, const struct synch_seen *seen, int64_t now_ns)
{
	bool again = true;

	while (again) {
		again = grant_first(coordinator, seen) != SYNCH_PARTICIPANTS_MAX;
		for (uint32_t i = 0; i < coordinator->net.participant_count; i++) {
			if (!seen[i].alive && participant_of(coordinator, i)->waits)
				again |= stand_in(coordinator, i, now_ns);
			if (coordinator->state.phases[i] != SYNCH_OWES)
				continue;
			pay_end(coordinator, i);
			again |= coordinator->state.phases[i] != SYNCH_OWES;
		}
	}
}

/* What could not fire now, and asked for no later. */
static void deny(struct synch_coordinator *coordinator, const struct synch_seen *seen)
{
	for (uint32_t i = 0; i < coordinator->net.participant_count; i++)
		if (coordinator->open[i] != 0 && seen[i].alive &&
		    synch_wish_of(coordinator->open[i]) == SYNCH_TRY)
			answer(coordinator, i, SYNCH_NOT_NOW);
}

bool synch_turn(struct synch_coordinator *coordinator, const struct synch_seen *seen, int64_t now_ns)
{
	const size_t size = synch_state_size(&coordinator->net);
	struct synch_state before;

	memcpy(&before, &coordinator->state, size);
	coordinator->rung = 0;
	coordinator->stands_in = false;
	for (uint32_t i = 0; i < coordinator->net.participant_count; i++)
		if (participant_of(coordinator, i)->waits)
			hear(coordinator, i, &seen[i], now_ns);
		else
			hear_line(coordinator, i, &seen[i]);
	settle(coordinator, seen, now_ns);
	deny(coordinator, seen);
	return memcmp(&before, &coordinator->state, size) != 0;
}
