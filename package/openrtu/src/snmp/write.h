/* SPDX-License-Identifier: GPL-3.0-or-later */
/* A SET: all that is in one request is checked, and only then carried out. */
#ifndef OPENRTU_SNMP_WRITE_H
#define OPENRTU_SNMP_WRITE_H

#include "snmp/tree.h"

/* The errors of RFC 3416, 3. */
enum snmp_error {
	SNMP_GOOD = 0,
	SNMP_TOO_BIG = 1,
	SNMP_GENERAL_ERROR = 5,
	SNMP_NO_ACCESS = 6,
	SNMP_WRONG_TYPE = 7,
	SNMP_WRONG_LENGTH = 8,
	SNMP_WRONG_VALUE = 10,
	SNMP_NO_CREATION = 11,
	SNMP_INCONSISTENT_VALUE = 12,
	SNMP_RESOURCE_UNAVAILABLE = 13,
	SNMP_AUTHORIZATION_ERROR = 16,
	SNMP_NOT_WRITABLE = 17,
};

#define SNMP_ROWS_SET_MAX    16 /* in one request */
#define SNMP_COLUMNS_SET_MAX 6  /* columns 1 to 5 */

/* A varbind of a SET. Octets are a number of 64 bits if there are eight of them. */
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

/* *index: of the varbind that is wrong, from 1. */
enum snmp_error snmp_set(struct snmp_agent *agent, uint8_t user, const struct snmp_assignment *assignments,
			 size_t count, size_t *index);

#endif
