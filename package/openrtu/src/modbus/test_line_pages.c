/* SPDX-License-Identifier: GPL-3.0-or-later */
/* Reads that a write prepares: which page is chosen when, and what goes between. */
#include "modbus/test_bus.h"

#define CHOICE 900
#define UNIT   17
#define OTHER  18

static struct modbus_pages pages;

/* Two registers of each page at the same addresses, and one that is on none. */
static void set_up_pages(uint8_t retries)
{
	set_up();
	pages = (struct modbus_pages){.address = CHOICE, .count = 2, .values = {5, 9}};
	add_device(UNIT, retries);
	add_objects(MODBUS_READ_HOLDING_REGISTERS, 100, 2);
	add_objects(MODBUS_READ_HOLDING_REGISTERS, 100, 2);
	add_objects(MODBUS_READ_HOLDING_REGISTERS, 0, 1);
	for (unsigned i = 0; i < 4; i++)
		bus.objects[0][i].page = (1 + i / 2) & 31u;
	bus.devices[0].pages = &pages;
}

static bool is_of_page(const struct modbus_request *request)
{
	return request->unit == UNIT && request->function == MODBUS_READ_HOLDING_REGISTERS &&
	       request->address == 100 && request->count == 2;
}

static bool chooses(const struct modbus_request *request)
{
	return request->unit == UNIT && request->address == CHOICE && !modbus_is_read(request->function);
}

/* How many reads of a page were asked for, each behind its choice, with nothing to the device between. */
static unsigned prepared_reads(bool alone)
{
	const struct modbus_request *last = NULL;
	unsigned count = 0;

	for (size_t i = 0; i < bus.sent_count; i++) {
		const struct modbus_request *request = &bus.sent[i].request;

		if (!alone && request->unit != UNIT)
			continue;
		if (is_of_page(request) && last != NULL) { /* that of the first one may be forgotten */
			assert_true(chooses(last));
			count++;
		}
		last = request;
	}
	return count;
}

static void test_each_page_is_chosen_before_it_is_read(void **state)
{
	(void)state;
	set_up_pages(1);
	start();
	run_for(SECOND);
	forget_trace();
	run_for(5 * SECOND);
	assert_true(prepared_reads(true) > 20);
	for (size_t i = 0; i + 2 < bus.sent_count; i++)
		if (chooses(&bus.sent[i].request) && chooses(&bus.sent[i + 2].request))
			assert_int_not_equal(bus.sent[i].request.values[0],
					     bus.sent[i + 2].request.values[0]);
	assert_int_equal(bus.line.counters.commands, 0);
}

static void test_objects_of_one_page_share_a_read(void **state)
{
	(void)state;
	set_up_pages(1);
	start();
	assert_int_equal(bus.devices[0].read_count, 3);
	for (uint32_t i = 0; i < 3; i++)
		assert_int_equal(bus.devices[0].reads[i].page, i);
}

static void test_no_command_goes_between(void **state)
{
	(void)state;
	set_up_pages(1);
	start();
	run_for(SECOND);
	forget_trace();
	for (uint16_t i = 0; i < 200; i++) {
		command(0, MODBUS_WRITE_REGISTER, 50, i, i);
		run_for(37 * MS);
	}
	assert_true(prepared_reads(true) > 10);
	assert_in_range(sent_with(UNIT, MODBUS_WRITE_REGISTER), 200, TRACE_MAX);
}

static void test_others_are_asked_while_it_rests(void **state)
{
	(void)state;
	set_up_pages(1);
	bus.devices[0].pause_ns = 200 * MS;
	add_device(OTHER, 1);
	add_objects(MODBUS_READ_HOLDING_REGISTERS, 0, 4);
	start();
	run_for(SECOND);
	forget_trace();
	run_for(10 * SECOND);
	assert_true(prepared_reads(false) > 10);
	assert_true(sent_with(OTHER, MODBUS_READ_HOLDING_REGISTERS) > 100);
}

static void test_a_page_that_is_refused_is_not_read(void **state)
{
	(void)state;
	set_up_pages(1);
	bus.slaves[0].write_exception = MODBUS_ILLEGAL_VALUE;
	start();
	run_for(10 * SECOND);
	assert_int_equal(prepared_reads(true), 0);
	assert_true(bus.devices[0].alive);
	assert_int_equal(bus.devices[0].read_count, 3); /* no address of it is to blame */
	assert_int_equal(bus.refused_addresses[0], 3ULL << 100 % 64);
	assert_true(bus.devices[0].reads[0].given);
	bus.slaves[0].write_exception = 0;
	run_for(60 * SECOND);
	assert_true(prepared_reads(true) > 10);
}

static void test_the_function_that_the_device_knows_chooses(void **state)
{
	(void)state;
	set_up_pages(1);
	bus.slaves[0].unknown = 1u << MODBUS_WRITE_REGISTER;
	start();
	run_for(10 * SECOND);
	assert_int_equal(sent_with(UNIT, MODBUS_WRITE_REGISTER), 1);
	assert_true(sent_with(UNIT, MODBUS_WRITE_REGISTERS) > 20);
	assert_int_equal(bus.turns, 1);
	assert_true(bus.devices[0].reads[1].given && bus.devices[0].reads[2].given);
}

static void test_a_choice_without_an_answer_chooses_nothing(void **state)
{
	(void)state;
	set_up_pages(2);
	start();
	run_for(SECOND);
	bus.slaves[0].present = false;
	run_until_dead(0, 10 * SECOND);
	assert_int_equal(pages.chosen, 0);
	forget_trace();
	bus.slaves[0].present = true;
	run_for(20 * SECOND);
	assert_true(bus.devices[0].alive);
	assert_true(prepared_reads(true) > 10);
}

int main(void)
{
	const struct CMUnitTest tests[] = {
	    cmocka_unit_test(test_each_page_is_chosen_before_it_is_read),
	    cmocka_unit_test(test_objects_of_one_page_share_a_read),
	    cmocka_unit_test(test_no_command_goes_between),
	    cmocka_unit_test(test_others_are_asked_while_it_rests),
	    cmocka_unit_test(test_a_page_that_is_refused_is_not_read),
	    cmocka_unit_test(test_the_function_that_the_device_knows_chooses),
	    cmocka_unit_test(test_a_choice_without_an_answer_chooses_nothing),
	};

	return cmocka_run_group_tests(tests, NULL, NULL);
}
