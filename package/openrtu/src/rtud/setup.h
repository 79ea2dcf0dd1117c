/* SPDX-License-Identifier: GPL-3.0-or-later */
/*
 * The configuration that the gateway's page changes (web/setup.h). The page's process hands over a text; whatever touches a file is
 * done here, by processes beside rtud. Until it is confirmed, the file on the disk is the former one.
 */
#ifndef OPENRTU_RTUD_SETUP_H
#define OPENRTU_RTUD_SETUP_H

#include <stdio.h>
#include <sys/types.h>

#include "map/map.h"
#include "rtud/proposal.h"

struct supervisor;

/* What a process beside rtud tells it. */
struct setup_told {
	uint32_t text; /* hash of what it has read */
};

struct setup {
	struct proposal proposal;
	uint32_t in_force; /* hash of the text of what runs */
	uint32_t base;     /* of the one that the proposal was made of */
	bool asked;        /* a request waits for its answer */
	struct map_request request;
	pid_t worker;        /* shows a text, or writes the file; 0: none */
	int64_t deadline_ns; /* of it */
	struct map_request
	    shown; /* the worker shows one, for this request; its requester is 0 if it does not */
	struct setup_told *told; /* in memory that is shared with these processes */
};

/* Text: of the file that runs. False with errno. */
bool setup_begin(struct supervisor *supervisor, uint32_t text);
void setup_take(struct supervisor *supervisor, const struct map_request *request);
/* Does what time asks for. */
void setup_step(struct supervisor *supervisor);
/* A process has ended. True: it was one of these. */
bool setup_reap(struct supervisor *supervisor, pid_t pid, int status);

/* ---- for reload.c ------------------------------------------------------------------------- */

enum setup_job { SETUP_NO_JOB, SETUP_JOB_CHECK, SETUP_JOB_APPLY, SETUP_JOB_BACK };
/* What such a process looks at before it reads the file. */
enum setup_verdict {
	SETUP_READ,    /* it may come into force */
	SETUP_ONLY,    /* read it to say what is wrong with it; it may not */
	SETUP_REFUSED, /* said why */
};

/* In the process beside rtud. instead: what it is to read, PATH_MAX octets. */
enum setup_verdict setup_prepare(const struct supervisor *supervisor, enum setup_job job, char *instead,
				 FILE *report);
/* The reload of such a job is over. */
void setup_reloaded(struct supervisor *supervisor, bool good);
/* Nobody else may change the configuration. */
bool setup_holds(const struct supervisor *supervisor);

#endif
