/* SPDX-License-Identifier: GPL-3.0-or-later */
/* Which of the words that there are somebody may have meant. */
#ifndef OPENRTU_CONFIG_NEAR_H
#define OPENRTU_CONFIG_NEAR_H

#include <stdbool.h>

/* Begins with zeros. */
struct near {
	const char *word; /* the nearest so far, NULL: none */
	unsigned distance;
};

void near_consider(struct near *best, const char *written, const char *word);

/* Whether the nearest is worth a suggestion. */
bool near_enough(const struct near *best);

#endif
