/* SPDX-License-Identifier: GPL-3.0-or-later */
/*
 * The configuration that the gateway's page changes (web/setup.h). The page's process hands over a text; whatever touches a file is
 * done here, by processes beside rtud. Until it is confirmed, the file on the disk is the former one.
 */
#ifndef OPENRTU_RTUD_SETUP_H
#define OPENRTU_RTUD_SETUP_H

#include <stdbool.h>
#include <sys/types.h>

#include "map/map.h"
#include "rtud/proposal.h"

struct supervisor;

/* What a process beside rtud tells it. */
struct setup_told {
	uint32_t text; /* hash of what it has read */
};

enum setup_job { SETUP_NO_JOB, SETUP_JOB_CHECK, SETUP_JOB_APPLY, SETUP_JOB_BACK };

struct setup {
	struct proposal proposal;
	struct proposal_pace pace;
	uint32_t in_force; /* hash of the text of what runs */
	uint32_t base;     /* of the one that the proposal was made of */
	bool asked;        /* a request waits for its answer */
	struct map_request request;
	pid_t worker;        /* shows a text, or writes the file; 0: none */
	int64_t deadline_ns; /* of it */
	struct map_request
	    shown; /* the worker shows one, for this request; its requester is 0 if it does not */
	enum setup_job
	    reloaded; /* a reload of it is over, which was a good one or not; SETUP_NO_JOB: none is */
	bool reloaded_well;
	bool replaced;           /* another reload than the page's has put a file into force */
	struct setup_told *told; /* in memory that is shared with these processes */
};

/* Text: of the file that runs. False with errno. */
bool setup_begin(struct supervisor *supervisor, uint32_t text);
void setup_take(struct supervisor *supervisor, const struct map_request *request);
/* Does what time asks for. */
void setup_step(struct supervisor *supervisor);
/* A process has ended. True: it was one of these. */
bool setup_reap(struct supervisor *supervisor, pid_t pid, int status);

#endif
