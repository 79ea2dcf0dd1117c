/* SPDX-License-Identifier: GPL-3.0-or-later */
/* The journal at rtud's start: its folder, and what it held before the power was cut. */
#ifndef OPENRTU_JOURNAL_BEGIN_H
#define OPENRTU_JOURNAL_BEGIN_H

#include <sys/types.h>

#include "map/map.h"

/*
 * Makes the folder of the configuration's journal and gives it to owner and group (0: leaves it), whose process will write
 * it; what is wrong, the log of the map says. Does nothing without a journal.
 */
void journal_give_folder(struct map *map, const struct map_config *config, uid_t owner, gid_t group);
/*
 * Puts what the journal of the map's configuration holds back into the map, and says in the log what that is or why it is
 * not. After that and map_create, before any module is started. Does nothing without a journal.
 */
void journal_restore_from_file(struct map *map);

#endif
