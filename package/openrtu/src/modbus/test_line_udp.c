/* SPDX-License-Identifier: GPL-3.0-or-later */
/* Modbus TCP's frames in datagrams, which get lost, come late or twice, and from anybody. */
#include "modbus/test_bus.h"

#define UNIT 17

static void start_udp(uint8_t retries)
{
	set_up();
	use_udp();
	add_device(UNIT, retries);
	add_objects(MODBUS_READ_HOLDING_REGISTERS, 0, 8);
	start();
	run_for(SECOND);
	assert_true(bus.devices[0].alive);
	forget_trace();
}

static void test_values_come_and_a_write_goes(void **state)
{
	(void)state;
	start_udp(1);
	command(0, MODBUS_WRITE_REGISTER, 3, 5, 9);
	run_for(SECOND);
	assert_int_equal(bus.last_result, MODBUS_DONE);
	assert_int_equal(bus.slaves[0].registers[3], 5);
	assert_true(bus.reads_done[0] > 50);
}

static void test_a_lost_datagram_is_asked_for_again(void **state)
{
	(void)state;
	start_udp(1);
	bus.slaves[0].fault = MUTE;
	for (unsigned i = 0; i < 10; i++) {
		bus.slaves[0].faults = 1;
		run_for(SECOND);
	}
	assert_int_equal(bus.line.counters.timeouts, 10);
	assert_int_equal(bus.deaths[0], 0);
	assert_int_equal(bus.line.connection.settle_ns + bus.line.connection.hung, 0);
}

static void test_a_write_that_is_lost_is_not_repeated(void **state)
{
	(void)state;
	start_udp(1);
	bus.slaves[0].fault = MUTE;
	command(0, MODBUS_WRITE_REGISTER, 3, 5, 9);
	bus.slaves[0].faults = 2; /* a read may be under way */
	run_for(2 * SECOND);
	assert_int_equal(bus.last_result, MODBUS_TIMED_OUT);
	assert_int_equal(sent_with(UNIT, MODBUS_WRITE_REGISTER), 1);
}

/* on_read looks at each value. */
static void test_a_late_answer_is_known_by_its_transaction(void **state)
{
	(void)state;
	set_up();
	use_udp();
	expect_late_answers_apart();
}

static void test_an_answer_that_comes_twice_counts_once(void **state)
{
	const uint8_t again[] = {0, 1, 0, 0, 0, 5, UNIT, 3, 2, 0, 0};

	(void)state;
	start_udp(1);
	put_on_wire(bus.now_ns + MS / 2, again, sizeof(again));
	run_for(100 * MS);
	assert_int_equal(bus.line.counters.unasked_frames, 1);
	assert_int_equal(bus.deaths[0], 0);
}

static void test_what_is_no_frame_is_nothing(void **state)
{
	static const uint8_t junk[300] = {0, 1, 0, 7, 0, 5, 'x'};
	static const size_t lengths[] = {1, 5, 6, 7, 12, 300};

	(void)state;
	start_udp(1);
	for (size_t i = 0; i < sizeof(lengths) / sizeof(lengths[0]); i++)
		assert_true(modbus_line_receive(&bus.line, junk, lengths[i], bus.now_ns));
	assert_int_equal(bus.line.counters.noise_bytes, 1 + 5 + 6 + 7 + 12 + 300);
	run_for(SECOND);
	assert_int_equal(bus.deaths[0], 0);
	assert_int_equal(bus.line.counters.timeouts, 0);
}

/* Half of a frame in one, half in the next: neither is one. */
static void test_a_frame_in_two_datagrams_is_none(void **state)
{
	(void)state;
	start_udp(1);
	while (bus.line.state != MODBUS_WAITING)
		run_for(MS / 10);
	const uint8_t answer[] = {
	    (uint8_t)(bus.line.transaction >> 8), (uint8_t)bus.line.transaction, 0, 0, 0, 3, UNIT, 0x83, 4};

	assert_true(modbus_line_receive(&bus.line, answer, 7, bus.now_ns));
	assert_true(modbus_line_receive(&bus.line, answer + 7, 2, bus.now_ns));
	assert_int_equal(bus.devices[0].counters.exceptions, 0);
	assert_int_equal(bus.line.counters.noise_bytes, sizeof(answer));
}

int main(void)
{
	const struct CMUnitTest tests[] = {
	    cmocka_unit_test(test_values_come_and_a_write_goes),
	    cmocka_unit_test(test_a_lost_datagram_is_asked_for_again),
	    cmocka_unit_test(test_a_write_that_is_lost_is_not_repeated),
	    cmocka_unit_test(test_a_late_answer_is_known_by_its_transaction),
	    cmocka_unit_test(test_an_answer_that_comes_twice_counts_once),
	    cmocka_unit_test(test_what_is_no_frame_is_nothing),
	    cmocka_unit_test(test_a_frame_in_two_datagrams_is_none),
	};

	return cmocka_run_group_tests(tests, NULL, NULL);
}
