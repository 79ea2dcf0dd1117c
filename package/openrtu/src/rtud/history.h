/* SPDX-License-Identifier: GPL-3.0-or-later */
/*
 * The configuration file on the disk, exchanged whole, and those that were there before: FILE.history/NUMBER_TIME_USER.json, the
 * user being who replaced it. A power cut at any moment leaves the old file or the new one.
 */
#ifndef OPENRTU_RTUD_HISTORY_H
#define OPENRTU_RTUD_HISTORY_H

#include <jansson.h>
#include <stdbool.h>
#include <stdint.h>
#include <stdio.h>

/* Texts are no longer than this: the page's limit, and what is beyond it. */
#define HISTORY_TEXT_MAX (4u << 20)

struct history_text {
	char *octets; /* to be freed */
	size_t length;
	uint32_t hash;
};

/* False with errno: it cannot be read, is no file or too long. */
bool history_read(const char *path, struct history_text *out);
/* Number of the history of the file at path. False with errno. */
bool history_recall(const char *path, uint32_t number, struct history_text *out);
/* Puts text into the place of the file, whose text is former, which is kept. False: messages say why, and the former one is there. */
bool history_replace(const char *path, const struct history_text *former, const struct history_text *text,
		     const char *user, FILE *messages);
/* An array of objects with number, time and user, the newest first. NULL: there is no memory. */
json_t *history_list(const char *path);

#endif
