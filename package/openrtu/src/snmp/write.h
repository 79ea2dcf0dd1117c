/* SPDX-License-Identifier: GPL-3.0-or-later */
/* A SET: all that is in one request is checked, and only then carried out. */
#ifndef OPENRTU_SNMP_WRITE_H
#define OPENRTU_SNMP_WRITE_H

#include "snmp/tree.h"

#define SNMP_SPIN            1 /* column of the TestAndIncr of what can be set */
#define SNMP_SPIN_MAX        0x7fffffffu
#define SNMP_ROWS_SET_MAX    16 /* in one request */
#define SNMP_COLUMNS_SET_MAX 7  /* columns 1 to 6 */

/* A varbind of a SET. Octets are a number if there are four of them, or eight. */
struct snmp_assignment {
	const uint32_t *name;
	size_t length;
	uint8_t syntax;
	uint16_t size;
	int64_t number;
};

/* What a request sets in one row. */
struct snmp_change {
	struct snmp_place place;
	uint8_t user;
	uint32_t given; /* 1 << column */
	uint8_t fault;  /* the column that check() blames */
	uint8_t syntax[SNMP_COLUMNS_SET_MAX];
	uint16_t size[SNMP_COLUMNS_SET_MAX];
	int64_t number[SNMP_COLUMNS_SET_MAX];
	uint16_t place_in_request[SNMP_COLUMNS_SET_MAX];
};

static inline bool snmp_sets(const struct snmp_change *change, unsigned column)
{
	return (change->given & 1u << column) != 0;
}

/* The answer of a check that this column fails. */
enum snmp_error snmp_blame(struct snmp_change *change, unsigned column, enum snmp_error error);
/* Whether a column that is set has this syntax, and octets this size. */
enum snmp_error snmp_check_column(struct snmp_change *change, unsigned column, enum snmp_syntax syntax,
				  uint16_t size);
/* A request that is repeated because its answer was lost acts once: column 1 is the row's TestAndIncr, and must be set. */
enum snmp_error snmp_check_spin(struct snmp_change *change, uint32_t spin);
/* Another number than the process before had: a SET that was held up does not fit any more. */
uint32_t snmp_first_spin(const struct snmp_agent *agent, uint32_t row);
/* The next value of one. */
static inline uint32_t snmp_next_spin(uint32_t spin)
{
	return (spin + 1) & SNMP_SPIN_MAX;
}

/* *index: of the varbind that is wrong, from 1. */
enum snmp_error snmp_set(struct snmp_agent *agent, uint8_t user, const struct snmp_assignment *assignments,
			 size_t count, size_t *index);

#endif
