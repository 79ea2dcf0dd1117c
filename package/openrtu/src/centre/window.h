/* SPDX-License-Identifier: GPL-3.0-or-later */
/*
 * How many stations may do something at once, and who waits for it in turn. Who takes too long gives its place back
 * (station.c), so that the slowness of some does not reach the others.
 */
#ifndef OPENRTU_CENTRE_WINDOW_H
#define OPENRTU_CENTRE_WINDOW_H

#include <stdbool.h>
#include <stdint.h>

#define CENTRE_NOBODY UINT32_MAX

struct centre_window {
	uint32_t limit, used;
	uint32_t first, last; /* who waits; CENTRE_NOBODY */
	uint32_t *next;       /* by station; all windows share it: a station waits in one */
};

void centre_window_init(struct centre_window *window, uint32_t limit, uint32_t *next);
/* A place at once, or false: the station waits behind those that do. It waits in no window. */
bool centre_window_enter(struct centre_window *window, uint32_t station);
void centre_window_leave(struct centre_window *window);
/* The next one that waits gets a place; CENTRE_NOBODY: nobody waits, or there is none. */
uint32_t centre_window_admit(struct centre_window *window);
/* Nobody is there and nobody waits. */
void centre_window_clear(struct centre_window *window);

#endif
