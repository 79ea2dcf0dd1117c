/* SPDX-License-Identifier: GPL-3.0-or-later */
/* Peers of a TCP connection as they are: they hang up when idle or behind each answer, hang, want time behind a connect. */
#include "modbus/test_bus.h"

/* A connection has them whatever its frames are. */
static enum modbus_framing framing;

static void set_up_units(uint8_t units)
{
	set_up();
	use_connection(framing);
	for (uint8_t unit = 1; unit <= units; unit++) {
		add_device(unit, 1);
		add_objects(MODBUS_READ_HOLDING_REGISTERS, 0, 8);
		bus.devices[unit - 1].response_timeout_ns = 500 * MS;
		bus.devices[unit - 1].response_timeout_min_ns = 100 * MS;
	}
}

static void read_each(uint16_t period_ms)
{
	for (uint32_t i = 0; i < bus.devices[0].object_count; i++)
		bus.objects[0][i].period_ms = period_ms;
}

/* ---- it hangs up ------------------------------------------------------------------------------- */

static void test_a_peer_that_hangs_up_when_idle_is_connected_when_due(void **state)
{
	(void)state;
	set_up_units(1);
	read_each(10000);
	bus.peer.idle_ns = 3 * SECOND;
	start();
	run_for(600 * SECOND);
	assert_int_equal(bus.deaths[0], 0);
	assert_in_range(bus.reads_done[0], 59, 62);
	assert_in_range(bus.connections, 59, 62);
	assert_int_equal(bus.devices[0].counters.missed_periods, 0);
	assert_int_equal(bus.line.counters.timeouts, 0);
	assert_in_range(bus.line.connection.idle_ns, 2900 * MS, 3000 * MS);
	/* A command makes a connection of its own. */
	run_for(4 * SECOND);
	assert_true(bus.apart);
	command(0, MODBUS_WRITE_REGISTER, 3, 7, 1);
	run_for(SECOND);
	assert_int_equal(bus.last_result, MODBUS_DONE);
	assert_int_equal(bus.commands_done, 1);
}

static void test_a_peer_that_hangs_up_behind_each_answer_is_good(void **state)
{
	(void)state;
	set_up_units(1);
	bus.peer.idle_ns = 1;
	start();
	run_for(60 * SECOND);
	assert_int_equal(bus.deaths[0], 0);
	assert_true(bus.reads_done[0] > 1000);
	assert_in_range(bus.connections, bus.reads_done[0], bus.reads_done[0] + 3); /* and two probes */
	assert_int_equal(bus.line.counters.timeouts, 0);
}

/* The next request crosses it on its way: a read is asked again, and a write is not. */
static void hang_up_under_way(bool writing)
{
	set_up_units(1);
	read_each(1000);
	start();
	run_for(2500 * MS);
	bus.slaves[0].reaction_ns = 50 * MS;
	if (writing)
		command(0, MODBUS_WRITE_REGISTER, 3, 7, 1);
	run_for(writing ? MS : 510 * MS);
	assert_int_equal(bus.line.state, MODBUS_WAITING);
	bus.hang_up_ns = bus.now_ns + 1;
	run_for(SECOND);
}

static void test_a_read_that_is_cut_off_is_asked_again(void **state)
{
	(void)state;
	hang_up_under_way(false);
	assert_int_equal(bus.deaths[0], 0);
	assert_int_equal(bus.connections, 2);
	assert_int_equal(bus.devices[0].counters.missed_periods, 0);
	assert_int_equal(bus.reads_done[0], 4);
}

static void test_a_write_that_is_cut_off_is_not_repeated(void **state)
{
	(void)state;
	hang_up_under_way(true);
	assert_int_equal(bus.deaths[0], 0);
	assert_int_equal(bus.last_result, MODBUS_TIMED_OUT);
	run_for(10 * SECOND);
	assert_int_equal(sent_with(1, MODBUS_WRITE_REGISTER), 1);
	assert_int_equal(bus.commands_done, 1);
}

static void test_a_peer_that_is_gone_when_it_is_due_is_lost(void **state)
{
	(void)state;
	set_up_units(1);
	read_each(10000);
	bus.peer.idle_ns = 3 * SECOND;
	start();
	run_for(34 * SECOND);
	assert_true(bus.apart);
	modbus_line_close(&bus.line, bus.now_ns); /* as a port does that cannot connect */
	assert_int_equal(bus.deaths[0], 1);
	run_for(20 * SECOND);
	assert_int_equal(bus.births[0], 2);
}

/* Before it answers anything: there is nobody. */
static void test_a_peer_that_hangs_up_at_once_is_lost(void **state)
{
	(void)state;
	set_up_units(1);
	start();
	assert_false(modbus_line_interrupted(&bus.line, bus.now_ns));
	modbus_line_close(&bus.line, bus.now_ns);
	assert_int_equal(bus.births[0], 0);
}

/* One that hangs up on what it does not know is asked for less, and gives the rest. */
static void test_a_read_that_the_peer_hangs_up_on_is_divided(void **state)
{
	(void)state;
	set_up_units(1);
	add_objects(MODBUS_READ_HOLDING_REGISTERS, 400, 2);
	bus.peer.hangs_up_at = true;
	bus.peer.hated = 400;
	start();
	run_for(60 * SECOND);
	forget_trace();
	bus.deaths[0] = 0;
	run_for(60 * SECOND);
	assert_int_equal(bus.deaths[0], 0);
	assert_true(bus.objects_read[0] > 1000);
	assert_int_equal(bus.devices[0].read_count, 3);
}

/* ---- it hangs ---------------------------------------------------------------------------------- */

static void test_a_connection_that_hangs_is_made_anew(void **state)
{
	(void)state;
	set_up_units(1);
	bus.peer.hangs_after = 500;
	start();
	run_for(60 * SECOND);
	assert_in_range(bus.connections, 5, 15);
	assert_in_range(bus.line.connection.hung, bus.connections - 1, bus.connections);
	assert_true(bus.longest_ns[0] < 2 * SECOND);
	assert_true(bus.reads_done[0] > 3000);
}

static void test_a_connection_that_hangs_is_made_anew_for_all_its_units(void **state)
{
	(void)state;
	set_up_units(3);
	bus.peer.hangs_after = 1500;
	start();
	run_for(60 * SECOND);
	assert_true(bus.connections >= 2);
	for (unsigned i = 0; i < 3; i++)
		assert_true(bus.longest_ns[i] < 4 * SECOND);
}

/* It is the unit that is silent, not the connection. */
static void test_a_silent_unit_among_others_does_not_end_the_connection(void **state)
{
	(void)state;
	set_up_units(3);
	bus.slaves[1].present = false;
	start();
	run_for(600 * SECOND);
	bus.slaves[0].present = false;
	run_for(600 * SECOND);
	assert_int_equal(bus.connections, 1);
	assert_int_equal(bus.deaths[2], 0);
}

/* A lone unit that is dead behind a gateway: the connection is made anew less and less often, and each probe goes on. */
static void test_a_silent_unit_alone_ends_the_connection_less_and_less_often(void **state)
{
	unsigned connections;

	(void)state;
	set_up_units(1);
	start();
	run_for(SECOND);
	bus.slaves[0].present = false;
	run_for(600 * SECOND);
	connections = bus.connections;
	assert_in_range(connections, 5, 16);
	run_for(600 * SECOND);
	assert_in_range(bus.connections - connections, 5, 11);
	assert_int_equal(bus.deaths[0], 1);
	bus.slaves[0].present = true;
	run_for(61 * SECOND);
	assert_int_equal(bus.births[0], 2);
}

/* What comes later than its time-out, but comes, is no silence. */
static void test_a_slow_device_keeps_its_connection(void **state)
{
	(void)state;
	set_up_units(1);
	bus.slaves[0].reaction_ns = 1300 * MS;
	start();
	run_for(120 * SECOND);
	assert_int_equal(bus.connections, 1);
	assert_true(bus.lates[0] > 1);
	assert_int_equal(bus.devices[0].counters.too_late, bus.lates[0]);
	assert_true(bus.devices[0].latest_ns >= 1300 * MS);
	assert_true(bus.devices[0].latest_ns < 1400 * MS);
}

/* ---- it wants time ----------------------------------------------------------------------------- */

static void start_and_lose(unsigned times)
{
	start();
	run_for(15 * SECOND);
	for (unsigned i = 0; i < times; i++) {
		assert_true(bus.devices[0].alive);
		bus.hang_up_ns = bus.now_ns + 1;
		run_for(15 * SECOND);
	}
}

static void test_a_peer_that_is_silent_behind_its_connect_is_given_time(void **state)
{
	(void)state;
	set_up_units(1);
	bus.peer.settle_ns = 1500 * MS;
	start_and_lose(3);
	assert_in_range(bus.line.connection.settle_ns, 1500 * MS, 4 * SECOND);
	bus.line.counters.timeouts = bus.deaths[0] = 0;
	bus.hang_up_ns = bus.now_ns + 1;
	run_for(15 * SECOND);
	assert_int_equal(bus.line.counters.timeouts + bus.deaths[0], 0);
}

static void test_a_peer_that_hangs_up_on_what_comes_too_soon_is_given_time(void **state)
{
	(void)state;
	set_up_units(1);
	bus.peer.settle_ns = 2 * SECOND;
	bus.peer.hangs_up_early = true;
	start();
	run_for(30 * SECOND);
	assert_true(bus.devices[0].alive);
	assert_in_range(bus.line.connection.settle_ns, 2 * SECOND, 5 * SECOND);
	bus.deaths[0] = 0;
	bus.hang_up_ns = bus.now_ns + 1;
	run_for(15 * SECOND);
	assert_true(bus.devices[0].alive);
	assert_int_equal(bus.deaths[0], 0);
}

static void test_the_configuration_gives_it_time(void **state)
{
	(void)state;
	set_up_units(1);
	bus.peer.settle_ns = bus.line.connection.settle_least_ns = 2 * SECOND;
	start();
	run_for(10 * SECOND);
	assert_int_equal(bus.line.counters.timeouts, 0);
	assert_in_range(bus.reads_done[0], 700, 800);
	assert_int_equal(bus.line.counters.stuck_s, 0);
}

int main(void)
{
	const struct CMUnitTest tests[] = {
	    cmocka_unit_test(test_a_peer_that_hangs_up_when_idle_is_connected_when_due),
	    cmocka_unit_test(test_a_peer_that_hangs_up_behind_each_answer_is_good),
	    cmocka_unit_test(test_a_read_that_is_cut_off_is_asked_again),
	    cmocka_unit_test(test_a_write_that_is_cut_off_is_not_repeated),
	    cmocka_unit_test(test_a_peer_that_is_gone_when_it_is_due_is_lost),
	    cmocka_unit_test(test_a_peer_that_hangs_up_at_once_is_lost),
	    cmocka_unit_test(test_a_read_that_the_peer_hangs_up_on_is_divided),
	    cmocka_unit_test(test_a_connection_that_hangs_is_made_anew),
	    cmocka_unit_test(test_a_connection_that_hangs_is_made_anew_for_all_its_units),
	    cmocka_unit_test(test_a_silent_unit_among_others_does_not_end_the_connection),
	    cmocka_unit_test(test_a_silent_unit_alone_ends_the_connection_less_and_less_often),
	    cmocka_unit_test(test_a_slow_device_keeps_its_connection),
	    cmocka_unit_test(test_a_peer_that_is_silent_behind_its_connect_is_given_time),
	    cmocka_unit_test(test_a_peer_that_hangs_up_on_what_comes_too_soon_is_given_time),
	    cmocka_unit_test(test_the_configuration_gives_it_time),
	};
	int failed;

	framing = MODBUS_FRAMING_TCP;
	failed = cmocka_run_group_tests_name("modbus line connection", tests, NULL, NULL);
	framing = MODBUS_FRAMING_RTU;
	return failed + cmocka_run_group_tests_name("modbus line connection, RTU", tests, NULL, NULL);
}
