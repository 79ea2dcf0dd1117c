/* SPDX-License-Identifier: GPL-3.0-or-later */
/* Every error class: answers that are lost, damaged or another's, noise, and a line that hears itself. */
#include "modbus/test_bus.h"

static void spoil_one(enum fault fault)
{
	start_simple(1);
	bus.slaves[0].fault = fault;
	bus.slaves[0].faults = 1;
	run_for(3 * SECOND);
	assert_int_equal(bus.slaves[0].faults, 0);
	assert_int_equal(bus.deaths[0], 0);
	assert_true(bus.devices[0].alive);
	assert_true(bus.reads_done[0] > 10);
}

static void test_a_lost_answer_is_read_again(void **state)
{
	(void)state;
	spoil_one(MUTE);
	assert_int_equal(bus.line.counters.timeouts, 1);
	/* after the time-out something short that no late answer looks like, then the read again */
	assert_int_equal(bus.sent[1].request.count, 1);
	assert_int_equal(bus.sent[2].request.count, 8);
	assert_true(bus.sent[1].time_ns - bus.sent[0].time_ns < TIMEOUT_NS + 10 * MS);
}

static void test_a_corrupt_answer_is_read_again(void **state)
{
	(void)state;
	spoil_one(CORRUPT);
	assert_int_equal(bus.line.counters.crc_errors, 1);
	assert_int_equal(bus.line.counters.timeouts, 0);
	assert_int_equal(bus.devices[0].counters.errors, 1);
}

static void test_a_truncated_answer_is_read_again(void **state)
{
	(void)state;
	spoil_one(TRUNCATED);
	assert_int_equal(bus.line.counters.crc_errors, 1);
	assert_int_equal(bus.line.counters.noise_bytes, 0);
}

static void test_another_units_answer_is_not_taken(void **state)
{
	(void)state;
	spoil_one(WRONG_UNIT);
	assert_int_equal(bus.line.counters.wrong_units, 1);
	assert_int_equal(bus.strangers[0], 1);
	assert_int_equal(bus.stranger, 117);
	assert_int_equal(bus.devices[0].counters.errors, 1);
	assert_int_equal(bus.line.counters.timeouts, 1);
}

static void test_another_functions_answer_is_not_taken(void **state)
{
	(void)state;
	spoil_one(WRONG_FUNCTION);
	assert_int_equal(bus.line.counters.wrong_functions, 1);
	assert_int_equal(bus.line.counters.timeouts, 1);
}

static void test_another_lengths_answer_is_not_taken(void **state)
{
	(void)state;
	spoil_one(WRONG_LENGTH);
	assert_int_equal(bus.line.counters.wrong_lengths, 1);
	assert_int_equal(bus.line.counters.timeouts, 1);
	assert_int_equal(bus.misfits[0], 1);
	assert_int_equal(bus.fit, 16);
	assert_int_equal(bus.misfit, 16 + EXCESS);
}

static void test_another_writes_confirmation_is_not_taken(void **state)
{
	(void)state;
	start_simple(0);
	bus.slaves[0].fault = WRONG_ECHO;
	bus.slaves[0].faults = 1;
	command(0, MODBUS_WRITE_REGISTER, 3, 7, 1);
	run_for(200 * MS);
	assert_int_equal(bus.last_result, MODBUS_TIMED_OUT);
	assert_int_equal(bus.line.counters.wrong_answers, 1);
	assert_int_equal(bus.line.counters.timeouts, 1);
	run_for(3 * SECOND);
	command(0, MODBUS_WRITE_REGISTER, 3, 8, 2);
	run_for(200 * MS);
	assert_int_equal(bus.last_result, MODBUS_DONE);
}

static void test_noise_before_an_answer_does_not_hide_it(void **state)
{
	(void)state;
	spoil_one(NOISE_BEFORE);
	assert_int_equal(bus.line.counters.noise_bytes, 3);
	assert_int_equal(bus.line.counters.timeouts, 0);
	assert_in_range(bus.line.counters.answers, bus.sent_count - 1, bus.sent_count + 1);
}

static void spoil_all(enum fault fault)
{
	start_simple(0);
	bus.slaves[0].fault = fault;
	bus.slaves[0].faults = ~0u;
	run_for(3 * SECOND);
}

/* As transceivers do that let go of the line: such a device is read as quickly as others, and so are its neighbours. */
static void test_what_a_transceiver_adds_costs_no_time(void **state)
{
	size_t sound;

	(void)state;
	start_simple(0);
	run_for(3 * SECOND);
	sound = bus.sent_count;
	spoil_all(NOISE_BEHIND);
	assert_in_range(bus.sent_count, sound * 9 / 10, sound);
	assert_in_range(bus.line.counters.noise_bytes, 2 * bus.sent_count - 2, 2 * bus.sent_count);
	assert_int_equal(bus.line.counters.timeouts, 0);
	for (size_t i = 1; i < bus.sent_count; i++)
		assert_true(bus.sent[i].time_ns >= bus.sent[i - 1].time_ns + 29 * bus.line.wire.char_ns +
						       REACTION_NS + bus.line.wire.silence_ns);
}

/* More may be another master, or a device that is at fault. */
static void test_whatever_else_comes_behind_an_answer_has_to_cease(void **state)
{
	(void)state;
	spoil_all(BABBLE_BEHIND);
	assert_true(bus.sent_count > 10);
	for (size_t i = 1; i < bus.sent_count; i++)
		assert_true(bus.sent[i].time_ns >= bus.sent[i - 1].time_ns + MODBUS_GAP_NS);
}

static void test_a_strangers_frame_does_not_hide_the_answer(void **state)
{
	(void)state;
	spoil_one(STRANGER_FIRST);
	assert_int_equal(bus.line.counters.wrong_units, 1);
	assert_int_equal(bus.line.counters.timeouts, 0);
}

static void test_noise_between_frames_delays_the_next_request(void **state)
{
	(void)state;
	start_simple(0);
	modbus_line_close(&bus.line, bus.now_ns);
	bus.wire_count = 0;
	modbus_line_open(&bus.line, bus.now_ns);
	put_on_wire(bus.now_ns + 30 * MS, (const uint8_t[]){1, 2, 3}, 3);
	run_for(200 * MS);
	assert_int_equal(bus.line.counters.noise_bytes, 3);
	assert_true(bus.sent[0].time_ns >= bus.now_ns - 200 * MS + 30 * MS + MODBUS_GAP_NS);
}

/* As of another master, while nothing of ours is under way. */
static void test_a_frame_that_nobody_asked_for_is_counted_as_such(void **state)
{
	uint8_t frame[8] = {99, 3, 0, 0, 0, 1};

	(void)state;
	start_simple(0);
	modbus_line_close(&bus.line, bus.now_ns);
	bus.wire_count = 0;
	modbus_line_open(&bus.line, bus.now_ns);
	put_on_wire(bus.now_ns + 10 * MS, frame, seal(frame, 6));
	run_for(SECOND);
	assert_int_equal(bus.line.counters.unasked_frames, 1);
	assert_int_equal(bus.line.counters.noise_bytes, 0);
	assert_int_equal(bus.line.counters.timeouts, 0);
	assert_true(bus.reads_done[0] > 1);
}

/* A line that babbles is not sent on, and its devices are not good. */
static void test_a_babbling_line_is_given_up(void **state)
{
	(void)state;
	start_simple(3);
	int64_t began = bus.now_ns;
	for (int i = 0; i < 200; i++)
		put_on_wire(began + i * 20 * MS, (const uint8_t[]){0xAA}, 1);
	run_for(3500 * MS);
	assert_int_equal(bus.deaths[0], 1);
	assert_true(bus.died_ns[0] - began < 2 * SECOND);
	assert_true(bus.sent_count <= 2);
	assert_int_equal(bus.line.counters.stuck_s, 3);
	run_for(10 * SECOND);
	assert_in_range(bus.line.counters.stuck_s, 3, 4);
	assert_true(bus.devices[0].alive);
}

/* ---- a line that hears itself ------------------------------------------------------------------- */

static void test_an_echo_is_not_a_confirmation(void **state)
{
	(void)state;
	start_simple(3);
	bus.echoing = true;
	run_for(SECOND);
	assert_int_equal(bus.deaths[0], 0);
	assert_true(bus.reads_done[0] > 10);
	assert_int_equal(bus.devices[0].counters.errors, 0);
	assert_in_range(bus.line.counters.echoes, bus.sent_count - 1, bus.sent_count);
	command(0, MODBUS_WRITE_REGISTER, 3, 900, 1);
	run_for(200 * MS);
	assert_int_equal(bus.last_result, MODBUS_DONE);
	assert_int_equal(bus.slaves[0].registers[3], 900);
	bus.slaves[0].missing = 60;
	command(0, MODBUS_WRITE_REGISTER, 60, 1, 2);
	run_for(200 * MS);
	assert_int_equal(bus.last_result, MODBUS_REFUSED);
	bus.slaves[0].present = false;
	command(0, MODBUS_WRITE_COIL, 3, 1, 3);
	run_for(SECOND);
	assert_int_equal(bus.last_result, MODBUS_TIMED_OUT);
	assert_int_equal(bus.commands_done, 3);
	bus.slaves[0].present = true;
	bus.echoing = false;
	run_for(3 * SECOND);
	command(0, MODBUS_WRITE_REGISTER, 3, 901, 4);
	run_for(200 * MS);
	assert_int_equal(bus.last_result, MODBUS_DONE);
}

/* Noise may hide an echo, and the line hears itself all the same. */
static void test_one_lost_echo_does_not_make_the_next_a_confirmation(void **state)
{
	(void)state;
	start_simple(3);
	bus.echoing = true;
	run_for(SECOND);
	bus.echoing = false;
	for (unsigned reads = bus.reads_done[0]; bus.reads_done[0] < reads + 2;)
		run_for(MS);
	bus.echoing = true;
	bus.slaves[0].present = false;
	command(0, MODBUS_WRITE_REGISTER, 3, 900, 1);
	run_for(SECOND);
	assert_int_equal(bus.commands_done, 1);
	assert_int_equal(bus.last_result, MODBUS_TIMED_OUT);
}

static void test_a_broadcasts_echo_is_one(void **state)
{
	(void)state;
	start_simple(0);
	add_device(MODBUS_BROADCAST, 0);
	bus.echoing = true;
	run_for(SECOND);
	forget_trace();
	command(1, MODBUS_WRITE_REGISTER, 6, 4321, 9);
	run_for(SECOND);
	assert_int_equal(bus.last_result, MODBUS_DONE);
	assert_in_range(bus.line.counters.echoes, bus.sent_count - 1, bus.sent_count);
	assert_int_equal(bus.line.counters.unasked_frames, 0);
}

/* The request 17 1 3 0 0 24 looks like the answer with the three data bytes 0, 0, 24. */
static void test_an_echo_is_not_a_value(void **state)
{
	(void)state;
	set_up();
	add_device(17, 1);
	add_objects(MODBUS_READ_COILS, 0x0300, 24);
	bus.echoing = true;
	start();
	run_for(SECOND);
	assert_int_equal(bus.sent[bus.sent_count - 1].request.count, 24);
	assert_true(bus.reads_done[0] > 10);
}

/* Without an echo it is the answer. */
static void test_a_value_is_not_an_echo(void **state)
{
	(void)state;
	set_up();
	add_device(17, 1);
	add_objects(MODBUS_READ_COILS, 0x0300, 24);
	for (uint16_t bit = 0; bit < 24; bit++)
		bus.slaves[0].registers[0x0300 + bit] = !(bit == 19 || bit == 20);
	start();
	run_for(SECOND);
	assert_int_equal(bus.sent[bus.sent_count - 1].request.count, 24);
	assert_true(bus.reads_done[0] > 10);
	assert_int_equal(bus.line.counters.timeouts, 0);
}

int main(void)
{
	const struct CMUnitTest tests[] = {
	    cmocka_unit_test(test_a_lost_answer_is_read_again),
	    cmocka_unit_test(test_a_corrupt_answer_is_read_again),
	    cmocka_unit_test(test_a_truncated_answer_is_read_again),
	    cmocka_unit_test(test_another_units_answer_is_not_taken),
	    cmocka_unit_test(test_another_functions_answer_is_not_taken),
	    cmocka_unit_test(test_another_lengths_answer_is_not_taken),
	    cmocka_unit_test(test_another_writes_confirmation_is_not_taken),
	    cmocka_unit_test(test_noise_before_an_answer_does_not_hide_it),
	    cmocka_unit_test(test_what_a_transceiver_adds_costs_no_time),
	    cmocka_unit_test(test_whatever_else_comes_behind_an_answer_has_to_cease),
	    cmocka_unit_test(test_a_strangers_frame_does_not_hide_the_answer),
	    cmocka_unit_test(test_noise_between_frames_delays_the_next_request),
	    cmocka_unit_test(test_a_frame_that_nobody_asked_for_is_counted_as_such),
	    cmocka_unit_test(test_a_babbling_line_is_given_up),
	    cmocka_unit_test(test_an_echo_is_not_a_confirmation),
	    cmocka_unit_test(test_one_lost_echo_does_not_make_the_next_a_confirmation),
	    cmocka_unit_test(test_a_broadcasts_echo_is_one),
	    cmocka_unit_test(test_an_echo_is_not_a_value),
	    cmocka_unit_test(test_a_value_is_not_an_echo),
	};
	return cmocka_run_group_tests_name("modbus line faults", tests, NULL, NULL);
}
