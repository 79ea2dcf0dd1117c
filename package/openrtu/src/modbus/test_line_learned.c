/* SPDX-License-Identifier: GPL-3.0-or-later */
/* Devices that take less than the protocol allows: what is learned of them, and that it spares them the refusals. */
#include "modbus/test_bus.h"

#include <string.h>

#define READING_NS (3 * SECOND)

static void begin(void)
{
	set_up();
	add_device(17, 1);
}

static struct modbus_learned learned(void)
{
	return modbus_learn(bus.devices[0].reads, bus.devices[0].read_count);
}

/* As after a restart, with what is configured now. */
static void start_again(const struct modbus_limits *limits)
{
	forget_trace();
	modbus_line_close(&bus.line, bus.now_ns);
	bus.devices[0].limits = *limits;
	start();
	run_for(READING_NS);
	assert_true(bus.objects_read[0] > bus.devices[0].object_count);
}

static void assert_nothing_is_refused(uint32_t reads)
{
	assert_int_equal(bus.line.counters.exceptions, 0);
	assert_int_equal(bus.devices[0].read_count, reads);
	assert_int_equal(learned().open, 0);
}

static void test_a_device_of_short_answers(void **state)
{
	(void)state;
	begin();
	add_objects(MODBUS_READ_HOLDING_REGISTERS, 0, 40);
	bus.slaves[0].most = 16;
	start();
	run_for(READING_NS);
	assert_int_equal(bus.line.counters.exceptions, 3);
	assert_int_equal(learned().given_registers, 10);
	assert_int_equal(learned().refused_registers, 20);
	start_again(&(struct modbus_limits){.registers = 10});
	assert_nothing_is_refused(4);
}

static void test_a_device_with_a_hole(void **state)
{
	(void)state;
	begin();
	add_objects(MODBUS_READ_HOLDING_REGISTERS, 0, 5);
	add_objects(MODBUS_READ_HOLDING_REGISTERS, 8, 2);
	add_objects(MODBUS_READ_INPUT_REGISTERS, 20, 20);
	bus.slaves[0].blank = 5;
	bus.slaves[0].blanks = 3;
	start();
	run_for(READING_NS);
	assert_int_equal(bus.line.counters.exceptions, 1);
	assert_int_equal(learned().hole.address, 5);
	assert_int_equal(learned().hole.count, 3);
	assert_true(learned().hole.read < learned().given_registers);
	assert_int_equal(learned().holes_given, 0);
	start_again(&(struct modbus_limits){.no_holes = true});
	assert_nothing_is_refused(3);
}

static void test_an_object_that_is_not_there(void **state)
{
	(void)state;
	begin();
	add_objects(MODBUS_READ_HOLDING_REGISTERS, 0, 8);
	bus.slaves[0].missing = 5;
	start();
	run_for(READING_NS);
	assert_int_equal(learned().lacking.address, 5);
	assert_int_equal(learned().lacking.count, 1);
	assert_int_equal(learned().refused_registers, 0);
	assert_int_equal(learned().hole.count, 0);
}

static void test_a_device_that_does_not_answer_long_reads(void **state)
{
	(void)state;
	begin();
	add_objects(MODBUS_READ_HOLDING_REGISTERS, 0, 8);
	bus.slaves[0].deaf = 5;
	start();
	run_for(20 * SECOND);
	assert_int_equal(learned().open, 0);
	assert_int_equal(learned().unclear, 1);
	assert_int_equal(learned().refused_registers, 0);
}

/* Who looks at it only when there is news misses nothing. */
static void test_news_is_told(void **state)
{
	uint32_t told = 0;

	(void)state;
	begin();
	add_objects(MODBUS_READ_HOLDING_REGISTERS, 0, 40);
	bus.slaves[0].most = 16;
	start();
	for (int i = 0; i < 300; i++) {
		struct modbus_learned before = learned(), after;

		bus.devices[0].news = false;
		run_for(10 * MS);
		after = learned();
		if (memcmp(&before, &after, sizeof(before)) != 0)
			assert_true(bus.devices[0].news);
		told += bus.devices[0].news;
	}
	assert_in_range(told, 4, 12); /* three refusals and four reads, not each answer */
	bus.devices[0].news = false;
	run_for(SECOND);
	assert_false(bus.devices[0].news);
}

static void test_latency_is_that_of_the_answers(void **state)
{
	(void)state;
	start_simple(1);
	assert_in_range(bus.devices[0].latency.least_us, REACTION_NS / 1000, REACTION_NS / 1000 + 5000);
	bus.slaves[0].late = 1;
	bus.slaves[0].late_ns = 60 * MS;
	run_for(SECOND);
	assert_in_range(bus.devices[0].latency.most_us, 65000, 66000);
	assert_true(bus.devices[0].latency.typical_us < 10000);
}

int main(void)
{
	const struct CMUnitTest tests[] = {
	    cmocka_unit_test(test_a_device_of_short_answers),
	    cmocka_unit_test(test_a_device_with_a_hole),
	    cmocka_unit_test(test_an_object_that_is_not_there),
	    cmocka_unit_test(test_a_device_that_does_not_answer_long_reads),
	    cmocka_unit_test(test_news_is_told),
	    cmocka_unit_test(test_latency_is_that_of_the_answers),
	};
	return cmocka_run_group_tests_name("modbus line learned", tests, NULL, NULL);
}
