/* SPDX-License-Identifier: GPL-3.0-or-later */
/* Strings of a program made by hand; what each operation makes of one is in tests/logic/test_logic.py. */
#include <setjmp.h>
#include <stdarg.h>
#include <stddef.h>
#include <stdint.h>
#include <string.h>

#include <cmocka.h>

#include "logic/logic.h"
#include "logic/test_seal.h"

enum { LONG = 1, SHORT = 4, NUMBER = 6, COUNT, REAL, DOUBLE, SLOTS }; /* a STRING(16), a STRING(8) */

struct program {
	struct logic_head head;
	uint8_t types[(SLOTS + 3) / 4 * 4];
	struct logic_routine routine;
	struct logic_string strings[3];
	struct logic_instruction code[2];
	uint16_t lines[2];
	char names[8];
};
_Static_assert(sizeof(struct program) == 48 + 12 + 4 + 12 + 16 + 4 + 8, "no padding");

static const struct program sound_program = {
    .head = {.magic = {'R', 'T', 'U', 'L'},
	     .version = LOGIC_VERSION,
	     .strings = 3,
	     .size = sizeof(struct program),
	     .constants = 1,
	     .slots = SLOTS,
	     .routines = 1,
	     .code = 2,
	     .uptime = LOGIC_NO_SLOT,
	     .elapsed = LOGIC_NO_SLOT,
	     .now = LOGIC_NO_SLOT,
	     .names = 8},
    .types = {LOGIC_LINT, LOGIC_LINT, LOGIC_LINT, LOGIC_LINT, LOGIC_LINT, LOGIC_LINT, LOGIC_INT, LOGIC_LINT,
	      LOGIC_REAL, LOGIC_LREAL},
    .routine = {0, 2},
    .strings = {{LONG, 16}, {SHORT, 8}, {LONG, 1}},
    .code = {{LOGIC_TEXT, 0, 1, 0, 0}, {LOGIC_RETURN, 0, 0, 0, 0}},
    .names = "{}",
};

static struct program program;
static struct logic logic;
static union {
	int64_t aligned;
	uint8_t octets[1024];
} memory;

static const char *loaded(void)
{
	seal(&program, sizeof(program));
	return logic_load(&logic, &memory, &program, sizeof(program));
}

#define REFUSED(why, place, value)                                                                           \
	do {                                                                                                 \
		program = sound_program;                                                                     \
		program.place = (value);                                                                     \
		assert_string_equal(loaded(), why);                                                          \
	} while (0)

static void load(uint8_t operation, uint16_t a, uint16_t b, uint16_t c)
{
	program = sound_program;
	program.code[0] = (struct logic_instruction){operation, 0, a, b, c};
	assert_null(loaded());
}

static const char *octets(uint16_t slot)
{
	return (const char *)&logic.cells[slot + 1];
}

static bool run(void)
{
	static const struct logic_times times;

	return logic_scan(&logic, &times, 1000);
}

static void put(uint16_t slot, const char *text, int64_t length)
{
	logic.cells[slot].i = length;
	memcpy(&logic.cells[slot + 1], text, strlen(text));
}

static void test_what_the_verifier_refuses(void **state)
{
	static const char memory_lacks[] = "a string has no memory",
			  operands[] = "an instruction does not fit its operands";

	(void)state;
	REFUSED(memory_lacks, strings[0].octets, 0);
	REFUSED(memory_lacks, strings[0].octets, LOGIC_STRING_MAX + 1);
	REFUSED(memory_lacks, strings[1].octets, 9); /* over the slots of another type */
	REFUSED(memory_lacks, strings[1].first, SLOTS);
	REFUSED(memory_lacks, strings[1].first, UINT16_MAX);
	REFUSED(operands, strings[1].first, 0); /* a constant is written */
	REFUSED(operands, code[0].a, 3);
	REFUSED(operands, code[0].b, 3);
	REFUSED(operands, code[0].c, 1);
	REFUSED("this is not a program, or it is from another version", head.strings, 2);
}

/* Whatever a file does to the slots: the length is clipped where it is read. */
static void test_a_wrong_length_reaches_nothing(void **state)
{
	static const int64_t lengths[] = {17, 300, INT64_MAX, -1, INT64_MIN};
	static const char text[] = "0123456789abcdef";

	(void)state;
	for (unsigned i = 0; i < sizeof(lengths) / sizeof(lengths[0]); i++) {
		load(LOGIC_TEXT, 1, 0, 0);
		put(LONG, text, lengths[i]);
		assert_true(run());
		assert_int_equal(logic.cells[SHORT].i, lengths[i] < 0 ? 0 : 8);
		assert_memory_equal(octets(SHORT), lengths[i] < 0 ? "\0\0\0\0\0\0\0" : "01234567", 8);
		assert_int_equal(logic.quality[SHORT], lengths[i] < 0 ? 0 : LOGIC_OVERFLOW);
		assert_int_equal(logic.cells[NUMBER].i, 0);
	}
}

static void test_a_string_may_be_made_of_itself(void **state)
{
	(void)state;
	load(LOGIC_JOIN, 0, 0, 0);
	put(LONG, "abc", 3);
	assert_true(run());
	assert_int_equal(logic.cells[LONG].i, 6);
	assert_string_equal(octets(LONG), "abcabc");
	load(LOGIC_TAIL, 0, 0, COUNT);
	put(LONG, "abcdef", 6);
	logic.cells[COUNT].i = 2;
	assert_true(run());
	assert_string_equal(octets(LONG), "cdef");
	load(LOGIC_LAST, 2, 0, COUNT); /* into a part of itself */
	put(LONG, "abcdef", 6);
	logic.cells[COUNT].i = INT64_MAX;
	assert_true(run());
	assert_int_equal(logic.cells[LONG].i, 1);
	logic.cells[COUNT].i = INT64_MIN;
	assert_true(run());
	assert_int_equal(logic.cells[LONG].i, 0);
	assert_int_equal(logic.faults[LOGIC_DOMAIN], 1);
}

static void shows(uint16_t slot, const char *text)
{
	assert_true(run());
	assert_string_equal(octets(LONG), text);
	assert_int_equal(logic.quality[LONG], logic.quality[slot]);
}

/* The digits are the same on each machine: `make cross` runs this as ARMv5 code. */
static void test_numbers(void **state)
{
	(void)state;
	load(LOGIC_FORMAT, 0, 0, REAL);
	logic.cells[REAL].r = 16777217.0F / 3.0F;
	shows(REAL, "5592406");
	logic.cells[REAL].r = 1.0e-20F;
	logic.quality[REAL] = LOGIC_INVALID;
	shows(REAL, "1e-20");
	load(LOGIC_FORMAT, 0, 0, DOUBLE);
	logic.cells[DOUBLE].d = -2.0 / 3.0;
	assert_true(run());
	assert_memory_equal(octets(LONG), "-0.6666666666666", 16); /* cut */
	assert_int_equal(logic.quality[LONG], LOGIC_OVERFLOW);
	load(LOGIC_FORMAT, 0, 0, COUNT);
	logic.cells[COUNT].i = INT64_MIN;
	assert_true(run());
	assert_memory_equal(octets(LONG), "-922337203685477", 16);
}

static void test_the_budget_counts_what_a_search_costs(void **state)
{
	static const struct logic_times times;

	(void)state;
	load(LOGIC_FIND, NUMBER, 0, 1);
	assert_false(logic_scan(&logic, &times, 2)); /* 1 + 16 * 8 / 64 */
	assert_true(logic_scan(&logic, &times, 3));
}

int main(void)
{
	const struct CMUnitTest tests[] = {
	    cmocka_unit_test(test_what_the_verifier_refuses),
	    cmocka_unit_test(test_a_wrong_length_reaches_nothing),
	    cmocka_unit_test(test_a_string_may_be_made_of_itself),
	    cmocka_unit_test(test_numbers),
	    cmocka_unit_test(test_the_budget_counts_what_a_search_costs),
	};
	return cmocka_run_group_tests_name("logic text", tests, NULL, NULL);
}
