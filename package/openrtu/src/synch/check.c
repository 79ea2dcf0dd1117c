/* SPDX-License-Identifier: GPL-3.0-or-later */
#include "synch/check.h"

#include "synch/analysis.h"
#include "synch/config.h"

#define MARKINGS_MAX 20000 /* some MiB, and less than a second on a desk */

static const char *plural(uint32_t count)
{
	return count == 1 ? "" : "s";
}

static void print_sequence(const struct synch_net *net, const struct synch_sequence *sequence, FILE *out)
{
	char name[SYNCH_LABEL_SIZE];

	if (sequence->length == 0)
		fputs(" at the start", out);
	for (uint32_t i = 0; i < sequence->length; i++) {
		synch_fired_name(net, sequence->fired[i], name);
		fprintf(out, "%s %s", i == 0 ? " after" : ",", name);
	}
	fputc('\n', out);
}

static void print_size(const struct synch_net *net, const struct synch_findings *findings, FILE *out)
{
	fprintf(out, "net: %u participant%s, %u place%s, %u transition%s; ", net->participant_count,
		plural(net->participant_count), net->place_count, plural(net->place_count),
		net->transition_count, plural(net->transition_count));
	if (findings->complete)
		fprintf(out, "all %u markings looked at\n", findings->markings);
	else
		fprintf(out, "there are more than the %u markings looked at\n", findings->markings);
}

static void print_bounds(const struct synch_net *net, const struct synch_findings *findings, FILE *out)
{
	uint16_t most = 0;

	if (findings->bounded == SYNCH_UNKNOWN)
		fputs("net: whether it is bounded is not known: the search stopped short\n", out);
	for (uint32_t i = 0; i < net->place_count; i++) {
		if (findings->most[i] == SYNCH_NO_BOUND)
			fprintf(out,
				"net: not bounded: place \"%s\" fills without end if what takes from it is "
				"slow; a "
				"capacity limits it\n",
				net->places[i].name);
		else if (findings->most[i] > most)
			most = findings->most[i];
	}
	if (findings->bounded == SYNCH_YES)
		fprintf(out, "net: bounded: at most %u token%s in a place\n", most, plural(most));
}

static void print_dead(const struct synch_net *net, const struct synch_findings *findings, FILE *out)
{
	for (uint32_t i = 0; i < net->transition_count; i++)
		if (findings->fires[i] == SYNCH_NO)
			fprintf(out, "net: dead: transition \"%s\" can never fire\n",
				net->transitions[i].name);
	for (uint32_t i = 0; i < net->participant_count; i++) {
		const struct synch_participant *participant = &net->participants[i];

		if (participant->begin != SYNCH_NOTHING && findings->fires[participant->begin] == SYNCH_NO)
			fprintf(out, "net: \"%s\" can never run: nothing lets its scan begin\n",
				participant->name);
	}
}

static void print_stuck(const struct synch_net *net, const struct synch_findings *findings, FILE *out)
{
	if (findings->deadlock.found) {
		fputs("net: deadlock", out);
		print_sequence(net, &findings->deadlock, out);
	} else if (!findings->complete) {
		fprintf(out, "net: no deadlock within %u markings; beyond them nobody has looked\n",
			findings->markings);
	} else {
		fputs("net: no deadlock\n", out);
	}
	for (uint32_t i = 0; i < net->participant_count; i++) {
		const struct synch_participant *participant = &net->participants[i];

		if (findings->deadlock.found || !findings->stuck[i].found ||
		    findings->fires[participant->begin] == SYNCH_NO)
			continue;
		fprintf(out, "net: \"%s\" stops for good", participant->name);
		print_sequence(net, &findings->stuck[i], out);
	}
}

bool synch_print(const struct map_config *config, FILE *out)
{
	const struct synch_tables *tables = synch_tables(config);
	struct synch_findings findings;
	struct synch_net net;
	bool good;

	if (tables == NULL)
		return true;
	net = synch_net_of(tables);
	good = synch_analyse(&net, MARKINGS_MAX, &findings);
	if (good) {
		print_size(&net, &findings, out);
		print_bounds(&net, &findings, out);
		print_dead(&net, &findings, out);
		print_stuck(&net, &findings, out);
	}
	synch_free_findings(&findings);
	return good;
}
