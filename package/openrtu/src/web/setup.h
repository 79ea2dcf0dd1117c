/* SPDX-License-Identifier: GPL-3.0-or-later */
/*
 * How the page hands a changed configuration to rtud: its wish lies in the section of rtu-web's segment, behind the counters, and
 * a request MAP_SETUP says that it does. rtud answers when it is done, and says the rest in files of the map's folder.
 */
#ifndef OPENRTU_WEB_SETUP_H
#define OPENRTU_WEB_SETUP_H

#include "web/stats.h"
#include "web/users.h"

#define SETUP_TEXT_MAX (256u * 1024u) /* octets of a configuration that the page changes */
#define SETUP_TRIAL_S  60             /* a configuration that nobody confirms by then goes */
#define SETUP_HISTORY  20             /* former files that are kept */

/* In the map's folder. */
#define SETUP_STATE  "setup.state"  /* JSON, for the group of the map: how far the proposal is */
#define SETUP_REPORT "setup.report" /* for the same: what rtud --check says of it, and what it would change */
#define SETUP_SHOWN  "setup.shown"  /* JSON, for rtu-web's user: a file's text, and the history */

/* The detail of the request. */
enum setup_wish {
	SETUP_SHOW,    /* writes SETUP_SHOWN: of the file in force, or of number of the history */
	SETUP_CHECK,   /* text, made of the file of hash base: says what it would change */
	SETUP_APPLY,   /* puts what was checked last, of hash proposed, into force for a trial */
	SETUP_CONFIRM, /* of the trial: the file stays */
	SETUP_RETURN,  /* of the trial: the former file comes back */
	SETUP_WISHES
};

struct web_setup {
	char user[WEB_USER_SIZE];
	uint32_t number;         /* of the history; 0: the file in force */
	uint32_t base, proposed; /* hashes of texts: map/hash.h */
	uint32_t length;
	char text[SETUP_TEXT_MAX];
};

/* The section of a page that may change the configuration. */
struct web_section {
	struct web_stats stats;
	struct web_setup setup;
};

#endif
