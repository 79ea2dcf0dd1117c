/* SPDX-License-Identifier: GPL-3.0-or-later */
#include "config/near.h"

#include <ctype.h>
#include <stddef.h>
#include <string.h>

#define WORD_LENGTH_MAX 32 /* longer than any word of the tables */

static unsigned least(unsigned a, unsigned b, unsigned c)
{
	unsigned ab = a < b ? a : b;

	return ab < c ? ab : c;
}

/* Levenshtein's distance without regard to case. Both have at most WORD_LENGTH_MAX characters. */
static unsigned edit_distance(const char *a, const char *b)
{
	unsigned row[WORD_LENGTH_MAX + 1];
	size_t width = strlen(b);

	for (unsigned j = 0; j <= width; j++)
		row[j] = j;
	for (unsigned i = 0; a[i] != '\0'; i++) {
		unsigned diagonal = row[0];

		row[0] = i + 1;
		for (size_t j = 0; j < width; j++) {
			bool same = tolower((unsigned char)a[i]) == tolower((unsigned char)b[j]);
			unsigned above = row[j + 1];

			row[j + 1] = least(above + 1, row[j] + 1, diagonal + (same ? 0 : 1));
			diagonal = above;
		}
	}
	return row[width];
}

void near_consider(struct near *best, const char *written, const char *word)
{
	unsigned distance;

	if (strlen(written) > WORD_LENGTH_MAX)
		return;
	distance = edit_distance(written, word);
	if (best->word == NULL || distance < best->distance)
		*best = (struct near){.word = word, .distance = distance};
}

/* Two slips in a short word, more in a long one; beyond, a suggestion would be a guess. */
bool near_enough(const struct near *best)
{
	return best->word != NULL && best->distance <= 1 + strlen(best->word) / 4;
}
