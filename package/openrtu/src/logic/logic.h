/* SPDX-License-Identifier: GPL-3.0-or-later */
/*
 * A program of Structured Text, compiled by openrtu logic, in a virtual machine: docs/logic.md.
 * Bytes, time, inputs and outputs are arguments. After logic_load() nothing is allocated, and nothing that the program
 * does raises a signal or reaches beyond its own memory.
 */
#ifndef OPENRTU_LOGIC_H
#define OPENRTU_LOGIC_H

#include <stdbool.h>
#include <stddef.h>
#include <stdint.h>

#include "logic/format.h"
#include "map/map.h"

/* The flags of a quality are the map's. */
enum {
	LOGIC_OVERFLOW = MAP_OVERFLOW,
	LOGIC_BLOCKED = MAP_BLOCKED,
	LOGIC_SUBSTITUTED = MAP_SUBSTITUTED,
	LOGIC_NOT_TOPICAL = MAP_NOT_TOPICAL,
	LOGIC_INVALID = MAP_INVALID,
	LOGIC_NOT_GOOD = LOGIC_INVALID | LOGIC_NOT_TOPICAL | LOGIC_OVERFLOW
};

enum logic_fault { LOGIC_DIVISION, LOGIC_RANGE, LOGIC_BOUNDS, LOGIC_DOMAIN, LOGIC_BUDGET, LOGIC_FAULTS };

union logic_cell {
	int64_t i; /* all types but REAL and LREAL */
	float r;
	double d;
	uint64_t bits;
};

/* Different messages of one scan. */
#define LOGIC_MESSAGES 8

struct logic_range {
	int64_t low, high;
};

/* Of each type but REAL and LREAL. */
extern const struct logic_range logic_ranges[LOGIC_TYPES];

struct logic_value {
	union logic_cell value;
	int64_t time_us; /* of a point's acquisition, since 1970 */
	uint8_t quality;
};

struct logic_times {
	int64_t uptime_us;  /* monotonic, since the program's start, across its processes and reloads */
	int64_t elapsed_us; /* since the scan before */
	int64_t now_us;     /* UTC, since 1970 */
};

/* What a program holds and where it stands; only load.c and run.c write it. */
struct logic {
	const struct logic_head *head;
	const uint8_t *types;
	const struct logic_array *arrays;
	const struct logic_routine *routines;
	const struct logic_point *points;
	const struct logic_command *commands;
	const struct logic_request *requests;
	const struct logic_retained *retained;
	const struct logic_string *strings;
	const struct logic_instruction *code;
	const uint16_t *lines;
	const char *names;
	union logic_cell *cells; /* of each slot */
	uint8_t *quality;        /* of each slot */
	uint8_t *covered;        /* of each instruction, or NULL: LOGIC_RUN, LOGIC_WENT_ON, LOGIC_JUMPED */
	uint32_t faults[LOGIC_FAULTS];
	uint16_t last_line; /* of the last fault */
	uint8_t last_fault;
	uint8_t messages;                    /* of the last scan */
	uint16_t message_at[LOGIC_MESSAGES]; /* their instructions */
	uint32_t unsaid;                     /* that found no room */
};

enum { LOGIC_RUN = 1, LOGIC_WENT_ON = 2, LOGIC_JUMPED = 4 };

/* Calls within calls that a program may have: routines refer only to routines before them. */
#define LOGIC_DEPTH    32
#define LOGIC_ROUTINES 4096
/* Instructions of a scan, if nothing else is configured: some 100 ms on the board. */
#define LOGIC_BUDGET_DEFAULT 200000

/* The memory that logic_load() needs for the file, or 0 if the file's head is none. */
size_t logic_memory(const void *file, size_t size);

/* Where the qualities are in it; the cells are at its beginning. */
static inline size_t logic_quality_place(const struct logic_head *head)
{
	return head->slots * sizeof(union logic_cell) + ((head->size + 3) & ~(size_t)3);
}

/*
 * Verifies the file and makes a machine of it in the memory, which is of logic_memory() octets and aligned as malloc()
 * does. The file is not needed afterwards. Returns NULL, or why the file is refused.
 */
const char *logic_load(struct logic *logic, void *memory, const void *file, size_t size);

const char *logic_name(const struct logic *logic, uint16_t name);

/* Before a scan. What is no value of the point's type becomes 0 and invalid. */
void logic_set(struct logic *logic, const struct logic_point *point, const struct logic_value *value);
/* After a scan. */
void logic_get(const struct logic *logic, const struct logic_point *point, struct logic_value *value);

/* Before a scan: what the host says to a block, an integer or a LREAL; valid. */
void logic_tell(struct logic *logic, uint16_t slot, int64_t value);
void logic_tell_number(struct logic *logic, uint16_t slot, double value);

/* One scan. False: more than budget instructions; the scan has ended there, and all that the program computes is invalid. */
bool logic_scan(struct logic *logic, const struct logic_times *times, uint32_t budget);

/* What a COMMAND wants after a scan. */
enum logic_wish {
	LOGIC_NOTHING,
	LOGIC_EXECUTE,
	LOGIC_DOUBTFUL, /* EXECUTE, but that, the value or the selection is not valid: nothing is to be sent */
};

enum logic_wish logic_wish(const struct logic *logic, const struct logic_command *command);

/* What the program has decided about an active command to a point of its own. */
enum logic_decision { LOGIC_PENDING, LOGIC_CONFIRMED, LOGIC_EXECUTED, LOGIC_REFUSED };

struct logic_verdict {
	enum logic_decision decision;
	uint8_t result; /* enum map_command_result, once it has ended */
};

/* After a scan in which the request was active. What the program doubts it refuses, unless it has passed the command on. */
struct logic_verdict logic_judge(const struct logic *logic, const struct logic_request *request);

/* The slots of a STRING. */
static inline uint32_t logic_string_slots(uint32_t octets)
{
	return 1 + (octets + 7) / 8;
}

/* Of an operation with a STRING: what it costs of the budget; false: it wants a negative number of octets. */
uint32_t logic_text_cost(const struct logic *logic, const struct logic_instruction *at);
bool logic_text(struct logic *logic, const struct logic_instruction *at);
/* A text of the file with the value of one slot in it. */
void logic_format(const struct logic *logic, uint16_t text, uint16_t slot, char *out, size_t size);

/* In words, as "division by zero". */
const char *logic_fault_name(enum logic_fault fault);

/*
 * After a scan: the text of one of its messages, with the values as they were when it was said last. What does not find
 * room is cut; size is at least 1.
 */
void logic_message(const struct logic *logic, unsigned message, char *out, size_t size);

/* A variable of that type may have the value. */
bool logic_holds(enum logic_type type, union logic_cell value);
/* Two programs retain the same variable: by name, type and size. */
bool logic_retains_alike(const struct logic *a, const struct logic_retained *in_a, const struct logic *b,
			 const struct logic_retained *in_b);
/*
 * Copies the retained variables that both have, by name, type and size, with their qualities, and what the library's blocks remember;
 * returns how many of the former.
 */
unsigned logic_carry(struct logic *to, const struct logic *from);

#endif
