/* SPDX-License-Identifier: GPL-3.0-or-later */
/*
 * The objects of the agent in the order of their names. An object's instances are found by halves among the rows of its table,
 * and the one behind another is the next row, so that a GETBULK goes through a table once.
 */
#ifndef OPENRTU_SNMP_TREE_H
#define OPENRTU_SNMP_TREE_H

#include <stdbool.h>
#include <stddef.h>
#include <stdint.h>

#include "snmp/config.h"

#define SNMP_INDEX_MAX  3
#define SNMP_IDS_MAX    (SNMP_BASE_MAX + 8) /* of an instance */
#define SNMP_OCTETS_MAX 1200

struct snmp_agent;
struct snmp_change;

/* The tags of RFC 3416 for what we have. */
enum snmp_syntax {
	SNMP_INTEGER = 0x02,
	SNMP_OCTETS = 0x04,
	SNMP_OID = 0x06, /* the octets are an array of uint32_t */
	SNMP_COUNTER = 0x41,
	SNMP_GAUGE = 0x42,
	SNMP_TICKS = 0x43,
	SNMP_COUNTER_64 = 0x46,
};

struct snmp_value {
	uint8_t syntax; /* enum snmp_syntax */
	uint16_t size;  /* of octets */
	int64_t number;
	union {
		uint8_t octets[SNMP_OCTETS_MAX];
		uint32_t ids[SNMP_IDS_MAX];
	};
};

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

/*
 * A table, or a scalar: a table of one row without an index, and without columns. Scalars that a request sets together are a
 * table, too: their group is its entry, and its only row has the index 0.
 */
struct snmp_table {
	uint8_t prefix[3]; /* below its root */
	uint8_t prefix_length;
	uint8_t entry;                                     /* below the prefix; 0: 1, as tables have it */
	uint8_t first, last;                               /* columns that can be read; 0: a scalar */
	uint8_t indexes;                                   /* numbers of its index */
	uint8_t reader;                                    /* enum snmp_role that it needs to be read */
	uint8_t writer;                                    /* ... and to be written, where it can */
	uint32_t writable;                                 /* 1 << column */
	uint32_t (*count)(const struct snmp_agent *agent); /* left out: 1 */
	void (*index)(const struct snmp_agent *agent, uint32_t row, uint32_t out[SNMP_INDEX_MAX]);
	/* False: there is no such instance. */
	bool (*read)(struct snmp_agent *agent, uint32_t column, uint32_t row, struct snmp_value *out);
	/* Of one that can be written: whether a row takes what a request sets in it, and that it takes it. write.h */
	enum snmp_error (*check)(struct snmp_agent *agent, struct snmp_change *change);
	void (*apply)(struct snmp_agent *agent, const struct snmp_change *change);
};

/* Tables below one name, in order. */
struct snmp_root {
	uint32_t ids[SNMP_BASE_MAX];
	uint32_t length;
	const struct snmp_table *const *tables;
	uint32_t count;
};

#define SNMP_ROOTS 7

/* An instance. */
struct snmp_place {
	uint8_t root;
	uint8_t table; /* of its root */
	uint8_t column;
	uint32_t row;
};

const struct snmp_table *snmp_table_at(const struct snmp_agent *agent, const struct snmp_place *place);
/* False: the agent has no instance of this name. */
bool snmp_find(const struct snmp_agent *agent, const uint32_t *name, size_t length, struct snmp_place *out);
/* Whether a name is of an object that this role may read, whether that has this instance or not. */
bool snmp_knows(const struct snmp_agent *agent, const uint32_t *name, size_t length, enum snmp_role role);
/* The first instance behind a name that this role may read. False: there is none. */
bool snmp_next(const struct snmp_agent *agent, const uint32_t *name, size_t length, enum snmp_role role,
	       struct snmp_place *out);
/* The first one behind an instance. */
bool snmp_after(const struct snmp_agent *agent, enum snmp_role role, struct snmp_place *place);
/* Returns how many numbers its name has. */
size_t snmp_name(const struct snmp_agent *agent, const struct snmp_place *place, uint32_t out[SNMP_IDS_MAX]);

#endif
