/* SPDX-License-Identifier: GPL-3.0-or-later */
/* Faults and bytes of every kind at random. */
#include "modbus/test_bus.h"

/*
 * Faults of every kind at random: no value is ever another's (on_read), no command is confirmed that was
 * not executed (on_command), each ends once, all devices come back.
 */
static void a_bad_line(bool echoing, bool late_process, bool tcp, int64_t floor_ns)
{
	for (uint32_t seed = 1; seed <= 20; seed++) {
		uint32_t chance = seed;
		unsigned commands = 0;

		set_up();
		bus.echoing = echoing;
		bus.chance = late_process ? seed : 0;
		if (tcp)
			use_tcp();
		for (uint8_t unit = 1; unit <= DEVICES_MAX; unit++) {
			add_device(unit, unit);
			bus.devices[unit - 1].response_timeout_min_ns = floor_ns;
			add_objects(MODBUS_READ_COILS, 0, 5);
			add_objects(MODBUS_READ_HOLDING_REGISTERS, 0, 4);
			add_objects(MODBUS_READ_HOLDING_REGISTERS, 40, 4);
		}
		start();
		for (int step = 0; step < 150; step++) {
			struct slave *slave = &bus.slaves[random_next(&chance) % DEVICES_MAX];

			slave->fault = random_next(&chance) % (STRANGER_FIRST + 1);
			slave->faults = random_next(&chance) % 3;
			slave->late = random_next(&chance) % 2;
			slave->late_ns = (int64_t)(random_next(&chance) % 700) * MS;
			if (random_next(&chance) % 8 == 0) {
				uint32_t device = random_next(&chance) % DEVICES_MAX;

				command(device, MODBUS_WRITE_REGISTER, 50, (uint16_t)step, commands++);
				run_for(2 * SECOND);
			}
			bus.sent_count = 0;
			run_for((int64_t)(random_next(&chance) % 500) * MS);
		}
		for (int i = 0; i < DEVICES_MAX; i++)
			bus.slaves[i].faults = bus.slaves[i].late = 0;
		bus.sent_count = 0;
		run_for(65 * SECOND);
		assert_int_equal(bus.commands_done, commands);
		for (int i = 0; i < DEVICES_MAX; i++)
			assert_true(bus.devices[i].alive);
	}
}

static void test_faults_at_random(void **state)
{
	(void)state;
	a_bad_line(false, false, false, TIMEOUT_NS);
	a_bad_line(false, false, false, 10 * MS);
}

static void test_faults_on_a_line_that_hears_itself(void **state)
{
	(void)state;
	a_bad_line(true, false, false, TIMEOUT_NS);
	a_bad_line(true, false, false, 10 * MS);
}

static void test_faults_under_a_late_process(void **state)
{
	(void)state;
	a_bad_line(false, true, false, TIMEOUT_NS);
	a_bad_line(false, true, false, 10 * MS);
}

static void test_faults_on_a_connection(void **state)
{
	(void)state;
	a_bad_line(false, false, true, TIMEOUT_NS);
	a_bad_line(false, false, true, 10 * MS);
}

static void test_faults_on_a_connection_under_a_late_process(void **state)
{
	(void)state;
	a_bad_line(false, true, true, TIMEOUT_NS);
	a_bad_line(false, true, true, 10 * MS);
}

/* Bytes of any kind in pieces of any size at any time: nothing breaks, and the deadline is always ahead. */
static void test_hostile_bytes(void **state)
{
	(void)state;
	uint32_t chance = 42;

	start_simple(1);
	for (int round = 0; round < 30000; round++) {
		uint8_t bytes[600] = {0};
		size_t length = random_next(&chance) % (round % 100 == 0 ? sizeof(bytes) : 20);

		for (size_t i = 0; i < length; i++)
			bytes[i] = (uint8_t)(random_next(&chance) % 4 ? random_next(&chance) : 17);
		if (length > 5 && random_next(&chance) % 2)
			seal(bytes, length - 2);
		bus.now_ns += (int64_t)(random_next(&chance) % 40) * MS;
		modbus_line_receive(&bus.line, bytes, length, bus.now_ns);
		struct modbus_output output = modbus_line_poll(&bus.line, bus.now_ns);
		assert_true(output.deadline_ns > bus.now_ns);
		assert_true(output.length <= MODBUS_FRAME_MAX);
	}
}

int main(void)
{
	const struct CMUnitTest tests[] = {
	    cmocka_unit_test(test_faults_at_random),
	    cmocka_unit_test(test_faults_on_a_line_that_hears_itself),
	    cmocka_unit_test(test_faults_under_a_late_process),
	    cmocka_unit_test(test_faults_on_a_connection),
	    cmocka_unit_test(test_faults_on_a_connection_under_a_late_process),
	    cmocka_unit_test(test_hostile_bytes),
	};
	return cmocka_run_group_tests_name("modbus line random", tests, NULL, NULL);
}
