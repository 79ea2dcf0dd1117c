/* SPDX-License-Identifier: GPL-3.0-or-later */
/* When each of many stations is due: a binary heap with the earliest one on top. */
#ifndef OPENRTU_CENTRE_DEADLINES_H
#define OPENRTU_CENTRE_DEADLINES_H

#include <stdbool.h>
#include <stdint.h>

struct centre_deadlines {
	uint32_t count;
	int64_t *due_ns; /* by station */
	uint32_t *order; /* the heap, of stations */
	uint32_t *place; /* of each station in the heap */
};

/* All of count stations are never due (INT64_MAX). False: no memory. */
bool centre_deadlines_init(struct centre_deadlines *deadlines, uint32_t count);
void centre_deadlines_free(struct centre_deadlines *deadlines);
void centre_deadlines_set(struct centre_deadlines *deadlines, uint32_t station, int64_t due_ns);
/* The station that is due first. There is at least one. */
uint32_t centre_deadlines_first(const struct centre_deadlines *deadlines);

#endif
