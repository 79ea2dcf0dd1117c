/* SPDX-License-Identifier: GPL-3.0-or-later */
/* Frames in words: those of the protocol's own examples, and octets that are none. */
#include <setjmp.h>
#include <stdarg.h>
#include <stddef.h>
#include <stdint.h>
#include <string.h>

#include <cmocka.h>

#include "modbus/describe.h"

/* With its CRC. */
static void assert_rtu(enum modbus_direction direction, const char *expected, const uint8_t *body,
		       size_t length)
{
	uint8_t frame[MODBUS_FRAME_MAX];
	char words[MODBUS_WORDS_SIZE];
	uint16_t crc = modbus_crc(body, length);

	memcpy(frame, body, length);
	frame[length] = (uint8_t)(crc & 0xff);
	frame[length + 1] = (uint8_t)(crc >> 8);
	assert_true(modbus_describe(MODBUS_FRAMING_RTU, direction, frame, length + 2, words));
	assert_string_equal(words, expected);
}

#define ASSERT_SENT(expected, ...)                                                                           \
	assert_rtu(MODBUS_SENT, expected, (const uint8_t[]){__VA_ARGS__},                                    \
		   sizeof((const uint8_t[]){__VA_ARGS__}))
#define ASSERT_RECEIVED(expected, ...)                                                                       \
	assert_rtu(MODBUS_RECEIVED, expected, (const uint8_t[]){__VA_ARGS__},                                \
		   sizeof((const uint8_t[]){__VA_ARGS__}))

static void test_requests(void **state)
{
	(void)state;
	ASSERT_SENT("unit 1: read 2 holding registers from 107", 1, 3, 0, 107, 0, 2);
	ASSERT_SENT("unit 17: read 1 coil from 0", 17, 1, 0, 0, 0, 1);
	ASSERT_SENT("unit 1: write coil 172 on", 1, 5, 0, 172, 0xff, 0);
	ASSERT_SENT("unit 1: write coil 172 neither on nor off", 1, 5, 0, 172, 1, 0);
	ASSERT_SENT("unit 1: write register 1 = 3", 1, 6, 0, 1, 0, 3);
	ASSERT_SENT("unit 1: write 2 registers from 1: 10 258", 1, 16, 0, 1, 0, 2, 4, 0, 10, 1, 2);
	ASSERT_SENT("unit 1: write 10 coils from 19", 1, 15, 0, 19, 0, 10, 2, 0xcd, 1);
	ASSERT_SENT("unit 1: write register 4, keep 0x00f2, set 0x0025", 1, 22, 0, 4, 0, 0xf2, 0, 0x25);
	ASSERT_SENT("unit 1: read identification from object 0", 1, 43, 14, 1, 0);
	ASSERT_SENT("unit 1: function 43, 4 octets", 1, 43, 13, 1, 0, 0);
	ASSERT_SENT("unit 1: function 3, 2 octets", 1, 3, 0, 0);
}

static void test_answers(void **state)
{
	(void)state;
	ASSERT_RECEIVED("unit 1: identification: AB, C?", 1, 43, 14, 1, 1, 0, 0, 2, 0, 2, 'A', 'B', 1, 2, 'C',
			7);
	ASSERT_RECEIVED("unit 1: identification: A", 1, 43, 14, 1, 1, 0, 0, 9, 0, 9, 'A');
	ASSERT_RECEIVED("unit 1: function 43, 2 octets", 1, 43, 14, 1);
	ASSERT_RECEIVED("unit 1: holding registers 555 100", 1, 3, 4, 2, 43, 0, 100);
	ASSERT_RECEIVED("unit 1: discrete inputs in octets ac 01", 1, 2, 2, 0xac, 1);
	ASSERT_RECEIVED("unit 1: has written register 1 = 3", 1, 6, 0, 1, 0, 3);
	ASSERT_RECEIVED("unit 1: has written 2 registers from 1", 1, 16, 0, 1, 0, 2);
	ASSERT_RECEIVED("unit 1: exception 2, illegal data address, to function 3", 1, 0x83, 2);
	ASSERT_RECEIVED("unit 1: exception 200, to function 3", 1, 0x83, 200);
	ASSERT_RECEIVED("unit 1: function 3, 3 octets", 1, 3, 4, 0, 0);
}

static void test_of_a_long_answer_stands_what_has_room(void **state)
{
	uint8_t body[3 + 250] = {1, 3, 250};

	(void)state;
	char words[MODBUS_WORDS_SIZE], frame[sizeof(body) + 2];
	uint16_t crc = modbus_crc(body, sizeof(body));

	memcpy(frame, body, sizeof(body));
	frame[sizeof(body)] = (char)(crc & 0xff);
	frame[sizeof(body) + 1] = (char)(crc >> 8);
	assert_true(modbus_describe(MODBUS_FRAMING_RTU, MODBUS_RECEIVED, (const uint8_t *)frame,
				    sizeof(frame), words));
	assert_int_equal(strlen(words), MODBUS_WORDS_SIZE - 1);
}

static void assert_tcp(bool sound, const char *expected, const uint8_t *frame, size_t length)
{
	char words[MODBUS_WORDS_SIZE];

	assert_int_equal(modbus_describe(MODBUS_FRAMING_TCP, MODBUS_RECEIVED, frame, length, words), sound);
	assert_string_equal(words, expected);
}

static void test_frames_of_tcp(void **state)
{
	static const uint8_t frame[] = {1, 2, 0, 0, 0, 5, 1, 3, 2, 0, 7};

	(void)state;
	assert_tcp(true, "transaction 258, unit 1: holding register 7", frame, sizeof(frame));
	assert_tcp(false, "10 octets, no sound frame", frame, sizeof(frame) - 1);
	assert_tcp(false, "3 octets, no sound frame", frame, 3);
	assert_tcp(false, "0 octets, no sound frame", frame, 0);
}

/* Every beginning of every kind of octets is looked at, and nothing beyond it. */
static void test_octets_of_any_kind(void **state)
{
	char words[MODBUS_WORDS_SIZE];

	(void)state;
	for (unsigned function = 0; function < 256; function++)
		for (size_t length = 0; length < 12; length++) {
			uint8_t *body = test_calloc(length + 2, 1);

			for (size_t i = 0; i < length; i++)
				body[i] = i == 1 ? (uint8_t)function : (uint8_t)(i * 37);
			uint16_t crc = modbus_crc(body, length);
			body[length] = (uint8_t)(crc & 0xff);
			body[length + 1] = (uint8_t)(crc >> 8);
			for (int direction = MODBUS_SENT; direction <= MODBUS_RECEIVED; direction++) {
				modbus_describe(MODBUS_FRAMING_RTU, (enum modbus_direction)direction, body,
						length + 2, words);
				modbus_describe(MODBUS_FRAMING_TCP, (enum modbus_direction)direction, body,
						length + 2, words);
			}
			test_free(body);
		}
}

int main(void)
{
	const struct CMUnitTest tests[] = {
	    cmocka_unit_test(test_requests),
	    cmocka_unit_test(test_answers),
	    cmocka_unit_test(test_of_a_long_answer_stands_what_has_room),
	    cmocka_unit_test(test_frames_of_tcp),
	    cmocka_unit_test(test_octets_of_any_kind),
	};
	return cmocka_run_group_tests_name("describe", tests, NULL, NULL);
}
