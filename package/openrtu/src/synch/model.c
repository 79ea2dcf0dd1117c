/* SPDX-License-Identifier: GPL-3.0-or-later */
#include "synch/model.h"

#include <string.h>

#include "synch/analysis.h"

static void add_arc(struct model *model, enum synch_arc_kind kind, unsigned place, unsigned transition)
{
	struct synch_transition *record = &model->transitions[transition];

	if (record->arc_count == 0)
		record->first_arc = (uint16_t)model->net.arc_count;
	record->arc_count++;
	model->arcs[model->net.arc_count++] = (struct synch_arc){
	    .kind = (uint8_t)kind, .place = (uint8_t)place, .transition = (uint8_t)transition, .weight = 1};
}

/* The places of a participant whose scans take turns with its waiting; 0: it has none, and may fire at any time. */
static bool has_turns(const struct synch_net *net, unsigned participant)
{
	const struct synch_participant *record = &net->participants[participant];

	if (record->begin == SYNCH_NOTHING)
		return false;
	if (record->end != SYNCH_NOTHING)
		return true;
	for (uint32_t i = 0; i < net->point_count; i++)
		if (net->points[i].participant == participant)
			return true;
	return false;
}

struct turn {
	bool has;
	uint8_t waits, scans; /* places */
	bool quiet;           /* no transition ends its scan */
};

static void add_places(struct model *model, unsigned participant, struct turn *turn)
{
	const struct synch_net *net = &model->net;

	*turn = (struct turn){.has = has_turns(net, participant)};
	if (!turn->has)
		return;
	turn->quiet = net->participants[participant].end == SYNCH_NOTHING;
	turn->waits = (uint8_t)model->net.place_count++;
	turn->scans = (uint8_t)model->net.place_count++;
	model->places[turn->waits].tokens = 1;
}

/* A transition that two of its hooks or points fire gets its arcs once. */
static void add_turns(struct model *model, const struct synch_participant *record, unsigned participant,
		      const struct turn *turn, unsigned transition)
{
	bool is_point = false;

	if (!turn->has)
		return;
	for (uint32_t i = 0; i < model->net.point_count; i++)
		is_point |= model->net.points[i].participant == participant &&
			    model->net.points[i].transition == transition;
	if (record->begin == transition) {
		add_arc(model, SYNCH_TAKES, turn->waits, transition);
		add_arc(model, SYNCH_GIVES, turn->scans, transition);
	} else if (record->end == transition) {
		add_arc(model, SYNCH_TAKES, turn->scans, transition);
		add_arc(model, SYNCH_GIVES, turn->waits, transition);
	} else if (is_point) {
		add_arc(model, SYNCH_TAKES, turn->scans, transition);
		add_arc(model, SYNCH_GIVES, turn->scans, transition);
	}
}

static void add_transition(struct model *model, const struct synch_net *net, const struct turn *turns,
			   unsigned transition)
{
	const struct synch_transition *record = &net->transitions[transition];

	model->transitions[transition] =
	    (struct synch_transition){.first_arc = (uint16_t)model->net.arc_count};
	model->names[transition] = (uint8_t)transition;
	for (uint32_t i = 0; i < record->arc_count; i++)
		model->arcs[model->net.arc_count++] = net->arcs[record->first_arc + i];
	model->transitions[transition].arc_count = record->arc_count;
	for (uint32_t i = 0; i < net->participant_count; i++)
		add_turns(model, &net->participants[i], i, &turns[i], transition);
}

static void add_quiet_end(struct model *model, unsigned participant, const struct turn *turn)
{
	const unsigned transition = model->net.transition_count;

	if (!turn->quiet)
		return;
	model->transitions[transition] = (struct synch_transition){.first_arc = 0};
	model->names[transition] = (uint8_t)(SYNCH_QUIET_END + participant);
	add_arc(model, SYNCH_TAKES, turn->scans, transition);
	add_arc(model, SYNCH_GIVES, turn->waits, transition);
	model->net.transition_count++;
}

void model_make(struct model *model, const struct synch_net *net)
{
	struct turn turns[SYNCH_PARTICIPANTS_MAX];

	memset(model, 0, sizeof(*model));
	model->net = *net;
	model->net.arc_count = 0;
	memcpy(model->places, net->places, net->place_count * sizeof(*net->places));
	for (uint32_t i = 0; i < net->participant_count; i++)
		add_places(model, i, &turns[i]);
	model->net.places = model->places;
	model->net.transitions = model->transitions;
	model->net.arcs = model->arcs;
	for (uint32_t i = 0; i < net->transition_count; i++)
		add_transition(model, net, turns, i);
	for (uint32_t i = 0; i < net->participant_count; i++)
		add_quiet_end(model, i, &turns[i]);
}
