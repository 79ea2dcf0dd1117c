/* SPDX-License-Identifier: GPL-3.0-or-later */
/*
 * Modules are frames side by side, with the transitions that they fire one below the other. A place stands in the gap between two
 * neighbours, or in a row below the frames if it joins others.
 */
#include "rtuctl/net_picture.h"

#include <string.h>

#define MARGIN      24
#define FRAME_WIDTH 150
#define GAP         150 /* between two frames */
#define HEAD        34  /* of a frame */
#define ROW         44  /* a transition */
#define BOX_WIDTH   126
#define BOX_HEIGHT  26
#define RADIUS      17
#define PLACE_ROW   72
#define DOT         3.5
#define DOTS_MAX    4
#define LABEL_MAX   20 /* letters beside a place */

struct spot {
	int x, y;
};

struct picture {
	const struct synch_net *net;
	FILE *out;
	struct spot places[SYNCH_PLACES_MAX], transitions[SYNCH_TRANSITIONS_MAX]; /* middles */
	int columns[SYNCH_TRANSITIONS_MAX];                                       /* whose frame */
	int rows;                                                                 /* of the highest frame */
	int width, height;
};

/* ---- where things are -------------------------------------------------------------------- */

static void put_transition(struct picture *picture, uint8_t transition, int column, int *row)
{
	if (transition == SYNCH_NOTHING)
		return;
	picture->columns[transition] = column;
	picture->transitions[transition] =
	    (struct spot){.x = MARGIN + column * (FRAME_WIDTH + GAP) + FRAME_WIDTH / 2,
			  .y = MARGIN + HEAD + *row * ROW + ROW / 2};
	*row += 1;
	if (*row > picture->rows)
		picture->rows = *row;
}

static void put_transitions(struct picture *picture)
{
	const struct synch_net *net = picture->net;

	for (uint32_t i = 0; i < net->participant_count; i++) {
		int row = 0;

		put_transition(picture, net->participants[i].begin, (int)i, &row);
		for (uint32_t j = 0; j < net->point_count; j++)
			if (net->points[j].participant == i)
				put_transition(picture, net->points[j].transition, (int)i, &row);
		put_transition(picture, net->participants[i].end, (int)i, &row);
	}
}

/* The frames that a place joins, from the first to the last. False: it has no arcs. */
static bool span_of(const struct picture *picture, uint32_t place, int *first, int *last)
{
	bool found = false;

	for (uint32_t i = 0; i < picture->net->arc_count; i++) {
		const int column = picture->columns[picture->net->arcs[i].transition];

		if (picture->net->arcs[i].place != place)
			continue;
		*first = !found || column < *first ? column : *first;
		*last = !found || column > *last ? column : *last;
		found = true;
	}
	return found;
}

/* One below the other in the gap behind a frame, from its middle on. */
static struct spot spot_in_gap(int column, int taken)
{
	return (struct spot){.x = MARGIN + column * (FRAME_WIDTH + GAP) + FRAME_WIDTH + GAP / 2,
			     .y = MARGIN + HEAD / 2 + RADIUS + taken * PLACE_ROW};
}

static void put_places(struct picture *picture)
{
	const int frames = (int)picture->net->participant_count;
	int taken[SYNCH_PARTICIPANTS_MAX] = {0}, below = 0, first = 0, last = 0, deepest = 0;

	for (uint32_t i = 0; i < picture->net->place_count; i++) {
		if (!span_of(picture, i, &first, &last))
			first = last = 0;
		if (last - first > 1)
			continue;
		picture->places[i] = spot_in_gap(first, taken[first]++);
		if (taken[first] > deepest)
			deepest = taken[first];
	}
	picture->height = MARGIN + HEAD + picture->rows * ROW;
	if (MARGIN + deepest * PLACE_ROW > picture->height)
		picture->height = MARGIN + deepest * PLACE_ROW;
	for (uint32_t i = 0; i < picture->net->place_count; i++) {
		if (!span_of(picture, i, &first, &last) || last - first <= 1)
			continue;
		picture->places[i] =
		    (struct spot){.x = MARGIN + FRAME_WIDTH / 2 + (first + last) * (FRAME_WIDTH + GAP) / 2,
				  .y = picture->height + PLACE_ROW / 2 + below++ * PLACE_ROW};
	}
	picture->height += below * PLACE_ROW + MARGIN;
	picture->width =
	    2 * MARGIN + frames * (FRAME_WIDTH + GAP) - (frames > 0 && taken[frames - 1] > 0 ? 0 : GAP);
}

/* ---- drawing ----------------------------------------------------------------------------- */

static void text(FILE *out, int x, int y, const char *class, const char *words)
{
	fprintf(out, "<text x=\"%d\" y=\"%d\" class=\"%s\">", x, y, class);
	for (; *words != '\0'; words++)
		if (*words == '>')
			fputs("&gt;", out);
		else
			fputc(*words, out);
	fputs("</text>\n", out);
}

static void draw_head(const struct picture *picture)
{
	fprintf(
	    picture->out,
	    "<svg xmlns=\"http://www.w3.org/2000/svg\" width=\"%d\" height=\"%d\" viewBox=\"0 0 %d %d\">\n"
	    "<style>text{font:12px sans-serif;text-anchor:middle;fill:#222}.name{font-weight:bold}"
	    ".small{font-size:10px}.arc{fill:none;stroke:#456;stroke-width:1.2}"
	    ".frame{fill:#eef3f8;stroke:#789}.waits{fill:#fdf3d8;stroke:#b80}"
	    ".dead{fill:#fbe4e4;stroke:#b33;stroke-dasharray:4 3}.box{fill:#fff;stroke:#345}"
	    ".can{fill:#cfe8cf;stroke:#262}.place{fill:#fff;stroke:#222;stroke-width:1.5}</style>\n"
	    "<defs><marker id=\"arrow\" viewBox=\"0 0 8 8\" refX=\"8\" refY=\"4\" markerWidth=\"8\" "
	    "markerHeight=\"8\" orient=\"auto\"><path d=\"M0 0L8 4L0 8z\" fill=\"#456\"/></marker>"
	    "<marker id=\"unless\" viewBox=\"0 0 8 8\" refX=\"8\" refY=\"4\" markerWidth=\"8\" "
	    "markerHeight=\"8\" orient=\"auto\"><circle cx=\"4\" cy=\"4\" r=\"3\" fill=\"#fff\" "
	    "stroke=\"#456\"/></marker></defs>\n"
	    "<rect width=\"100%%\" height=\"100%%\" fill=\"#fff\"/>\n",
	    picture->width, picture->height, picture->width, picture->height);
}

static void draw_frame(const struct picture *picture, uint32_t number, const struct net_mark *mark)
{
	const int x = MARGIN + (int)number * (FRAME_WIDTH + GAP);
	int rows = 0;

	for (uint32_t i = 0; i < picture->net->transition_count; i++)
		rows += picture->columns[i] == (int)number;
	fprintf(picture->out, "<rect x=\"%d\" y=\"%d\" width=\"%d\" height=\"%d\" rx=\"8\" class=\"%s\"/>\n",
		x, MARGIN, FRAME_WIDTH, HEAD + rows * ROW,
		!mark->alive  ? "dead"
		: mark->waits ? "waits"
			      : "frame");
	text(picture->out, x + FRAME_WIDTH / 2, MARGIN + 21, "name", picture->net->participants[number].name);
}

/* Within its frame, "filter.scan_end" is scan_end. */
static const char *short_name(const struct synch_net *net, uint32_t transition, int column)
{
	const char *name = net->transitions[transition].name, *module = net->participants[column].name;
	const size_t length = strlen(module);

	return strncmp(name, module, length) == 0 && name[length] == '.' ? name + length + 1 : name;
}

static void draw_transition(const struct picture *picture, uint32_t number, bool can_fire)
{
	const struct spot at = picture->transitions[number];

	fprintf(picture->out, "<rect x=\"%d\" y=\"%d\" width=\"%d\" height=\"%d\" class=\"%s\"/>\n",
		at.x - BOX_WIDTH / 2, at.y - BOX_HEIGHT / 2, BOX_WIDTH, BOX_HEIGHT, can_fire ? "can" : "box");
	text(picture->out, at.x, at.y + 4, "", short_name(picture->net, number, picture->columns[number]));
}

static void draw_tokens(const struct picture *picture, struct spot at, unsigned tokens)
{
	char number[sizeof("4294967295")];

	if (tokens > DOTS_MAX) {
		snprintf(number, sizeof(number), "%u", tokens);
		text(picture->out, at.x, at.y + 4, "name", number);
		return;
	}
	for (unsigned i = 0; i < tokens; i++)
		fprintf(picture->out, "<circle cx=\"%g\" cy=\"%d\" r=\"%g\"/>\n",
			at.x + (2.0 * i + 1 - tokens) * (DOT + 1), at.y, DOT);
}

static void draw_place(const struct picture *picture, uint32_t number, unsigned tokens)
{
	const struct synch_place *place = &picture->net->places[number];
	const struct spot at = picture->places[number];
	char label[SYNCH_LABEL_SIZE + 16];

	fprintf(picture->out, "<circle cx=\"%d\" cy=\"%d\" r=\"%d\" class=\"place\"/>\n", at.x, at.y, RADIUS);
	draw_tokens(picture, at, tokens);
	snprintf(label, sizeof(label), place->capacity ? "%.*s (%u)" : "%.*s", LABEL_MAX, place->name,
		 place->capacity);
	text(picture->out, at.x, at.y + RADIUS + 12, "small", label);
}

/* From or to the side of the box that is nearer. */
static void draw_arc(const struct picture *picture, const struct synch_arc *arc)
{
	const struct spot place = picture->places[arc->place], box = picture->transitions[arc->transition];
	const int side = place.x < box.x ? -1 : 1;
	const struct spot edge = {.x = box.x + side * BOX_WIDTH / 2, .y = box.y};
	const struct spot rim = {.x = place.x - side * RADIUS, .y = place.y};
	const int reach = GAP / 3;
	const bool to_place = arc->kind == SYNCH_GIVES;
	const struct spot from = to_place ? edge : rim, to = to_place ? rim : edge;
	const int bend = to_place ? side * reach : -side * reach;
	char weight[8];

	fprintf(picture->out,
		"<path d=\"M%d %dC%d %d %d %d %d %d\" class=\"arc\" marker-end=\"url(#%s)\"/>\n", from.x,
		from.y, from.x + bend, from.y, to.x - bend, to.y, to.x, to.y,
		arc->kind == SYNCH_UNLESS ? "unless" : "arrow");
	if (arc->weight < 2)
		return;
	snprintf(weight, sizeof(weight), "%u", arc->weight);
	text(picture->out, (from.x + to.x) / 2, (from.y + to.y) / 2 - 4, "small", weight);
}

void net_picture(const struct synch_net *net, const uint16_t *tokens, const struct net_mark *marks, FILE *out)
{
	struct picture picture = {.net = net, .out = out};

	put_transitions(&picture);
	put_places(&picture);
	draw_head(&picture);
	for (uint32_t i = 0; i < net->participant_count; i++)
		draw_frame(&picture, i, &marks[i]);
	for (uint32_t i = 0; i < net->arc_count; i++)
		draw_arc(&picture, &net->arcs[i]);
	for (uint32_t i = 0; i < net->transition_count; i++)
		draw_transition(&picture, i, synch_enabled(net, tokens, i));
	for (uint32_t i = 0; i < net->place_count; i++)
		draw_place(&picture, i, tokens[i]);
	fputs("</svg>\n", out);
}
