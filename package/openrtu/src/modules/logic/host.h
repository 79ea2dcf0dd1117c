/* SPDX-License-Identifier: GPL-3.0-or-later */
/* What the files of rtu-logic share: the program, and what the host keeps of its points, commands and requests. */
#ifndef OPENRTU_MODULES_LOGIC_HOST_H
#define OPENRTU_MODULES_LOGIC_HOST_H

#include "logic/logic.h"
#include "logic/stats.h"
#include "map/map.h"
#include "process/commanding.h"
#include "synch/synched.h"

/* A point of the program. */
struct host_point {
	uint32_t point;
	enum map_type type;
	bool own;
	bool awaited;             /* the first scan waits for it */
	bool kept;                /* a former process has said what masters have set */
	struct map_sample sample; /* as it was read, or published, last */
	uint8_t cause;            /* enum map_cause of the next publication */
};

/* A COMMAND of the program. */
struct host_command {
	const struct host_point *point;
	enum logic_type type; /* the program's of the point */
	struct logic_asked *asked;
};

/* A REQUEST of the program. */
struct host_request {
	struct host_point *point;
	enum { REQUEST_NONE, REQUEST_WAITS, REQUEST_ACTIVE } phase;
	bool seen_none; /* a scan has seen that there is none since the last one ended */
	bool confirmed;
	struct map_request request;
	double number;
	int64_t begun_ns;
};

struct host {
	struct map *map;
	const struct logic_instance *instance;
	struct logic_stats *stats;
	struct synched synched;
	struct logic logic;
	struct host_point *points;     /* of each point of the program */
	struct host_command *commands; /* of each COMMAND */
	struct commanding *commanding; /* the same */
	struct host_request *requests; /* of each REQUEST */
	struct map_update *updates;    /* of own points */
	int64_t inputs_until_ns;       /* the first scan waits for inputs until then */
};

/* ---- points.c ---------------------------------------------------------------------------- */

/* What the program reads is what there was when the scan began. */
void points_freeze(struct host *host);
/* All own points at once. */
void points_publish(struct host *host, int64_t now_ns);
/* The value of a point that masters set, which is published next with that cause. */
void points_set(struct host_point *point, union map_value value, uint8_t cause);
/* That point alone: outputs are of the scan that computed them. */
void points_publish_set(struct host *host, struct host_point *point);
struct host_point *points_find(const struct host *host, uint32_t point);
/* NULL: a name that is none of the program's. */
struct host_point *points_named(const struct host *host, uint16_t name);

/* ---- inputs.c ---------------------------------------------------------------------------- */

/* The program has not run since the gateway began: its first scan waits for what it reads. */
void inputs_begin(struct host *host);
/* Each of these has been read once, or has had its time. */
bool inputs_are_known(struct host *host, int64_t now_ns);

/* ---- commands.c -------------------------------------------------------------------------- */

/* Answers that have come, and owners that have gone; then what the program sees of its commands in this scan. */
void commands_before(struct host *host, int64_t now_ns);
/* Before the first scan. */
void commands_restore(struct host *host);
/* What the program wants. */
void commands_after(struct host *host, int64_t now_ns);

/* ---- requests.c -------------------------------------------------------------------------- */

/* Takes what was requested of own points. */
void requests_take(struct host *host, int64_t now_ns);
/* What the program sees of them in this scan. */
void requests_before(struct host *host);
/* What the program has decided. Before points_publish: the return information has its cause. */
void requests_judge(struct host *host);
/* Ends what has been decided: its return information is out. */
void requests_after(struct host *host, int64_t now_ns);

/* ---- messages.c -------------------------------------------------------------------------- */

/* What the program has said in this scan. */
void messages_say(const struct host *host, int64_t now_ns);

/* ---- kept.c ------------------------------------------------------------------------------ */

/* Takes over what the process before has kept, or the journal. */
void kept_restore(struct host *host);
void kept_store(struct host *host);

#endif
