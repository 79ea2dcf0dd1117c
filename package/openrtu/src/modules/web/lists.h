/* SPDX-License-Identifier: GPL-3.0-or-later */
/* Lists of what is in the map, made row by row while they are sent: the same rows as those of rtuctl --json. */
#ifndef OPENRTU_MODULES_WEB_LISTS_H
#define OPENRTU_MODULES_WEB_LISTS_H

#include "modules/web/answer.h"

/* from, count, search (a part of the name), bad=1 (those alone that are not good); total: how many there are of these */
http_route list_points;
http_route list_commands, list_lines, list_modules, list_counters;
http_route list_events, list_log; /* count: of the newest */
http_route list_frames;           /* port: of which line; count: of the newest */

/* Something is wrong with a point: it is not good, though it can be. */
bool list_is_bad(const struct map *map, uint32_t point);

#endif
