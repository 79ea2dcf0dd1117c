/* SPDX-License-Identifier: GPL-3.0-or-later */
/* Commands to points and to the clock, and the answers of those who carry them out. */
#include "iec104/test_masters.h"

#include <string.h>

static void test_single_command_of_figure_5_6(void **state)
{
	const struct map_request *request = &fake.requests[0];

	(void)state;
	ASK(0, C_SC_NA, 0x01, ACT, 0x01, CA_3067, IOA(4), 0x01);
	expect_nothing(0); /* not before the device has answered */
	assert_int_equal(fake.request_count, 1);
	assert_int_equal(request->point, COIL4);
	assert_int_equal(request->action, MAP_EXECUTE);
	assert_int_equal(request->value.u, 1);
	assert_true(request->deadline_ns == now + 10 * S);
	answer(1, MAP_EXECUTING, MAP_RESULT_NONE);
	ASK(0, C_RD_NA, 1, REQUEST, 0, CA_3067, IOA(1)); /* the session goes on */
	EXPECT(0, M_SP_NA, 1, REQUEST, 0, CA_3067, IOA(1), 0);
	expect_nothing(0);
	answer(1, MAP_EXECUTING, MAP_RESULT_DONE);
	run();
	EXPECT(0, C_SC_NA, 0x01, ACT_CON, 0x01, CA_3067, IOA(4), 0x01);
	ASK(0, C_RD_NA, 1, REQUEST, 0, CA_3067, IOA(1));
	EXPECT(0, M_SP_NA, 1, REQUEST, 0, CA_3067, IOA(1), 0);
	expect_nothing(0);
	return_information(COIL4, 1);
	answer(1, MAP_EXECUTED_COMMAND, MAP_RESULT_DONE);
	run();
	EXPECT(0, M_SP_TB, 1, RETURN_REMOTE, 0, CA_3067, IOA(4), 1, TIME);
	EXPECT(0, C_SC_NA, 0x01, ACT_TERM, 0x01, CA_3067, IOA(4), 0x01);
	expect_nothing(0);
	assert_int_equal(fake.request_count, 2);
	assert_int_equal(fake.requests[1].action, MAP_RELEASE);
	assert_int_equal(fake.requests[1].session, request->session);
}

static void command_coil4(void)
{
	ASK(0, C_SC_NA, 1, ACT, 1, CA_3067, IOA(4), 1);
	expect_nothing(0);
}

/* A read-back that failed or changed nothing that may be seen: the device's answer stands. */
static void test_end_without_return_information(void **state)
{
	(void)state;
	command_coil4();
	answer(1, MAP_EXECUTED_COMMAND, MAP_RESULT_DONE);
	run();
	EXPECT(0, C_SC_NA, 1, ACT_CON, 1, CA_3067, IOA(4), 1);
	EXPECT(0, C_SC_NA, 1, ACT_TERM, 1, CA_3067, IOA(4), 1);
	expect_nothing(0);
}

static void answers_of_a_device(void)
{
	answer(1, MAP_EXECUTING, MAP_RESULT_DONE);
	return_information(COIL4, 1);
	answer(1, MAP_EXECUTED_COMMAND, MAP_RESULT_DONE);
}

static void test_confirmation_goes_before_return_information_that_overtakes_it(void **state)
{
	(void)state;
	command_coil4();
	fake.on_last_answer = answers_of_a_device;
	run();
	EXPECT(0, C_SC_NA, 1, ACT_CON, 1, CA_3067, IOA(4), 1);
	EXPECT(0, M_SP_TB, 1, RETURN_REMOTE, 0, CA_3067, IOA(4), 1, TIME);
	EXPECT(0, C_SC_NA, 1, ACT_TERM, 1, CA_3067, IOA(4), 1);
	expect_nothing(0);
}

static void test_termination_waits_for_all_events_before_it(void **state)
{
	(void)state;
	connect_master(1, true);
	start(1);
	command_coil4();
	hold_back(0);
	publish(COIL4 + 1, 1);
	answers_of_a_device();
	run();
	publish(COIL4 + 2, 1); /* later than the end */
	assert_null(next_frame(&masters[0]));
	acknowledge(&masters[0]);
	EXPECT(0, C_SC_NA, 1, ACT_CON, 1, CA_3067, IOA(4), 1);
	EXPECT(0, M_SP_TB, 1, SPONTANEOUS, 0, CA_3067, IOA(10001), 1, TIME);
	EXPECT(0, M_SP_TB, 1, RETURN_REMOTE, 0, CA_3067, IOA(4), 1, TIME);
	EXPECT(0, C_SC_NA, 1, ACT_TERM, 1, CA_3067, IOA(4), 1);
	EXPECT(0, M_SP_TB, 1, SPONTANEOUS, 0, CA_3067, IOA(10002), 1, TIME);
	expect_nothing(0);
	EXPECT(1, M_SP_TB, 1, SPONTANEOUS, 0, CA_3067, IOA(10001), 1, TIME);
	EXPECT(1, M_SP_TB, 1, RETURN_REMOTE, 0, CA_3067, IOA(4), 1, TIME); /* all masters see it */
	EXPECT(1, M_SP_TB, 1, SPONTANEOUS, 0, CA_3067, IOA(10002), 1, TIME);
	expect_nothing(1);
}

static void test_pulse_whose_end_fails(void **state)
{
	(void)state;
	ASK(0, C_SC_NA, 1, ACT, 1, CA_3067, IOA(4), 1 << 2 | 1);
	assert_int_equal(fake.requests[0].pulse_ms, 500);
	answer(1, MAP_EXECUTING, MAP_RESULT_NONE);
	answer(1, MAP_EXECUTING, MAP_RESULT_DONE);
	run();
	EXPECT(0, C_SC_NA, 1, ACT_CON, 1, CA_3067, IOA(4), 1 << 2 | 1);
	return_information(COIL4, 1);
	run();
	EXPECT(0, M_SP_TB, 1, RETURN_REMOTE, 0, CA_3067, IOA(4), 1, TIME);
	expect_nothing(0);
	answer(1, MAP_REFUSED_COMMAND, MAP_RESULT_EXCEPTION);
	run();
	EXPECT(0, C_SC_NA, 1, NEGATIVE | ACT_TERM, 1, CA_3067, IOA(4), 1 << 2 | 1);
	expect_nothing(0);
	ASK(0, C_DC_NA, 1, ACT, 1, CA_4001, IOA(1), 2 << 2 | 1);
	assert_int_equal(fake.requests[2].pulse_ms, 2000);
}

static void test_stopped_connection_hears_of_no_end(void **state)
{
	static const uint8_t stopdt[] = {0x68, 4, 0x13, 0, 0, 0}, con[] = {0x68, 4, 0x23, 0, 0, 0};

	(void)state;
	command_coil4();
	hold_back(0);
	answers_of_a_device();
	run();
	put_bytes(&masters[0], stopdt, sizeof(stopdt));
	acknowledge(&masters[0]);
	assert_memory_equal(next_frame(&masters[0]), con, sizeof(con));
	start(0);
	EXPECT(0, M_SP_TB, 1, RETURN_REMOTE, 0, CA_3067, IOA(4), 1, TIME);
	expect_nothing(0);
}

static void test_many_commands_wait_for_their_ends(void **state)
{
	(void)state;
	hold_back(0);
	for (uint32_t i = 1; i <= IEC104_OPEN_REQUESTS_MAX + 1; i++) {
		if (i % 5 == 0)
			iec104_station_disconnect(&station, masters[0].connection), connect_master(0, true),
			    start(0), hold_back(0);
		ASK(0, C_SC_NA, 1, ACT, 1, CA_3067, IOA(4), 1);
		answer(fake.request_count, MAP_EXECUTED_COMMAND, MAP_RESULT_DONE);
		run();
		assert_int_equal(fake.request_count, 2 * i); /* none was refused for want of room */
	}
}

static void test_refused_command(void **state)
{
	(void)state;
	ASK(0, C_SC_NA, 1, ACT, 1, CA_3067, IOA(4), 1);
	answer(1, MAP_EXECUTING, MAP_RESULT_NONE);
	answer(1, MAP_REFUSED_COMMAND, MAP_RESULT_TIMEOUT);
	run();
	EXPECT(0, C_SC_NA, 1, NEGATIVE | ACT_CON, 1, CA_3067, IOA(4), 1);
	expect_nothing(0);
	assert_int_equal(fake.requests[1].action, MAP_RELEASE);
}

static void test_select_execute_cancel(void **state)
{
	(void)state;
	ASK(0, C_SC_NA, 1, ACT, 1, CA_3067, IOA(4), 0x81);
	assert_int_equal(fake.requests[0].action, MAP_SELECT);
	answer(1, MAP_ACCEPTED_SELECTION, MAP_RESULT_NONE);
	run();
	EXPECT(0, C_SC_NA, 1, ACT_CON, 1, CA_3067, IOA(4), 0x81);
	expect_nothing(0); /* a selection has no termination and is not released */
	assert_int_equal(fake.request_count, 1);
	ASK(0, C_SC_NA, 1, DEACT, 1, CA_3067, IOA(4), 0x81);
	assert_int_equal(fake.requests[1].action, MAP_CANCEL);
	assert_int_equal(fake.requests[1].session, fake.requests[0].session);
	answer(2, MAP_INTERRUPTED_SELECTION, MAP_RESULT_DONE);
	run();
	EXPECT(0, C_SC_NA, 1, DEACT_CON, 1, CA_3067, IOA(4), 0x81);
	ASK(0, C_SC_NA, 1, DEACT, 1, CA_3067, IOA(4), 0x01);
	answer(4, MAP_REFUSED_SELECTION, MAP_RESULT_NOT_SELECTED);
	run();
	EXPECT(0, C_SC_NA, 1, NEGATIVE | DEACT_CON, 1, CA_3067, IOA(4), 0x01);
	expect_nothing(0);
}

static void select_coil4(uint32_t id)
{
	const struct map_request *request = &fake.requests[id - 1];

	ASK(0, C_SC_NA, 1, ACT, 1, CA_3067, IOA(4), 0x81);
	answer(id, MAP_ACCEPTED_SELECTION, MAP_RESULT_NONE);
	fake.commands[COIL4] =
	    (struct map_command){.state = MAP_ACCEPTED_SELECTION, .session = request->session};
}

static void test_selection_ends_with_its_connection(void **state)
{
	(void)state;
	connect_master(1, true);
	start(1);
	select_coil4(1);
	run();
	EXPECT(0, C_SC_NA, 1, ACT_CON, 1, CA_3067, IOA(4), 0x81);
	iec104_station_disconnect(&station, masters[1].connection);
	assert_int_equal(fake.request_count, 1);
	iec104_station_disconnect(&station, masters[0].connection);
	assert_int_equal(fake.request_count, 2);
	assert_int_equal(fake.requests[1].action, MAP_RELEASE);
	assert_int_equal(fake.requests[1].point, COIL4);
	assert_int_equal(fake.requests[1].session, fake.requests[0].session);
}

static void test_selection_is_granted_after_its_connection_has_gone(void **state)
{
	(void)state;
	select_coil4(1);
	iec104_station_disconnect(&station, masters[0].connection);
	connect_master(0, true); /* takes the same place */
	start(0);
	assert_int_equal(fake.requests[1].action, MAP_RELEASE);
	assert_int_equal(fake.requests[1].session, fake.requests[0].session);
	expect_nothing(0);
}

/* A selection of a former process of this station: its owner tells the generations apart, this side does not ask. */
static void test_only_own_selections_are_ended(void **state)
{
	(void)state;
	select_coil4(1);
	run();
	fake.commands[COIL4].session += 1u << 8; /* another connection's */
	iec104_station_disconnect(&station, masters[0].connection);
	fake.commands[COIL4].session -= 1u << 8;
	fake.commands[COIL4].requester = 1; /* another module's */
	iec104_station_disconnect(&station, masters[0].connection);
	assert_int_equal(fake.request_count, 1);
}

static void test_selections_are_told_apart(void **state)
{
	(void)state;
	connect_master(1, true);
	start(1);
	ASK(0, C_SC_NA, 1, ACT, 1, CA_3067, IOA(4), 0x81);
	ASK(0, C_SC_NA, 1, ACT, 2, CA_3067, IOA(4), 0x01);
	ASK(1, C_SC_NA, 1, ACT, 1, CA_3067, IOA(4), 0x01);
	assert_int_not_equal(fake.requests[0].session, fake.requests[1].session);
	assert_int_not_equal(fake.requests[0].session, fake.requests[2].session);
}

struct value_case {
	uint8_t asdu[21];
	size_t size;
	uint32_t point;
	union map_value value;
};

static void test_values(void **state)
{
	static const struct value_case cases[] = {
	    {{49, 1, 6, 0, 0xfb, 0x0b, 0x43, 0x9c, 0, 255, 0, 0}, 12, HOLDING3, {.i = 255}},
	    {{62, 1, 6, 0, 0xfb, 0x0b, 0x43, 0x9c, 0, 255, 0, 0, TIME}, 19, HOLDING3, {.i = 255}},
	    {{46, 1, 6, 0, 0xa1, 0x0f, 1, 0, 0, 2}, 10, DOUBLE1, {.u = 2}},
	    {{46, 1, 6, 0, 0xa1, 0x0f, 1, 0, 0, 3 << 2 | 1}, 10, DOUBLE1, {.u = 1}}, /* persistent */
	    {{59, 1, 6, 0, 0xa1, 0x0f, 1, 0, 0, 1, TIME}, 17, DOUBLE1, {.u = 1}},
	    {{48, 1, 6, 0, 0xa1, 0x0f, 9, 0, 0, 0xff, 0xff, 0}, 12, NORMALIZED, {.i = -1}},
	    {{50, 1, 6, 0, 0xa1, 0x0f, 11, 0, 0, 0, 0, 0xc0, 0xbf, 0}, 14, FLOAT, {.f = -1.5f}},
	    {{51, 1, 6, 0, 0xa1, 0x0f, 7, 0, 0, 1, 0, 0, 0x80}, 13, BITS, {.u = 0x80000001}},
	    {{64, 1, 6, 0, 0xa1, 0x0f, 7, 0, 0, 1, 0, 0, 0x80, TIME}, 20, BITS, {.u = 0x80000001}},
	};

	(void)state;
	for (unsigned i = 0; i < sizeof(cases) / sizeof(cases[0]); i++) {
		ask(&masters[0], cases[i].asdu, cases[i].size);
		assert_int_equal(fake.request_count, i + 1);
		assert_int_equal(fake.requests[i].point, cases[i].point);
		assert_int_equal(fake.requests[i].value.u, cases[i].value.u);
	}
}

static void test_values_that_cannot_be_carried_out(void **state)
{
	static const struct value_case cases[] = {
	    {{45, 1, 6, 0, 0xfb, 0x0b, 4, 0, 0, 1 << 2 | 0}, 10, 0, {0}}, /* a pulse to OFF */
	    {{45, 1, 6, 0, 0xfb, 0x0b, 4, 0, 0, 2 << 2 | 1}, 10, 0, {0}}, /* no long pulse is configured */
	    {{45, 1, 6, 0, 0xfb, 0x0b, 3, 0, 0, 1 << 2 | 1}, 10, 0, {0}}, /* no pulse at all */
	    {{45, 1, 6, 0, 0xfb, 0x0b, 4, 0, 0, 4 << 2 | 1}, 10, 0, {0}}, /* reserved */
	    {{45, 1, 6, 0, 0xfb, 0x0b, 4, 0, 0, 31 << 2 | 1}, 10, 0, {0}},
	    {{46, 1, 6, 0, 0xa1, 0x0f, 1, 0, 0, 1 << 2 | 1}, 10, 0, {0}},
	    {{46, 1, 6, 0, 0xa1, 0x0f, 1, 0, 0, 16 << 2 | 1}, 10, 0, {0}},
	    {{47, 1, 6, 0, 0xfb, 0x0b, 0x43, 0x9c, 0, 0}, 10, 0, {0}}, /* RCS 0 and 3 */
	    {{47, 1, 6, 0, 0xfb, 0x0b, 0x43, 0x9c, 0, 3}, 10, 0, {0}},
	    {{47, 1, 6, 0, 0xfb, 0x0b, 0x43, 0x9c, 0, 1 << 2 | 1}, 10, 0, {0}},
	    {{46, 1, 6, 0, 0xa1, 0x0f, 1, 0, 0, 0}, 10, 0, {0}},
	    {{46, 1, 6, 0, 0xa1, 0x0f, 1, 0, 0, 3}, 10, 0, {0}},
	    {{49, 1, 6, 0, 0xfb, 0x0b, 0x43, 0x9c, 0, 255, 0, 1}, 12, 0, {0}},
	    {{50, 1, 6, 0, 0xa1, 0x0f, 11, 0, 0, 0, 0, 0xc0, 0x7f, 0}, 14, 0, {0}}, /* not a number */
	    {{50, 1, 6, 0, 0xa1, 0x0f, 11, 0, 0, 0, 0, 0x80, 0xff, 0}, 14, 0, {0}}, /* minus infinity */
	};

	(void)state;
	for (unsigned i = 0; i < sizeof(cases) / sizeof(cases[0]); i++) {
		uint8_t expected[21];

		memcpy(expected, cases[i].asdu, sizeof(expected));
		expected[2] = 0x47;
		ask(&masters[0], cases[i].asdu, cases[i].size);
		expect_asdu(0, expected, cases[i].size);
	}
	assert_int_equal(fake.request_count, 0);
}

static void test_regulating_steps(void **state)
{
	(void)state;
	ASK(0, C_RC_NA, 1, ACT, 0, CA_3067, IOA(40003), 1);
	ASK(0, C_RC_TA, 1, ACT, 0, CA_3067, IOA(40003), 3 << 2 | 2, TIME);
	ASK(0, C_RC_NA, 1, ACT, 0, CA_3067, IOA(40003), 0x82);
	assert_int_equal(fake.request_count, 3);
	for (unsigned i = 0; i < 3; i++) {
		assert_int_equal(fake.requests[i].point, HOLDING3);
		assert_int_equal(fake.requests[i].step, i == 0 ? -1 : 1);
		assert_int_equal(fake.requests[i].value.u, 0);
		assert_int_equal(fake.requests[i].action, i == 2 ? MAP_SELECT : MAP_EXECUTE);
	}
	ASK(0, C_RC_NA, 1, ACT, 0, CA_3067, IOA(40002), 1); /* takes no steps */
	EXPECT(0, C_RC_NA, 1, NEGATIVE | UNKNOWN_IOA, 0, CA_3067, IOA(40002), 1);
	ASK(0, C_RC_NA, 1, ACT, 0, CA_3067, IOA(4), 1);
	EXPECT(0, C_RC_NA, 1, NEGATIVE | UNKNOWN_IOA, 0, CA_3067, IOA(4), 1);
	ASK(0, C_RC_NA, 1, ACT, 0, CA_4001, IOA(5), 1); /* a step position that is only read */
	EXPECT(0, C_RC_NA, 1, NEGATIVE | UNKNOWN_IOA, 0, CA_4001, IOA(5), 1);
	assert_int_equal(fake.request_count, 3);
}

static void test_time_tags(void **state)
{
	(void)state;
	fake.clock.offset_ns += 10 * S;
	ASK(0, C_SC_TA, 1, ACT, 0, CA_3067, IOA(4), 1, TIME);
	assert_int_equal(fake.request_count, 1);
	fake.clock.offset_ns += 1 * MS; /* too old */
	ASK(0, C_SC_TA, 1, ACT, 0, CA_3067, IOA(4), 1, TIME);
	EXPECT(0, C_SC_TA, 1, NEGATIVE | ACT_CON, 0, CA_3067, IOA(4), 1, TIME);
	fake.clock.offset_ns -= 20 * S + 2 * MS; /* from the future */
	ASK(0, C_SC_TA, 1, ACT, 0, CA_3067, IOA(4), 1, TIME);
	EXPECT(0, C_SC_TA, 1, NEGATIVE | ACT_CON, 0, CA_3067, IOA(4), 1, TIME);
	assert_int_equal(fake.request_count, 1);
}

/* Its age cannot be known. */
static void test_time_tag_while_the_clock_was_never_set(void **state)
{
	unsigned logged = fake.log_count;

	(void)state;
	fake.clock.set = false;
	ASK(0, C_SC_TA, 1, ACT, 0, CA_3067, IOA(4), 1, TIME);
	EXPECT(0, C_SC_TA, 1, NEGATIVE | ACT_CON, 0, CA_3067, IOA(4), 1, TIME);
	assert_int_equal(fake.request_count, 0);
	assert_int_equal(fake.log_count, logged + 1);
	ASK(0, C_SC_NA, 1, ACT, 0, CA_3067, IOA(4), 1);
	assert_int_equal(fake.request_count, 1);
	fake.settings.command_without_clock = true;
	ASK(0, C_SC_TA, 1, ACT, 0, CA_3067, IOA(4), 1, TIME);
	assert_int_equal(fake.request_count, 2);
	ASK(0, C_SC_TA, 1, ACT, 0, CA_3067, IOA(4), 1, 0, 0, 0x80, 0, 1, 1, 25); /* IV */
	EXPECT(0, C_SC_TA, 1, NEGATIVE | ACT_CON, 0, CA_3067, IOA(4), 1, 0, 0, 0x80, 0, 1, 1, 25);
	assert_int_equal(fake.request_count, 2);
}

static void test_test_bit_of_a_command(void **state)
{
	(void)state;
	ASK(0, C_SC_NA, 1, TEST_BIT | ACT, 1, CA_3067, IOA(4), 1);
	EXPECT(0, C_SC_NA, 1, TEST_BIT | ACT_CON, 1, CA_3067, IOA(4), 1);
	ASK(0, C_CS_NA, 1, TEST_BIT | ACT, 1, CA_3067, IOA(0), 0, 0, 0, 0, 1, 1, 30);
	EXPECT(0, C_CS_NA, 1, TEST_BIT | ACT_CON, 1, CA_3067, IOA(0), TIME);
	expect_nothing(0);
	assert_int_equal(fake.request_count, 0);
}

static void test_owner_dies(void **state)
{
	(void)state;
	ASK(0, C_SC_NA, 1, ACT, 1, CA_3067, IOA(4), 1);
	answer(1, MAP_EXECUTING, MAP_RESULT_NONE);
	expect_nothing(0);
	fake.dead[1] = true;
	run();
	EXPECT(0, C_SC_NA, 1, NEGATIVE | ACT_CON, 1, CA_3067, IOA(4), 1);
	ASK(0, C_SC_NA, 1, ACT, 1, CA_3067, IOA(4), 1);
	EXPECT(0, C_SC_NA, 1, NEGATIVE | ACT_CON, 1, CA_3067, IOA(4), 1);
	fake.dead[1] = false;
	ASK(0, C_SC_NA, 1, ACT, 1, CA_3067, IOA(4), 1);
	expect_nothing(0);
	fake.generation[1]++; /* died and came back between two looks */
	run();
	EXPECT(0, C_SC_NA, 1, NEGATIVE | ACT_CON, 1, CA_3067, IOA(4), 1);
	expect_nothing(0);
}

static void test_owner_dies_after_its_confirmation(void **state)
{
	(void)state;
	command_coil4();
	answer(1, MAP_EXECUTING, MAP_RESULT_DONE);
	ASK(0, C_SC_NA, 1, ACT, 1, CA_3067, IOA(4), 1 << 2 | 1);
	answer(2, MAP_EXECUTING, MAP_RESULT_DONE);
	run();
	EXPECT(0, C_SC_NA, 1, ACT_CON, 1, CA_3067, IOA(4), 1);
	EXPECT(0, C_SC_NA, 1, ACT_CON, 1, CA_3067, IOA(4), 1 << 2 | 1);
	fake.generation[1]++;
	run();
	EXPECT(0, C_SC_NA, 1, ACT_TERM, 1, CA_3067, IOA(4), 1);
	EXPECT(0, C_SC_NA, 1, NEGATIVE | ACT_TERM, 1, CA_3067, IOA(4), 1 << 2 | 1);
	expect_nothing(0);
}

/* rtud has not looked yet at a module that is back; what it is asked, it carries out. */
static void test_owner_is_starting(void **state)
{
	(void)state;
	fake.generation[1]++;
	fake.starting[1] = true;
	ASK(0, C_SC_NA, 1, ACT, 1, CA_3067, IOA(4), 1);
	expect_nothing(0);
	fake.starting[1] = false;
	answer(1, MAP_EXECUTED_COMMAND, MAP_RESULT_DONE);
	run();
	EXPECT(0, C_SC_NA, 1, ACT_CON, 1, CA_3067, IOA(4), 1);
	EXPECT(0, C_SC_NA, 1, ACT_TERM, 1, CA_3067, IOA(4), 1);
}

/* Reads on over values that have a period of their own. */
static void expect_no_answer_to_a_command(unsigned master)
{
	const uint8_t *frame;

	acknowledge(&masters[master]);
	while ((frame = next_frame(&masters[master])) != NULL)
		assert_int_not_equal(frame[6], 45);
}

static void test_answer_is_lost(void **state)
{
	(void)state;
	ASK(0, C_SC_NA, 1, ACT, 1, CA_3067, IOA(4), 1);
	for (int i = 0; i < 39; i++) {
		now += S;
		expect_no_answer_to_a_command(0);
	}
	assert_true(iec104_station_deadline(&station) <= now + S);
	now += S; /* command_timeout, and the longest time-out of a device that was asked at its end */
	run();
	EXPECT(0, C_SC_NA, 1, NEGATIVE | ACT_CON, 1, CA_3067, IOA(4), 1);
	answer(1, MAP_EXECUTED_COMMAND, MAP_RESULT_DONE);
	expect_no_answer_to_a_command(0);
}

static void test_answer_after_the_master_has_gone(void **state)
{
	(void)state;
	ASK(0, C_SC_NA, 1, ACT, 1, CA_3067, IOA(4), 1);
	iec104_station_disconnect(&station, masters[0].connection);
	connect_master(0, true); /* takes the same place */
	start(0);
	answer(1, MAP_EXECUTED_COMMAND, MAP_RESULT_DONE);
	expect_nothing(0);
	assert_int_equal(fake.requests[1].action, MAP_RELEASE);
}

/* Only executions have two answers. */
static void test_answers_that_make_no_sense(void **state)
{
	(void)state;
	ASK(0, C_CS_NA, 1, ACT, 1, CA_3067, IOA(0), TIME);
	answer(1, MAP_EXECUTING, MAP_RESULT_DONE);
	expect_nothing(0);
	answer(1, MAP_EXECUTED_COMMAND, MAP_RESULT_DONE);
	run();
	EXPECT(0, C_CS_NA, 1, ACT_CON, 1, CA_3067, IOA(0), TIME);
	ASK(0, C_SC_NA, 1, ACT, 1, CA_3067, IOA(4), 0x81);
	answer(2, MAP_EXECUTING, MAP_RESULT_DONE);
	expect_nothing(0);
	answer(2, MAP_REFUSED_SELECTION, MAP_RESULT_INTERLOCK);
	answer(2, MAP_EXECUTED_COMMAND, MAP_RESULT_DONE);
	run();
	EXPECT(0, C_SC_NA, 1, NEGATIVE | ACT_CON, 1, CA_3067, IOA(4), 0x81);
	expect_nothing(0);
}

/* ---- clock -------------------------------------------------------------------------------------- */

static void test_clock(void **state)
{
	(void)state;
	ASK(0, C_CS_NA, 1, ACT, 1, CA_3067, IOA(0), TIME);
	expect_nothing(0);
	assert_int_equal(fake.requests[0].action, MAP_SET_CLOCK);
	assert_int_equal(fake.requests[0].point, MAP_NONE);
	assert_true(fake.requests[0].wall_ns == WALL_NS);
	assert_true(fake.requests[0].time_ns == now);
	now += 3 * MS;
	answer(1, MAP_EXECUTED_COMMAND, MAP_RESULT_DONE);
	run();
	EXPECT(0, C_CS_NA, 1, ACT_CON, 1, CA_3067, IOA(0), 0x1b, 0xbc, 24, 13, 19, 2, 25);
	ASK(0, C_CS_NA, 1, ACT, 1, CA_ALL, IOA(0), TIME);
	answer(2, MAP_EXECUTED_COMMAND, MAP_RESULT_DONE);
	run();
	EXPECT(0, C_CS_NA, 1, ACT_CON, 1, CA_3067, IOA(0), 0x1b, 0xbc, 24, 13, 19, 2, 25);
	EXPECT(0, C_CS_NA, 1, ACT_CON, 1, CA_4001, IOA(0), 0x1b, 0xbc, 24, 13, 19, 2, 25);
	ASK(0, C_CS_NA, 1, ACT, 1, CA_3067, IOA(0), 0, 0, 0, 0, 1, 13, 25);
	EXPECT(0, C_CS_NA, 1, NEGATIVE | ACT_CON, 1, CA_3067, IOA(0), 0, 0, 0, 0, 1, 13, 25);
	assert_int_equal(fake.request_count, 2);
}

static void test_clock_masters(void **state)
{
	(void)state;
	connect_master(1, false);
	start(1);
	ASK(1, C_CS_NA, 1, ACT, 1, CA_3067, IOA(0), TIME);
	EXPECT(1, C_CS_NA, 1, NEGATIVE | ACT_CON, 1, CA_3067, IOA(0), TIME);
	assert_int_equal(fake.request_count, 0);
}

int main(void)
{
	const struct CMUnitTest tests[] = {
	    TEST(test_single_command_of_figure_5_6),
	    TEST(test_end_without_return_information),
	    TEST(test_confirmation_goes_before_return_information_that_overtakes_it),
	    TEST(test_termination_waits_for_all_events_before_it),
	    TEST(test_pulse_whose_end_fails),
	    TEST(test_stopped_connection_hears_of_no_end),
	    TEST(test_many_commands_wait_for_their_ends),
	    TEST(test_refused_command),
	    TEST(test_select_execute_cancel),
	    TEST(test_selection_ends_with_its_connection),
	    TEST(test_selection_is_granted_after_its_connection_has_gone),
	    TEST(test_only_own_selections_are_ended),
	    TEST(test_selections_are_told_apart),
	    TEST(test_values),
	    TEST(test_values_that_cannot_be_carried_out),
	    TEST(test_regulating_steps),
	    TEST(test_time_tags),
	    TEST(test_time_tag_while_the_clock_was_never_set),
	    TEST(test_test_bit_of_a_command),
	    TEST(test_owner_dies),
	    TEST(test_owner_dies_after_its_confirmation),
	    TEST(test_owner_is_starting),
	    TEST(test_answer_is_lost),
	    TEST(test_answer_after_the_master_has_gone),
	    TEST(test_answers_that_make_no_sense),
	    TEST(test_clock),
	    TEST(test_clock_masters),
	};

	return cmocka_run_group_tests(tests, NULL, NULL);
}
