/* SPDX-License-Identifier: GPL-3.0-or-later */
/* What devices say of themselves: asked once, at nobody's expense; who does not know it is left alone. */
#include <string.h>

#include "modbus/test_bus.h"

static const char *const meter[7] = {"Maker", "M1", "V1.2", "https://example.org", "Meter one"};

static void start_asked(void)
{
	set_up();
	add_device(17, 1);
	add_objects(MODBUS_READ_HOLDING_REGISTERS, 0, 8);
	add_identity();
	memcpy(bus.slaves[0].identity, meter, sizeof(meter));
}

static unsigned asked(void)
{
	return sent_with(17, MODBUS_ENCAPSULATED);
}

static void assert_known(void)
{
	char text[MODBUS_IDENTITY_WORDS];

	assert_int_equal(bus.identities[0].state, MODBUS_IDENTITY_KNOWN);
	for (uint8_t i = 0; i < 3; i++) {
		modbus_identity_text(bus.identities[0].texts, bus.identities[0].size, i, text);
		assert_string_equal(text, meter[i]);
	}
}

static void come_back(void)
{
	bus.slaves[0].present = false;
	run_until_dead(0, 10 * SECOND);
	bus.slaves[0].present = true;
	run_for(70 * SECOND);
	assert_true(bus.devices[0].alive);
}

static void test_it_is_asked_once_and_when_it_is_back(void **state)
{
	(void)state;
	start_asked();
	start();
	run_for(5 * SECOND);
	assert_known();
	assert_int_equal(asked(), 1);
	assert_int_equal(bus.identified[0], 1);
	forget_trace();
	come_back();
	assert_int_equal(asked(), 1);
	assert_int_equal(bus.identified[0], 2);
	assert_known();
}

static void test_it_is_asked_behind_all_its_reads(void **state)
{
	(void)state;
	start_asked();
	bus.devices[0].limits.registers = 1;
	start();
	run_for(5 * SECOND);
	for (size_t i = 0; i < bus.sent_count; i++)
		if (bus.sent[i].request.function == MODBUS_ENCAPSULATED)
			assert_true(i >= 8);
	assert_int_equal(asked(), 1);
}

static void test_what_does_not_fit_into_one_answer_comes_in_several(void **state)
{
	(void)state;
	start_asked();
	bus.slaves[0].identified = 1;
	start();
	run_for(30 * SECOND);
	assert_known();
	assert_int_equal(asked(), 5);
}

static void test_it_is_the_same_on_tcp_and_as_text(void **state)
{
	(void)state;
	start_asked();
	use_tcp();
	start();
	run_for(5 * SECOND);
	assert_known();
	start_asked();
	use_ascii(19200);
	start();
	run_for(5 * SECOND);
	assert_known();
	start_asked();
	use_connection(MODBUS_FRAMING_RTU);
	start();
	run_for(5 * SECOND);
	assert_known();
}

static void test_one_that_gives_the_basic_objects_alone_is_asked_for_them(void **state)
{
	(void)state;
	start_asked();
	bus.slaves[0].basic_only = true;
	start();
	run_for(10 * SECOND);
	assert_known();
	assert_int_equal(asked(), 2);
}

static void test_one_that_does_not_know_it_is_left_alone(void **state)
{
	(void)state;
	start_asked();
	bus.slaves[0].identity[0] = NULL;
	start();
	run_for(60 * SECOND);
	assert_int_equal(asked(), 1);
	assert_int_equal(bus.identities[0].state, MODBUS_IDENTITY_REFUSED);
	assert_int_equal(bus.line.counters.exceptions, 0);
	assert_int_equal(bus.devices[0].counters.exceptions, 0);
}

/* It lives, its reads stay whole, and no pause is learned. */
static void test_one_that_is_silent_is_left_alone(void **state)
{
	(void)state;
	start_asked();
	bus.slaves[0].identity[0] = NULL;
	bus.slaves[0].dumb = true;
	bus.devices[0].retries = 0;
	start();
	run_for(60 * SECOND);
	assert_int_equal(asked(), 1);
	assert_int_equal(bus.deaths[0], 0);
	assert_int_equal(bus.devices[0].read_count, 1);
	assert_int_equal(bus.pauses[0], 0);
	assert_int_equal(bus.identities[0].state, MODBUS_IDENTITY_SILENT);
	forget_trace();
	come_back();
	assert_int_equal(asked(), 1);
	come_back();
	come_back();
	assert_int_equal(asked(), 1); /* twice, and never again */
}

/* It hangs up: that is silence, too. */
static void test_one_that_hangs_up_is_left_alone(void **state)
{
	(void)state;
	start_asked();
	use_tcp();
	bus.peer.hangs_up_at_identification = true;
	start();
	run_for(600 * SECOND);
	assert_in_range(asked(), 1, 2);
	assert_true(bus.devices[0].alive);
}

static void test_it_waits_for_room_between_periods(void **state)
{
	(void)state;
	start_asked();
	for (unsigned i = 0; i < 8; i++)
		bus.objects[0][i].period_ms = 100; /* less than the longest answer takes */
	start();
	run_for(20 * SECOND);
	assert_int_equal(asked(), 0);
	assert_int_equal(bus.devices[0].counters.missed_periods, 0);
	start_asked();
	for (unsigned i = 0; i < 8; i++)
		bus.objects[0][i].period_ms = 2000;
	start();
	run_for(20 * SECOND);
	assert_int_equal(asked(), 1);
	assert_known();
	assert_int_equal(bus.devices[0].counters.missed_periods, 0);
}

/* However many come back at once. */
static void test_it_takes_a_small_share_of_the_line(void **state)
{
	int64_t last_ns = 0;

	(void)state;
	set_up();
	for (uint8_t i = 0; i < DEVICES_MAX; i++) {
		add_device((uint8_t)(17 + i), 1);
		add_objects(MODBUS_READ_HOLDING_REGISTERS, 0, 8);
		add_identity();
		memcpy(bus.slaves[i].identity, meter, sizeof(meter));
	}
	start();
	run_for(20 * SECOND);
	for (size_t i = 0; i + 1 < bus.sent_count; i++) {
		if (bus.sent[i].request.function != MODBUS_ENCAPSULATED)
			continue;
		const int64_t took_ns = bus.sent[i + 1].time_ns - bus.sent[i].time_ns;

		assert_true(last_ns == 0 || bus.sent[i].time_ns - last_ns > 15 * took_ns);
		last_ns = bus.sent[i].time_ns;
	}
	for (uint32_t i = 0; i < DEVICES_MAX; i++)
		assert_int_equal(bus.identities[i].state, MODBUS_IDENTITY_KNOWN);
}

int main(void)
{
	const struct CMUnitTest tests[] = {
	    cmocka_unit_test(test_it_is_asked_once_and_when_it_is_back),
	    cmocka_unit_test(test_it_is_asked_behind_all_its_reads),
	    cmocka_unit_test(test_what_does_not_fit_into_one_answer_comes_in_several),
	    cmocka_unit_test(test_it_is_the_same_on_tcp_and_as_text),
	    cmocka_unit_test(test_one_that_gives_the_basic_objects_alone_is_asked_for_them),
	    cmocka_unit_test(test_one_that_does_not_know_it_is_left_alone),
	    cmocka_unit_test(test_one_that_is_silent_is_left_alone),
	    cmocka_unit_test(test_one_that_hangs_up_is_left_alone),
	    cmocka_unit_test(test_it_waits_for_room_between_periods),
	    cmocka_unit_test(test_it_takes_a_small_share_of_the_line),
	};
	return cmocka_run_group_tests_name("modbus line identity", tests, NULL, NULL);
}
