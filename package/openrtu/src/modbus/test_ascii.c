/* SPDX-License-Identifier: GPL-3.0-or-later */
/* Modbus ASCII: the frames of the standard's examples, and text that is none. */
#include <setjmp.h>
#include <stdarg.h>
#include <stddef.h>
#include <stdint.h>
#include <string.h>

#include <cmocka.h>

#include "modbus/ascii.h"

static enum modbus_ascii_state take(struct modbus_ascii *ascii, const char *text)
{
	enum modbus_ascii_state state = MODBUS_ASCII_NOISE;

	for (; *text != '\0'; text++)
		state = modbus_ascii_take(ascii, (uint8_t)*text);
	return state;
}

static void assert_body(const struct modbus_ascii *ascii, const uint8_t *body, size_t length)
{
	assert_int_equal(ascii->length, length);
	assert_memory_equal(ascii->body, body, length);
}

static void test_request_is_text(void **state)
{
	const uint8_t body[] = {1, MODBUS_READ_HOLDING_REGISTERS, 0, 107, 0, 3};
	uint8_t text[MODBUS_ASCII_REQUEST_MAX];

	(void)state;
	assert_int_equal(modbus_ascii_frame(body, sizeof(body), text), 17);
	assert_memory_equal(text, ":0103006B00038E\r\n", 17);
}

static void test_longest_request_has_room(void **state)
{
	const uint8_t body[MODBUS_ASCII_BODY_MAX] = {247, MODBUS_WRITE_REGISTERS};
	uint8_t text[MODBUS_ASCII_REQUEST_MAX + 1] = {0};
	struct modbus_ascii ascii = {.begun = false};

	(void)state;
	assert_int_equal(modbus_ascii_frame(body, sizeof(body), text), MODBUS_ASCII_REQUEST_MAX);
	assert_int_equal(take(&ascii, (const char *)text), MODBUS_ASCII_SOUND);
}

static void test_answer_is_read(void **state)
{
	struct modbus_ascii ascii = {.begun = false};

	(void)state;
	assert_int_equal(take(&ascii, ":0103022B00CF\r\n"), MODBUS_ASCII_SOUND);
	assert_body(&ascii, (const uint8_t[]){1, 3, 2, 0x2b, 0}, 5);
	assert_int_equal(take(&ascii, ":0103022b00cf\r\n"), MODBUS_ASCII_SOUND); /* small letters */
	assert_int_equal(take(&ascii, ":0103022B00CF\n"), MODBUS_ASCII_SOUND);
}

static void test_wrong_lrc_is_seen(void **state)
{
	struct modbus_ascii ascii = {.begun = false};

	(void)state;
	assert_int_equal(take(&ascii, ":0103022B01CF\r\n"), MODBUS_ASCII_GARBLED);
	assert_body(&ascii, (const uint8_t[]){1, 3, 2, 0x2b, 1}, 5);
}

static void test_a_colon_begins_anew(void **state)
{
	struct modbus_ascii ascii = {.begun = false};

	(void)state;
	assert_int_equal(take(&ascii, ":010302:0103022B00CF\r\n"), MODBUS_ASCII_SOUND);
	assert_body(&ascii, (const uint8_t[]){1, 3, 2, 0x2b, 0}, 5);
}

static void test_what_is_no_frame_is_noise(void **state)
{
	static const char *const texts[] = {"x",    "\r",    "\n",      "0",      ":0G",
					    ":01 ", ":01\n", ":0103\n", ":010\n", ":\x80"};

	(void)state;
	for (size_t i = 0; i < sizeof(texts) / sizeof(texts[0]); i++) {
		struct modbus_ascii ascii = {.begun = false};

		assert_int_equal(take(&ascii, texts[i]), MODBUS_ASCII_NOISE);
		assert_false(ascii.begun);
	}
}

static void test_a_frame_that_never_ends_is_given_up(void **state)
{
	struct modbus_ascii ascii = {.begun = false};
	unsigned taken = 0;

	(void)state;
	take(&ascii, ":");
	while (modbus_ascii_take(&ascii, '0') == MODBUS_ASCII_BEGUN)
		taken++;
	assert_int_equal(taken, 2 * (MODBUS_ASCII_BODY_MAX + 1));
}

int main(void)
{
	const struct CMUnitTest tests[] = {
	    cmocka_unit_test(test_request_is_text),
	    cmocka_unit_test(test_longest_request_has_room),
	    cmocka_unit_test(test_answer_is_read),
	    cmocka_unit_test(test_wrong_lrc_is_seen),
	    cmocka_unit_test(test_a_colon_begins_anew),
	    cmocka_unit_test(test_what_is_no_frame_is_noise),
	    cmocka_unit_test(test_a_frame_that_never_ends_is_given_up),
	};
	return cmocka_run_group_tests_name("ascii", tests, NULL, NULL);
}
