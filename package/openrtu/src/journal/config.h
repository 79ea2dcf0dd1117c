/* SPDX-License-Identifier: GPL-3.0-or-later */
/* What only the journal knows of the configuration: its section of it. */
#ifndef OPENRTU_JOURNAL_CONFIG_H
#define OPENRTU_JOURNAL_CONFIG_H

#include "map/config.h"

#define JOURNAL_SETTINGS MAP_SECTION_ID('J', 'R', 'N', 'L')

/* What rtu-journal writes, so that events outlive a power cut. */
struct journal_settings {
	char path[MAP_FILE_SIZE]; /* its folder */
	uint32_t size_kb;         /* of its file, at most; a record has a quarter of it at most */
	uint32_t interval_s;      /* between two records, at least */
	uint32_t volume_mb;       /* MiB of the flash that the file system spreads its writing over */
	uint32_t cycles;          /* how often a block of it may be erased */
};

/* NULL: there is no journal. */
static inline const struct journal_settings *journal_settings(const struct map_config *config)
{
	return map_records(config, JOURNAL_SETTINGS, sizeof(struct journal_settings));
}

#endif
