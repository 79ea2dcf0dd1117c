/* SPDX-License-Identifier: GPL-3.0-or-later */
/* Counter interrogation: groups, frozen readings, freezes and what becomes of them. */
#include "iec104/test_masters.h"

/* A second counter, of counter group 3, at CA 3067. */
#define COUNTER_3067 9

static int set_up_counters(void **state)
{
	points[COUNTER_3067] =
	    (struct map_point){.set = 0, .type = MAP_COUNTER, .ioa = 30003, .counter_group = 3};
	points[COUNTER].counter_group = 1;
	return set_up(state);
}

#define COUNTERS(name) cmocka_unit_test_setup(name, set_up_counters)

static void freeze_total(uint32_t point, uint32_t value, uint8_t detail, uint8_t quality)
{
	fake.totals[point] =
	    (struct map_sample){.value.u = value, .detail = detail, .quality = quality, .time_ns = now};
}

static void test_frozen_readings_are_read(void **state)
{
	(void)state;
	freeze_total(COUNTER, 0x01020304, 31 | MAP_COUNTER_CARRY | MAP_COUNTER_ADJUSTED, MAP_INVALID);
	fake.samples[COUNTER].value.u = 7;
	ASK(0, C_CI_NA, 1, ACT, 4, CA_4001, IOA(0), 5);
	EXPECT(0, C_CI_NA, 1, ACT_CON, 4, CA_4001, IOA(0), 5);
	EXPECT(0, M_IT_NA, 1, COUNTERS_REQUESTED, 4, CA_4001, IOA(15), 4, 3, 2, 1, 0xff);
	EXPECT(0, C_CI_NA, 1, ACT_TERM, 4, CA_4001, IOA(0), 5);
	/* a read command asks for the value of now */
	ASK(0, C_RD_NA, 1, REQUEST, 4, CA_4001, IOA(15));
	EXPECT(0, M_IT_NA, 1, REQUEST, 4, CA_4001, IOA(15), 7, 0, 0, 0, 0);
	expect_nothing(0);
}

static void test_groups(void **state)
{
	(void)state;
	fake.samples[COUNTER].value.u = 5;
	for (uint8_t group = 1; group <= 4; group++) {
		ASK(0, C_CI_NA, 1, ACT, 0, CA_4001, IOA(0), group);
		EXPECT(0, C_CI_NA, 1, ACT_CON, 0, CA_4001, IOA(0), group);
		if (group == 1)
			EXPECT(0, M_IT_NA, 1, COUNTERS_REQUESTED + 1, 0, CA_4001, IOA(15), 5, 0, 0, 0, 0);
		EXPECT(0, C_CI_NA, 1, ACT_TERM, 0, CA_4001, IOA(0), group);
		acknowledge(&masters[0]);
	}
	ASK(0, C_CI_NA, 1, ACT, 0, CA_3067, IOA(0), 3);
	EXPECT(0, C_CI_NA, 1, ACT_CON, 0, CA_3067, IOA(0), 3);
	EXPECT(0, M_IT_NA, 1, COUNTERS_REQUESTED + 3, 0, CA_3067, IOA(30003), 1, 0, 0, 0, 0);
	EXPECT(0, C_CI_NA, 1, ACT_TERM, 0, CA_3067, IOA(0), 3);
}

static void test_a_freeze_is_confirmed_when_it_was_carried_out(void **state)
{
	(void)state;
	for (uint8_t mode = MAP_FREEZE_ONLY; mode <= MAP_RESET_ONLY; mode++) {
		uint8_t qualifier = (uint8_t)(mode << 6 | 1);

		ASK(0, C_CI_NA, 1, ACT, 4, CA_4001, IOA(0), qualifier);
		expect_nothing(0);
		assert_int_equal(fake.request_count, mode);
		assert_int_equal(fake.requests[mode - 1].action, MAP_FREEZE);
		assert_int_equal(fake.requests[mode - 1].point, COUNTER);
		assert_int_equal(fake.requests[mode - 1].detail, mode);
		assert_int_equal(fake.requests[mode - 1].value.u, 1);
		answer(mode, MAP_EXECUTED_COMMAND, MAP_RESULT_DONE);
		run();
		EXPECT(0, C_CI_NA, 1, ACT_CON, 4, CA_4001, IOA(0), qualifier);
		EXPECT(0, C_CI_NA, 1, ACT_TERM, 4, CA_4001, IOA(0), qualifier);
		expect_nothing(0);
	}
}

static void test_a_freeze_of_all_stations_waits_for_all_owners(void **state)
{
	(void)state;
	ASK(0, C_CI_NA, 1, ACT, 0, CA_ALL, IOA(0), 0x45);
	assert_int_equal(fake.request_count, 2);
	assert_int_equal(fake.requests[0].value.u, MAP_FREEZE_ALL_DEVICES);
	answer(2, MAP_EXECUTED_COMMAND, MAP_RESULT_DONE);
	expect_nothing(0);
	answer(1, MAP_EXECUTED_COMMAND, MAP_RESULT_DONE);
	run();
	EXPECT(0, C_CI_NA, 1, ACT_CON, 0, CA_3067, IOA(0), 0x45);
	EXPECT(0, C_CI_NA, 1, ACT_TERM, 0, CA_3067, IOA(0), 0x45);
	EXPECT(0, C_CI_NA, 1, ACT_CON, 0, CA_4001, IOA(0), 0x45);
	EXPECT(0, C_CI_NA, 1, ACT_TERM, 0, CA_4001, IOA(0), 0x45);
	expect_nothing(0);
}

static void test_a_freeze_fails_with_any_owner(void **state)
{
	(void)state;
	fake.silent[2] = true;
	ASK(0, C_CI_NA, 1, ACT, 0, CA_ALL, IOA(0), 0x45);
	EXPECT(0, C_CI_NA, 1, NEGATIVE | ACT_CON, 0, CA_ALL, IOA(0), 0x45);
	assert_int_equal(fake.request_count, 0); /* nobody was asked */
	fake.silent[2] = false;
	ASK(0, C_CI_NA, 1, ACT, 0, CA_ALL, IOA(0), 0x45);
	answer(1, MAP_EXECUTED_COMMAND, MAP_RESULT_DONE);
	expect_nothing(0);
	fake.dead[2] = true;
	run();
	EXPECT(0, C_CI_NA, 1, NEGATIVE | ACT_CON, 0, CA_ALL, IOA(0), 0x45);
	fake.dead[2] = false;
	ASK(0, C_CI_NA, 1, ACT, 0, CA_4001, IOA(0), 0x45);
	answer(fake.request_count, MAP_REFUSED_COMMAND, MAP_RESULT_TOO_OLD);
	run();
	EXPECT(0, C_CI_NA, 1, NEGATIVE | ACT_CON, 0, CA_4001, IOA(0), 0x45);
	expect_nothing(0);
}

static void test_a_lost_answer_is_negative_in_time(void **state)
{
	const uint8_t *frame;
	int64_t due;

	(void)state;
	ASK(0, C_CI_NA, 1, ACT, 0, CA_4001, IOA(0), 0x45);
	ASK(0, C_CI_NA, 1, ACT, 0, CA_4001, IOA(0), 5); /* would bring what was frozen before */
	EXPECT(0, C_CI_NA, 1, NEGATIVE | ACT_CON, 0, CA_4001, IOA(0), 5);
	acknowledge(&masters[0]);
	due = iec104_station_deadline(&station);
	assert_true(due <= now + 10 * S);
	now += 10 * S;
	run();
	EXPECT(0, C_CI_NA, 1, NEGATIVE | ACT_CON, 0, CA_4001, IOA(0), 0x45);
	answer(1, MAP_EXECUTED_COMMAND, MAP_RESULT_DONE); /* too late: it was answered */
	run();
	while ((frame = next_frame(&masters[0])) != NULL) /* values whose period has ended */
		assert_int_not_equal(frame[6], 101);
}

static void test_a_test_freezes_nothing(void **state)
{
	(void)state;
	ASK(0, C_CI_NA, 1, TEST_BIT | ACT, 0, CA_4001, IOA(0), 0x85);
	EXPECT(0, C_CI_NA, 1, TEST_BIT | ACT_CON, 0, CA_4001, IOA(0), 0x85);
	EXPECT(0, C_CI_NA, 1, TEST_BIT | ACT_TERM, 0, CA_4001, IOA(0), 0x85);
	assert_int_equal(fake.request_count, 0);
	expect_nothing(0);
}

static void test_a_freeze_outlives_its_connection(void **state)
{
	(void)state;
	ASK(0, C_CI_NA, 1, ACT, 0, CA_4001, IOA(0), 0x45);
	iec104_station_disconnect(&station, masters[0].connection);
	connect_master(1, true);
	start(1);
	answer(1, MAP_EXECUTED_COMMAND, MAP_RESULT_DONE);
	expect_nothing(1);
}

/* A counter with a period of its own is seen as it was frozen, whoever asks. */
static void test_a_counter_that_freezes_by_itself(void **state)
{
	(void)state;
	points[COUNTER].freeze_s = 3600;
	freeze_total(COUNTER, 100, 9, 0);
	fake.samples[COUNTER].value.u = 130;
	put_event(MAP_EVENT_CHANGE, COUNTER, fake.totals[COUNTER]);
	run();
	EXPECT(0, M_IT_TB, 1, SPONTANEOUS, 0, CA_4001, IOA(15), 100, 0, 0, 0, 9, TIME);
	ASK(0, C_RD_NA, 1, REQUEST, 0, CA_4001, IOA(15));
	EXPECT(0, M_IT_NA, 1, REQUEST, 0, CA_4001, IOA(15), 100, 0, 0, 0, 9);
	points[COUNTER].freeze_s = 0;
	expect_nothing(0);
}

int main(void)
{
	const struct CMUnitTest tests[] = {
	    COUNTERS(test_frozen_readings_are_read),
	    COUNTERS(test_groups),
	    COUNTERS(test_a_freeze_is_confirmed_when_it_was_carried_out),
	    COUNTERS(test_a_freeze_of_all_stations_waits_for_all_owners),
	    COUNTERS(test_a_freeze_fails_with_any_owner),
	    COUNTERS(test_a_lost_answer_is_negative_in_time),
	    COUNTERS(test_a_test_freezes_nothing),
	    COUNTERS(test_a_freeze_outlives_its_connection),
	    COUNTERS(test_a_counter_that_freezes_by_itself),
	};

	return cmocka_run_group_tests(tests, NULL, NULL);
}
