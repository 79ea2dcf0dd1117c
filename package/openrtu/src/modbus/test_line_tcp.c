/* SPDX-License-Identifier: GPL-3.0-or-later */
/* A line over TCP: answers in pieces, late, another's, of a gateway; a stream that is no Modbus; its pace. */
#include "modbus/test_bus.h"

#define PACE_NS (10 * MS)

/* The latest request's answer: the values that the bus expects of registers first .. first + 7. */
static size_t answer(uint8_t *frame, uint16_t transaction, uint8_t unit)
{
	size_t at = 0;
	const uint8_t head[] = {
	    (uint8_t)(transaction >> 8), (uint8_t)transaction, 0, 0, 0, 3 + 16, unit, 3, 16};

	for (; at < sizeof(head); at++)
		frame[at] = head[at];
	for (uint16_t i = 0; i < 8; i++) {
		frame[at++] = unit;
		frame[at++] = (uint8_t)i;
	}
	return at;
}

static void start_tcp(uint8_t retries)
{
	set_up();
	use_tcp();
	add_device(17, retries);
	add_objects(MODBUS_READ_HOLDING_REGISTERS, 0, 8);
	start();
	run_for(SECOND);
	assert_true(bus.devices[0].alive);
	forget_trace();
}

/* A request has gone out, and nobody has answered it. */
static void start_waiting(void)
{
	start_tcp(1);
	bus.slaves[0].present = false;
	run_for(PACE_NS);
	assert_int_equal(bus.line.state, MODBUS_WAITING);
	forget_trace();
}

static void test_a_device_is_read_with_a_hundred_requests_a_second(void **state)
{
	(void)state;
	start_tcp(1);
	run_for(10 * SECOND);
	assert_in_range(bus.reads_done[0], 990, 1000);
	assert_int_equal(bus.line.counters.answers, bus.reads_done[0]);
	assert_int_equal(bus.line.counters.timeouts + bus.line.counters.unasked_frames, 0);
	assert_int_equal(bus.devices[0].counters.latency_us, REACTION_NS / 1000);
}

/* What takes longer than that is followed at once. */
static void test_a_slow_device_is_not_slowed_down(void **state)
{
	(void)state;
	start_tcp(1);
	bus.slaves[0].reaction_ns = 40 * MS;
	run_for(10 * SECOND);
	assert_in_range(bus.reads_done[0], 249, 250);
}

static void test_an_answer_may_come_octet_by_octet(void **state)
{
	(void)state;
	start_tcp(1);
	bus.spread_ns = 3 * MS; /* more than 50 ms for the whole */
	run_for(5 * SECOND);
	assert_true(bus.reads_done[0] > 50);
	assert_int_equal(bus.line.counters.timeouts, 0);
	assert_int_equal(bus.line.counters.noise_bytes, 0);
}

static void test_two_frames_may_come_at_once(void **state)
{
	(void)state;
	uint8_t frames[64];
	size_t length;

	start_waiting();
	length = answer(frames, (uint16_t)(bus.transaction - 1), 17);
	length += answer(frames + length, bus.transaction, 17);
	assert_true(modbus_line_receive(&bus.line, frames, length, bus.now_ns));
	assert_int_equal(bus.reads_done[0], 1);
	assert_int_equal(bus.line.counters.unasked_frames, 1); /* answered already */
	assert_int_equal(bus.line.counters.late_answers, 0);
}

static void test_only_its_own_transaction_answers_a_request(void **state)
{
	(void)state;
	uint8_t frame[64];
	size_t length;

	start_waiting();
	for (uint32_t other = 1; other <= UINT16_MAX; other += 13) {
		length = answer(frame, (uint16_t)(bus.transaction + other), 17);
		assert_true(modbus_line_receive(&bus.line, frame, length, bus.now_ns));
	}
	assert_int_equal(bus.reads_done[0], 0);
	length = answer(frame, bus.transaction, 16);
	assert_true(modbus_line_receive(&bus.line, frame, length, bus.now_ns));
	assert_int_equal(bus.reads_done[0], 0);
	assert_int_equal(bus.devices[0].counters.errors, 1);
	length = answer(frame, bus.transaction, 17);
	assert_true(modbus_line_receive(&bus.line, frame, length, bus.now_ns));
	assert_int_equal(bus.reads_done[0], 1);
}

/* No rest and no probe: the next request goes out with the time-out. */
static void test_a_late_answer_is_counted_and_costs_nothing(void **state)
{
	(void)state;
	start_tcp(5);
	bus.slaves[0].late = 1;
	bus.slaves[0].late_ns = 250 * MS;
	run_for(2 * SECOND);
	assert_int_equal(bus.deaths[0], 0);
	assert_int_equal(bus.line.counters.timeouts, 2); /* the second waits behind the first */
	assert_int_equal(bus.line.counters.late_answers, 2);
	assert_int_equal(bus.line.counters.unasked_frames, 0);
	assert_int_equal(bus.sent[1].time_ns - bus.sent[0].time_ns, TIMEOUT_NS);
	assert_int_equal(bus.sent[1].request.count, 8);
}

/* Half of it before the time-out, half after: the stream stays in step. */
static void test_an_answer_that_is_cut_by_its_time_out_is_late(void **state)
{
	(void)state;
	uint8_t frame[64];
	size_t length;

	start_waiting();
	length = answer(frame, bus.transaction, 17);
	assert_true(modbus_line_receive(&bus.line, frame, 10, bus.now_ns));
	bus.slaves[0].present = true;
	bus.slaves[0].reaction_ns = 50 * MS;
	run_for(TIMEOUT_NS);
	assert_true(modbus_line_receive(&bus.line, frame + 10, length - 10, bus.now_ns));
	run_for(SECOND);
	assert_int_equal(bus.line.counters.timeouts, 1);
	assert_int_equal(bus.line.counters.late_answers, 1);
	assert_true(bus.reads_done[0] > 10);
}

static bool is_taken(const uint8_t *bytes, size_t length)
{
	start_waiting();
	return modbus_line_receive(&bus.line, bytes, length, bus.now_ns);
}

static void test_what_is_no_modbus_ends_the_connection(void **state)
{
	(void)state;
	assert_true(is_taken((const uint8_t[]){0, 1, 0, 0, 0, 2}, 6));
	assert_false(is_taken((const uint8_t[]){0, 1, 0, 1, 0, 3}, 6));
	assert_false(is_taken((const uint8_t[]){0, 1, 0, 0, 0, 1}, 6));
	assert_false(is_taken((const uint8_t[]){0, 1, 0, 0, 0, 255}, 6));
	assert_false(is_taken((const uint8_t *)"HTTP/1.1 400", 12));
	/* The next connection begins at its beginning. */
	modbus_line_close(&bus.line, bus.now_ns);
	assert_int_equal(bus.deaths[0], 1);
	bus.slaves[0].present = true;
	modbus_line_open(&bus.line, bus.now_ns);
	run_for(SECOND);
	assert_int_equal(bus.births[0], 2);
	assert_true(bus.reads_done[0] > 10);
}

/* Two units behind a gateway. It says so of the one it does not reach (exception 11), or says nothing. */
static void one_unit_is_dead(uint8_t exception)
{
	set_up();
	use_tcp();
	for (uint8_t unit = 1; unit <= 2; unit++) {
		add_device(unit, 1);
		add_objects(MODBUS_READ_HOLDING_REGISTERS, 0, 4);
		add_objects(MODBUS_READ_COILS, 0, 4);
	}
	start();
	run_for(SECOND);
	bus.slaves[0].exception = exception;
	bus.slaves[0].present = exception != 0;
	bus.slaves[0].reaction_ns = 90 * MS;
	run_for(SECOND);
	assert_int_equal(bus.deaths[0], 1);
	forget_trace();
	run_for(60 * SECOND);
	assert_int_equal(bus.deaths[1], 0);
	assert_int_equal(bus.refused_addresses[0], 0);
	assert_in_range(sent_with(1, MODBUS_READ_COILS) + sent_with(1, MODBUS_READ_HOLDING_REGISTERS), 4, 7);
	assert_true(bus.longest_ns[1] < TIMEOUT_NS + 3 * PACE_NS);
	bus.slaves[0].exception = 0;
	bus.slaves[0].present = true;
	run_for(60 * SECOND);
	assert_int_equal(bus.births[0], 2);
}

static void test_a_unit_that_a_gateway_does_not_reach_is_dead(void **state)
{
	(void)state;
	one_unit_is_dead(MODBUS_NO_PATH);
	one_unit_is_dead(MODBUS_NO_TARGET);
}

static void test_a_silent_unit_is_dead(void **state)
{
	(void)state;
	one_unit_is_dead(0);
}

/* The scan in which the device died has no end. */
static void test_a_scan_without_an_answer_has_no_duration(void **state)
{
	(void)state;
	start_tcp(0);
	run_for(SECOND);
	bus.slaves[0].present = false;
	run_for(3 * SECOND);
	assert_int_equal(bus.deaths[0], 1);
	assert_in_range(bus.line.counters.scan_us, REACTION_NS / 1000, PACE_NS / 1000);
}

static void test_a_read_that_is_refused_is_halved(void **state)
{
	(void)state;
	start_tcp(1);
	bus.slaves[0].missing = 3;
	run_for(SECOND);
	assert_int_equal(bus.refused_addresses[0], 1 << 3);
	assert_int_equal(bus.deaths[0], 0);
}

static void test_a_command_is_confirmed_refused_or_lost(void **state)
{
	(void)state;
	start_tcp(1);
	command(0, MODBUS_WRITE_REGISTER, 3, 4711, 1);
	run_for(SECOND);
	assert_int_equal(bus.last_result, MODBUS_DONE);
	assert_int_equal(bus.slaves[0].registers[3], 4711);
	command(0, MODBUS_WRITE_REGISTER, ADDRESSES, 0, 2);
	run_for(SECOND);
	assert_int_equal(bus.last_result, MODBUS_REFUSED);
	assert_int_equal(bus.last_exception, 2);
	bus.slaves[0].present = false;
	command(0, MODBUS_WRITE_REGISTER, 3, 5, 3);
	run_for(2 * PACE_NS);
	modbus_line_close(&bus.line, bus.now_ns);
	assert_int_equal(bus.last_tag, 3);
	assert_int_equal(bus.last_result, MODBUS_TIMED_OUT);
	assert_int_equal(bus.commands_done, 3);
}

static void test_unit_0_is_no_broadcast(void **state)
{
	(void)state;
	set_up();
	use_tcp();
	add_device(MODBUS_BROADCAST, 1);
	add_objects(MODBUS_READ_HOLDING_REGISTERS, 0, 8);
	add_device(1, 1);
	add_objects(MODBUS_READ_HOLDING_REGISTERS, 0, 8);
	start();
	run_for(SECOND);
	assert_true(bus.reads_done[0] > 10);
	command(0, MODBUS_WRITE_REGISTER, 3, 4711, 1);
	run_for(SECOND);
	assert_int_equal(bus.last_result, MODBUS_DONE);
	assert_int_equal(bus.slaves[0].registers[3], 4711);
	assert_int_not_equal(bus.slaves[1].registers[3], 4711);
	command(0, MODBUS_WRITE_REGISTER, ADDRESSES, 1, 2);
	run_for(SECOND);
	assert_int_equal(bus.last_result, MODBUS_REFUSED);
	bus.slaves[0].present = false;
	run_for(SECOND);
	assert_int_equal(bus.deaths[0], 1);
	assert_int_equal(bus.deaths[1], 0);
}

/* After a write that was not confirmed the next goes at once: their confirmations cannot be mistaken. */
static void test_commands_do_not_wait_for_late_answers(void **state)
{
	(void)state;
	start_tcp(5);
	bus.slaves[0].faults = 1;
	bus.slaves[0].fault = MUTE;
	command(0, MODBUS_WRITE_REGISTER, 3, 1, 1);
	command(0, MODBUS_WRITE_REGISTER, 3, 2, 2);
	run_for(TIMEOUT_NS + 3 * PACE_NS);
	assert_int_equal(bus.commands_done, 2);
	assert_int_equal(bus.last_result, MODBUS_DONE);
	assert_int_equal(bus.slaves[0].registers[3], 2);
}

int main(void)
{
	const struct CMUnitTest tests[] = {
	    cmocka_unit_test(test_a_device_is_read_with_a_hundred_requests_a_second),
	    cmocka_unit_test(test_a_slow_device_is_not_slowed_down),
	    cmocka_unit_test(test_an_answer_may_come_octet_by_octet),
	    cmocka_unit_test(test_two_frames_may_come_at_once),
	    cmocka_unit_test(test_only_its_own_transaction_answers_a_request),
	    cmocka_unit_test(test_a_late_answer_is_counted_and_costs_nothing),
	    cmocka_unit_test(test_an_answer_that_is_cut_by_its_time_out_is_late),
	    cmocka_unit_test(test_what_is_no_modbus_ends_the_connection),
	    cmocka_unit_test(test_a_unit_that_a_gateway_does_not_reach_is_dead),
	    cmocka_unit_test(test_a_silent_unit_is_dead),
	    cmocka_unit_test(test_a_scan_without_an_answer_has_no_duration),
	    cmocka_unit_test(test_a_read_that_is_refused_is_halved),
	    cmocka_unit_test(test_a_command_is_confirmed_refused_or_lost),
	    cmocka_unit_test(test_unit_0_is_no_broadcast),
	    cmocka_unit_test(test_commands_do_not_wait_for_late_answers),
	};
	return cmocka_run_group_tests_name("modbus line tcp", tests, NULL, NULL);
}
