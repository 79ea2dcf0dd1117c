/* SPDX-License-Identifier: GPL-3.0-or-later */
/* End of initialisation, and the reset of the process. */
#include "iec104/test_masters.h"

#define EXPECT_END(master, cause)                                                                            \
	do {                                                                                                 \
		EXPECT(master, M_EI_NA, 1, INITIALISED, 0, CA_3067, IOA(0), cause);                          \
		EXPECT(master, M_EI_NA, 1, INITIALISED, 0, CA_4001, IOA(0), cause);                          \
	} while (0)

static int set_up_at_start(void **state)
{
	(void)state;
	fake_begin();
	fake.starts = 1;
	iec104_station_init(&station, &fake, sent_ns, places);
	return 0;
}

#define AT_START(name) cmocka_unit_test_setup(name, set_up_at_start)

static void all_read(void)
{
	for (uint32_t i = 0; i < POINTS; i++)
		fake.samples[i].time_ns = now;
}

static void test_the_first_connection_is_told(void **state)
{
	(void)state;
	all_read();
	connect_master(0, true);
	start(0);
	EXPECT_END(0, 0);
	expect_nothing(0);
	connect_master(1, true);
	start(1);
	expect_nothing(1);
	assert_int_equal(fake.note, 1);
}

static void test_all_that_wait_are_told_when_the_last_device_was_asked(void **state)
{
	(void)state;
	all_read();
	fake.samples[FLOAT].time_ns = 0;
	connect_master(0, true);
	connect_master(1, true);
	connect_master(2, true);
	start(0);
	start(1);
	expect_nothing(0);
	assert_true(iec104_station_deadline(&station) <= now + 200 * MS);
	fake.samples[FLOAT] = (struct map_sample){.quality = MAP_INVALID, .time_ns = now}; /* it is dead */
	run();
	EXPECT_END(0, 0);
	EXPECT_END(1, 0);
	start(2);
	expect_nothing(2);
	assert_true(iec104_station_deadline(&station) > now + 200 * MS);
}

static void test_it_does_not_wait_for_ever(void **state)
{
	const uint8_t *frame;
	unsigned told = 0;

	(void)state;
	connect_master(0, true);
	start(0);
	expect_nothing(0);
	for (int i = 0; i < 31; i++) {
		now += 1000 * MS;
		put_bytes(&masters[0], (const uint8_t[]){0x68, 4, 0x43, 0, 0, 0}, 6);
		while ((frame = next_frame(&masters[0])) != NULL)
			told += (frame[2] & 1) == 0 && frame[6] == 70;
		acknowledge(&masters[0]);
		assert_int_equal(told, i < 29 ? 0 : DEVICES);
	}
}

static void test_a_restart_of_the_process_alone_is_none(void **state)
{
	(void)state;
	fake.note = 1;
	all_read();
	connect_master(0, true);
	start(0);
	expect_nothing(0);
}

static void test_after_a_reset_it_is_another(void **state)
{
	(void)state;
	fake.note = 1;
	fake.starts = 2;
	all_read();
	connect_master(0, true);
	start(0);
	EXPECT_END(0, 2);
	expect_nothing(0);
}

static void test_reset_of_the_process(void **state)
{
	(void)state;
	ASK(0, C_RP_NA, 1, ACT, 3, CA_4001, IOA(0), 1);
	expect_nothing(0);
	assert_int_equal(fake.request_count, 1);
	assert_int_equal(fake.requests[0].action, MAP_RESTART);
	answer(1, MAP_EXECUTED_COMMAND, MAP_RESULT_DONE);
	run();
	EXPECT(0, C_RP_NA, 1, ACT_CON, 3, CA_4001, IOA(0), 1);
	ASK(0, C_RP_NA, 1, ACT, 3, CA_ALL, IOA(0), 1);
	answer(2, MAP_EXECUTED_COMMAND, MAP_RESULT_DONE);
	run();
	EXPECT(0, C_RP_NA, 1, ACT_CON, 3, CA_3067, IOA(0), 1);
	EXPECT(0, C_RP_NA, 1, ACT_CON, 3, CA_4001, IOA(0), 1);
	ASK(0, C_RP_NA, 1, ACT, 3, CA_4001, IOA(0), 1);
	answer(3, MAP_REFUSED_COMMAND, MAP_RESULT_INTERLOCK);
	run();
	EXPECT(0, C_RP_NA, 1, NEGATIVE | ACT_CON, 3, CA_4001, IOA(0), 1);
	ASK(0, C_RP_NA, 1, TEST_BIT | ACT, 3, CA_4001, IOA(0), 1); /* test */
	EXPECT(0, C_RP_NA, 1, TEST_BIT | ACT_CON, 3, CA_4001, IOA(0), 1);
	assert_int_equal(fake.request_count, 3);
	expect_nothing(0);
}

static void test_reset_of_waiting_events(void **state)
{
	(void)state;
	hold_back(0);
	publish(7, 1);
	ASK(0, C_RP_NA, 1, ACT, 0, CA_4001, IOA(0), 2); /* of one station of two */
	acknowledge(&masters[0]);
	EXPECT(0, C_RP_NA, 1, NEGATIVE | ACT_CON, 0, CA_4001, IOA(0), 2);
	EXPECT(0, M_ME_TE, 1, SPONTANEOUS, 0, CA_3067, IOA(30001), 1, 0, 0, TIME);
	acknowledge(&masters[0]);
	hold_back(0);
	publish(7, 2);
	ASK(0, C_RP_NA, 1, ACT, 0, CA_ALL, IOA(0), 2);
	acknowledge(&masters[0]);
	EXPECT(0, C_RP_NA, 1, ACT_CON, 0, CA_3067, IOA(0), 2);
	EXPECT(0, C_RP_NA, 1, ACT_CON, 0, CA_4001, IOA(0), 2);
	expect_nothing(0);
	publish(7, 3);
	run();
	EXPECT(0, M_ME_TE, 1, SPONTANEOUS, 0, CA_3067, IOA(30001), 3, 0, 0, TIME);
}

static void test_other_resets_are_refused(void **state)
{
	static const uint8_t wrong[] = {0, 3, 127, 128, 255};

	(void)state;
	for (size_t i = 0; i < sizeof(wrong); i++) {
		ASK(0, C_RP_NA, 1, ACT, 0, CA_ALL, IOA(0), wrong[i]);
		EXPECT(0, C_RP_NA, 1, NEGATIVE | ACT_CON, 0, CA_ALL, IOA(0), wrong[i]);
	}
	ASK(0, C_RP_NA, 1, DEACT, 0, CA_ALL, IOA(0), 1);
	EXPECT(0, C_RP_NA, 1, NEGATIVE | UNKNOWN_CAUSE, 0, CA_ALL, IOA(0), 1);
	ASK(0, C_RP_NA, 1, ACT, 0, CA_3067, IOA(1), 1);
	EXPECT(0, C_RP_NA, 1, NEGATIVE | UNKNOWN_IOA, 0, CA_3067, IOA(1), 1);
	assert_int_equal(fake.request_count, 0);
}

int main(void)
{
	const struct CMUnitTest tests[] = {
	    AT_START(test_the_first_connection_is_told),
	    AT_START(test_all_that_wait_are_told_when_the_last_device_was_asked),
	    AT_START(test_it_does_not_wait_for_ever),
	    AT_START(test_a_restart_of_the_process_alone_is_none),
	    AT_START(test_after_a_reset_it_is_another),
	    TEST(test_reset_of_the_process),
	    TEST(test_reset_of_waiting_events),
	    TEST(test_other_resets_are_refused),
	};

	return cmocka_run_group_tests(tests, NULL, NULL);
}
