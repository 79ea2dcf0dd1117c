/* SPDX-License-Identifier: GPL-3.0-or-later */
/* What a line writes by itself: when a device is back, at each period, and never at the price of others. */
#include "modbus/test_bus.h"

#define TAG      7
#define WATCHDOG 100
#define UNIT     17
#define BIT(n)   (1u << (n))
#define HOURS    (3600 * SECOND)

static void add_device_to_read(uint8_t unit, uint8_t retries)
{
	add_device(unit, retries);
	add_objects(MODBUS_READ_HOLDING_REGISTERS, 0, 8);
}

static void start_with(int64_t period_ns)
{
	set_up();
	add_device_to_read(UNIT, 1);
	add_kept(MODBUS_WRITE_REGISTER, WATCHDOG, 1, period_ns, TAG);
	start();
	run_for(SECOND);
	assert_true(bus.devices[0].alive);
}

static unsigned written(void)
{
	return sent_with(UNIT, MODBUS_WRITE_REGISTER);
}

static void go_and_come_back(void)
{
	bus.slaves[0].present = false;
	run_until_dead(0, 10 * SECOND);
	forget_trace();
	run_for(10 * SECOND);
	assert_int_equal(written(), 0); /* nothing to who is silent */
	bus.slaves[0].registers[WATCHDOG] = 0;
	bus.slaves[0].present = true;
	run_for(60 * SECOND);
	assert_true(bus.devices[0].alive);
}

static void test_it_is_written_when_the_device_is_there(void **state)
{
	(void)state;
	start_with(0);
	assert_int_equal(written(), 1);
	assert_int_equal(bus.slaves[0].registers[WATCHDOG], 1);
	/* Behind the answer that has shown that it is there. */
	assert_true(modbus_is_read(bus.sent[0].request.function));
	run_for(600 * SECOND);
	assert_int_equal(written(), 1);
	go_and_come_back();
	assert_int_equal(written(), 1);
	assert_int_equal(bus.slaves[0].registers[WATCHDOG], 1);
	assert_int_equal(bus.devices[0].counters.kept, 2);
	assert_int_equal(bus.devices[0].counters.kept_failed, 0);
	assert_int_equal(bus.kept_news[0], 0);
}

static void test_it_is_no_command(void **state)
{
	(void)state;
	start_with(SECOND);
	run_for(60 * SECOND);
	assert_int_equal(bus.line.counters.commands, 0);
	assert_int_equal(bus.commands_done, 0);
}

static void test_it_is_written_at_each_period(void **state)
{
	(void)state;
	start_with(2 * SECOND);
	run_for(SECOND);
	forget_trace();
	int64_t due_ns = (bus.now_ns / (2 * SECOND) + 1) * 2 * SECOND;
	run_for(60 * SECOND);
	assert_int_equal(written(), 30);
	for (size_t i = 0; i < bus.sent_count; i++) {
		if (modbus_is_read(bus.sent[i].request.function))
			continue;
		assert_in_range(bus.sent[i].time_ns, due_ns, due_ns + 40 * MS);
		due_ns += 2 * SECOND;
	}
	go_and_come_back();
	assert_in_range(written(), 25, 31);
}

static void test_several_are_written_in_their_order(void **state)
{
	(void)state;
	set_up();
	add_device_to_read(UNIT, 1);
	add_kept(MODBUS_WRITE_REGISTER, WATCHDOG, 1, 10 * SECOND, TAG);
	add_kept(MODBUS_WRITE_REGISTER, 99, 2, 0, TAG + 1);
	add_kept(MODBUS_WRITE_REGISTER, 101, 3, SECOND, TAG + 2);
	start();
	run_for(900 * MS);
	unsigned place = 0;
	for (size_t i = 0; i < bus.sent_count; i++) {
		if (bus.sent[i].request.function == MODBUS_WRITE_REGISTER)
			assert_int_equal(bus.sent[i].request.values[0], ++place);
	}
	assert_int_equal(place, 3);
}

static void test_what_was_commanded_is_written_again(void **state)
{
	(void)state;
	set_up();
	add_device_to_read(UNIT, 1);
	add_kept(0, 0, 0, 0, TAG);
	start();
	run_for(60 * SECOND);
	assert_int_equal(written(), 0);
	command(0, MODBUS_WRITE_REGISTER, WATCHDOG, 33, TAG);
	command(0, MODBUS_WRITE_REGISTER, 101, 44, TAG + 1); /* another's */
	run_for(SECOND);
	assert_int_equal(written(), 2);
	go_and_come_back();
	assert_int_equal(written(), 1);
	assert_int_equal(bus.slaves[0].registers[WATCHDOG], 33);
}

static void test_what_the_device_refused_is_not_kept(void **state)
{
	(void)state;
	set_up();
	add_device_to_read(UNIT, 1);
	add_kept(0, 0, 0, SECOND, TAG);
	start();
	run_for(SECOND);
	bus.slaves[0].write_exception = MODBUS_ILLEGAL_VALUE;
	command(0, MODBUS_WRITE_REGISTER, WATCHDOG, 33, TAG);
	run_for(60 * SECOND);
	assert_int_equal(written(), 1);
}

static void test_a_constant_comes_before_what_was_commanded(void **state)
{
	(void)state;
	start_with(10 * SECOND);
	command(0, MODBUS_WRITE_REGISTER, WATCHDOG, 33, TAG);
	run_for(SECOND);
	assert_int_equal(bus.slaves[0].registers[WATCHDOG], 33);
	run_for(10 * SECOND);
	assert_int_equal(bus.slaves[0].registers[WATCHDOG], 1);
}

/* Some watchdogs look for a change. */
static void test_values_are_written_in_turn(void **state)
{
	static const uint16_t values[] = {0x00FF, 0xFF00, 3};
	struct modbus_request constants[3];

	(void)state;
	set_up();
	add_device_to_read(UNIT, 1);
	add_kept(MODBUS_WRITE_REGISTER, WATCHDOG, 0, SECOND, TAG);
	for (unsigned i = 0; i < 3; i++)
		constants[i] = (struct modbus_request){UNIT, MODBUS_WRITE_REGISTER, WATCHDOG, 1, {values[i]}};
	bus.kept[0][0].constants = constants;
	bus.kept[0][0].constant_count = 3;
	start();
	run_for(10 * SECOND);
	unsigned turn = 0;
	for (size_t i = 0; i < bus.sent_count; i++) {
		if (bus.sent[i].request.function == MODBUS_WRITE_REGISTER)
			assert_int_equal(bus.sent[i].request.values[0], values[turn++ % 3]);
	}
	assert_in_range(turn, 9, 11);
}

static void test_a_refusal_is_told_once(void **state)
{
	(void)state;
	start_with(SECOND);
	bus.slaves[0].write_exception = MODBUS_ILLEGAL_VALUE;
	run_for(60 * SECOND);
	assert_int_equal(bus.kept_news[0], 1);
	assert_int_equal(bus.last_result, MODBUS_REFUSED);
	assert_int_equal(bus.last_exception, MODBUS_ILLEGAL_VALUE);
	assert_in_range(bus.devices[0].counters.kept_failed, 59, 61);
	assert_int_equal(bus.deaths[0], 0);
	bus.slaves[0].write_exception = 0;
	run_for(10 * SECOND);
	assert_int_equal(bus.kept_news[0], 2);
	assert_int_equal(bus.last_result, MODBUS_DONE);
}

/* What is not written again and again is asked for no more, until there may be another device. */
static void test_a_refusal_for_good_ends_it_until_the_device_is_back(void **state)
{
	(void)state;
	set_up();
	add_device_to_read(UNIT, 1);
	add_kept(MODBUS_WRITE_REGISTER, WATCHDOG, 1, 0, TAG);
	bus.slaves[0].write_exception = MODBUS_ILLEGAL_ADDRESS;
	start();
	run_for(600 * SECOND);
	assert_int_equal(written(), 1);
	go_and_come_back();
	assert_int_equal(written(), 1);
}

/* A device that has just started may be busy. */
static void test_a_busy_device_is_asked_again(void **state)
{
	(void)state;
	set_up();
	add_device_to_read(UNIT, 1);
	add_kept(MODBUS_WRITE_REGISTER, WATCHDOG, 1, 0, TAG);
	bus.slaves[0].write_exception = MODBUS_BUSY;
	start();
	run_for(8 * SECOND);
	assert_in_range(written(), 3, 5); /* after 1, 2, 4 s */
	bus.slaves[0].write_exception = 0;
	run_for(60 * SECOND);
	assert_int_equal(bus.slaves[0].registers[WATCHDOG], 1);
	forget_trace();
	run_for(600 * SECOND);
	assert_int_equal(written(), 0);
}

/* It answers all else: then it lives, and what it does not answer costs the others little. */
static void test_a_device_that_does_not_answer_it_lives_and_costs_little(void **state)
{
	(void)state;
	set_up();
	add_device_to_read(UNIT, 0);
	add_kept(MODBUS_WRITE_REGISTER, WATCHDOG, 1, 200 * MS, TAG);
	bus.slaves[0].unknown = BIT(MODBUS_WRITE_REGISTER);
	bus.slaves[0].dumb = true;
	add_device_to_read(18, 1);
	start();
	run_for(10 * SECOND);
	forget_trace();
	run_for(600 * SECOND);
	assert_int_equal(bus.deaths[0], 0);
	assert_true(bus.devices[0].alive);
	assert_int_equal(bus.kept_news[0], 1);
	assert_int_equal(bus.last_result, MODBUS_TIMED_OUT);
	assert_true(written() > 0);
	assert_true(written() * TIMEOUT_NS <= 600 * SECOND / MODBUS_DEAD_SHARE);
}

static void test_an_answer_that_was_lost_delays_nothing(void **state)
{
	(void)state;
	start_with(SECOND);
	forget_trace();
	for (unsigned i = 0; i < 10; i++) {
		while (bus.line.state != MODBUS_WAITING || bus.line.purpose != MODBUS_KEEP)
			run_for(MS);
		bus.slaves[0].fault = MUTE;
		bus.slaves[0].faults = 1;
		run_for(2100 * MS);
	}
	assert_true(written() >= 20);
	assert_int_equal(bus.deaths[0], 0);
}

static void test_the_function_is_learned_as_for_commands(void **state)
{
	(void)state;
	set_up();
	add_device_to_read(UNIT, 1);
	add_kept(MODBUS_WRITE_REGISTER, WATCHDOG, 1, SECOND, TAG);
	bus.slaves[0].unknown = BIT(MODBUS_WRITE_REGISTER);
	start();
	run_for(10 * SECOND);
	assert_int_equal(written(), 1);
	assert_in_range(sent_with(UNIT, MODBUS_WRITE_REGISTERS), 9, 11);
	assert_int_equal(bus.slaves[0].registers[WATCHDOG], 1);
	assert_int_equal(bus.devices[0].counters.kept_failed, 0);
	assert_int_equal(bus.turns, 1);
}

static void test_a_device_that_knows_neither_function_is_asked_once_a_period(void **state)
{
	(void)state;
	set_up();
	add_device_to_read(UNIT, 1);
	add_kept(MODBUS_WRITE_REGISTER, WATCHDOG, 1, SECOND, TAG);
	bus.slaves[0].unknown = BIT(MODBUS_WRITE_REGISTER) | BIT(MODBUS_WRITE_REGISTERS);
	start();
	run_for(60 * SECOND);
	assert_in_range(written() + sent_with(UNIT, MODBUS_WRITE_REGISTERS), 59, 63);
	assert_int_equal(bus.kept_news[0], 1);
}

/* Several of one device share what one may cost. */
static void test_all_that_a_device_does_not_answer_costs_as_little(void **state)
{
	(void)state;
	set_up();
	add_device_to_read(UNIT, 0);
	for (uint16_t i = 0; i < 4; i++)
		add_kept(MODBUS_WRITE_REGISTER, (uint16_t)(WATCHDOG + i), 1, 200 * MS, TAG + i);
	bus.slaves[0].unknown = BIT(MODBUS_WRITE_REGISTER);
	bus.slaves[0].dumb = true;
	start();
	run_for(10 * SECOND);
	forget_trace();
	run_for(600 * SECOND);
	assert_true(bus.devices[0].alive);
	assert_true(written() > 0);
	assert_true(written() * TIMEOUT_NS <= 600 * SECOND / MODBUS_DEAD_SHARE);
}

/* Asked for more than the line has, reads keep half of it. */
static void test_too_many_of_them_starve_nobody(void **state)
{
	(void)state;
	set_up();
	for (uint8_t unit = UNIT; unit < UNIT + DEVICES_MAX; unit++) {
		add_device_to_read(unit, 1);
		for (uint16_t i = 0; i < KEPT_MAX; i++)
			add_kept(MODBUS_WRITE_REGISTER, WATCHDOG + i, i, 10 * MS, i);
	}
	start();
	run_for(SECOND);
	forget_trace();
	run_for(60 * SECOND);
	unsigned reads = 0;
	for (uint32_t i = 0; i < DEVICES_MAX; i++) {
		assert_true(bus.reads_done[i] > 0);
		reads += bus.reads_done[i];
	}
	assert_in_range(reads, bus.sent_count * 49 / 100, bus.sent_count * 51 / 100);
	/* Nor does a flood of commands beside. */
	forget_trace();
	for (int64_t end_ns = bus.now_ns + 10 * SECOND; bus.now_ns < end_ns; run_for(5 * MS))
		while (bus.line.command_count < COMMANDS_MAX)
			command(2, MODBUS_WRITE_COIL, 900, 1, 0);
	for (uint32_t i = 0; i < DEVICES_MAX; i++)
		assert_true(bus.reads_done[i] > 5);
}

static void test_a_pause_is_kept(void **state)
{
	(void)state;
	set_up();
	add_device_to_read(UNIT, 1);
	bus.devices[0].pause_ns = 300 * MS;
	bus.slaves[0].pause_ns = 290 * MS;
	add_kept(MODBUS_WRITE_REGISTER, WATCHDOG, 1, SECOND, TAG);
	start();
	run_for(60 * SECOND);
	assert_int_equal(bus.line.counters.timeouts, 0);
	assert_in_range(written(), 59, 61);
}

/* A peer that hangs up when nothing is asked: what is due makes the next connection. */
static void test_it_is_worth_a_connection(void **state)
{
	(void)state;
	set_up();
	use_tcp();
	add_device_to_read(UNIT, 1);
	for (uint32_t i = 0; i < 8; i++)
		bus.objects[0][i].period_ms = 3600 * 1000;
	add_kept(MODBUS_WRITE_REGISTER, WATCHDOG, 1, 60 * SECOND, TAG);
	bus.peer.idle_ns = 3 * SECOND;
	start();
	run_for(HOURS / 2);
	assert_in_range(written(), 30, 32);
	assert_in_range(bus.connections, 30, 32);
	assert_int_equal(bus.deaths[0], 0);
}

int main(void)
{
	const struct CMUnitTest tests[] = {
	    cmocka_unit_test(test_it_is_written_when_the_device_is_there),
	    cmocka_unit_test(test_it_is_no_command),
	    cmocka_unit_test(test_it_is_written_at_each_period),
	    cmocka_unit_test(test_several_are_written_in_their_order),
	    cmocka_unit_test(test_what_was_commanded_is_written_again),
	    cmocka_unit_test(test_what_the_device_refused_is_not_kept),
	    cmocka_unit_test(test_a_constant_comes_before_what_was_commanded),
	    cmocka_unit_test(test_values_are_written_in_turn),
	    cmocka_unit_test(test_a_refusal_is_told_once),
	    cmocka_unit_test(test_a_refusal_for_good_ends_it_until_the_device_is_back),
	    cmocka_unit_test(test_a_busy_device_is_asked_again),
	    cmocka_unit_test(test_a_device_that_does_not_answer_it_lives_and_costs_little),
	    cmocka_unit_test(test_all_that_a_device_does_not_answer_costs_as_little),
	    cmocka_unit_test(test_an_answer_that_was_lost_delays_nothing),
	    cmocka_unit_test(test_the_function_is_learned_as_for_commands),
	    cmocka_unit_test(test_a_device_that_knows_neither_function_is_asked_once_a_period),
	    cmocka_unit_test(test_too_many_of_them_starve_nobody),
	    cmocka_unit_test(test_a_pause_is_kept),
	    cmocka_unit_test(test_it_is_worth_a_connection),
	};
	return cmocka_run_group_tests_name("modbus line kept", tests, NULL, NULL);
}
