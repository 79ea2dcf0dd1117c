/* SPDX-License-Identifier: GPL-3.0-or-later */
/* The journal: one module, if the configuration has "journal". */

#include <string.h>

#include "journal/begin.h"
#include "journal/config.h"
#include "journal/config_part.h"
#include "journal/stats.h"
#include "modules/kind.h"
#include "process/calls.h"

#define USER 2

static const struct call_rule calls[] = {
    CALL(poll),
    CALL(ppoll_time64),
    CALL(ppoll),
    CALL(openat),
    CALL(pwrite64),
    CALL(fdatasync),
    CALL(fsync),
    CALL(ftruncate),
    CALL(ftruncate64),
    CALL(renameat),
    CALL(renameat2),
    CALL(unlinkat),
    STATUS_CALLS,
    CALL(open),
    CALL_WITH(fcntl, EQUAL(1, F_SETFD)),
    CALL_WITH(fcntl64, EQUAL(1, F_SETFD)),
};

static const struct kind_program program = {
    .name = "rtu-journal",
    .calls = calls,
    .call_count = sizeof(calls) / sizeof(calls[0]),
};

static bool plan(struct map_config *config)
{
	const struct map_module_plan module = {
	    .name = "rtu-journal",
	    .kind = JOURNAL_KIND,
	    .rings = {.requests = 1, .answers = 1, .events = 1, .log = 128},
	    .heartbeat_limit_ms = MAP_IDLE_HEARTBEAT_LIMIT_MS,
	    .section_size = sizeof(struct journal_stats),
	    .counters = JOURNAL_COUNTERS,
	    .user = USER,
	};

	return journal_settings(config) == NULL || map_plan_module(config, &module) != MAP_NONE;
}

static bool same(const struct map_config *a, const struct map_config *b, uint32_t module, const char *name)
{
	(void)module, (void)name;
	return memcmp(journal_settings(a), journal_settings(b), sizeof(struct journal_settings)) == 0;
}

/* In another folder there is no file yet, and a power cut may come soon. */
static void carry(const struct map_config *before, const void *from, const struct map_config *now, void *to,
		  const char *module)
{
	struct journal_stats *stats = to;

	(void)from, (void)module;
	if (strcmp(journal_settings(before)->path, journal_settings(now)->path) != 0)
		atomic_store(&stats->moved, 1);
}

const struct kind journal_kind = {
    .name = JOURNAL_KIND,
    .part = &journal_part,
    .plan = plan,
    .programs = &program,
    .program_count = 1,
    .begin = journal_give_folder,
    .restore = journal_restore_from_file,
    .same = same,
    .change = kind_starts_again, /* what bounds its file is set when it begins */
    .carry = carry,
};
