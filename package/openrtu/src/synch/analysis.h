/* SPDX-License-Identifier: GPL-3.0-or-later */
/*
 * What a net can do, before it runs. All markings that the modules can reach are looked at, shortest firing sequences first, up to
 * a limit. Where they are more, or without end, coverability (Karp and Miller 1969) says which places have no bound and which
 * transitions can fire; inhibitors rule that out, and then nothing is said beyond the limit.
 *
 * A module fires in its order: scan_begin, its points, scan_end. The search knows that, and nothing of times.
 */
#ifndef OPENRTU_SYNCH_ANALYSIS_H
#define OPENRTU_SYNCH_ANALYSIS_H

#include "synch/net.h"

#define SYNCH_NO_BOUND UINT16_MAX
/* What a sequence may hold: a transition's number, or this and a participant's, whose scan ends and fires nothing. */
#define SYNCH_QUIET_END SYNCH_TRANSITIONS_MAX

enum synch_answer { SYNCH_NO, SYNCH_YES, SYNCH_UNKNOWN };

/* A firing sequence, or none. */
struct synch_sequence {
	uint8_t *fired;
	uint32_t length;
	bool found;
};

struct synch_findings {
	uint32_t markings; /* looked at */
	bool complete;     /* these are all that can be reached */
	enum synch_answer bounded;
	uint16_t most[SYNCH_PLACES_MAX]; /* tokens seen in a place; SYNCH_NO_BOUND: there is no most */
	enum synch_answer fires[SYNCH_TRANSITIONS_MAX];
	struct synch_sequence deadlock; /* the shortest to a marking in which nothing can fire */
	/* By participant with a scan_begin: the shortest to a marking after which it can never begin a scan again. */
	struct synch_sequence stuck[SYNCH_PARTICIPANTS_MAX];
};

/* limit: of markings. False: no memory. The findings are to be freed in any case. */
bool synch_analyse(const struct synch_net *net, uint32_t limit, struct synch_findings *out);
void synch_free_findings(struct synch_findings *findings);
/* What fired, in words: a transition's name, or whose scan ended. out: SYNCH_LABEL_SIZE octets. */
void synch_fired_name(const struct synch_net *net, uint8_t fired, char *out);

#endif
