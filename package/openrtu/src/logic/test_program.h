/* SPDX-License-Identifier: GPL-3.0-or-later */
/* A small program, made by hand: a[in] := in; out := 5 / in; WHILE go DO END_WHILE; */
#ifndef OPENRTU_LOGIC_TEST_PROGRAM_H
#define OPENRTU_LOGIC_TEST_PROGRAM_H

#include "logic/logic.h"
#include "logic/test_seal.h"

enum { FIVE, IN, OUT, GO, ELEMENTS, VALUE = ELEMENTS + 3, SELECT, STATE, RESULT, UPTIME, SLOTS };

struct program {
	struct logic_head head;
	uint8_t types[SLOTS];
	struct logic_initial initial;
	struct logic_array array;
	struct logic_routine routines[2];
	struct logic_point points[3];
	struct logic_command command;
	struct logic_retained retained;
	struct logic_instruction code[8];
	uint16_t lines[8];
	char names[12];
};
_Static_assert(sizeof(struct program) == 48 + 12 + 12 + 12 + 8 + 24 + 12 + 8 + 64 + 16 + 12, "no padding");

static const struct program sound_program = {
    .head = {.magic = {'R', 'T', 'U', 'L'},
	     .version = LOGIC_VERSION,
	     .size = sizeof(struct program),
	     .constants = 1,
	     .slots = SLOTS,
	     .initial = 1,
	     .arrays = 1,
	     .routines = 2,
	     .points = 3,
	     .commands = 1,
	     .retained = 1,
	     .code = 8,
	     .uptime = UPTIME,
	     .elapsed = LOGIC_NO_SLOT,
	     .now = LOGIC_NO_SLOT,
	     .names = 12},
    .types = {LOGIC_DINT, LOGIC_DINT, LOGIC_DINT, LOGIC_BOOL, LOGIC_DINT, LOGIC_DINT, LOGIC_DINT, LOGIC_LREAL,
	      LOGIC_BOOL, LOGIC_USINT, LOGIC_USINT, LOGIC_TIME},
    .initial = {.slot = FIVE, .low = 5},
    .array = {.first = ELEMENTS, .elements = 3, .stride = 1, .type = LOGIC_DINT, .low = 1},
    .routines = {{0, 2}, {2, 6}},
    .points = {{IN, LOGIC_NO_SLOT, LOGIC_DINT, 0, 2},
	       {OUT, LOGIC_NO_SLOT, LOGIC_DINT, 1, 5},
	       {GO, LOGIC_NO_SLOT, LOGIC_BOOL, 0, 9}},
    .command = {9, GO, VALUE, SELECT, STATE, RESULT},
    .retained = {0, ELEMENTS, 3, LOGIC_DINT, 0},
    .code = {{LOGIC_STORE, LOGIC_DINT, IN, 0, IN},
	     {LOGIC_RETURN, 0, 0, 0, 0},
	     {LOGIC_CALL, 0, 0, 0, 0},
	     {LOGIC_DIV, LOGIC_DINT, OUT, FIVE, IN},
	     {LOGIC_IF, 0, GO, 7, SELECT},
	     {LOGIC_JUMP, 0, 4, 0, 0},
	     {LOGIC_SPREAD, 0, OUT, IN, 1},
	     {LOGIC_RETURN, 0, 0, 0, 0}},
    .lines = {2, 2, 3, 4, 5, 5, 5, 6},
    .names = "a\0in\0out\0go",
};

#endif
