/* SPDX-License-Identifier: GPL-3.0-or-later */
/* All markings that can be reached, breadth first; coverability where they have no end is in cover.c. */
#include "synch/analysis.h"

#include <stdio.h>
#include <stdlib.h>
#include <string.h>

#include "map/hash.h"
#include "synch/cover.h"
#include "synch/model.h"

#define NO_MARKING UINT32_MAX

/* From one marking to another. */
struct edge {
	uint32_t from, to;
};

struct search {
	struct model model;
	uint32_t limit, count;
	uint16_t *tokens;    /* of each marking, one behind the other */
	uint32_t *parents;   /* from which it was reached first */
	uint8_t *fired;      /* by which transition of the model */
	uint32_t *table;     /* hash: marking + 1; 0: free */
	uint32_t table_size; /* a power of two */
	struct edge *edges;
	uint32_t edge_count, edge_room;
	uint32_t deadlock;
	bool full; /* there were more markings than the limit, or a place that has no bound was full */
};

static uint16_t *tokens_of(const struct search *search, uint32_t marking)
{
	return &search->tokens[(size_t)marking * search->model.net.place_count];
}

static size_t row_size(const struct search *search)
{
	return search->model.net.place_count * sizeof(uint16_t);
}

/* ---- the set of markings ----------------------------------------------------------------- */

static uint32_t hash(const uint16_t *tokens, uint32_t count)
{
	uint32_t sum = MAP_HASH_BASIS;

	for (uint32_t i = 0; i < count; i++)
		sum = map_hash_word(sum, tokens[i]);
	return sum;
}

/* Its number, old or new; NO_MARKING: there is no room for a new one. */
static uint32_t enter(struct search *search, const uint16_t *tokens, uint32_t parent, uint8_t fired)
{
	uint32_t slot = hash(tokens, search->model.net.place_count) & (search->table_size - 1);

	for (; search->table[slot] != 0; slot = (slot + 1) & (search->table_size - 1))
		if (memcmp(tokens_of(search, search->table[slot] - 1), tokens, row_size(search)) == 0)
			return search->table[slot] - 1;
	if (search->count == search->limit)
		return NO_MARKING;
	memcpy(tokens_of(search, search->count), tokens, row_size(search));
	search->parents[search->count] = parent;
	search->fired[search->count] = fired;
	search->table[slot] = ++search->count;
	return search->count - 1;
}

static bool add_edge(struct search *search, uint32_t from, uint32_t to)
{
	if (search->edge_count == search->edge_room) {
		const uint32_t room = search->edge_room ? 2 * search->edge_room : 1024;
		struct edge *grown = realloc(search->edges, room * sizeof(*grown));

		if (grown == NULL)
			return false;
		search->edges = grown;
		search->edge_room = room;
	}
	search->edges[search->edge_count++] = (struct edge){.from = from, .to = to};
	return true;
}

/* ---- breadth first ----------------------------------------------------------------------- */

/* What the model adds has no label of its own, and never holds more than one. */
static bool is_overfull(const struct search *search, const uint16_t *tokens)
{
	for (uint32_t i = 0; i < search->model.net.place_count; i++)
		if (search->model.places[i].capacity == 0 && tokens[i] == SYNCH_TOKENS_MAX)
			return true;
	return false;
}

static bool visit(struct search *search, uint32_t marking)
{
	const struct synch_net *net = &search->model.net;
	uint16_t tokens[MODEL_PLACES];
	bool stands = true;

	for (uint32_t i = 0; i < net->transition_count; i++) {
		uint32_t to;

		if (!synch_enabled(net, tokens_of(search, marking), i))
			continue;
		stands = false;
		memcpy(tokens, tokens_of(search, marking), row_size(search));
		synch_fire(net, tokens, i, NULL, NULL);
		to = is_overfull(search, tokens) ? NO_MARKING : enter(search, tokens, marking, (uint8_t)i);
		if (to == NO_MARKING)
			search->full = true;
		else if (!add_edge(search, marking, to))
			return false;
	}
	if (stands && search->deadlock == NO_MARKING)
		search->deadlock = marking;
	return true;
}

static bool walk(struct search *search)
{
	uint16_t tokens[MODEL_PLACES] = {0};

	for (uint32_t i = 0; i < search->model.net.place_count; i++)
		tokens[i] = search->model.places[i].tokens;
	enter(search, tokens, NO_MARKING, SYNCH_NOTHING);
	for (uint32_t marking = 0; marking < search->count; marking++)
		if (!visit(search, marking))
			return false;
	return true;
}

/* ---- what follows ------------------------------------------------------------------------ */

static bool take_sequence(const struct search *search, uint32_t marking, struct synch_sequence *out)
{
	uint32_t length = 0;

	for (uint32_t i = marking; search->parents[i] != NO_MARKING; i = search->parents[i])
		length++;
	out->fired = malloc(length + 1);
	if (out->fired == NULL)
		return false;
	out->length = length;
	out->found = true;
	for (uint32_t i = marking; search->parents[i] != NO_MARKING; i = search->parents[i])
		out->fired[--length] = search->model.names[search->fired[i]];
	return true;
}

/* Backwards from the markings in which it can begin, until no other can reach one of them. */
static bool find_stuck(const struct search *search, unsigned transition, struct synch_sequence *out)
{
	bool *can = calloc(search->count, sizeof(*can)), grew = true;
	bool good = true;

	if (can == NULL)
		return false;
	for (uint32_t i = 0; i < search->count; i++)
		can[i] = synch_enabled(&search->model.net, tokens_of(search, i), transition);
	while (grew) {
		grew = false;
		for (uint32_t i = search->edge_count; i-- > 0;)
			if (can[search->edges[i].to] && !can[search->edges[i].from])
				grew = can[search->edges[i].from] = true;
	}
	for (uint32_t i = 0; good && i < search->count; i++)
		if (!can[i]) {
			good = take_sequence(search, i, out);
			break;
		}
	free(can);
	return good;
}

static void take_bounds(const struct search *search, const struct synch_net *net, struct synch_findings *out)
{
	for (uint32_t marking = 0; marking < search->count; marking++)
		for (uint32_t i = 0; i < net->place_count; i++)
			if (tokens_of(search, marking)[i] > out->most[i])
				out->most[i] = tokens_of(search, marking)[i];
}

static void take_firings(const struct search *search, const struct synch_net *net, struct synch_findings *out)
{
	for (uint32_t i = 0; i < net->transition_count; i++) {
		out->fires[i] = search->full ? SYNCH_UNKNOWN : SYNCH_NO;
		for (uint32_t marking = 0; marking < search->count && out->fires[i] != SYNCH_YES; marking++)
			if (synch_enabled(&search->model.net, tokens_of(search, marking), i))
				out->fires[i] = SYNCH_YES;
	}
}

static bool conclude(const struct search *search, const struct synch_net *net, struct synch_findings *out)
{
	out->markings = search->count;
	out->complete = !search->full;
	out->bounded = search->full ? SYNCH_UNKNOWN : SYNCH_YES;
	take_bounds(search, net, out);
	take_firings(search, net, out);
	if (search->deadlock != NO_MARKING && !take_sequence(search, search->deadlock, &out->deadlock))
		return false;
	for (uint32_t i = 0; out->complete && i < net->participant_count; i++)
		if (net->participants[i].begin != SYNCH_NOTHING &&
		    !find_stuck(search, net->participants[i].begin, &out->stuck[i]))
			return false;
	return out->complete || cover(&search->model, search->limit, net, out);
}

/* ---- all --------------------------------------------------------------------------------- */

static bool allocate(struct search *search)
{
	search->table_size = 1;
	while (search->table_size < 2 * search->limit)
		search->table_size *= 2;
	search->tokens = calloc((size_t)search->limit * search->model.net.place_count + 1, sizeof(uint16_t));
	search->parents = calloc(search->limit, sizeof(*search->parents));
	search->fired = calloc(search->limit, sizeof(*search->fired));
	search->table = calloc(search->table_size, sizeof(*search->table));
	return search->tokens != NULL && search->parents != NULL && search->fired != NULL &&
	       search->table != NULL;
}

static void release(struct search *search)
{
	free(search->tokens);
	free(search->parents);
	free(search->fired);
	free(search->table);
	free(search->edges);
	free(search);
}

bool synch_analyse(const struct synch_net *net, uint32_t limit, struct synch_findings *out)
{
	struct search *search = calloc(1, sizeof(*search));
	bool good;

	memset(out, 0, sizeof(*out));
	if (search == NULL)
		return false;
	model_make(&search->model, net);
	search->limit = limit > 0 ? limit : 1;
	search->deadlock = NO_MARKING;
	good = allocate(search) && walk(search) && conclude(search, net, out);
	release(search);
	return good;
}

void synch_free_findings(struct synch_findings *findings)
{
	free(findings->deadlock.fired);
	for (uint32_t i = 0; i < SYNCH_PARTICIPANTS_MAX; i++)
		free(findings->stuck[i].fired);
	memset(findings, 0, sizeof(*findings));
}

void synch_fired_name(const struct synch_net *net, uint8_t fired, char *out)
{
	if (fired < SYNCH_QUIET_END)
		snprintf(out, SYNCH_LABEL_SIZE, "%s", net->transitions[fired].name);
	else
		snprintf(out, SYNCH_LABEL_SIZE, "%s ends its scan",
			 net->participants[fired - SYNCH_QUIET_END].name);
}
