/* SPDX-License-Identifier: GPL-3.0-or-later */
/* Commands on a map of their own, with a line that the test holds in its hand. */
#include "map/test_stage.h"
#include "modbus/convert.h"
#include "modules/modbus/commands.h"

#define MS         1000000LL
#define COIL       1 /* a single point */
#define APART      2 /* a double point on coils 10 and 20 */
#define REGISTER   3
#define NEIGHBOURS 0 /* a double point on coils 10 and 11 */

static struct write {
	uint32_t point;
	struct modbus_request request;
	int64_t deadline_ns;
} writes[16];
static unsigned write_count;
static bool closed;

static struct command_stage stage_of;
static struct commands_progress progress[POINTS];
static int8_t exponents[POINTS];
static struct commands commands;
static int64_t now;
static struct modbus_point wire[POINTS];
static struct modbus_port port;
static struct modbus_extra elsewhere = {.write_address = 31};
static struct modbus_slave slaves[] = {{.unit = 1}, {.unit = 1}};

static bool take_write(void *context, uint32_t point, const struct modbus_request *request,
		       int64_t deadline_ns)
{
	(void)context;
	if (closed)
		return false;
	writes[write_count++] = (struct write){point, *request, deadline_ns};
	return true;
}

static void start_owner(struct stage *stage)
{
	stage_of.owner = start(stage, FIRST);
	map_heartbeat(stage_of.owner);
	memset(exponents, 0, sizeof(exponents));
	commands = (struct commands){
	    .map = stage_of.owner, .exponents = exponents, .progress = progress, .write = take_write};
	commands_resume(&commands);
}

static int start_stage(void **state)
{
	struct stage *stage;
	struct map_point *points;

	set_up(state);
	stage = *state;
	points = stage->points;
	for (uint32_t i = 0; i < POINTS; i++)
		wire[i] = (struct modbus_point){.table = MODBUS_HOLDING_REGISTERS,
						.type = MAP_SCALED,
						.address = (uint16_t)(i % 4),
						.width = 1,
						.scale = 1};
	wire[COIL].table = wire[APART].table = MODBUS_COILS;
	points[COIL].type = wire[COIL].type = MAP_SINGLE;
	points[APART].type = wire[APART].type = MAP_DOUBLE;
	wire[APART].width = 2;
	wire[APART].address = 10;
	wire[APART].second_address = 20;
	points[NEIGHBOURS] = points[APART];
	wire[NEIGHBOURS] = wire[APART];
	wire[NEIGHBOURS].second_address = 11;
	points[REGISTER].flags = MAP_POINT_COMMAND;
	wire[REGISTER].format = MODBUS_FORMAT_INT16;
	map_add_section(&stage->config, MODBUS_POINTS, sizeof(wire[0]), POINTS, wire);
	map_add_section(&stage->config, MODBUS_PORTS, sizeof(port), 1, &port);
	map_add_section(&stage->config, MODBUS_EXTRAS, sizeof(elsewhere), 1, &elsewhere);
	map_add_section(&stage->config, MODBUS_SLAVES, sizeof(slaves[0]), 2, slaves);
	make_again(stage);
	write_count = 0;
	closed = false;
	now = map_now_ns();
	start_owner(stage);
	stage_of.requester = start(stage, "rtu-iec104");
	return 0;
}

static int end_stage(void **state)
{
	end_commands(&stage_of);
	return tear_down(state);
}

static void command(uint32_t point, int32_t value, uint16_t pulse_ms)
{
	struct map_request wish = request(point, MAP_EXECUTE, 1, value), taken;

	wish.pulse_ms = pulse_ms;
	assert_int_not_equal(map_request_post(stage_of.requester, wish), 0);
	assert_true(map_request_next(stage_of.owner, &taken));
	commands_request(&commands, &taken);
}

static void expect_write(uint32_t point, uint16_t address, uint16_t value)
{
	assert_int_equal(write_count, 1);
	assert_int_equal(writes[0].point, point);
	assert_int_equal(writes[0].request.address, address);
	assert_int_equal(writes[0].request.values[0], value);
	write_count = 0;
}

static void expect(enum map_command_state state, enum map_command_result result)
{
	assert_answer(&stage_of, state, result);
}

static void forget_answer(void)
{
	struct map_answer answer;

	assert_true(map_answer_next(stage_of.requester, &answer));
}

static void expect_no_answer(void)
{
	struct map_answer answer;

	assert_false(map_answer_next(stage_of.requester, &answer));
}

static void device_answers(uint32_t point, enum modbus_result result)
{
	commands_answered(&commands, point, result, result == MODBUS_REFUSED ? 2 : 0, now);
}

static void read_back(uint32_t point)
{
	assert_int_equal(commands_cause(&commands, point), MAP_RETURN_REMOTE);
	commands_published(&commands, point);
	assert_int_equal(commands_cause(&commands, point), MAP_SPONTANEOUS);
}

static void pass(int64_t duration_ns)
{
	now += duration_ns;
	commands_run(&commands, now);
}

static void test_confirmation_read_back_end(void **state)
{
	(void)state;
	command(REGISTER, 7, 0);
	expect(MAP_EXECUTING, MAP_RESULT_NONE);
	expect_write(REGISTER, 3, 7);
	commands_published(&commands, REGISTER); /* read before it was written */
	assert_int_equal(commands_cause(&commands, REGISTER), MAP_SPONTANEOUS);
	expect_no_answer();
	device_answers(REGISTER, MODBUS_DONE);
	expect(MAP_EXECUTING, MAP_RESULT_DONE);
	expect_no_answer();
	read_back(REGISTER);
	expect(MAP_EXECUTED_COMMAND, MAP_RESULT_DONE);
	assert_int_equal(commands.count, 0);
	assert_true(commands_deadline(&commands) == INT64_MAX);
}

static void test_the_next_command_waits_for_the_read_back(void **state)
{
	(void)state;
	command(REGISTER, 7, 0);
	expect(MAP_EXECUTING, MAP_RESULT_NONE);
	command(REGISTER, 8, 0);
	expect(MAP_REFUSED_COMMAND, MAP_RESULT_INTERLOCK);
	device_answers(REGISTER, MODBUS_DONE);
	expect(MAP_EXECUTING, MAP_RESULT_DONE);
	command(REGISTER, 8, 0);
	expect_no_answer();
	command(REGISTER, 9, 0); /* one may wait */
	expect(MAP_REFUSED_COMMAND, MAP_RESULT_INTERLOCK);
	write_count = 0;
	read_back(REGISTER);
	expect(MAP_EXECUTED_COMMAND, MAP_RESULT_DONE);
	expect(MAP_EXECUTING, MAP_RESULT_NONE);
	expect_write(REGISTER, 3, 8);
	device_answers(REGISTER, MODBUS_DONE);
	expect(MAP_EXECUTING, MAP_RESULT_DONE);
	assert_int_equal(commands.held_count, 0);
}

static void test_without_read_back_it_ends_all_the_same(void **state)
{
	(void)state;
	command(REGISTER, 7, 0);
	expect(MAP_EXECUTING, MAP_RESULT_NONE);
	device_answers(REGISTER, MODBUS_DONE);
	expect(MAP_EXECUTING, MAP_RESULT_DONE);
	pass(COMMANDS_READ_BACK_NS - 1);
	expect_no_answer();
	pass(1);
	expect(MAP_EXECUTED_COMMAND, MAP_RESULT_DONE);
	command(REGISTER, 8, 0);
	device_answers(REGISTER, MODBUS_DONE);
	expect(MAP_EXECUTING, MAP_RESULT_NONE);
	expect(MAP_EXECUTING, MAP_RESULT_DONE);
	commands_device_changed(&commands, 1, false, now);
	pass(0);
	expect_no_answer();
	commands_device_changed(&commands, 0, false, now);
	pass(0);
	expect(MAP_EXECUTED_COMMAND, MAP_RESULT_DONE);
}

/* It has left, and nobody answers it: it is never executed. */
static void test_a_broadcast_is_sent_and_unanswered(void **state)
{
	struct stage *stage = *state;

	modbus_slaves(&stage->rtud->config)[stage->points[REGISTER].set].unit = MODBUS_BROADCAST;
	command(REGISTER, 7, 0);
	expect(MAP_EXECUTING, MAP_RESULT_NONE);
	device_answers(REGISTER, MODBUS_DONE);
	expect(MAP_EXECUTING, MAP_RESULT_DONE);
	expect(MAP_REFUSED_COMMAND, MAP_RESULT_SENT);
	assert_int_equal(commands.count, 0);
	command(REGISTER, 8, 0);
	expect(MAP_EXECUTING, MAP_RESULT_NONE);
	device_answers(REGISTER, MODBUS_NOT_SENT);
	expect(MAP_REFUSED_COMMAND, MAP_RESULT_TIMEOUT);
}

static void leave_to_polling(void **state, uint32_t point)
{
	struct stage *stage = *state;

	modbus_points(&stage->rtud->config)[point].flags |= MODBUS_NO_READ_BACK;
}

static void command_register(int32_t value)
{
	command(REGISTER, value, 0);
	expect(MAP_EXECUTING, MAP_RESULT_NONE);
	device_answers(REGISTER, MODBUS_DONE);
	expect(MAP_EXECUTING, MAP_RESULT_DONE);
	expect(MAP_EXECUTED_COMMAND, MAP_RESULT_DONE);
}

static void test_the_confirmation_ends_what_is_not_to_be_read_back(void **state)
{
	leave_to_polling(state, REGISTER);
	command_register(7);
	read_back(REGISTER); /* by a read in its turn */
	assert_int_equal(commands.count, 0);
	expect_no_answer();
	command_register(8);
	command_register(9); /* before anything was read */
	assert_int_equal(commands.count, 1);
	read_back(REGISTER);
	assert_int_equal(commands.count, 0);
	assert_true(commands_deadline(&commands) == INT64_MAX);
}

static void test_what_is_read_much_later_is_no_return(void **state)
{
	leave_to_polling(state, REGISTER);
	command_register(7);
	pass(COMMANDS_READ_LATER_NS - 1);
	assert_int_equal(commands_cause(&commands, REGISTER), MAP_RETURN_REMOTE);
	pass(1);
	assert_int_equal(commands_cause(&commands, REGISTER), MAP_SPONTANEOUS);
	assert_int_equal(commands.count, 0);
	command_register(8);
	commands_device_changed(&commands, 0, false, now);
	pass(0);
	assert_int_equal(commands_cause(&commands, REGISTER), MAP_SPONTANEOUS);
	assert_int_equal(commands.count, 0);
	expect_no_answer();
}

/* Nothing can be read back. */
static void test_the_confirmation_ends_what_is_never_read(void **state)
{
	struct stage *stage = *state;

	stage->rtud->config.points[REGISTER].flags |= MAP_POINT_NEVER_READ;
	command_register(7);
	assert_int_equal(commands.count, 0);
	command_register(8);
	assert_int_equal(commands.count, 0);
	expect_no_answer();
}

/* The double is read on coils 10 and 20, and written to 31 and 32: neighbours, in one write. */
static void test_commands_go_where_the_point_is_written(void **state)
{
	struct stage *stage = *state;
	struct modbus_point *points = modbus_points(&stage->rtud->config);

	points[APART].table = MODBUS_DISCRETE_INPUTS;
	points[APART].flags |= MODBUS_WRITTEN_ELSEWHERE;
	points[APART].extra = 1;
	command(APART, 2, 500);
	expect(MAP_EXECUTING, MAP_RESULT_NONE);
	assert_int_equal(writes[0].request.function, MODBUS_WRITE_COILS);
	assert_int_equal(writes[0].request.values[1], 1);
	expect_write(APART, 31, 0);
	device_answers(APART, MODBUS_DONE);
	expect(MAP_EXECUTING, MAP_RESULT_DONE);
	pass(500 * MS);
	assert_int_equal(writes[0].request.values[1], 0);
	expect_write(APART, 31, 0);
	device_answers(APART, MODBUS_DONE);
	read_back(APART);
	expect(MAP_EXECUTED_COMMAND, MAP_RESULT_DONE);
}

static void test_refusals(void **state)
{
	static const enum map_command_result results[] = {[MODBUS_REFUSED] = MAP_RESULT_EXCEPTION,
							  [MODBUS_TIMED_OUT] = MAP_RESULT_TIMEOUT,
							  [MODBUS_TOO_OLD] = MAP_RESULT_TOO_OLD,
							  [MODBUS_NOT_SENT] = MAP_RESULT_TIMEOUT};

	(void)state;
	for (unsigned result = MODBUS_REFUSED; result <= MODBUS_NOT_SENT; result++) {
		command(REGISTER, 7, 0);
		expect(MAP_EXECUTING, MAP_RESULT_NONE);
		device_answers(REGISTER, result);
		expect(MAP_REFUSED_COMMAND, results[result]);
	}
	closed = true;
	command(REGISTER, 7, 0);
	expect(MAP_EXECUTING, MAP_RESULT_NONE);
	expect(MAP_REFUSED_COMMAND, MAP_RESULT_TIMEOUT);
	assert_int_equal(commands.count, 0);
}

static void test_without_its_power_of_ten_nothing_is_written(void **state)
{
	(void)state;
	exponents[REGISTER] = CONVERT_NO_EXPONENT;
	command(REGISTER, 5, 0);
	assert_int_equal(write_count, 0);
	expect(MAP_EXECUTING, MAP_RESULT_NONE);
	expect(MAP_REFUSED_COMMAND, MAP_RESULT_NO_SCALE);
	exponents[REGISTER] = -1;
	command(REGISTER, 5, 0);
	assert_int_equal(write_count, 1);
	assert_int_equal(writes[0].request.values[0], 50);
}

static void test_the_second_write_waits_for_the_first(void **state)
{
	(void)state;
	command(APART, 2, 0);
	expect(MAP_EXECUTING, MAP_RESULT_NONE);
	expect_write(APART, 10, 0);
	device_answers(APART, MODBUS_DONE);
	expect_no_answer();
	assert_true(writes[0].deadline_ns == MODBUS_NEVER); /* half a command is not left alone */
	expect_write(APART, 20, 1);
	device_answers(APART, MODBUS_DONE);
	expect(MAP_EXECUTING, MAP_RESULT_DONE);
	read_back(APART);
	expect(MAP_EXECUTED_COMMAND, MAP_RESULT_DONE);

	command(APART, 1, 0);
	expect(MAP_EXECUTING, MAP_RESULT_NONE);
	expect_write(APART, 20, 0);
	device_answers(APART, MODBUS_REFUSED);
	expect(MAP_REFUSED_COMMAND, MAP_RESULT_EXCEPTION);
	assert_int_equal(write_count, 0);
}

/* By the device's own word, and no other, it is written coil by coil. */
static void test_a_device_without_function_15_gets_two_writes(void **state)
{
	(void)state;
	command(NEIGHBOURS, 2, 0);
	expect(MAP_EXECUTING, MAP_RESULT_NONE);
	assert_int_equal(writes[0].request.function, MODBUS_WRITE_COILS);
	write_count = 0;
	commands_answered(&commands, NEIGHBOURS, MODBUS_REFUSED, MODBUS_ILLEGAL_FUNCTION, now);
	expect_no_answer();
	expect_write(NEIGHBOURS, 10, 0);
	device_answers(NEIGHBOURS, MODBUS_DONE);
	expect_write(NEIGHBOURS, 11, 1);
	device_answers(NEIGHBOURS, MODBUS_DONE);
	expect(MAP_EXECUTING, MAP_RESULT_DONE);
	read_back(NEIGHBOURS);
	expect(MAP_EXECUTED_COMMAND, MAP_RESULT_DONE);

	command(NEIGHBOURS, 1, 0);
	expect(MAP_EXECUTING, MAP_RESULT_NONE);
	write_count = 0;
	device_answers(NEIGHBOURS, MODBUS_TIMED_OUT);
	expect(MAP_REFUSED_COMMAND, MAP_RESULT_TIMEOUT);
	assert_int_equal(write_count, 0);
}

static void begin_pulse(uint16_t pulse_ms)
{
	command(COIL, 1, pulse_ms);
	expect(MAP_EXECUTING, MAP_RESULT_NONE);
	expect_write(COIL, 1, 1);
}

static void test_a_pulse_ends(void **state)
{
	(void)state;
	begin_pulse(500);
	pass(60000 * MS); /* it lasts from the device's answer on */
	assert_int_equal(write_count, 0);
	device_answers(COIL, MODBUS_DONE);
	expect(MAP_EXECUTING, MAP_RESULT_DONE);
	read_back(COIL);
	expect_no_answer();
	assert_true(commands_deadline(&commands) == now + 500 * MS);
	assert_true(map_pulse_end(stage_of.owner, COIL) == now + 500 * MS);
	pass(500 * MS - 1);
	assert_int_equal(write_count, 0);
	pass(1);
	assert_true(writes[0].deadline_ns == MODBUS_NEVER);
	expect_write(COIL, 1, 0);
	pass(10 * MS);
	assert_int_equal(write_count, 0);
	device_answers(COIL, MODBUS_DONE);
	assert_true(map_pulse_end(stage_of.owner, COIL) == 0);
	expect_no_answer();
	read_back(COIL);
	expect(MAP_EXECUTED_COMMAND, MAP_RESULT_DONE);
}

static void test_a_pulse_that_is_not_read_back_ends_with_its_last_write(void **state)
{
	leave_to_polling(state, COIL);
	begin_pulse(500);
	device_answers(COIL, MODBUS_DONE);
	expect(MAP_EXECUTING, MAP_RESULT_DONE);
	read_back(COIL);
	pass(500 * MS);
	expect_write(COIL, 1, 0);
	expect_no_answer();
	device_answers(COIL, MODBUS_DONE);
	expect(MAP_EXECUTED_COMMAND, MAP_RESULT_DONE);
	read_back(COIL);
	assert_int_equal(commands.count, 0);
}

static void test_a_pulse_is_ended_until_the_device_confirms(void **state)
{
	static const int64_t pauses_ms[] = {1000, 2000, 4000, 8000, 16000, 32000, 60000, 60000};

	(void)state;
	begin_pulse(500);
	device_answers(COIL, MODBUS_DONE);
	expect(MAP_EXECUTING, MAP_RESULT_DONE);
	pass(500 * MS);
	for (unsigned i = 0; i < sizeof(pauses_ms) / sizeof(pauses_ms[0]); i++) {
		expect_write(COIL, 1, 0);
		device_answers(COIL, i % 2 ? MODBUS_REFUSED : MODBUS_TIMED_OUT);
		if (i == 0)
			expect(MAP_REFUSED_COMMAND, MAP_RESULT_TIMEOUT);
		pass(pauses_ms[i] * MS - 1);
		assert_int_equal(write_count, 0);
		command(COIL, 1, 0);
		expect(MAP_REFUSED_COMMAND, MAP_RESULT_INTERLOCK);
		pass(1);
	}
	expect_write(COIL, 1, 0);
	device_answers(COIL, MODBUS_TIMED_OUT);
	commands_device_changed(&commands, 0, true, now);
	pass(0);
	expect_write(COIL, 1, 0);
	device_answers(COIL, MODBUS_DONE);
	expect_no_answer();
	command(COIL, 1, 0);
	expect(MAP_EXECUTING, MAP_RESULT_NONE);
}

static void test_pulses_are_ended_early_when_the_process_stops(void **state)
{
	(void)state;
	assert_false(commands_end_pulses(&commands, now));
	begin_pulse(60000);
	device_answers(COIL, MODBUS_DONE);
	assert_true(commands_end_pulses(&commands, now));
	pass(0);
	expect_write(COIL, 1, 0);
	assert_true(commands_end_pulses(&commands, now));
	device_answers(COIL, MODBUS_DONE);
	assert_false(commands_end_pulses(&commands, now));
}

static void test_a_pulse_that_may_have_begun_is_ended(void **state)
{
	(void)state;
	begin_pulse(500);
	device_answers(COIL, MODBUS_TIMED_OUT);
	expect(MAP_REFUSED_COMMAND, MAP_RESULT_TIMEOUT);
	pass(500 * MS);
	expect_write(COIL, 1, 0);
	device_answers(COIL, MODBUS_DONE);
	assert_int_equal(commands.count, 0);
}

/* Its coil may be on for another reason: off is not to be written. */
static void test_a_pulse_that_did_not_begin_is_not_ended(void **state)
{
	static const enum modbus_result results[] = {MODBUS_REFUSED, MODBUS_TOO_OLD, MODBUS_NOT_SENT};

	(void)state;
	for (unsigned i = 0; i < sizeof(results) / sizeof(results[0]); i++) {
		begin_pulse(500);
		device_answers(COIL, results[i]);
		forget_answer();
		assert_int_equal(commands.count, 0);
		assert_true(map_pulse_end(stage_of.owner, COIL) == 0);
	}
	command(APART, 2, 500);
	device_answers(APART, MODBUS_TIMED_OUT); /* the coil that goes off anyway */
	assert_int_equal(commands.count, 0);
}

static void restart(void **state)
{
	struct stage *stage = *state;

	map_module_ended(stage->rtud, index_of(stage, FIRST), true);
	map_detach(stage_of.owner);
	write_count = 0;
	start_owner(stage);
}

static void test_a_pulse_is_ended_by_the_next_process(void **state)
{
	begin_pulse(500);
	device_answers(COIL, MODBUS_DONE);
	command(APART, 1, 500);
	device_answers(APART, MODBUS_DONE); /* and before the second write is answered */
	closed = true;
	restart(state);
	assert_int_equal(commands.count, 2);
	now = map_now_ns();
	pass(0); /* the port is not open yet: what nobody knows to have begun is due at once */
	closed = false;
	commands_device_changed(&commands, 0, true, now);
	pass(0);
	assert_int_equal(write_count, 1);
	assert_int_equal(writes[0].point, APART);
	restart(state);
	now = map_now_ns() + 500 * MS;
	pass(0);
	assert_int_equal(write_count, 2);
	device_answers(COIL, MODBUS_DONE);
	device_answers(APART, MODBUS_DONE);
	device_answers(APART, MODBUS_DONE);
	assert_int_equal(commands.count, 0);
	restart(state);
	assert_int_equal(commands.count, 0);
}

#define TEST_COMMANDS(name) cmocka_unit_test_setup_teardown(name, start_stage, end_stage)

int main(void)
{
	const struct CMUnitTest tests[] = {
	    TEST_COMMANDS(test_confirmation_read_back_end),
	    TEST_COMMANDS(test_the_next_command_waits_for_the_read_back),
	    TEST_COMMANDS(test_without_read_back_it_ends_all_the_same),
	    TEST_COMMANDS(test_a_broadcast_is_sent_and_unanswered),
	    TEST_COMMANDS(test_the_confirmation_ends_what_is_not_to_be_read_back),
	    TEST_COMMANDS(test_what_is_read_much_later_is_no_return),
	    TEST_COMMANDS(test_the_confirmation_ends_what_is_never_read),
	    TEST_COMMANDS(test_commands_go_where_the_point_is_written),
	    TEST_COMMANDS(test_refusals),
	    TEST_COMMANDS(test_without_its_power_of_ten_nothing_is_written),
	    TEST_COMMANDS(test_the_second_write_waits_for_the_first),
	    TEST_COMMANDS(test_a_device_without_function_15_gets_two_writes),
	    TEST_COMMANDS(test_a_pulse_ends),
	    TEST_COMMANDS(test_a_pulse_that_is_not_read_back_ends_with_its_last_write),
	    TEST_COMMANDS(test_a_pulse_is_ended_until_the_device_confirms),
	    TEST_COMMANDS(test_pulses_are_ended_early_when_the_process_stops),
	    TEST_COMMANDS(test_a_pulse_that_may_have_begun_is_ended),
	    TEST_COMMANDS(test_a_pulse_that_did_not_begin_is_not_ended),
	    TEST_COMMANDS(test_a_pulse_is_ended_by_the_next_process),
	};

	return cmocka_run_group_tests(tests, NULL, NULL);
}
