/* SPDX-License-Identifier: GPL-3.0-or-later */
/*
 * One simulated Modbus slave: its four tables, and what it answers to a request. It knows nothing of
 * lines and time. Clause numbers are those of the MODBUS Application Protocol Specification V1.1b3.
 */
#ifndef LINESIM_SLAVE_H
#define LINESIM_SLAVE_H

#include <stdbool.h>
#include <stddef.h>
#include <stdint.h>

#define SLAVE_UNIT_MAX        247
#define SLAVE_BROADCAST       0
#define SLAVE_PDU_MAX         253 /* clause 4.1 */
#define SLAVE_TABLE_CELLS     65536
#define SLAVE_IDENTIFIED      7 /* clause 6.21: basic and regular objects */
#define SLAVE_IDENTIFIED_SIZE 41

enum slave_table {
	SLAVE_COILS,
	SLAVE_DISCRETE_INPUTS,
	SLAVE_INPUT_REGISTERS,
	SLAVE_HOLDING_REGISTERS,
	SLAVE_TABLES, /* how many there are; as a value: no such table */
};

/* What is wrong with a slave. The unit of the argument stands behind it. */
enum slave_fault_kind {
	SLAVE_HEALTHY,
	SLAVE_MUTE,       /* as if switched off: executes nothing, answers nothing */
	SLAVE_DELAY,      /* ms more before the answer, which is given up when the master speaks meanwhile */
	SLAVE_LATE,       /* ms more before the answer, which is sent whatever happens on the line */
	SLAVE_DEAF,       /* hears nothing for ms behind its answer */
	SLAVE_CORRUPT,    /* the answer's CRC is wrong */
	SLAVE_EXCEPTION,  /* exception code instead of executing */
	SLAVE_ECHO,       /* the request comes back before the answer */
	SLAVE_NOISE,      /* random bytes before the answer */
	SLAVE_WRONG_UNIT, /* the answer carries the next unit's number */
	SLAVE_LIMIT,      /* a read of more bits or registers than this is exception 3 */
	SLAVE_TRUNCATE,   /* only the first half of the answer */
	SLAVE_WRONG_FUNCTION, /* the answer carries the next function code */
	SLAVE_WRONG_LENGTH,   /* the answer is an octet longer, and sound */
	SLAVE_WRONG_ECHO,     /* the answer to a write repeats another value */
	SLAVE_OVERRIDE,       /* somebody else writes this value behind each write, before anything is read */
};

struct slave_fault {
	enum slave_fault_kind kind;
	uint32_t argument;
	uint8_t function;   /* SLAVE_EXCEPTION: for this function only, 0: for all */
	uint32_t remaining; /* requests it still applies to, 0: until cleared */
};

struct slave_stats {
	uint32_t requests;
	uint32_t answers; /* exceptions among them */
	uint32_t exceptions;
	uint32_t writes; /* requests that wrote something */
};

struct slave_cells {
	uint16_t value[SLAVE_TABLE_CELLS];
	bool exists[SLAVE_TABLE_CELLS];
};

struct slave {
	uint8_t unit; /* 0: stands for devices that only listen to broadcasts */
	struct slave_fault fault;
	int64_t deaf_until_ns; /* SLAVE_DEAF */
	struct slave_stats stats;
	struct slave_cells table[SLAVE_TABLES];
	char identification
	    [SLAVE_IDENTIFIED]
	    [SLAVE_IDENTIFIED_SIZE]; /* objects of function 43/14; the first empty: it does not know it */
};

/* The cells that a request touched, for the log. count 0: none. */
struct slave_access {
	enum slave_table table;
	uint16_t first;
	uint16_t count;
	bool write;
};

/*
 * Executes a request PDU (function code first, size >= 1) and puts the answer's PDU, an exception
 * included, into answer. Returns the answer's size.
 */
size_t slave_execute(struct slave *slave, const uint8_t *request, size_t size, uint8_t answer[SLAVE_PDU_MAX],
		     struct slave_access *access);

/* The request PDU is a read of more than the fault lets through. */
bool slave_is_too_long(const struct slave_fault *fault, const uint8_t *request, size_t size);

/* The fault that applies to a request with this function code; counts it down. */
struct slave_fault slave_take_fault(struct slave *slave, uint8_t function);

/* False: it is switched off, or deaf. */
bool slave_hears(const struct slave *slave, const struct slave_fault *fault, int64_t at_ns);
/* Its answer has ended. */
void slave_answered(struct slave *slave, const struct slave_fault *fault, int64_t end_ns);

/* Writes a cell from outside the line. False: there is no such cell, or it cannot hold the value. */
bool slave_set(struct slave *slave, enum slave_table table, long address, long value);
bool slave_exists(const struct slave *slave, enum slave_table table, long address);
bool slave_table_has_bits(enum slave_table table);

/* "coils", "discrete_inputs", "input_registers", "holding_registers"; SLAVE_TABLES when it is none. */
enum slave_table slave_table_named(const char *name);
const char *slave_table_name(enum slave_table table);
/* As in the report's figure 5.4: C, DI, IR, HR. */
const char *slave_table_mark(enum slave_table table);
/* "mute", "wrong-unit", …; "" for SLAVE_HEALTHY. */
const char *slave_fault_name(enum slave_fault_kind kind);

#endif
