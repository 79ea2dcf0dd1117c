/* SPDX-License-Identifier: GPL-3.0-or-later */
/* The file of a compiled program, little-endian: docs/logic.md, "The file". scripts/openrtu_tools/logic/binary.py writes it. */
#ifndef OPENRTU_LOGIC_FORMAT_H
#define OPENRTU_LOGIC_FORMAT_H

#include <stdint.h>

#define LOGIC_MAGIC   "RTUL"
#define LOGIC_VERSION 3
#define LOGIC_NO_SLOT 0xffff

/*
 * head (48 octets), then the sections in the order of the counts:
 *   types     u8 of each slot, filled up to a multiple of 4
 *   initial   u16 slot, u16 0, u64 value
 *   arrays    u16 first slot, u16 elements, u16 stride, u8 type, u8 0, i32 low bound
 *   routines  u16 first instruction, u16 instructions
 *   points    u16 slot, u16 slot of its time or none, u8 type, u8 written, u16 name
 *   commands  u16 name of the point, u16 slots of execute, value, select, state, result
 *   requests  u16 name of the point, u16 slots of active, value, refuse, state, result
 *   retained  u16 name, u16 first slot, u16 slots, u8 type, u8 1: only in another process, not over a power cut; behind the others
 *   strings   u16 first slot, u16 octets
 *   code      u8 operation, u8 type, u16 a, u16 b, u16 c
 *   lines     u16 of each instruction, filled up to a multiple of 4
 *   names     octets, each name ends with 0
 */
struct logic_head {
	char magic[4];
	uint16_t version;
	uint16_t strings;
	uint32_t size; /* of the file */
	uint32_t crc;  /* CRC-32 of what follows */
	uint16_t constants;
	uint16_t slots;
	uint16_t initial;
	uint16_t arrays;
	uint16_t routines;
	uint16_t points;
	uint16_t commands;
	uint16_t retained;
	uint16_t code;
	uint16_t name;    /* of the program */
	uint16_t uptime;  /* slot, or none */
	uint16_t elapsed; /* slot, or none */
	uint16_t now;     /* slot, or none */
	uint16_t requests;
	uint32_t names; /* octets */
};
_Static_assert(sizeof(struct logic_head) == 48, "logic_head");

struct logic_initial {
	uint16_t slot;
	uint16_t reserved;
	uint32_t low, high; /* of the value: no 64-bit member, so that there is no padding */
};

struct logic_array {
	uint16_t first;
	uint16_t elements;
	uint16_t stride;
	uint8_t type;
	uint8_t reserved;
	int32_t low;
};

struct logic_routine {
	uint16_t first;
	uint16_t instructions;
};

struct logic_point {
	uint16_t slot;
	uint16_t time;
	uint8_t type;
	uint8_t written;
	uint16_t name;
};

struct logic_command {
	uint16_t name;
	uint16_t execute, value, select, state, result;
};

/* A command to a point of the program's own. */
struct logic_request {
	uint16_t name;
	uint16_t active, value, refuse, state, result;
};

struct logic_retained {
	uint16_t name;
	uint16_t first;
	uint16_t slots;
	uint8_t type;
	uint8_t ends_with_power;
};

/* The number of octets, and they, 8 in a slot; all of LINT. */
struct logic_string {
	uint16_t first;
	uint16_t octets; /* at most */
};

struct logic_instruction {
	uint8_t operation;
	uint8_t type;
	uint16_t a, b, c;
};

enum logic_type {
	LOGIC_BOOL,
	LOGIC_SINT,
	LOGIC_INT,
	LOGIC_DINT,
	LOGIC_LINT,
	LOGIC_USINT,
	LOGIC_UINT,
	LOGIC_UDINT,
	LOGIC_BYTE,
	LOGIC_WORD,
	LOGIC_DWORD,
	LOGIC_TIME, /* microseconds */
	LOGIC_DT,   /* microseconds since 1970-01-01 UTC */
	LOGIC_REAL,
	LOGIC_LREAL,
	LOGIC_TYPES
};

/*
 * The operations: name, class of the instruction's type, what a, b and c are. Capitals are written.
 * class: - none; . any; n a number, a time; o all but REAL and LREAL; w BOOL or bits; s bits
 * operand: t T slot of the instruction's type; b B slot of BOOL; i slot that is not REAL or LREAL; Q of BYTE;
 *   f F of REAL; d D of LREAL; * + any slot; x array to read; X array to write; j instruction of the
 *   routine; k routine before this one; m function; n number of slots; v the same, 0 as well;
 *   l place among the names; N slot of INT; r string to read; S string to write; - 0
 */
#define LOGIC_OPERATIONS(OP)                                                                                 \
	OP(MOVE, ".", "Tt-")  /* a := b */                                                                   \
	OP(BLOCK, "-", "+*n") /* c slots from b to a */                                                      \
	OP(LOAD, ".", "Txi")  /* a := array b [c] */                                                         \
	OP(STORE, ".", "tXi") /* array b [c] := a */                                                         \
	OP(ADD, "n", "Ttt")                                                                                  \
	OP(SUB, "n", "Ttt")                                                                                  \
	OP(MUL, "n", "Ttt")                                                                                  \
	OP(DIV, "n", "Ttt")                                                                                  \
	OP(MOD, "n", "Ttt")                                                                                  \
	OP(NEG, "n", "Tt-")                                                                                  \
	OP(ABS, "n", "Tt-")                                                                                  \
	OP(EQ, "o", "Btt")                                                                                   \
	OP(NE, "o", "Btt")                                                                                   \
	OP(LT, "o", "Btt")                                                                                   \
	OP(LE, "o", "Btt")                                                                                   \
	OP(AND, "w", "Ttt")                                                                                  \
	OP(OR, "w", "Ttt")                                                                                   \
	OP(XOR, "w", "Ttt")                                                                                  \
	OP(NOT, "w", "Tt-")                                                                                  \
	OP(SHL, "s", "Tti")                                                                                  \
	OP(SHR, "s", "Tti")                                                                                  \
	OP(ROL, "s", "Tti")                                                                                  \
	OP(ROR, "s", "Tti")                                                                                  \
	OP(RADD, "-", "Fff")                                                                                 \
	OP(RSUB, "-", "Fff")                                                                                 \
	OP(RMUL, "-", "Fff")                                                                                 \
	OP(RDIV, "-", "Fff")                                                                                 \
	OP(RNEG, "-", "Ff-")                                                                                 \
	OP(RABS, "-", "Ff-")                                                                                 \
	OP(REQ, "-", "Bff")                                                                                  \
	OP(RNE, "-", "Bff")                                                                                  \
	OP(RLT, "-", "Bff")                                                                                  \
	OP(RLE, "-", "Bff")                                                                                  \
	OP(DADD, "-", "Ddd")                                                                                 \
	OP(DSUB, "-", "Ddd")                                                                                 \
	OP(DMUL, "-", "Ddd")                                                                                 \
	OP(DDIV, "-", "Ddd")                                                                                 \
	OP(DNEG, "-", "Dd-")                                                                                 \
	OP(DABS, "-", "Dd-")                                                                                 \
	OP(DEQ, "-", "Bdd")                                                                                  \
	OP(DNE, "-", "Bdd")                                                                                  \
	OP(DLT, "-", "Bdd")                                                                                  \
	OP(DLE, "-", "Bdd")                                                                                  \
	OP(EXPT, "-", "Ddd")                                                                                 \
	OP(MATH, "-", "Ddm")    /* a := function c of b */                                                   \
	OP(CONVERT, "o", "Ti-") /* a := b where a's type has it */                                           \
	OP(BITS, "w", "Ti-")    /* a := the low bits of b */                                                 \
	OP(I2R, "-", "Fi-")                                                                                  \
	OP(I2D, "-", "Di-")                                                                                  \
	OP(R2D, "-", "Df-")                                                                                  \
	OP(D2R, "-", "Fd-")                                                                                  \
	OP(ROUND, "o", "Td-") /* to the nearest, halves to even */                                           \
	OP(TRUNC, "o", "Td-")                                                                                \
	OP(JUMP, "-", "j--")                                                                                 \
	OP(IF, "-", "bj+")     /* to b unless a; the quality of c becomes a's */                             \
	OP(ELSIF, "-", "bj+")  /* to b unless a; the quality of c takes a's as well */                       \
	OP(CLEAN, "-", "*j-")  /* to b if a has no flag of quality */                                        \
	OP(SPREAD, "-", "+*n") /* c slots from a take the quality of b as well */                            \
	OP(CALL, "-", "k--")                                                                                 \
	OP(RETURN, "-", "---")                                                                               \
	OP(QUALITY, "-", "Q*-")                                                                              \
	OP(GOOD, "-", "B*-")                                                                                 \
	OP(AS_GOOD, ".", "Tt-")                                                                              \
	OP(MESSAGE, "-", "l*v") /* says the text a with the values of c slots from b */                      \
	OP(TEXT, "-", "Sr-")    /* a := b */                                                                 \
	OP(JOIN, "-", "Srr")    /* a := b and c behind it */                                                 \
	OP(HEAD, "-", "Sri")    /* a := the first c octets of b */                                           \
	OP(TAIL, "-", "Sri")    /* a := b without them */                                                    \
	OP(LAST, "-", "Sri")    /* a := the last c octets of b */                                            \
	OP(LENGTH, "-", "Nr-")                                                                               \
	OP(FIND, "-", "Nrr")    /* a := where c begins in b, from 1; 0: nowhere */                           \
	OP(COMPARE, "-", "Nrr") /* a := -1, 0 or 1 */                                                        \
	OP(FORMAT, "-", "Sl*")  /* a := the text b with the value c, as MESSAGE has it */

/* A STRING has at most so many octets. */
#define LOGIC_STRING_MAX 255
/* A MESSAGE has at most so many values, any of them a STRING. */
#define LOGIC_MESSAGE_VALUES 8
#define LOGIC_MESSAGE_SLOTS  (LOGIC_MESSAGE_VALUES * (1 + (LOGIC_STRING_MAX + 7) / 8))

enum logic_operation {
#define LOGIC_NAME(name, type, operands) LOGIC_##name,
	LOGIC_OPERATIONS(LOGIC_NAME)
#undef LOGIC_NAME
	    LOGIC_OPERATION_COUNT
};

#endif
