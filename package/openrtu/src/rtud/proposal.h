/* SPDX-License-Identifier: GPL-3.0-or-later */
/*
 * How far a configuration is that the page proposes: checked, in force on trial, kept or taken back. One at a time. Time is an
 * argument: CLOCK_MONOTONIC. Whoever holds it does what it says, and tells how that ended.
 */
#ifndef OPENRTU_RTUD_PROPOSAL_H
#define OPENRTU_RTUD_PROPOSAL_H

#include "web/setup.h"

#define PROPOSAL_AGAIN_S 10 /* until what could not be taken back is tried again */
/* Texts that are shown or checked without a rest; then one for each second of it. */
#define PROPOSAL_AT_ONCE 60

enum proposal_phase {
	PROPOSAL_NONE,
	PROPOSAL_CHECKING,
	PROPOSAL_CHECKED,
	PROPOSAL_APPLYING,
	PROPOSAL_TRIAL,     /* in force; the file on the disk is the former one */
	PROPOSAL_KEEPING,   /* the file is written */
	PROPOSAL_RETURNING, /* the former one comes back into force */
	PROPOSAL_STUCK,     /* it could not */
};

enum proposal_task {
	PROPOSAL_NOTHING,
	PROPOSAL_REFUSE, /* the wish */
	PROPOSAL_CHECK,
	PROPOSAL_APPLY,
	PROPOSAL_KEEP,
	PROPOSAL_GO_BACK,
};

struct proposal {
	enum proposal_phase phase;
	char user[WEB_USER_SIZE]; /* who proposed it */
	uint32_t text;            /* its hash, from when it was checked */
	int64_t until_ns;         /* of a trial; of one that is stuck */
};

/* How often a process beside rtud begins: one that never rests would keep others from a reload. */
struct proposal_pace {
	int64_t began_ns; /* the last one */
	int64_t paid_ns;  /* when all have had their second of rest */
};

/* False: not now. */
bool proposal_begins(struct proposal_pace *pace, int64_t now_ns);
/* What began last has ended: its time was no rest. */
void proposal_rests(struct proposal_pace *pace, int64_t now_ns);

/* A wish, but SETUP_SHOW: what is to be done. */
enum proposal_task proposal_ask(struct proposal *proposal, enum setup_wish wish, const char *user,
				uint32_t text, int64_t now_ns);
/* What was to be done has ended. text: its hash, when it was checked. Returns what is to be done then. */
enum proposal_task proposal_ended(struct proposal *proposal, bool good, uint32_t text, int64_t now_ns);
/* Time has passed. */
enum proposal_task proposal_wait(struct proposal *proposal, int64_t now_ns);
/* Another configuration is on trial or on its way: nobody else may change it. One that is stuck waits for whoever can. */
bool proposal_holds(const struct proposal *proposal);
const char *proposal_phase_name(enum proposal_phase phase);

#endif
