/* SPDX-License-Identifier: GPL-3.0-or-later */
#include "synch/cover.h"

#include <stdlib.h>
#include <string.h>

#define OMEGA   SYNCH_NO_BOUND /* as many tokens as anyone wants */
#define NO_NODE UINT32_MAX

/*
 * A place with a capacity never becomes OMEGA: what a sequence changes there need not be the same the next time. For
 * all others it is, and from a marking that is greater in every place the same sequence fires again.
 */
struct tree {
	const struct synch_net *net;
	uint32_t limit, count;
	uint16_t *tokens;
	uint32_t *parents;
};

static uint16_t *tokens_of(const struct tree *tree, uint32_t node)
{
	return &tree->tokens[(size_t)node * tree->net->place_count];
}

static bool has_inhibitors(const struct synch_net *net)
{
	for (uint32_t i = 0; i < net->arc_count; i++)
		if (net->arcs[i].kind == SYNCH_UNLESS)
			return true;
	return false;
}

/* As synch_fire; what is OMEGA stays so. */
static void fire(const struct synch_net *net, const uint16_t *from, uint16_t *to, unsigned transition)
{
	memcpy(to, from, net->place_count * sizeof(*to));
	synch_fire(net, to, transition, NULL, NULL);
	for (uint32_t i = 0; i < net->place_count; i++)
		if (from[i] == OMEGA)
			to[i] = OMEGA;
}

/* Every place of an ancestor has as many at most, and one without capacity fewer: that one grows for ever. */
static bool grows_from(const struct tree *tree, uint32_t ancestor, const uint16_t *tokens)
{
	const uint16_t *before = tokens_of(tree, ancestor);
	bool grew = false;

	for (uint32_t i = 0; i < tree->net->place_count; i++) {
		if (before[i] > tokens[i])
			return false;
		grew |= before[i] < tokens[i] && tree->net->places[i].capacity == 0;
	}
	return grew;
}

static void accelerate(const struct tree *tree, uint32_t parent, uint16_t *tokens)
{
	bool again = true;

	while (again) {
		again = false;
		for (uint32_t node = parent; node != NO_NODE; node = tree->parents[node]) {
			if (!grows_from(tree, node, tokens))
				continue;
			for (uint32_t i = 0; i < tree->net->place_count; i++)
				if (tokens_of(tree, node)[i] < tokens[i] && tokens[i] != OMEGA &&
				    tree->net->places[i].capacity == 0) {
					tokens[i] = OMEGA;
					again = true;
				}
		}
	}
}

/* Some node says it already: this one has nothing to add. */
static bool is_covered(const struct tree *tree, const uint16_t *tokens)
{
	for (uint32_t node = 0; node < tree->count; node++) {
		uint32_t i = 0;

		while (i < tree->net->place_count && tokens_of(tree, node)[i] >= tokens[i])
			i++;
		if (i == tree->net->place_count)
			return true;
	}
	return false;
}

static void add(struct tree *tree, const uint16_t *tokens, uint32_t parent)
{
	memcpy(tokens_of(tree, tree->count), tokens, tree->net->place_count * sizeof(*tokens));
	tree->parents[tree->count] = parent;
	tree->count++;
}

/* False: the limit was reached. */
static bool visit(struct tree *tree, uint32_t node)
{
	uint16_t tokens[MODEL_PLACES];

	for (uint32_t i = 0; i < tree->net->transition_count; i++) {
		if (!synch_enabled(tree->net, tokens_of(tree, node), i))
			continue;
		fire(tree->net, tokens_of(tree, node), tokens, i);
		accelerate(tree, node, tokens);
		if (is_covered(tree, tokens))
			continue;
		if (tree->count == tree->limit)
			return false;
		add(tree, tokens, node);
	}
	return true;
}

static bool build(struct tree *tree)
{
	uint16_t tokens[MODEL_PLACES] = {0};

	for (uint32_t i = 0; i < tree->net->place_count; i++)
		tokens[i] = tree->net->places[i].tokens;
	add(tree, tokens, NO_NODE);
	for (uint32_t node = 0; node < tree->count; node++)
		if (!visit(tree, node))
			return false;
	return true;
}

static void conclude(const struct tree *tree, const struct synch_net *net, struct synch_findings *out)
{
	out->bounded = SYNCH_YES;
	for (uint32_t i = 0; i < net->place_count; i++) {
		for (uint32_t node = 0; node < tree->count; node++)
			if (tokens_of(tree, node)[i] > out->most[i])
				out->most[i] = tokens_of(tree, node)[i];
		if (out->most[i] == OMEGA)
			out->bounded = SYNCH_NO;
	}
	for (uint32_t i = 0; i < net->transition_count; i++) {
		out->fires[i] = SYNCH_NO;
		for (uint32_t node = 0; node < tree->count; node++)
			if (synch_enabled(tree->net, tokens_of(tree, node), i))
				out->fires[i] = SYNCH_YES;
	}
}

bool cover(const struct model *model, uint32_t limit, const struct synch_net *net, struct synch_findings *out)
{
	struct tree tree = {.net = &model->net, .limit = limit};
	bool good = true;

	if (has_inhibitors(net))
		return true;
	tree.tokens = calloc((size_t)limit * model->net.place_count + 1, sizeof(*tree.tokens));
	tree.parents = calloc(limit, sizeof(*tree.parents));
	if (tree.tokens == NULL || tree.parents == NULL)
		good = false;
	else if (build(&tree))
		conclude(&tree, net, out);
	free(tree.tokens);
	free(tree.parents);
	return good;
}
