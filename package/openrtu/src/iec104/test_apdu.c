/* SPDX-License-Identifier: GPL-3.0-or-later */
#include <setjmp.h>
#include <stdarg.h>
#include <stddef.h>
#include <stdint.h>

#include <cmocka.h>

#include "iec104/apdu.h"

static void test_size_from_the_first_octets(void **state)
{
	const uint8_t frame[] = {0x68, 0x0e};

	(void)state;
	assert_int_equal(iec104_apdu_size(frame, 0), 0);
	assert_int_equal(iec104_apdu_size(frame, 1), 0);
	assert_int_equal(iec104_apdu_size(frame, 2), 16);
}

static void test_start_octet(void **state)
{
	(void)state;
	for (int octet = 0; octet < 256; octet++) {
		const uint8_t frame[] = {(uint8_t)octet};

		assert_int_equal(iec104_apdu_size(frame, 1), octet == 0x68 ? 0 : -1);
	}
}

static void test_length_octet(void **state)
{
	(void)state;
	for (int length = 0; length < 256; length++) {
		const uint8_t frame[] = {0x68, (uint8_t)length};

		assert_int_equal(iec104_apdu_size(frame, 2), length >= 4 && length <= 253 ? length + 2 : -1);
	}
}

/* Every value of the first control octet: I when bit 0 is 0, S is 01 alone, U is one of six. */
static void test_control_octet(void **state)
{
	(void)state;
	for (int octet = 0; octet < 256; octet++) {
		const uint8_t frame[] = {0x68, 4, (uint8_t)octet, 0, 0, 0};
		struct iec104_apdu apdu;
		bool valid = octet == 0x01 || octet == 0x07 || octet == 0x0b || octet == 0x13 ||
			     octet == 0x23 || octet == 0x43 || octet == 0x83;

		assert_int_equal(iec104_apdu_decode(frame, sizeof(frame), &apdu), valid);
	}
}

static void test_reserved_bits(void **state)
{
	static const uint8_t wrong[][8] = {
	    {0x68, 4, 0x01, 0x01, 0, 0},    {0x68, 4, 0x01, 0, 0x01, 0}, {0x68, 4, 0x43, 0x01, 0, 0},
	    {0x68, 4, 0x43, 0, 0x02, 0},    {0x68, 4, 0x43, 0, 0, 0x01}, {0x68, 6, 0x43, 0, 0, 0, 0, 0},
	    {0x68, 6, 0x00, 0, 0x01, 0, 1}, {0x68, 6, 0x01, 0, 0, 0},
	};
	struct iec104_apdu apdu;

	(void)state;
	for (size_t i = 0; i < sizeof(wrong) / sizeof(wrong[0]); i++)
		assert_false(iec104_apdu_decode(wrong[i], (size_t)wrong[i][1] + 2, &apdu));
}

static void test_i_frame(void **state)
{
	const uint8_t frame[] = {0x68, 0x05, 0xfe, 0xff, 0x02, 0x01, 0x2a};
	uint8_t encoded[IEC104_APCI_SIZE];
	struct iec104_apdu apdu;

	(void)state;
	assert_true(iec104_apdu_decode(frame, sizeof(frame), &apdu));
	assert_int_equal(apdu.format, IEC104_I_FRAME);
	assert_int_equal(apdu.ns, 32767);
	assert_int_equal(apdu.nr, 129);
	assert_int_equal(apdu.asdu_size, 1);
	assert_ptr_equal(apdu.asdu, frame + 6);
	iec104_apdu_encode(encoded, &apdu);
	assert_memory_equal(encoded, frame, sizeof(encoded));
}

static void test_s_and_u_frames(void **state)
{
	static const uint8_t frames[][6] = {
	    {0x68, 4, 0x01, 0, 0x0a, 0},
	    {0x68, 4, 0x01, 0, 0xfe, 0xff},
	    {0x68, 4, 0x07, 0, 0, 0},
	    {0x68, 4, 0x83, 0, 0, 0},
	};
	uint8_t encoded[IEC104_APCI_SIZE];
	struct iec104_apdu apdu;

	(void)state;
	for (size_t i = 0; i < sizeof(frames) / sizeof(frames[0]); i++) {
		assert_true(iec104_apdu_decode(frames[i], 6, &apdu));
		iec104_apdu_encode(encoded, &apdu);
		assert_memory_equal(encoded, frames[i], 6);
	}
	assert_true(iec104_apdu_decode(frames[0], 6, &apdu));
	assert_int_equal(apdu.nr, 5);
}

int main(void)
{
	const struct CMUnitTest tests[] = {
	    cmocka_unit_test(test_size_from_the_first_octets),
	    cmocka_unit_test(test_start_octet),
	    cmocka_unit_test(test_length_octet),
	    cmocka_unit_test(test_control_octet),
	    cmocka_unit_test(test_reserved_bits),
	    cmocka_unit_test(test_i_frame),
	    cmocka_unit_test(test_s_and_u_frames),
	};

	return cmocka_run_group_tests(tests, NULL, NULL);
}
