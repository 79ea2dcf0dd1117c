/* SPDX-License-Identifier: GPL-3.0-or-later */
#include "synch/net.h"

#include <string.h>

static const struct synch_arc *first_arc(const struct synch_net *net, unsigned transition)
{
	return &net->arcs[net->transitions[transition].first_arc];
}

bool synch_enabled(const struct synch_net *net, const uint16_t *tokens, unsigned transition)
{
	const struct synch_arc *arcs = first_arc(net, transition);

	for (uint32_t i = 0; i < net->transitions[transition].arc_count; i++)
		if ((arcs[i].kind == SYNCH_TAKES && tokens[arcs[i].place] < arcs[i].weight) ||
		    (arcs[i].kind == SYNCH_UNLESS && tokens[arcs[i].place] > 0))
			return false;
	return true;
}

/* What a module's scan has changed stays within 16 bits, whatever it fires. */
static void note(int16_t *changes, unsigned place, int by)
{
	int sum;

	if (changes == NULL)
		return;
	sum = changes[place] + by;
	changes[place] = (int16_t)(sum > INT16_MAX ? INT16_MAX : sum < -INT16_MAX ? -INT16_MAX : sum);
}

static void give(const struct synch_net *net, uint16_t *tokens, const struct synch_arc *arc, int16_t *changes,
		 uint32_t *lost)
{
	const unsigned room = synch_capacity(&net->places[arc->place]) - tokens[arc->place];
	const unsigned given = arc->weight < room ? arc->weight : room;

	tokens[arc->place] = (uint16_t)(tokens[arc->place] + given);
	note(changes, arc->place, (int)given);
	if (lost != NULL)
		lost[arc->place] += arc->weight - given;
}

void synch_fire(const struct synch_net *net, uint16_t *tokens, unsigned transition, int16_t *changes,
		uint32_t *lost)
{
	const struct synch_arc *arcs = first_arc(net, transition);
	const uint32_t count = net->transitions[transition].arc_count;

	for (uint32_t i = 0; i < count; i++) {
		if (arcs[i].kind != SYNCH_TAKES)
			continue;
		tokens[arcs[i].place] = (uint16_t)(tokens[arcs[i].place] - arcs[i].weight);
		note(changes, arcs[i].place, -arcs[i].weight);
	}
	for (uint32_t i = 0; i < count; i++)
		if (arcs[i].kind == SYNCH_GIVES)
			give(net, tokens, &arcs[i], changes, lost);
}

void synch_undo(const struct synch_net *net, uint16_t *tokens, const int16_t *changes)
{
	for (uint32_t i = 0; i < net->place_count; i++) {
		const int most = synch_capacity(&net->places[i]);
		const int left = tokens[i] - changes[i];

		tokens[i] = (uint16_t)(left < 0 ? 0 : left > most ? most : left);
	}
}

bool synch_is_of(const struct synch_net *net, unsigned participant, unsigned transition)
{
	if (transition >= net->transition_count)
		return false;
	if (net->participants[participant].begin == transition ||
	    net->participants[participant].end == transition)
		return true;
	for (uint32_t i = 0; i < net->point_count; i++)
		if (net->points[i].participant == participant && net->points[i].transition == transition)
			return true;
	return false;
}

uint8_t synch_point_named(const struct synch_net *net, unsigned participant, const char *name)
{
	for (uint32_t i = 0; i < net->point_count; i++)
		if (net->points[i].participant == participant && strcmp(net->points[i].name, name) == 0)
			return net->points[i].transition;
	return SYNCH_NOTHING;
}
