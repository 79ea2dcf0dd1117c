/* SPDX-License-Identifier: GPL-3.0-or-later */
/* Modbus ASCII on a line, and on a connection: text with pauses in it, noise, echoes, late answers. */
#include "modbus/test_bus.h"

#include <string.h>

static void set_up_device(uint16_t objects)
{
	set_up();
	use_ascii(9600);
	add_device(17, 1);
	add_objects(MODBUS_READ_HOLDING_REGISTERS, 0, objects);
}

static void start_device(uint16_t objects)
{
	set_up_device(objects);
	start();
	run_for(SECOND);
	assert_true(bus.devices[0].alive);
}

static void test_it_is_scanned_at_the_speed_of_its_text(void **state)
{
	(void)state;
	start_device(8);
	bus.reads_done[0] = 0;
	run_for(10 * SECOND);
	/* 17 and 43 characters of 1.04 ms, twice 3.5 of silence, 5 ms of reaction: 75 ms. */
	assert_in_range(bus.reads_done[0], 125, 142);
	assert_int_equal(bus.line.counters.noise_bytes, 0);
	assert_int_equal(bus.line.counters.crc_errors, 0);
	assert_int_equal(bus.line.counters.timeouts, 0);
}

static void test_commands_are_executed(void **state)
{
	(void)state;
	start_device(8);
	command(0, MODBUS_WRITE_REGISTER, 3, 777, 1);
	run_for(SECOND);
	assert_int_equal(bus.commands_done, 1);
	assert_int_equal(bus.last_result, MODBUS_DONE);
	assert_int_equal(bus.slaves[0].registers[3], 777);
}

static void test_a_wrong_lrc_is_counted(void **state)
{
	(void)state;
	start_device(8);
	bus.slaves[0].fault = CORRUPT;
	bus.slaves[0].faults = 1;
	run_for(SECOND);
	assert_int_equal(bus.line.counters.crc_errors, 1);
	assert_true(bus.devices[0].alive);
}

/* A radio modem's: up to a second between two characters is allowed (2.5.2.1). */
static void test_pauses_inside_a_frame_are_borne(void **state)
{
	(void)state;
	set_up_device(1);
	bus.spread_ns = 80 * MS; /* which is also behind a request */
	start();
	run_for(60 * SECOND);
	assert_true(bus.reads_done[0] >= 25);
	assert_int_equal(bus.line.counters.crc_errors, 0);
}

static void test_who_pauses_for_ever_is_dead_and_has_not_the_line(void **state)
{
	(void)state;
	set_up_device(1);
	add_device(18, 1);
	add_objects(MODBUS_READ_HOLDING_REGISTERS, 0, 1);
	start();
	run_for(SECOND);
	bus.slaves[0].endless = true;
	run_for(20 * SECOND);
	bus.reads_done[1] = 0;
	run_for(20 * SECOND);
	assert_true(bus.reads_done[1] > 300);
}

static void test_its_own_echo_is_no_answer(void **state)
{
	(void)state;
	set_up_device(8);
	bus.echoing = true;
	start();
	run_for(10 * SECOND);
	assert_true(bus.reads_done[0] > 50);
	assert_true(bus.line.counters.echoes > 50);
	assert_int_equal(bus.line.counters.crc_errors, 0);
	command(0, MODBUS_WRITE_REGISTER, 3, 778, 1);
	run_for(SECOND);
	assert_int_equal(bus.last_result, MODBUS_DONE);
	assert_int_equal(bus.slaves[0].registers[3], 778);
}

static void test_another_s_answer_is_a_stranger_s(void **state)
{
	(void)state;
	start_device(8);
	bus.slaves[0].fault = WRONG_UNIT;
	bus.slaves[0].faults = 1;
	run_for(SECOND);
	assert_int_equal(bus.line.counters.wrong_units, 1);
	assert_int_equal(bus.strangers[0], 1);
}

static void test_a_late_answer_is_never_taken_for_another_s(void **state)
{
	(void)state;
	set_up();
	use_ascii(19200);
	expect_late_answers_apart();
}

static void test_text_that_nobody_asked_for_is_waited_out(void **state)
{
	static const char text[] = "HELLO :01 ::\r\n:0103";

	(void)state;
	start_device(8);
	for (unsigned i = 0; i < 5; i++) {
		put_on_wire(bus.now_ns, (const uint8_t *)text, strlen(text));
		run_for(3 * SECOND);
	}
	assert_true(bus.devices[0].alive);
	assert_true(bus.line.counters.noise_bytes >= 5 * 14);
}

static void test_it_goes_over_a_connection(void **state)
{
	(void)state;
	set_up();
	use_connection(MODBUS_FRAMING_ASCII);
	add_device(17, 1);
	add_objects(MODBUS_READ_HOLDING_REGISTERS, 0, 8);
	start();
	run_for(10 * SECOND);
	assert_in_range(bus.reads_done[0], 900, 1000);
	assert_int_equal(bus.line.counters.noise_bytes, 0);
}

static void test_unit_0_is_a_broadcast(void **state)
{
	(void)state;
	set_up();
	use_ascii(9600);
	add_device(17, 1);
	add_objects(MODBUS_READ_HOLDING_REGISTERS, 0, 8);
	add_device(MODBUS_BROADCAST, 1);
	start();
	run_for(SECOND);
	command(1, MODBUS_WRITE_REGISTER, 3, 5, 9);
	run_for(SECOND);
	assert_int_equal(bus.last_result, MODBUS_DONE);
	assert_int_equal(bus.slaves[0].registers[3], 5);
}

int main(void)
{
	const struct CMUnitTest tests[] = {
	    cmocka_unit_test(test_it_is_scanned_at_the_speed_of_its_text),
	    cmocka_unit_test(test_commands_are_executed),
	    cmocka_unit_test(test_a_wrong_lrc_is_counted),
	    cmocka_unit_test(test_pauses_inside_a_frame_are_borne),
	    cmocka_unit_test(test_who_pauses_for_ever_is_dead_and_has_not_the_line),
	    cmocka_unit_test(test_its_own_echo_is_no_answer),
	    cmocka_unit_test(test_another_s_answer_is_a_stranger_s),
	    cmocka_unit_test(test_a_late_answer_is_never_taken_for_another_s),
	    cmocka_unit_test(test_text_that_nobody_asked_for_is_waited_out),
	    cmocka_unit_test(test_it_goes_over_a_connection),
	    cmocka_unit_test(test_unit_0_is_a_broadcast),
	};
	return cmocka_run_group_tests_name("line ascii", tests, NULL, NULL);
}
