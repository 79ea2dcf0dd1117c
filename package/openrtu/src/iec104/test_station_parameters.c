/* SPDX-License-Identifier: GPL-3.0-or-later */
/* Parameters of measured values, their activation, and what an interrogation says of them. */
#include "iec104/test_masters.h"

static void expect_request(unsigned number, uint32_t point, enum map_parameter kind, uint32_t value)
{
	const struct map_request *request = &fake.requests[number - 1];

	assert_int_equal(fake.request_count, number);
	assert_int_equal(request->action, MAP_PARAMETER);
	assert_int_equal(request->point, point);
	assert_int_equal(request->detail, kind);
	assert_int_equal(request->value.u, value);
}

static void test_a_parameter_is_confirmed_by_its_owner(void **state)
{
	(void)state;
	ASK(0, P_ME_NA, 1, ACT, 3, CA_4001, IOA(9), 0x00, 0x40, 1); /* 0.5 */
	expect_nothing(0);
	expect_request(1, NORMALIZED, MAP_THRESHOLD, 0x4000);
	answer(1, MAP_EXECUTED_COMMAND, MAP_RESULT_DONE);
	run();
	EXPECT(0, P_ME_NA, 1, ACT_CON, 3, CA_4001, IOA(9), 0x00, 0x40, 1);
	ASK(0, P_ME_NB, 1, ACT, 0, CA_3067, IOA(30001), 0xfe, 0xff, 3);
	expect_request(2, 7, MAP_LOW_LIMIT, (uint32_t)-2);
	answer(2, MAP_REFUSED_COMMAND, MAP_RESULT_OUT_OF_RANGE);
	run();
	EXPECT(0, P_ME_NB, 1, NEGATIVE | ACT_CON, 0, CA_3067, IOA(30001), 0xfe, 0xff, 3);
	ASK(0, P_ME_NC, 1, ACT, 0, CA_4001, IOA(11), 0, 0, 0x80, 0x3f, 2); /* 1.0 */
	expect_request(3, FLOAT, MAP_SMOOTHING, 0x3f800000);
	answer(3, MAP_EXECUTED_COMMAND, MAP_RESULT_DONE);
	run();
	EXPECT(0, P_ME_NC, 1, ACT_CON, 0, CA_4001, IOA(11), 0, 0, 0x80, 0x3f, 2);
	expect_nothing(0);
	assert_int_equal(fake.request_count, 3); /* no command side was released */
}

static void test_reserved_qualifiers_are_refused(void **state)
{
	static const uint8_t wrong[] = {0, 5, 63, 0x41, 0x81, 0xc1};

	(void)state;
	for (size_t i = 0; i < sizeof(wrong); i++) {
		ASK(0, P_ME_NB, 1, ACT, 0, CA_3067, IOA(30001), 1, 0, wrong[i]);
		EXPECT(0, P_ME_NB, 1, NEGATIVE | ACT_CON, 0, CA_3067, IOA(30001), 1, 0, wrong[i]);
	}
	for (uint8_t qualifier = 0; qualifier < 5; qualifier++) {
		if (qualifier == 3)
			continue;
		ASK(0, P_AC_NA, 1, ACT, 0, CA_4001, IOA(9), qualifier);
		EXPECT(0, P_AC_NA, 1, NEGATIVE | ACT_CON, 0, CA_4001, IOA(9), qualifier);
	}
	assert_int_equal(fake.request_count, 0);
}

static void test_refusals(void **state)
{
	(void)state;
	ASK(0, P_ME_NA, 1, ACT, 0, CA_3067, IOA(30001), 1, 0, 1); /* a scaled value's */
	EXPECT(0, P_ME_NA, 1, NEGATIVE | UNKNOWN_IOA, 0, CA_3067, IOA(30001), 1, 0, 1);
	ASK(0, P_ME_NB, 1, ACT, 0, CA_3067, IOA(1), 1, 0, 1);
	EXPECT(0, P_ME_NB, 1, NEGATIVE | UNKNOWN_IOA, 0, CA_3067, IOA(1), 1, 0, 1);
	ASK(0, P_AC_NA, 1, ACT, 0, CA_4001, IOA(15), 3);
	EXPECT(0, P_AC_NA, 1, NEGATIVE | UNKNOWN_IOA, 0, CA_4001, IOA(15), 3);
	ASK(0, P_ME_NB, 1, DEACT, 0, CA_3067, IOA(30001), 1, 0, 1); /* nobody deactivates a value */
	EXPECT(0, P_ME_NB, 1, NEGATIVE | UNKNOWN_CAUSE, 0, CA_3067, IOA(30001), 1, 0, 1);
	ASK(0, P_ME_NB, 1, ACT, 0, CA_ALL, IOA(30001), 1, 0, 1);
	EXPECT(0, P_ME_NB, 1, NEGATIVE | UNKNOWN_CA, 0, CA_ALL, IOA(30001), 1, 0, 1);
	fake.dead[1] = true;
	ASK(0, P_ME_NB, 1, ACT, 0, CA_3067, IOA(30001), 1, 0, 1);
	EXPECT(0, P_ME_NB, 1, NEGATIVE | ACT_CON, 0, CA_3067, IOA(30001), 1, 0, 1);
	ASK(0, P_ME_NB, 1, TEST_BIT | ACT, 0, CA_3067, IOA(30001), 1, 0, 1);
	EXPECT(0, P_ME_NB, 1, TEST_BIT | ACT_CON, 0, CA_3067, IOA(30001), 1, 0, 1);
	assert_int_equal(fake.request_count, 0);
}

static void test_cyclic_transmission_is_stopped_and_started(void **state)
{
	(void)state;
	ASK(0, P_AC_NA, 1, DEACT, 0, CA_4001, IOA(9), 3);
	expect_request(1, NORMALIZED, MAP_CYCLIC, 0);
	answer(1, MAP_EXECUTED_COMMAND, MAP_RESULT_DONE);
	run();
	EXPECT(0, P_AC_NA, 1, DEACT_CON, 0, CA_4001, IOA(9), 3);
	fake.parameters[NORMALIZED].loaded = 1u << MAP_CYCLIC;
	now += 1000 * MS;
	expect_nothing(0);
	ASK(0, P_AC_NA, 1, ACT, 0, CA_4001, IOA(9), 3);
	expect_request(2, NORMALIZED, MAP_CYCLIC, 1);
	fake.parameters[NORMALIZED].loaded = 0;
	answer(2, MAP_EXECUTED_COMMAND, MAP_RESULT_DONE);
	run();
	EXPECT(0, P_AC_NA, 1, ACT_CON, 0, CA_4001, IOA(9), 3);
	now += 1000 * MS;
	run();
	EXPECT(0, M_ME_NA, 1, CYCLIC, 0, CA_4001, IOA(9), 0, 0, 0);
}

static void test_an_interrogation_brings_what_was_loaded(void **state)
{
	(void)state;
	fake.parameters[NORMALIZED] = (struct map_parameters){
	    .loaded = 1u << MAP_THRESHOLD | 1u << MAP_HIGH_LIMIT, .values = {{.i = 2}, {0}, {0}, {.i = -3}}};
	fake.parameters[FLOAT] =
	    (struct map_parameters){.loaded = 1u << MAP_SMOOTHING, .values = {{0}, {.f = 1.5f}}};
	ASK(0, C_IC_NA, 1, ACT, 7, CA_4001, IOA(0), 22); /* group 2 */
	EXPECT(0, C_IC_NA, 1, ACT_CON, 7, CA_4001, IOA(0), 22);
	EXPECT(0, M_DP_NA, 1, INTERROGATED + 2, 7, CA_4001, IOA(1), 1);
	EXPECT(0, M_ME_NA, 1, INTERROGATED + 2, 7, CA_4001, IOA(9), 0, 0, 0);
	EXPECT(0, P_ME_NA, 2, INTERROGATED + 2, 7, CA_4001, IOA(9), 2, 0, 1, 9, 0, 0, 0xfd, 0xff, 4);
	EXPECT(0, C_IC_NA, 1, ACT_TERM, 7, CA_4001, IOA(0), 22);
	acknowledge(&masters[0]);
	ASK(0, C_IC_NA, 1, ACT, 7, CA_4001, IOA(0), 20);
	for (int i = 0; i < 6; i++)
		assert_non_null(next_frame(&masters[0])); /* confirmation, five types of values */
	EXPECT(0, P_ME_NA, 2, INTERROGATED, 7, CA_4001, IOA(9), 2, 0, 1, 9, 0, 0, 0xfd, 0xff, 4);
	EXPECT(0, P_ME_NC, 1, INTERROGATED, 7, CA_4001, IOA(11), 0, 0, 0xc0, 0x3f, 2);
	EXPECT(0, C_IC_NA, 1, ACT_TERM, 7, CA_4001, IOA(0), 20);
	expect_nothing(0);
}

int main(void)
{
	const struct CMUnitTest tests[] = {
	    TEST(test_a_parameter_is_confirmed_by_its_owner),
	    TEST(test_reserved_qualifiers_are_refused),
	    TEST(test_refusals),
	    TEST(test_cyclic_transmission_is_stopped_and_started),
	    TEST(test_an_interrogation_brings_what_was_loaded),
	};

	return cmocka_run_group_tests(tests, NULL, NULL);
}
