/* SPDX-License-Identifier: GPL-3.0-or-later */
#include "synch/synched.h"

#include "synch/config.h"
#include "synch/stats.h"

static const struct synch_participant *self(const struct synched *synched)
{
	return &synched->net.participants[synched->number];
}

static void say(struct synched *synched, enum synch_wish wish, uint8_t transition)
{
	const uint16_t sequence = (uint16_t)((synched->word >> 16) + 1);

	synched->word = synch_word(sequence, wish, transition) | (synched->met ? 0 : SYNCH_NEW);
	map_synch_say(synched->map, synched->number, synched->word);
}

void synched_begin(struct synched *synched, struct map *map, const char *name)
{
	const struct map_config *config = map_config(map);

	*synched = (struct synched){.map = map, .number = synch_participant_named(config, name)};
	if (synched->number == UINT32_MAX)
		return;
	synched->stats = synch_stats_of(map);
	if (synched->stats == NULL)
		return;
	synched->net = synch_net_of(synch_tables(config));
	synched->word = map_synch_said(map, map_self(map), synched->number);
	if (self(synched)->waits)
		say(synched, SYNCH_HELLO, SYNCH_NOTHING);
}

bool synched_waits(const struct synched *synched)
{
	return synched_takes_part(synched) && self(synched)->begin != SYNCH_NOTHING;
}

void synched_ask_begin(struct synched *synched)
{
	synched_ask(synched, self(synched)->begin, true);
}

void synched_ask(struct synched *synched, uint8_t transition, bool blocking)
{
	synched->open = true;
	say(synched, blocking ? SYNCH_ASK : SYNCH_TRY, transition);
}

bool synched_ask_end(struct synched *synched)
{
	if (!synched_takes_part(synched) || (!synched->open && self(synched)->end == SYNCH_NOTHING))
		return false;
	synched->open = false;
	say(synched, SYNCH_END, SYNCH_NOTHING);
	return true;
}

enum synch_result synched_answer(struct synched *synched)
{
	const uint32_t answer = synch_answer_in(synched->stats, synched->number);

	if (!synch_is_answered(synched->word, answer))
		return SYNCH_OPEN;
	synched->met = true;
	return (enum synch_result)(answer & 0xff);
}

void synched_ended(struct synched *synched)
{
	if (synched_takes_part(synched))
		map_synch_say(synched->map, synched->number, ++synched->word);
}
