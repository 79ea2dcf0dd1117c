/* SPDX-License-Identifier: GPL-3.0-or-later */
/* What is passed on: it gets its own answer or none, costs the scan no more than its share, and teaches the line nothing. */
#include <string.h>

#include "modbus/test_bus.h"

#define UNIT      17
#define PERIOD_NS (500 * MS)
#define READ(at)                                                                                             \
	{                                                                                                    \
		UNIT, MODBUS_READ_HOLDING_REGISTERS, 0, at, 0, 2                                             \
	}
#define READ_BYTES 7 /* of its answer */

static const uint8_t reading[] = READ(40);
static const uint8_t writing[] = {UNIT, MODBUS_WRITE_REGISTER, 0, 50, 0x12, 0x34};

static void pass_and_wait(const uint8_t *body, size_t length)
{
	const unsigned passes = bus.passes;

	assert_true(pass(0, body, length, 7));
	for (unsigned i = 0; i < 10000 && bus.passes == passes; i++)
		run_for(MS);
	assert_int_equal(bus.passes, passes + 1);
	assert_int_equal(bus.pass_tag, 7);
}

static void assert_answered(uint16_t address)
{
	const uint8_t low = (uint8_t)(address & 0xFF);
	const uint8_t answer[READ_BYTES] = {UNIT, 3, 4, UNIT, low, UNIT, (uint8_t)(low + 1)};

	assert_int_equal(bus.pass_result, MODBUS_DONE);
	assert_int_equal(bus.pass_length, sizeof(answer));
	assert_memory_equal(bus.pass_answer, answer, sizeof(answer));
}

static void start_framed(enum modbus_framing framing)
{
	set_up();
	if (framing == MODBUS_FRAMING_TCP)
		use_tcp();
	else if (framing == MODBUS_FRAMING_ASCII)
		use_ascii(19200);
	add_device(UNIT, 1);
	add_objects(MODBUS_READ_HOLDING_REGISTERS, 0, 8);
	start();
	run_for(SECOND);
	assert_true(bus.devices[0].alive);
	forget_trace();
}

static void test_a_request_gets_its_answer_in_each_framing(void **state)
{
	static const enum modbus_framing framings[] = {MODBUS_FRAMING_RTU, MODBUS_FRAMING_TCP,
						       MODBUS_FRAMING_ASCII};

	(void)state;
	for (size_t i = 0; i < 3; i++) {
		start_framed(framings[i]);
		pass_and_wait(reading, sizeof(reading));
		assert_answered(40);
		pass_and_wait(writing, sizeof(writing));
		assert_int_equal(bus.pass_result, MODBUS_DONE);
		assert_memory_equal(bus.pass_answer, writing, sizeof(writing));
		assert_int_equal(bus.slaves[0].registers[50], 0x1234);
	}
}

/* Functions whose answers have a length that only silence tells. */
static void test_any_function_passes(void **state)
{
	const uint8_t both[] = {UNIT, 23, 0, 1, 0, 1, 0, 9, 0, 1, 2, 0, 5};

	(void)state;
	start_simple(1);
	pass_and_wait(both, sizeof(both));
	assert_int_equal(bus.pass_result, MODBUS_DONE);
	assert_int_equal(bus.pass_answer[1], 23);
}

static void test_an_echo_is_no_answer(void **state)
{
	(void)state;
	set_up();
	bus.echoing = true;
	add_device(UNIT, 1);
	add_objects(MODBUS_READ_HOLDING_REGISTERS, 0, 8);
	start();
	run_for(SECOND);
	pass_and_wait(reading, sizeof(reading));
	assert_answered(40);
	bus.slaves[0].fault = MUTE;
	bus.slaves[0].faults = 100;
	pass_and_wait(writing, sizeof(writing));
	assert_int_equal(bus.pass_result, MODBUS_TIMED_OUT);
}

/* Of a device that is not polled nothing has shown that the line hears itself: the others have. */
static void test_an_echo_is_no_answer_of_a_device_that_is_not_polled(void **state)
{
	static const uint8_t body[] = {UNIT + 1, MODBUS_WRITE_REGISTER, 0, 50, 0x12, 0x34};

	(void)state;
	set_up();
	bus.echoing = true;
	add_device(UNIT, 1);
	add_objects(MODBUS_READ_HOLDING_REGISTERS, 0, 8);
	add_device(UNIT + 1, 1);
	bus.slaves[1].present = false;
	start();
	run_for(SECOND);
	assert_true(pass(1, body, sizeof(body), 7));
	run_for(10 * SECOND);
	assert_int_equal(bus.passes, 1);
	assert_int_equal(bus.pass_result, MODBUS_TIMED_OUT);
	assert_true(bus.devices[0].alive);
}

/* ---- nothing is learned ------------------------------------------------------------------------------ */

static void test_a_refusal_is_passed_on_and_is_not_the_devices(void **state)
{
	const struct modbus_device_counters before = (start_simple(1), bus.devices[0].counters);
	const uint8_t unknown[] = {UNIT, 6, 0, 200, 0, 0};

	(void)state;
	bus.slaves[0].write_exception = MODBUS_ILLEGAL_FUNCTION;
	pass_and_wait(unknown, sizeof(unknown));
	assert_int_equal(bus.pass_result, MODBUS_DONE);
	assert_memory_equal(bus.pass_answer, ((const uint8_t[]){UNIT, 0x86, 1}), 3);
	assert_int_equal(bus.devices[0].counters.exceptions, before.exceptions);
	assert_int_equal(bus.devices[0].writes.registers, 0);
	assert_int_equal(bus.turns, 0);
}

static void test_silence_says_nothing_of_the_device(void **state)
{
	struct modbus_device before;

	(void)state;
	start_simple(0); /* one request of the line's own that is not answered would be its death */
	before = bus.devices[0];
	bus.slaves[0].deaf = 40;
	pass_and_wait(reading, sizeof(reading));
	assert_int_equal(bus.pass_result, MODBUS_TIMED_OUT);
	run_for(5 * SECOND);
	assert_int_equal(bus.deaths[0], 0);
	assert_int_equal(bus.devices[0].counters.timeouts, before.counters.timeouts);
	assert_int_equal(bus.devices[0].counters.errors, before.counters.errors);
	assert_int_equal(bus.devices[0].timeout_ns, before.timeout_ns);
	assert_int_equal(bus.devices[0].pause.kept_ns, before.pause.kept_ns);
}

static void test_a_peer_that_hangs_up_on_it_is_not_lost(void **state)
{
	(void)state;
	set_up();
	use_tcp();
	add_device(UNIT, 0);
	add_objects(MODBUS_READ_HOLDING_REGISTERS, 0, 8);
	bus.peer.hangs_up_at = true;
	bus.peer.hated = 40;
	start();
	run_for(SECOND);
	pass_and_wait(reading, sizeof(reading));
	assert_int_equal(bus.pass_result, MODBUS_TIMED_OUT);
	run_for(5 * SECOND);
	assert_int_equal(bus.deaths[0], 0);
	assert_int_equal(bus.line.connection.settle_ns, 0);
	assert_int_equal(bus.connections, 2);
}

/* ---- whose answer it is ------------------------------------------------------------------------------ */

/* The answer to one that was given up never becomes that to the next, nor a value: on_read looks at each. */
static void test_a_late_answer_is_nobodys(void **state)
{
	(void)state;
	set_up();
	add_device(UNIT, 3);
	add_objects(MODBUS_READ_HOLDING_REGISTERS, 0, 1); /* what is passed on reads two */
	add_objects(MODBUS_READ_HOLDING_REGISTERS, 300, 1);
	start();
	run_for(SECOND);
	for (unsigned i = 0; i < 20; i++) {
		const uint8_t other[] = READ(60);

		bus.slaves[0].long_ns = TIMEOUT_NS + 7 * MS + i * 11 * MS;
		pass_and_wait(reading, sizeof(reading));
		assert_int_equal(bus.pass_result, MODBUS_TIMED_OUT);
		bus.slaves[0].long_ns = 0;
		pass_and_wait(other, sizeof(other));
		assert_answered(60);
	}
	assert_true(bus.line.counters.late_answers >= 20);
	assert_int_equal(bus.deaths[0], 0);
	assert_int_equal(bus.lates[0] + bus.devices[0].counters.too_late, 0);
}

static void test_another_units_answer_is_not_taken(void **state)
{
	(void)state;
	start_simple(1);
	bus.slaves[0].fault = WRONG_UNIT;
	assert_true(pass(0, reading, sizeof(reading), 7));
	while (bus.line.purpose != MODBUS_PASS)
		run_for(MS / 10);
	bus.slaves[0].faults = 0;
	while (bus.passes == 0)
		run_for(MS);
	assert_answered(40);
}

/* More than the line keeps, without a pause. */
static void test_a_flood_is_no_answer(void **state)
{
	uint8_t flood[2 * MODBUS_FRAME_MAX + 100];

	(void)state;
	start_simple(1);
	memset(flood, 'B', sizeof(flood));
	assert_true(pass(0, reading, sizeof(reading), 7));
	while (bus.line.purpose != MODBUS_PASS)
		run_for(MS / 10);
	bus.wire_count = 0;
	assert_true(modbus_line_receive(&bus.line, flood, sizeof(flood), bus.now_ns));
	run_for(SECOND);
	assert_int_equal(bus.pass_result, MODBUS_TIMED_OUT);
	assert_int_equal(bus.passes, 1);
	run_for(SECOND);
	assert_true(bus.devices[0].alive);
}

/* ---- whose time it takes ----------------------------------------------------------------------------- */

static unsigned read_for(int64_t ns, bool passing)
{
	const int64_t until_ns = bus.now_ns + ns;

	forget_trace();
	while (bus.now_ns < until_ns) {
		if (passing)
			pass(0, reading, sizeof(reading), 7);
		run_for(MS);
	}
	return bus.reads_done[0];
}

static void test_it_takes_its_share_of_a_scan_without_end(void **state)
{
	unsigned alone, beside;

	(void)state;
	start_simple(1);
	alone = read_for(60 * SECOND, false);
	beside = read_for(60 * SECOND, true);
	assert_in_range(beside, alone * 85 / 100, alone);
	assert_true(bus.passes > 100);
	bus.slaves[0].deaf = 40; /* nor if it is in vain */
	assert_in_range(read_for(60 * SECOND, true), alone * 80 / 100, alone);
}

/* A connection is free for the next request later than an answer comes: that time is the tool's, too. */
static void test_it_takes_its_share_of_a_connection(void **state)
{
	unsigned alone, beside;

	(void)state;
	start_framed(MODBUS_FRAMING_TCP);
	bus.line.pass_share = 10;
	bus.slaves[0].reaction_ns = MS;
	alone = read_for(60 * SECOND, false);
	beside = read_for(60 * SECOND, true);
	assert_in_range(beside, alone * 85 / 100, alone);
	assert_true(bus.passes > 100);
}

static void test_a_length_that_is_not_its_functions_is_known(void **state)
{
	static const uint8_t hidden[] = {UNIT, 3, 0, 0,  0,    1,    0xAA, 0xBB,
					 0,    6, 0, 50, 0x12, 0x34, 0xCC, 0xDD};
	static const uint8_t registers[] = {UNIT, 16, 0, 0, 0, 1, 2, 0, 7};
	static const uint8_t both[] = {UNIT, 23, 0, 0, 0, 1, 0, 9, 0, 1, 2, 0, 7};
	static const uint8_t identification[] = {UNIT, 43, 14, 1, 0};

	(void)state;
	assert_false(modbus_is_whole(hidden, sizeof(hidden)));
	for (size_t length = 2; length < sizeof(registers); length++)
		assert_false(modbus_is_whole(registers, length));
	assert_true(modbus_is_whole(registers, sizeof(registers)));
	for (size_t length = 2; length < sizeof(both); length++)
		assert_false(modbus_is_whole(both, length));
	assert_true(modbus_is_whole(both, sizeof(both)));
	assert_true(modbus_is_whole(reading, sizeof(reading)));
	assert_true(modbus_is_whole(writing, sizeof(writing)));
	assert_true(modbus_is_whole(identification, sizeof(identification)));
	assert_false(modbus_is_whole(identification, 4));
	assert_true(modbus_is_whole((const uint8_t[]){UNIT, 17}, 2));
	assert_false(modbus_is_whole((const uint8_t[]){UNIT, 17, 0}, 3));
}

static void test_periods_are_kept(void **state)
{
	(void)state;
	set_up();
	add_device(UNIT, 1);
	add_objects(MODBUS_READ_HOLDING_REGISTERS, 0, 8);
	for (uint32_t i = 0; i < bus.devices[0].object_count; i++)
		bus.objects[0][i].period_ms = PERIOD_NS / MS;
	bus.line.pass_share = 90;
	start();
	run_for(3 * SECOND);
	forget_trace();
	bus.devices[0].counters.missed_periods = 0;
	assert_in_range(read_for(60 * SECOND, true), 119, 121);
	assert_in_range(bus.longest_ns[0], 1, PERIOD_NS + 5 * MS);
	assert_int_equal(bus.devices[0].counters.missed_periods, 0);
	assert_true(bus.passes > 100);
}

static void test_without_room_it_is_not_sent(void **state)
{
	(void)state;
	set_up();
	add_device(UNIT, 1);
	add_objects(MODBUS_READ_HOLDING_REGISTERS, 0, 8);
	for (uint32_t i = 0; i < bus.devices[0].object_count; i++)
		bus.objects[0][i].period_ms = 100;
	start();
	run_for(SECOND);
	forget_trace();
	pass_and_wait(writing, sizeof(writing));
	assert_int_equal(bus.pass_result, MODBUS_TOO_OLD);
	assert_int_equal(sent_with(UNIT, MODBUS_WRITE_REGISTER), 0);
}

static void test_a_lost_port_ends_it(void **state)
{
	(void)state;
	start_simple(1);
	assert_true(pass(0, reading, sizeof(reading), 1));
	assert_false(pass(0, reading, sizeof(reading), 2));
	modbus_line_close(&bus.line, bus.now_ns);
	assert_int_equal(bus.pass_result, MODBUS_NOT_SENT);
	assert_false(pass(0, reading, sizeof(reading), 3));
	start_simple(1);
	assert_true(pass(0, writing, sizeof(writing), 4));
	while (bus.line.purpose != MODBUS_PASS)
		run_for(MS / 10);
	modbus_line_close(&bus.line, bus.now_ns);
	assert_int_equal(bus.pass_result, MODBUS_TIMED_OUT);
	assert_int_equal(bus.passes, 1);
}

static void test_what_changes_nothing_is_known(void **state)
{
	static const uint8_t reads[] = {1, 2, 3, 4, 7, 11, 12, 17, 20, 24};
	unsigned found = 0;

	(void)state;
	for (uint8_t function = 0; function < MODBUS_EXCEPTION_BIT; function++)
		found += modbus_reads_only((const uint8_t[]){1, function, 0}, 3);
	assert_int_equal(found, sizeof(reads));
	for (size_t i = 0; i < sizeof(reads); i++)
		assert_true(modbus_reads_only((const uint8_t[]){1, reads[i]}, 2));
	assert_true(modbus_reads_only((const uint8_t[]){1, 43, 14, 1, 0}, 5));
	assert_false(modbus_reads_only((const uint8_t[]){1, 43, 13, 1, 0}, 5));
	assert_false(modbus_reads_only((const uint8_t[]){1, 43}, 2));
}

int main(void)
{
	const struct CMUnitTest tests[] = {
	    cmocka_unit_test(test_a_request_gets_its_answer_in_each_framing),
	    cmocka_unit_test(test_any_function_passes),
	    cmocka_unit_test(test_an_echo_is_no_answer),
	    cmocka_unit_test(test_an_echo_is_no_answer_of_a_device_that_is_not_polled),
	    cmocka_unit_test(test_a_refusal_is_passed_on_and_is_not_the_devices),
	    cmocka_unit_test(test_silence_says_nothing_of_the_device),
	    cmocka_unit_test(test_a_peer_that_hangs_up_on_it_is_not_lost),
	    cmocka_unit_test(test_a_late_answer_is_nobodys),
	    cmocka_unit_test(test_another_units_answer_is_not_taken),
	    cmocka_unit_test(test_a_flood_is_no_answer),
	    cmocka_unit_test(test_it_takes_its_share_of_a_scan_without_end),
	    cmocka_unit_test(test_it_takes_its_share_of_a_connection),
	    cmocka_unit_test(test_a_length_that_is_not_its_functions_is_known),
	    cmocka_unit_test(test_periods_are_kept),
	    cmocka_unit_test(test_without_room_it_is_not_sent),
	    cmocka_unit_test(test_a_lost_port_ends_it),
	    cmocka_unit_test(test_what_changes_nothing_is_known),
	};

	return cmocka_run_group_tests(tests, NULL, NULL);
}
