/* SPDX-License-Identifier: GPL-3.0-or-later */
#include <setjmp.h>
#include <stdarg.h>
#include <stddef.h>
#include <stdint.h>
#include <string.h>

#include <cmocka.h>

#include "modbus/frame.h"

#define FUZZ_ROUNDS 200000

static size_t sealed(uint8_t *frame, size_t length)
{
	uint16_t crc = modbus_crc(frame, length);

	frame[length] = (uint8_t)(crc & 0xFF);
	frame[length + 1] = (uint8_t)(crc >> 8);
	return length + 2;
}

static void assert_frame(struct modbus_request request, const uint8_t *bytes, size_t length)
{
	uint8_t frame[MODBUS_FRAME_MAX];

	assert_int_equal(modbus_request_frame(&request, frame), length);
	assert_memory_equal(frame, bytes, length);
}

#define ASSERT_FRAME(request, ...)                                                                           \
	assert_frame(request, (const uint8_t[]){__VA_ARGS__}, sizeof((const uint8_t[]){__VA_ARGS__}))

/* The report, figures 5.5 and 5.8. */
static void test_writes_of_the_report(void **state)
{
	(void)state;
	ASSERT_FRAME(((struct modbus_request){67, MODBUS_WRITE_COIL, 3, 1, {1}}), 67, 5, 0, 3, 255, 0, 115,
		     24);
	ASSERT_FRAME(((struct modbus_request){67, MODBUS_WRITE_REGISTER, 2, 1, {255}}), 67, 6, 0, 2, 0, 255,
		     103, 104);
}

/* Known frames; their CRCs were computed with another implementation. */
static void test_requests_of_every_function(void **state)
{
	(void)state;
	ASSERT_FRAME(((struct modbus_request){0x11, 1, 0x13, 0x25, {0}}), 0x11, 1, 0, 0x13, 0, 0x25, 0x0E,
		     0x84);
	ASSERT_FRAME(((struct modbus_request){0x11, 2, 0xC4, 0x16, {0}}), 0x11, 2, 0, 0xC4, 0, 0x16, 0xBA,
		     0xA9);
	ASSERT_FRAME(((struct modbus_request){0x11, 3, 0x6B, 3, {0}}), 0x11, 3, 0, 0x6B, 0, 3, 0x76, 0x87);
	ASSERT_FRAME(((struct modbus_request){0x11, 4, 8, 1, {0}}), 0x11, 4, 0, 8, 0, 1, 0xB2, 0x98);
	ASSERT_FRAME(((struct modbus_request){0x11, 5, 0xAC, 1, {1}}), 0x11, 5, 0, 0xAC, 0xFF, 0, 0x4E, 0x8B);
	ASSERT_FRAME(((struct modbus_request){0x11, 6, 1, 1, {3}}), 0x11, 6, 0, 1, 0, 3, 0x9A, 0x9B);
	ASSERT_FRAME(((struct modbus_request){0x11, 15, 0x13, 2, {1, 1}}), 0x11, 15, 0, 0x13, 0, 2, 1, 3,
		     0x1A, 0x59);
	ASSERT_FRAME(((struct modbus_request){0x11, 16, 1, 2, {0x0A, 0x0102}}), 0x11, 16, 0, 1, 0, 2, 4, 0,
		     0x0A, 1, 2, 0xC6, 0xF0);
}

static void test_answer_is_complete_at_its_last_byte(void **state)
{
	(void)state;
	const struct modbus_request request = {0x11, 3, 0x6B, 3, {0}};
	const uint8_t answer[] = {0x11, 3, 6, 0x02, 0x2B, 0, 0, 0, 0x64, 0xC8, 0xBA};

	assert_int_equal(modbus_answer_length(&request), sizeof(answer));
	for (size_t length = 0; length < sizeof(answer); length++)
		assert_int_equal(modbus_answer_judge(&request, answer, length), MODBUS_INCOMPLETE);
	assert_int_equal(modbus_answer_judge(&request, answer, sizeof(answer)), MODBUS_ANSWER);
	assert_int_equal(modbus_register(answer + 3, 0), 0x022B);
	assert_int_equal(modbus_register(answer + 3, 2), 0x64);
}

static void test_every_single_bit_error_is_found(void **state)
{
	(void)state;
	const struct modbus_request request = {0x11, 1, 0x13, 0x25, {0}};
	uint8_t answer[] = {0x11, 1, 5, 0xCD, 0x6B, 0xB2, 0x0E, 0x1B, 0x45, 0xE6};

	assert_int_equal(modbus_answer_judge(&request, answer, sizeof(answer)), MODBUS_ANSWER);
	for (size_t bit = 0; bit < 8 * sizeof(answer); bit++) {
		answer[bit / 8] ^= (uint8_t)(1u << (bit % 8));
		assert_int_not_equal(modbus_answer_judge(&request, answer, sizeof(answer)), MODBUS_ANSWER);
		answer[bit / 8] ^= (uint8_t)(1u << (bit % 8));
	}
	assert_true(modbus_bit(answer + 3, 0));
	assert_false(modbus_bit(answer + 3, 1));
	assert_true(modbus_bit(answer + 3, 36));
}

static void test_exceptions(void **state)
{
	(void)state;
	const struct modbus_request request = {10, 1, 0x4A1, 1, {0}};
	uint8_t answer[] = {10, 0x81, 2, 0xB0, 0x53};

	assert_int_equal(modbus_answer_judge(&request, answer, 4), MODBUS_INCOMPLETE);
	assert_int_equal(modbus_answer_missing(&request, answer, 1, true), 4);
	assert_int_equal(modbus_answer_missing(&request, answer, 1, false), 5);
	assert_int_equal(modbus_answer_missing(&request, answer, 4, false), 1);
	assert_int_equal(modbus_answer_judge(&request, answer, 5), MODBUS_EXCEPTION);
	answer[2] = 3;
	assert_int_equal(modbus_answer_judge(&request, answer, 5), MODBUS_GARBLED);
	answer[1] = 0x82;
	assert_int_equal(modbus_answer_judge(&request, answer, sealed(answer, 3)), MODBUS_NOT_ITS_OWN);
}

static void test_foreign_answers(void **state)
{
	(void)state;
	const struct modbus_request request = {17, 3, 0, 1, {0}};
	uint8_t frame[] = {17, 3, 2, 0, 1, 0, 0};

	assert_int_equal(modbus_answer_judge(&request, frame, sealed(frame, 5)), MODBUS_ANSWER);
	frame[0] = 18;
	assert_int_equal(modbus_answer_judge(&request, frame, 1), MODBUS_NOT_ITS_OWN);
	frame[0] = 17;
	frame[1] = 4;
	assert_int_equal(modbus_answer_judge(&request, frame, 2), MODBUS_NOT_ITS_OWN);
	frame[1] = 3;
	frame[2] = 4;
	assert_int_equal(modbus_answer_judge(&request, frame, 3), MODBUS_NOT_ITS_OWN);
}

static void assert_echo(struct modbus_request request, const uint8_t fields[4])
{
	uint8_t frame[MODBUS_FRAME_MAX] = {request.unit, request.function};

	memcpy(frame + 2, fields, 4);
	assert_int_equal(modbus_answer_length(&request), 8);
	assert_int_equal(modbus_answer_judge(&request, frame, sealed(frame, 6)), MODBUS_ANSWER);
	for (size_t i = 2; i < 6; i++) {
		frame[i]++;
		assert_int_equal(modbus_answer_judge(&request, frame, sealed(frame, 6)), MODBUS_NOT_ITS_OWN);
		frame[i]--;
	}
}

static void test_answer_to_a_masked_write_must_echo_both_masks(void **state)
{
	(void)state;
	const struct modbus_request request = {9, 22, 0x102, 1, {0xFFF7, 0x0008}};
	uint8_t frame[MODBUS_FRAME_MAX] = {9, 22, 1, 2, 0xFF, 0xF7, 0, 8};
	size_t length = sealed(frame, 8);

	assert_frame(request, frame, length);
	assert_int_equal(modbus_answer_length(&request), 10);
	assert_int_equal(modbus_answer_judge(&request, frame, length), MODBUS_ANSWER);
	for (size_t i = 2; i < 8; i++) {
		frame[i]++;
		assert_int_equal(modbus_answer_judge(&request, frame, sealed(frame, 8)), MODBUS_NOT_ITS_OWN);
		frame[i]--;
	}
}

static void test_answers_to_writes_must_echo(void **state)
{
	(void)state;
	assert_echo((struct modbus_request){9, 5, 0x102, 1, {1}}, (const uint8_t[]){1, 2, 0xFF, 0});
	assert_echo((struct modbus_request){9, 6, 0x102, 1, {0xABCD}}, (const uint8_t[]){1, 2, 0xAB, 0xCD});
	assert_echo((struct modbus_request){9, 15, 0x102, 2, {1, 0}}, (const uint8_t[]){1, 2, 0, 2});
	assert_echo((struct modbus_request){9, 16, 0x102, 2, {7, 8}}, (const uint8_t[]){1, 2, 0, 2});
}

static uint32_t random_next(uint32_t *seed)
{
	*seed = *seed * 1664525u + 1013904223u;
	return *seed >> 8;
}

/* The bytes lie at the end of an allocation, so that the sanitizer sees a read beyond them. */
static void test_hostile_bytes(void **state)
{
	(void)state;
	static const uint8_t functions[] = {1, 2, 3, 4, 5, 6, 15, 16};
	uint32_t seed = 20261120;
	uint8_t *bytes = test_malloc(MODBUS_FRAME_MAX);

	for (int round = 0; round < FUZZ_ROUNDS; round++) {
		uint8_t function = functions[random_next(&seed) % sizeof(functions)];
		struct modbus_request request = {
		    (uint8_t)(random_next(&seed) % 3), function, (uint16_t)random_next(&seed), 1, {0}};
		size_t length = random_next(&seed) % 12;
		uint8_t *start = bytes + MODBUS_FRAME_MAX - length;

		request.count = (uint16_t)(1 + random_next(&seed) % (modbus_is_read(function) ? 125 : 2));
		for (size_t i = 0; i < length; i++)
			start[i] = (uint8_t)random_next(&seed);
		if (length > 2 && random_next(&seed) % 2) {
			start[0] = request.unit;
			start[1] = function | (random_next(&seed) % 2 ? MODBUS_EXCEPTION_BIT : 0);
		}
		enum modbus_verdict verdict = modbus_answer_judge(&request, start, length);
		if (verdict == MODBUS_ANSWER)
			assert_true(modbus_crc_valid(start, modbus_answer_length(&request)));
		if (verdict == MODBUS_EXCEPTION)
			assert_true(modbus_crc_valid(start, 5));
	}
	test_free(bytes);
}

int main(void)
{
	const struct CMUnitTest tests[] = {
	    cmocka_unit_test(test_writes_of_the_report),
	    cmocka_unit_test(test_requests_of_every_function),
	    cmocka_unit_test(test_answer_is_complete_at_its_last_byte),
	    cmocka_unit_test(test_every_single_bit_error_is_found),
	    cmocka_unit_test(test_exceptions),
	    cmocka_unit_test(test_foreign_answers),
	    cmocka_unit_test(test_answer_to_a_masked_write_must_echo_both_masks),
	    cmocka_unit_test(test_answers_to_writes_must_echo),
	    cmocka_unit_test(test_hostile_bytes),
	};
	return cmocka_run_group_tests_name("modbus frame", tests, NULL, NULL);
}
