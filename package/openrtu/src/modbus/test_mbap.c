/* SPDX-License-Identifier: GPL-3.0-or-later */
#include <setjmp.h>
#include <stdarg.h>
#include <stddef.h>
#include <stdint.h>

#include <cmocka.h>

#include "modbus/mbap.h"

static size_t framed(const struct modbus_request *request, uint16_t transaction, uint8_t *frame)
{
	return modbus_mbap_seal(frame, transaction, modbus_request_body(request, frame + MODBUS_MBAP_PREFIX));
}

/* MODBUS Messaging on TCP/IP Implementation Guide V1.0b, 4.4.1.2: the example of an ADU, register 5 of unit 255. */
static void test_the_guides_own_request(void **state)
{
	(void)state;
	static const uint8_t expected[] = {0x15, 0x01, 0, 0, 0, 6, 0xFF, 3, 0, 4, 0, 1};
	const struct modbus_request request = {255, MODBUS_READ_HOLDING_REGISTERS, 4, 1, {0}};
	uint8_t frame[MODBUS_FRAME_MAX];

	assert_int_equal(framed(&request, 0x1501, frame), sizeof(expected));
	assert_memory_equal(frame, expected, sizeof(expected));
}

static void test_a_write_of_two_registers(void **state)
{
	(void)state;
	static const uint8_t expected[] = {0xFF, 0xFF, 0, 0, 0, 11, 17, 16, 0, 1, 0, 2, 4, 0, 0x0A, 1, 2};
	const struct modbus_request request = {17, MODBUS_WRITE_REGISTERS, 1, 2, {0x0A, 0x0102}};
	uint8_t frame[MODBUS_FRAME_MAX];

	assert_int_equal(framed(&request, UINT16_MAX, frame), sizeof(expected));
	assert_memory_equal(frame, expected, sizeof(expected));
}

/* The length comes with the sixth octet. */
static void test_the_length_is_known_with_its_field(void **state)
{
	(void)state;
	static const uint8_t head[] = {1, 2, 0, 0, 0, 5};

	for (size_t length = 0; length < sizeof(head); length++)
		assert_true(modbus_mbap_length(head, length) > length);
	assert_int_equal(modbus_mbap_length(head, sizeof(head)), 11);
}

static size_t length_of(uint8_t protocol_high, uint8_t protocol_low, uint16_t field)
{
	const uint8_t head[] = {
	    0, 9, protocol_high, protocol_low, (uint8_t)(field >> 8), (uint8_t)(field & 0xFF)};

	return modbus_mbap_length(head, sizeof(head));
}

static void test_no_other_protocol_and_no_impossible_length(void **state)
{
	(void)state;
	assert_int_equal(length_of(0, 0, 2), 8);
	assert_int_equal(length_of(0, 0, 254), MODBUS_MBAP_FRAME_MAX);
	assert_int_equal(length_of(0, 0, 0), 0);
	assert_int_equal(length_of(0, 0, 1), 0);
	assert_int_equal(length_of(0, 0, 255), 0);
	assert_int_equal(length_of(0, 0, UINT16_MAX), 0);
	assert_int_equal(length_of(0, 1, 6), 0);
	assert_int_equal(length_of(1, 0, 6), 0);
}

static void test_a_body_is_judged_as_a_whole(void **state)
{
	(void)state;
	const struct modbus_request read = {255, MODBUS_READ_HOLDING_REGISTERS, 4, 1, {0}};
	const uint8_t answer[] = {255, 3, 2, 1, 2, 0}, refusal[] = {255, 0x83, 11, 0};

	assert_int_equal(modbus_body_judge(&read, answer, 5), MODBUS_ANSWER);
	assert_int_equal(modbus_body_judge(&read, answer, 4), MODBUS_NOT_ITS_OWN);
	assert_int_equal(modbus_body_judge(&read, answer, 6), MODBUS_NOT_ITS_OWN);
	assert_int_equal(modbus_body_judge(&read, refusal, 3), MODBUS_EXCEPTION);
	assert_int_equal(modbus_body_judge(&read, refusal, 2), MODBUS_NOT_ITS_OWN);
	assert_int_equal(modbus_body_judge(&read, refusal, 4), MODBUS_NOT_ITS_OWN);
	assert_int_equal(modbus_body_judge(&read, (const uint8_t[]){1, 3, 2, 1, 2}, 5), MODBUS_NOT_ITS_OWN);
	assert_int_equal(modbus_body_judge(&read, (const uint8_t[]){255, 4, 2, 1, 2}, 5), MODBUS_NOT_ITS_OWN);
}

int main(void)
{
	const struct CMUnitTest tests[] = {
	    cmocka_unit_test(test_the_guides_own_request),
	    cmocka_unit_test(test_a_write_of_two_registers),
	    cmocka_unit_test(test_the_length_is_known_with_its_field),
	    cmocka_unit_test(test_no_other_protocol_and_no_impossible_length),
	    cmocka_unit_test(test_a_body_is_judged_as_a_whole),
	};
	return cmocka_run_group_tests_name("modbus mbap", tests, NULL, NULL);
}
