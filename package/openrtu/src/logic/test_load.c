/* SPDX-License-Identifier: GPL-3.0-or-later */
/* Each refusal of the verifier, by one change of a program that it accepts. */
#include <setjmp.h>
#include <stdarg.h>
#include <stddef.h>
#include <stdint.h>
#include <string.h>

#include <cmocka.h>

#include "logic/test_program.h"

static union {
	int64_t aligned;
	uint8_t octets[4096];
} memory;
static struct logic logic;
static struct program program;

static const char *loaded(void)
{
	seal(&program, sizeof(program));
	assert_in_range(logic_memory(&program, sizeof(program)), 1, sizeof(memory));
	return logic_load(&logic, &memory, &program, sizeof(program));
}

/* Sets a field of a fresh program and expects this refusal. */
#define REFUSED(why, field, value)                                                                           \
	do {                                                                                                 \
		program = sound_program;                                                                     \
		program.field = (value);                                                                     \
		assert_string_equal(loaded(), why);                                                          \
	} while (0)

static void test_the_program_is_accepted(void **state)
{
	(void)state;
	program = sound_program;
	assert_null(loaded());
	assert_string_equal(logic_name(&logic, logic.points[1].name), "out");
	assert_int_equal(logic.cells[FIVE].i, 5);
}

static void test_what_is_no_program(void **state)
{
	(void)state;
	program = sound_program;
	assert_int_equal(logic_memory(&program, sizeof(struct logic_head) - 1), 0);
	assert_int_equal(logic_memory(&program, sizeof(program) - 1), 0);
	program.head.magic[0] = 'X';
	assert_int_equal(logic_memory(&program, sizeof(program)), 0);
	program = sound_program;
	program.head.version++;
	assert_int_equal(logic_memory(&program, sizeof(program)), 0);
	assert_string_equal(logic_load(&logic, &memory, &program, sizeof(program)),
			    "this is not a program, or it is from another version");
	program = sound_program;
	program.head.code++; /* more than the file has */
	assert_int_equal(logic_memory(&program, sizeof(program)), 0);
}

static void test_a_damaged_file(void **state)
{
	(void)state;
	program = sound_program;
	seal(&program, sizeof(program));
	program.initial.low ^= 1;
	assert_string_equal(logic_load(&logic, &memory, &program, sizeof(program)),
			    "the program is damaged: its CRC does not match");
}

static void test_tables(void **state)
{
	(void)state;
	REFUSED("the program is too large", head.constants, SLOTS + 1);
	REFUSED("the names have no end", names[sizeof(program.names) - 1], 'x');
	REFUSED("the names have no end", head.name, sizeof(program.names));
	REFUSED("a variable has an unknown type", types[GO], LOGIC_TYPES);
	REFUSED("an array is too long", array.elements, 0);
	REFUSED("an array is too long", array.stride, 0);
	REFUSED("an array is too long", array.elements, SLOTS);
	REFUSED("an array is too long", array.stride, SLOTS);
	REFUSED("an array has elements of several types", array.elements, 4);
	REFUSED("an array has elements of several types", array.stride, 2); /* over the elements' end */
	REFUSED("a point has no variable", points[0].slot, FIVE);           /* a constant */
	REFUSED("a point has no variable", points[0].type, LOGIC_INT);
	REFUSED("a point has no variable", points[0].time, UPTIME); /* a TIME, not a DT */
	REFUSED("a point has no variable", points[0].name, sizeof(program.names));
	REFUSED("a command has no variables", command.execute, IN);
	REFUSED("a command has no variables", command.value, GO);
	REFUSED("a command has no variables", command.select, SLOTS);
	REFUSED("a command has no variables", command.state, IN);
	REFUSED("a command has no variables", command.result, IN);
	REFUSED("a command has no variables", command.name, sizeof(program.names));
	REFUSED("a retained variable has no memory", retained.first, FIVE);
	REFUSED("a retained variable has no memory", retained.slots, SLOTS);
	REFUSED("a retained variable has no memory", retained.name, sizeof(program.names));
	REFUSED("a retained variable has several types", retained.slots, 4);
	REFUSED("what is retained is not in its order", retained.ends_with_power, 2);
	REFUSED("the time has no variable", head.uptime, IN);
	REFUSED("the time has no variable", head.elapsed, SLOTS);
	REFUSED("the time has no variable", head.now, UPTIME);
	REFUSED("an initial value does not fit its variable", initial.high, 1); /* 2^32 for a DINT */
	REFUSED("an initial value does not fit its variable", initial.slot, SLOTS);
}

static void test_routines(void **state)
{
	(void)state;
	REFUSED("the routines are not in order", routines[0].first, 1);
	REFUSED("the routines are not in order", routines[0].instructions, 0);
	REFUSED("the routines are not in order", routines[1].instructions, UINT16_MAX);
	REFUSED("a routine has no end", code[1].operation, LOGIC_CLEAN);
	program = sound_program;
	program.routines[1].instructions = 4;
	program.code[4].b = 5; /* a jump that stays within it */
	assert_string_equal(loaded(), "instructions are in no routine");
	program = sound_program; /* the tables' octets become part of the names */
	program.head.routines = program.head.points = program.head.commands = program.head.retained = 0;
	program.head.names += (uint32_t)(sizeof(program.routines) + sizeof(program.points) +
					 sizeof(program.command) + sizeof(program.retained));
	assert_string_equal(loaded(), "the program has no routine, or too many");
}

static void test_instructions(void **state)
{
	static const char why[] = "an instruction does not fit its operands";

	(void)state;
	REFUSED(why, code[0].operation, LOGIC_OPERATION_COUNT);
	REFUSED(why, code[0].type, LOGIC_INT);
	REFUSED(why, code[0].type, LOGIC_TYPES);
	REFUSED(why, code[0].b, 1);            /* there is one array */
	REFUSED(why, code[0].c, VALUE);        /* an index that is no whole number */
	REFUSED(why, code[2].a, 1);            /* calls itself */
	REFUSED(why, code[2].b, 1);            /* an operand that CALL does not have */
	REFUSED(why, code[3].a, FIVE);         /* writes a constant */
	REFUSED(why, code[3].a, GO);           /* another type */
	REFUSED(why, code[3].b, SLOTS);        /* behind the memory */
	REFUSED(why, code[4].a, IN);           /* a condition that is no BOOL */
	REFUSED(why, code[4].b, 0);            /* jumps out of its routine */
	REFUSED(why, code[5].a, 8);            /* behind the code */
	REFUSED(why, code[6].c, 0);            /* spreads over nothing */
	REFUSED(why, code[6].c, SLOTS);        /* behind the memory */
	REFUSED(why, code[6].a, FIVE);         /* over a constant */
	REFUSED(why, code[6].b, SLOTS);        /* from behind the memory */
	REFUSED(why, code[1].type, LOGIC_INT); /* a type that RETURN does not have */
}

static void test_depth(void **state)
{
	static struct {
		struct logic_head head;
		struct logic_routine routines[LOGIC_DEPTH + 1];
		struct logic_instruction code[2 * (LOGIC_DEPTH + 1)];
		uint16_t lines[2 * (LOGIC_DEPTH + 1)];
		char names[4];
	} chain = {.head = {.magic = {'R', 'T', 'U', 'L'},
			    .version = LOGIC_VERSION,
			    .size = sizeof(chain),
			    .routines = LOGIC_DEPTH + 1,
			    .code = 2 * (LOGIC_DEPTH + 1),
			    .uptime = LOGIC_NO_SLOT,
			    .elapsed = LOGIC_NO_SLOT,
			    .now = LOGIC_NO_SLOT,
			    .names = 4}};
	static const struct logic_times times;

	(void)state;
	for (uint16_t i = 0; i <= LOGIC_DEPTH; i++) {
		chain.routines[i] = (struct logic_routine){(uint16_t)(2 * i), 2};
		chain.code[2 * i].operation = i ? LOGIC_CALL : LOGIC_RETURN;
		chain.code[2 * i].a = (uint16_t)(i ? i - 1 : 0);
		chain.code[2 * i + 1].operation = LOGIC_RETURN;
	}
	seal(&chain, sizeof(chain));
	assert_string_equal(logic_load(&logic, &memory, &chain, sizeof(chain)), "calls are nested too deep");
	chain.code[2] = (struct logic_instruction){.operation = LOGIC_RETURN};
	seal(&chain, sizeof(chain));
	assert_null(logic_load(&logic, &memory, &chain, sizeof(chain)));
	assert_true(logic_scan(&logic, &times, LOGIC_BUDGET_DEFAULT));
}

int main(void)
{
	const struct CMUnitTest tests[] = {
	    cmocka_unit_test(test_the_program_is_accepted),
	    cmocka_unit_test(test_what_is_no_program),
	    cmocka_unit_test(test_a_damaged_file),
	    cmocka_unit_test(test_tables),
	    cmocka_unit_test(test_routines),
	    cmocka_unit_test(test_instructions),
	    cmocka_unit_test(test_depth),
	};
	return cmocka_run_group_tests_name("logic load", tests, NULL, NULL);
}
