/* SPDX-License-Identifier: GPL-3.0-or-later */
/*
 * libFuzzer on the net: the input is a JSON object with "synch", "start" and "net", behind an octet of its own. It is refused, or every
 * index is within its bounds, the analysis ends, and a coordinator that hears any words of any module keeps its marking within the
 * capacities.
 */
#include <stdlib.h>

#include "config/scanners.h"
#include "fuzz/target.h"
#include "map/time_ns.h"
#include "synch/analysis.h"
#include "synch/config.h"
#include "synch/config_part.h"
#include "synch/coordinator.h"

#define MARKINGS 200
#define TURNS    64

static void check_tables(const struct synch_tables *tables)
{
	uint32_t arcs = 0;

	CHECK(tables->place_count <= SYNCH_PLACES_MAX && tables->transition_count <= SYNCH_TRANSITIONS_MAX);
	CHECK(tables->arc_count <= SYNCH_ARCS_MAX && tables->participant_count <= SYNCH_PARTICIPANTS_MAX);
	for (uint32_t i = 0; i < tables->transition_count; i++) {
		CHECK(tables->transitions[i].first_arc == arcs);
		arcs += tables->transitions[i].arc_count;
	}
	CHECK(arcs == tables->arc_count);
	for (uint32_t i = 0; i < arcs; i++)
		CHECK(tables->arcs[i].place < tables->place_count &&
		      tables->arcs[i].transition < tables->transition_count &&
		      (tables->arcs[i].weight > 0) == (tables->arcs[i].kind != SYNCH_UNLESS));
	for (uint32_t i = 0; i < tables->participant_count; i++)
		CHECK((tables->participants[i].begin == SYNCH_NOTHING ||
		       (tables->participants[i].begin < tables->transition_count &&
			tables->participants[i].waits)) &&
		      (tables->participants[i].end == SYNCH_NOTHING ||
		       tables->participants[i].end < tables->transition_count));
	for (uint32_t i = 0; i < tables->point_count; i++)
		CHECK(tables->points[i].participant < tables->participant_count &&
		      tables->points[i].transition < tables->transition_count);
}

/* The seed's octets are the words of modules gone wild. */
static void coordinate(const struct synch_net *net, uint32_t seed)
{
	static struct synch_coordinator coordinator;
	static struct synch_seen seen[SYNCH_PARTICIPANTS_MAX];
	const struct synch_state none = {.begun = 0};

	memset(seen, 0, sizeof(seen));
	synch_begin(&coordinator, net, &none);
	for (int turn = 0; turn < TURNS; turn++) {
		for (uint32_t i = 0; i < net->participant_count; i++) {
			seed = seed * 1664525u + 1013904223u;
			seen[i].alive = seed >> 28 != 0;
			if (seed >> 27 & 1)
				seen[i].word = net->participants[i].waits ? seed ^ seed >> 16
									  : seen[i].word + (seed >> 24 & 3);
		}
		synch_turn(&coordinator, seen, turn * NS_PER_MS);
		for (uint32_t i = 0; i < net->place_count; i++)
			CHECK(coordinator.state.tokens[i] <= synch_capacity(&net->places[i]));
	}
}

static void check_net(const struct synch_tables *tables, uint32_t seed)
{
	const struct synch_net net = synch_net_of(tables);
	struct synch_findings findings;

	check_tables(tables);
	CHECK(synch_analyse(&net, MARKINGS, &findings));
	CHECK(findings.markings >= 1 && findings.markings <= MARKINGS);
	synch_free_findings(&findings);
	coordinate(&net, seed);
}

static void read_part(struct config_loader *loader, const json_t *root)
{
	const struct config_place file = {.in = NULL};
	struct config_value values[8];
	void *own = config_allocate(1, synch_part.own_size);

	CHECK(own != NULL && synch_part.key_count <= sizeof(values) / sizeof(values[0]));
	config_read_keys(&loader->report, &file, root, synch_part.keys, synch_part.key_count, values);
	synch_part.read(loader, own, values);
	CHECK(synch_part.link(loader, own));
	synch_part.end(own);
	free(own);
}

int LLVMFuzzerTestOneInput(const uint8_t *data, size_t size)
{
	static FILE *messages;
	struct map_config config = {.set_count = 0};
	struct config_loader *loader = calloc(1, sizeof(*loader));
	json_t *root =
	    size > 0 ? json_loadb((const char *)data + 1, size - 1, JSON_REJECT_DUPLICATES, NULL) : NULL;

	if (messages == NULL)
		messages = fopen("/dev/null", "we");
	CHECK(loader != NULL && messages != NULL);
	loader->report.messages = messages;
	loader->report.source = (struct config_source){.path = "net", .text = ""};
	loader->config = &config;
	config_add_scanner(loader, "line1", false, 45);
	config_add_scanner(loader, "a", true, 0);
	config_add_scanner(loader, "b", true, 10);
	config_add_scanner(loader, "c", true, 0);
	if (json_is_object(root))
		read_part(loader, root);
	if (synch_tables(&config) != NULL && loader->report.errors == 0)
		check_net(synch_tables(&config), data[0] * 2654435761u);
	free(synch_tables(&config));
	json_decref(root);
	free(loader);
	return 0;
}
