/* SPDX-License-Identifier: GPL-3.0-or-later */
#include "centre/window.h"

void centre_window_init(struct centre_window *window, uint32_t limit, uint32_t *next)
{
	window->limit = limit;
	window->next = next;
	centre_window_clear(window);
}

void centre_window_clear(struct centre_window *window)
{
	window->used = 0;
	window->first = window->last = CENTRE_NOBODY;
}

bool centre_window_enter(struct centre_window *window, uint32_t station)
{
	if (window->used < window->limit && window->first == CENTRE_NOBODY) {
		window->used++;
		return true;
	}
	window->next[station] = CENTRE_NOBODY;
	if (window->first == CENTRE_NOBODY)
		window->first = station;
	else
		window->next[window->last] = station;
	window->last = station;
	return false;
}

void centre_window_leave(struct centre_window *window)
{
	window->used--;
}

uint32_t centre_window_admit(struct centre_window *window)
{
	uint32_t station = window->first;

	if (station == CENTRE_NOBODY || window->used == window->limit)
		return CENTRE_NOBODY;
	window->first = window->next[station];
	window->used++;
	return station;
}
