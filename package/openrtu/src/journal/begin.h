/* SPDX-License-Identifier: GPL-3.0-or-later */
/* The journal at rtud's start: its folder, and what it held before the power was cut. */
#ifndef OPENRTU_JOURNAL_BEGIN_H
#define OPENRTU_JOURNAL_BEGIN_H

#include <sys/types.h>

#include "map/map.h"

/*
 * Puts what the journal of the map's configuration holds back into the map, and says in the log what that is or why it is
 * not. Makes the journal's folder and gives it to owner and group (0: leaves it), whose process will write it. After
 * map_create, before any module is started. Does nothing without a journal.
 */
void journal_begin_again(struct map *map, uid_t owner, gid_t group);

#endif
