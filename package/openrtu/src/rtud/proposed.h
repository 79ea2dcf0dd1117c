/* SPDX-License-Identifier: GPL-3.0-or-later */
/* A text that the page proposes, judged in a process beside rtud, and the files of the map's folder that go with it. */
#ifndef OPENRTU_RTUD_PROPOSED_H
#define OPENRTU_RTUD_PROPOSED_H

#include <stdio.h>
#include <sys/types.h>

#include "rtud/setup.h"
#include "rtud/supervise.h"

#define PROPOSED_FILE "setup.proposed" /* in the map's folder, for rtud alone */

/* What such a process looks at before it reads the file. */
enum setup_verdict {
	SETUP_READ,    /* it may come into force */
	SETUP_ONLY,    /* it is no JSON: read it to say where */
	SETUP_REFUSED, /* said why */
};

/* Where the text is that FILE stands for: one that was kept, or its own. */
const char *proposed_source(const struct supervise_options *options);
/* Where the page's is kept. */
const char *proposed_target(const struct supervise_options *options);

/* What the page's process says in its section. NULL: it has none. */
const struct web_setup *proposed_wish(const struct map *map, const struct map_request *request);
/* instead: takes the path of what is to be read in the file's place, PATH_MAX octets. */
enum setup_verdict proposed_prepare(const struct supervisor *supervisor, enum setup_job job, char *instead,
				    FILE *report);

/* The path of a file of the map's folder: PATH_MAX octets. */
void proposed_path(const struct supervisor *supervisor, const char *name, char *path);
/* Such a file, whole or not at all, for a user, a group, or (-1) rtud alone. */
bool proposed_put(const struct supervisor *supervisor, const char *name, const char *octets, size_t length,
		  uid_t user, gid_t group);
/* False. */
bool proposed_say_errno(FILE *report, const char *what);

#endif
