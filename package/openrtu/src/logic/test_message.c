/* SPDX-License-Identifier: GPL-3.0-or-later */
/* What a program made by hand says. */
#include <setjmp.h>
#include <stdarg.h>
#include <stddef.h>
#include <stdint.h>
#include <string.h>

#include <cmocka.h>

#include "logic/test_program.h"

static union {
	int64_t aligned;
	uint8_t octets[1024];
} memory;
static struct logic logic;
static struct program program;

/* The first instruction says the text, with so many slots from this one on. */
static const char *loaded(const char *text, uint16_t slot, uint16_t values)
{
	program = sound_program;
	strncpy(program.names, text, sizeof(program.names) - 1);
	program.names[sizeof(program.names) - 1] = '\0';
	program.code[0] = (struct logic_instruction){LOGIC_MESSAGE, 0, 0, slot, values};
	seal(&program, sizeof(program));
	assert_in_range(logic_memory(&program, sizeof(program)), 1, sizeof(memory));
	return logic_load(&logic, &memory, &program, sizeof(program));
}

static const char *text_of(const char *text, uint16_t slot, uint16_t values)
{
	static const struct logic_times times;
	static char out[64];

	assert_null(loaded(text, slot, values));
	assert_true(logic_scan(&logic, &times, 1000));
	assert_int_equal(logic.messages, 1);
	logic.cells[IN].i = -7;
	logic.cells[OUT].i = 8;
	logic.quality[OUT] = LOGIC_NOT_TOPICAL;
	logic.cells[VALUE].d = 2.5;
	logic.cells[GO].i = 1;
	logic_message(&logic, 0, out, sizeof(out));
	return out;
}

static void test_values_stand_in_the_text(void **state)
{
	(void)state;
	assert_string_equal(text_of("in {}", IN, 1), "in -7");
	assert_string_equal(text_of("{}, {}.", IN, 2), "-7, 8!.");
	assert_string_equal(text_of("{} kV", VALUE, 1), "2.5 kV");
	assert_string_equal(text_of("is {}", GO, 1), "is TRUE");
	assert_string_equal(text_of("{} up", UPTIME, 1), "0 s up");
}

static void test_a_text_that_does_not_fit_its_values(void **state)
{
	(void)state;
	assert_string_equal(text_of("{}{} {", IN, 1), "-7{} {");
	assert_string_equal(text_of("{ } %s %n", IN, 1), "{ } %s %n");
	assert_string_equal(text_of("a\nb\x1b\x7f{}", IN, 0), "a?b??{}");
	assert_string_equal(text_of("", IN, 1), "");
}

static void test_a_value_has_a_name(void **state)
{
	(void)state;
	assert_string_equal(text_of("\x01"
				    "1=A,-7=B\x02.",
				    IN, 1),
			    "B.");
	assert_string_equal(text_of("\x01"
				    "8=A,9=B\x02{}",
				    OUT, 1),
			    "A!{}");
	assert_string_equal(text_of("\x01"
				    "1=A\x02 {}",
				    IN, 2),
			    "-7 8!");
	assert_string_equal(text_of("\x01"
				    "-7=A",
				    IN, 1),
			    "A"); /* no end */
	assert_string_equal(text_of("\x01"
				    "-7,,=\x02x",
				    IN, 1),
			    "-7x");
	assert_string_equal(text_of("\x01"
				    "-7=\x1b,\x02x",
				    IN, 1),
			    "?x");
	assert_string_equal(text_of("\x01", IN, 1), "-7");
}

static void test_what_finds_no_room_is_cut(void **state)
{
	char out[4];

	(void)state;
	assert_string_equal(text_of("ab{}{}", VALUE, 1), "ab2.5{}");
	logic_message(&logic, 0, out, 4);
	assert_string_equal(out, "ab2");
	logic_message(&logic, 0, out, 3);
	assert_string_equal(out, "ab");
	logic_message(&logic, 0, out, 1);
	assert_string_equal(out, "");
}

static void test_what_the_verifier_refuses(void **state)
{
	static const char why[] = "an instruction does not fit its operands";

	(void)state;
	assert_null(loaded("a", UPTIME, 1));
	assert_string_equal(loaded("a", UPTIME, 2), why);
	assert_string_equal(loaded("a", SLOTS, 0), why);
	assert_string_equal(loaded("a", IN, LOGIC_MESSAGE_SLOTS + 1), why);
	program.code[0] = (struct logic_instruction){LOGIC_MESSAGE, 0, sizeof(program.names), IN, 0};
	seal(&program, sizeof(program));
	assert_string_equal(logic_load(&logic, &memory, &program, sizeof(program)), why);
}

int main(void)
{
	const struct CMUnitTest tests[] = {
	    cmocka_unit_test(test_values_stand_in_the_text),
	    cmocka_unit_test(test_a_text_that_does_not_fit_its_values),
	    cmocka_unit_test(test_a_value_has_a_name),
	    cmocka_unit_test(test_what_finds_no_room_is_cut),
	    cmocka_unit_test(test_what_the_verifier_refuses),
	};
	return cmocka_run_group_tests_name("logic message", tests, NULL, NULL);
}
