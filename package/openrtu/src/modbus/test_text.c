/* SPDX-License-Identifier: GPL-3.0-or-later */
/* Texts in registers, as devices have them. */
#include <setjmp.h>
#include <stdarg.h>
#include <stddef.h>
#include <stdint.h>

#include <cmocka.h>
#include <string.h>

#include "modbus/text.h"

#define REGISTERS 4

static void assert_text(enum modbus_format format, uint8_t flags, const char *octets, const char *expected)
{
	const struct modbus_point point = {.type = MAP_BITSTRING,
					   .format = format & 31u,
					   .address = 7,
					   .second_address = 7 + REGISTERS - 1,
					   .flags = flags};
	uint8_t registers[2 * REGISTERS];
	char text[MAP_TEXT_SIZE];

	memcpy(registers, octets, sizeof(registers));
	modbus_text(&point, registers, text);
	assert_string_equal(text, expected);
}

static void test_two_characters_a_register(void **state)
{
	(void)state;
	assert_text(MODBUS_FORMAT_STRING, 0, "ABB B23 ", "ABB B23");
	assert_text(MODBUS_FORMAT_STRING, 0, "ABCDEFGH", "ABCDEFGH");
	assert_text(MODBUS_FORMAT_STRING, 0, " A  B \0x", " A  B");
	assert_text(MODBUS_FORMAT_STRING, MODBUS_BYTES_SWAPPED, "BA\0C\0\0\0\0", "ABC");
}

static void test_one_character_a_register(void **state)
{
	(void)state;
	assert_text(MODBUS_FORMAT_STRING16, 0, "\0A\0B\0C\0\0", "ABC");
	assert_text(MODBUS_FORMAT_STRING16, MODBUS_BYTES_SWAPPED, "A\0B\0 \0 \0", "AB");
	assert_text(MODBUS_FORMAT_STRING16, 0, "\0AXY\0C\0D", "A?CD");
}

static void test_what_fills_it_up_is_left_out(void **state)
{
	(void)state;
	assert_text(MODBUS_FORMAT_STRING, 0, "\0\0\0\0\0\0\0\0", "");
	assert_text(MODBUS_FORMAT_STRING, 0, "        ", "");
	assert_text(MODBUS_FORMAT_STRING, 0, "V1\xFF\xFF\xFF\xFF\xFF\xFF", "V1");
	assert_text(MODBUS_FORMAT_STRING16, 0, "\0V\xFF\xFF\xFF\xFF\xFF\xFF", "V");
	assert_text(MODBUS_FORMAT_STRING, 0, "V1\0\x1B[2J", "V1");
}

static void test_what_is_no_ascii_is_shown_safely(void **state)
{
	(void)state;
	assert_text(MODBUS_FORMAT_STRING, 0,
		    "\xB5"
		    "A\xFC\xFF"
		    "B\0\0\0",
		    "\xC2\xB5"
		    "A\xC3\xBC\xC3\xBF"
		    "B");
	assert_text(MODBUS_FORMAT_STRING, 0, "\x1B[2J\x7F\x85\x9F.", "?[2J???.");
}

static void test_the_longest_one_has_room(void **state)
{
	const struct modbus_point point = {.type = MAP_BITSTRING,
					   .format = MODBUS_FORMAT_STRING & 31u,
					   .second_address = MODBUS_TEXT_MAX - 1};
	uint8_t registers[2 * MODBUS_TEXT_MAX];
	char text[MAP_TEXT_SIZE];

	(void)state;
	memset(registers, 0xE4, sizeof(registers));
	modbus_text(&point, registers, text);
	assert_int_equal(strlen(text), 2 * 2 * MODBUS_TEXT_MAX);
}

int main(void)
{
	const struct CMUnitTest tests[] = {
	    cmocka_unit_test(test_two_characters_a_register),
	    cmocka_unit_test(test_one_character_a_register),
	    cmocka_unit_test(test_what_fills_it_up_is_left_out),
	    cmocka_unit_test(test_what_is_no_ascii_is_shown_safely),
	    cmocka_unit_test(test_the_longest_one_has_room),
	};

	return cmocka_run_group_tests(tests, NULL, NULL);
}
