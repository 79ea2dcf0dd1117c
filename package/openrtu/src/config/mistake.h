/* SPDX-License-Identifier: GPL-3.0-or-later */
/* What people write that is not JSON, in words of theirs. */
#ifndef OPENRTU_CONFIG_MISTAKE_H
#define OPENRTU_CONFIG_MISTAKE_H

#include <jansson.h>

#include "config/keys.h"

/* A place in a text, from 1. */
struct config_spot {
	unsigned line, column;
};

/* What is there and how to write it, and where: the parser's error is behind it. NULL: the parser's own words are better. */
const char *config_mistake(const struct config_source *source, const json_error_t *error,
			   struct config_spot *spot);

#endif
