/* SPDX-License-Identifier: GPL-3.0-or-later */
/* A terminal that is drawn anew again and again, with keys. One at a time. */
#ifndef OPENRTU_RTUCTL_TERMINAL_H
#define OPENRTU_RTUCTL_TERMINAL_H

#include <stdbool.h>
#include <stddef.h>

enum terminal_key {
	TERMINAL_NONE, /* no key within the time; or the size has changed */
	TERMINAL_QUIT, /* q, Ctrl-C, SIGTERM, SIGHUP, the terminal's end */
	TERMINAL_UP,
	TERMINAL_DOWN,
	TERMINAL_PAGE_UP,
	TERMINAL_PAGE_DOWN,
	TERMINAL_HOME,
	TERMINAL_FILTER, /* i */
};

struct terminal_size {
	size_t rows, columns;
};

/* Takes it over: its other screen, no echo. False when input and output are no terminal that can be drawn on. */
bool terminal_open(void);
/* Gives it back as it was. */
void terminal_close(void);
struct terminal_size terminal_size(void);

/* Waits at most so long for a key. */
enum terminal_key terminal_key(int wait_ms);

/* Draws text over what is there, clipped to the size; colours (CSI sequences) take no place. */
void terminal_draw(const char *text);

/* Characters of a text on the terminal: UTF-8, CSI sequences apart. */
size_t terminal_width(const char *text);

#endif
