/* SPDX-License-Identifier: GPL-3.0-or-later */
/* The end of each module's start. */
#ifndef OPENRTU_PROCESS_CONFINE_H
#define OPENRTU_PROCESS_CONFINE_H

#include <stddef.h>

#include "map/map.h"

/*
 * From here on the process can make no other, writes no file beyond so many bytes, and makes no system call but those of
 * the filter that rtud has left behind this descriptor (-1: none). One that it makes all the same ends it by SIGSYS, and
 * rtud says which. 0, or -1 with errno: it must not go on. Of a build with a sanitizer, which makes calls and a process
 * of its own, nothing is asked.
 */
int confine(struct map *map, int filter_fd, size_t file_size);

#endif
