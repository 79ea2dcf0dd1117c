/* SPDX-License-Identifier: GPL-3.0-or-later */
/* The net: its marking, and who waits for what since when. */
#include <errno.h>
#include <stdio.h>
#include <string.h>

#include "rtuctl/net_picture.h"
#include "rtuctl/tables.h"
#include "synch/config.h"
#include "synch/stats.h"

#define COUNT(array) (sizeof(array) / sizeof((array)[0]))

static const char *const phases[] = {[SYNCH_IDLE] = "between scans",
				     [SYNCH_SCANS] = "in a scan",
				     [SYNCH_LOST] = "taken for dead",
				     [SYNCH_HELD] = "holds tokens",
				     [SYNCH_OWES] = "its end is owed"};
static const char *const deaths[] = {[SYNCH_RETURN] = "return", [SYNCH_HOLD] = "hold", [SYNCH_FIRE] = "fire"};

static const struct listing_column module_columns[] = {
    {"name", "NAME", LISTING_TEXT},          {"alive", "ALIVE", LISTING_TEXT},
    {"state", "STATE", LISTING_TEXT},        {"waits_for", "WAITS FOR", LISTING_TEXT},
    {"waits_s", "SINCE", LISTING_AGE},       {"on_death", "ON DEATH", LISTING_TEXT},
    {"deaths", "DEATHS", LISTING_RIGHT},     {"stood_in", "STOOD IN", LISTING_RIGHT},
    {"left_out", "LEFT OUT", LISTING_RIGHT},
};

static const struct listing_column place_columns[] = {
    {"name", "PLACE", LISTING_TEXT},
    {"tokens", "TOKENS", LISTING_RIGHT},
    {"capacity", "CAPACITY", LISTING_RIGHT},
    {"lost", "LOST", LISTING_RIGHT},
};

static const struct listing_column transition_columns[] = {
    {"name", "TRANSITION", LISTING_TEXT},
    {"fired_by", "FIRED BY", LISTING_TEXT},
    {"can_fire", "CAN FIRE", LISTING_TEXT},
    {"firings", "FIRINGS", LISTING_RIGHT},
};

/* What there is at one moment; the net's tables do not change. */
static struct synch_net net;
static struct synch_stats *stats;
static struct synch_state state;

static const char *waits_for(uint32_t number)
{
	const uint32_t transition = stats->waits_for[number];

	return transition == 0 || transition > net.transition_count ? NULL
								    : net.transitions[transition - 1].name;
}

static json_t *module_rows(const struct map *map)
{
	const uint32_t now_ms = (uint32_t)(map_now_ns() / NS_PER_MS);
	json_t *rows = json_array();

	for (uint32_t i = 0; i < net.participant_count; i++) {
		const struct synch_participant *participant = &net.participants[i];
		const char *waits = waits_for(i);
		json_t *row = json_object();

		json_object_set_new(row, "name", json_string(participant->name));
		json_object_set_new(row, "alive", json_boolean(map_alive(map, participant->module)));
		json_object_set_new(row, "state",
				    participant->waits && state.phases[i] < COUNT(phases)
					? json_string(phases[state.phases[i]])
					: json_null());
		json_object_set_new(row, "waits_for", waits == NULL ? json_null() : json_string(waits));
		json_object_set_new(row, "waits_s",
				    waits == NULL ? json_null()
						  : json_real((now_ms - stats->since_ms[i]) / 1e3));
		json_object_set_new(row, "on_death",
				    participant->waits ? json_string(deaths[participant->on_death])
						       : json_null());
		json_object_set_new(row, "deaths", json_integer(stats->deaths[i]));
		json_object_set_new(row, "stood_in", json_integer(stats->stood_in[i]));
		json_object_set_new(row, "left_out", json_integer(stats->left_out[i]));
		json_array_append_new(rows, row);
	}
	return rows;
}

static json_t *place_rows(const struct map *map)
{
	json_t *rows = json_array();

	(void)map;
	for (uint32_t i = 0; i < net.place_count; i++) {
		const struct synch_place *place = &net.places[i];
		json_t *row = json_object();

		json_object_set_new(row, "name", json_string(place->name));
		json_object_set_new(row, "tokens", json_integer(state.tokens[i]));
		json_object_set_new(row, "capacity",
				    place->capacity ? json_integer(place->capacity) : json_null());
		json_object_set_new(row, "lost", json_integer(stats->lost[i]));
		json_array_append_new(rows, row);
	}
	return rows;
}

static json_t *fired_by(uint32_t transition)
{
	for (uint32_t i = 0; i < net.participant_count; i++)
		if (net.participants[i].begin == transition || net.participants[i].end == transition)
			return json_sprintf("%s, scan_%s", net.participants[i].name,
					    net.participants[i].begin == transition ? "begin" : "end");
	for (uint32_t i = 0; i < net.point_count; i++)
		if (net.points[i].transition == transition)
			return json_sprintf("%s, point %s", net.participants[net.points[i].participant].name,
					    net.points[i].name);
	return json_null();
}

static json_t *transition_rows(const struct map *map)
{
	json_t *rows = json_array();

	(void)map;
	for (uint32_t i = 0; i < net.transition_count; i++)
		json_array_append_new(rows, json_pack("{s:s, s:o, s:b, s:I}", "name", net.transitions[i].name,
						      "fired_by", fired_by(i), "can_fire",
						      synch_enabled(&net, state.tokens, i), "firings",
						      (json_int_t)stats->firings[i]));
	return rows;
}

static const struct table tables[] = {
    {"modules", module_columns, COUNT(module_columns), module_rows},
    {"places", place_columns, COUNT(place_columns), place_rows},
    {"transitions", transition_columns, COUNT(transition_columns), transition_rows},
};

/* ---- the picture ------------------------------------------------------------------------- */

static int draw(const struct map *map, const char *path)
{
	struct net_mark marks[SYNCH_PARTICIPANTS_MAX];
	FILE *out = fopen(path, "we");

	if (out == NULL) {
		fprintf(stderr, "rtuctl: cannot write %s: %s\n", path, strerror(errno));
		return RTUCTL_FAILED;
	}
	for (uint32_t i = 0; i < net.participant_count; i++)
		marks[i] = (struct net_mark){.alive = map_alive(map, net.participants[i].module),
					     .waits = waits_for(i) != NULL};
	net_picture(&net, state.tokens, marks, out);
	if (fclose(out) == 0)
		return RTUCTL_DONE;
	fprintf(stderr, "rtuctl: cannot write %s: %s\n", path, strerror(errno));
	return RTUCTL_FAILED;
}

/* Before rtu-synch has begun, there is the marking of the start. */
static bool take_state(const struct map *map)
{
	const struct synch_tables *read = synch_tables(map_config(map));

	stats = synch_stats_of(map);
	if (read == NULL || stats == NULL)
		return false;
	net = synch_net_of(read);
	if (!latch_load(&stats->latch, stats->copies, &state, sizeof(state)) || !state.begun)
		for (uint32_t i = 0; i < net.place_count; i++)
			state.tokens[i] = net.places[i].tokens;
	return true;
}

int rtuctl_synch(struct map *map, const struct rtuctl_request *request)
{
	if (!take_state(map)) {
		fputs("rtuctl: the configuration has no net: neither \"synch\" nor \"net\" is in it\n",
		      stderr);
		return RTUCTL_FAILED;
	}
	if (request->svg != NULL)
		return draw(map, request->svg);
	return tables_print(map, request, tables, COUNT(tables), "modules, places or transitions");
}
