/* SPDX-License-Identifier: GPL-3.0-or-later */
/* One command a point: selection, execution, release, and nothing twice. */
#include "map/test_stage.h"

static void assert_command(const struct stage *stage, uint32_t point, enum map_command_state state)
{
	struct map_command command;

	assert_true(map_command_read(stage->rtud, point, &command));
	assert_int_equal(command.state, state);
}

static void test_a_direct_command_is_executed_and_released(void **state)
{
	struct stage *stage = *state;
	struct command_stage commands = start_commands(stage);
	struct map_answer answer;

	assert_true(post(&commands, request(1, MAP_EXECUTE, 1, 255)));
	assert_answer(&commands, MAP_EXECUTING, MAP_RESULT_NONE);
	assert_command(stage, 1, MAP_EXECUTING);
	map_command_finish(commands.owner, 1, MAP_RESULT_EXCEPTION, 2);
	assert_true(map_answer_next(commands.requester, &answer));
	assert_int_equal(answer.state, MAP_REFUSED_COMMAND);
	assert_int_equal(answer.result, MAP_RESULT_EXCEPTION);
	assert_int_equal(answer.detail, 2);
	assert_false(post(&commands, request(1, MAP_RELEASE, 1, 0)));
	assert_false(map_answer_next(commands.requester, &answer));
	assert_command(stage, 1, MAP_INACTIVE);
	end_commands(&commands);
}

static void test_a_command_is_confirmed_before_it_ends(void **state)
{
	struct stage *stage = *state;
	struct command_stage commands = start_commands(stage);

	map_command_confirm(commands.owner, 1); /* nothing is under way */
	assert_true(post(&commands, request(1, MAP_EXECUTE, 1, 255)));
	assert_answer(&commands, MAP_EXECUTING, MAP_RESULT_NONE);
	map_command_confirm(commands.owner, 1);
	assert_answer(&commands, MAP_EXECUTING, MAP_RESULT_DONE);
	assert_false(post(&commands, request(1, MAP_EXECUTE, 1, 255)));
	assert_answer(&commands, MAP_REFUSED_COMMAND, MAP_RESULT_INTERLOCK);
	map_command_finish(commands.owner, 1, MAP_RESULT_DONE, 0);
	assert_answer(&commands, MAP_EXECUTED_COMMAND, MAP_RESULT_DONE);
	end_commands(&commands);
}

static uint32_t log_lines(const struct stage *stage, uint32_t *position, char text[MAP_LOG_TEXT_SIZE])
{
	struct map_log_line line;
	uint32_t lines = 0, lost = 0;

	for (; map_log_next(stage->rtud, index_of(stage, FIRST), position, &line, &lost); lines++)
		snprintf(text, MAP_LOG_TEXT_SIZE, "%s", line.text);
	return lines;
}

static void carry_out(struct command_stage *commands, int32_t value, enum map_command_result result)
{
	assert_true(post(commands, request(1, MAP_EXECUTE, 1, value)));
	map_command_finish(commands->owner, 1, result, 4);
	assert_false(post(commands, request(1, MAP_RELEASE, 1, 0)));
}

/* How it ended, and who wanted it; of many for one point, how many more there were. */
static void test_the_log_says_how_a_command_ended(void **state)
{
	struct stage *stage = *state;
	struct command_stage commands = start_commands(stage);
	char text[MAP_LOG_TEXT_SIZE], name[MAP_NAME_SIZE], expected[MAP_LOG_TEXT_SIZE];
	uint32_t position = 0;

	map_point_name(&commands.owner->config, &commands.owner->config.points[1], name);
	carry_out(&commands, 255, MAP_RESULT_DONE);
	assert_int_equal(log_lines(stage, &position, text), 1);
	snprintf(expected, sizeof(expected), "%s = 255: done, commanded by rtu-iec104", name);
	assert_string_equal(text, expected);
	carry_out(&commands, 7, MAP_RESULT_EXCEPTION);
	assert_int_equal(log_lines(stage, &position, text), 1);
	snprintf(expected, sizeof(expected), "%s = 7: exception 4, commanded by rtu-iec104", name);
	assert_string_equal(text, expected);
	for (int i = 0; i < 100; i++)
		carry_out(&commands, i, MAP_RESULT_DONE);
	assert_in_range(log_lines(stage, &position, text), 18, 20);
	commands.owner->commanded[stage->points[1].command].paid_ns = 0; /* an hour later */
	carry_out(&commands, 3, MAP_RESULT_DONE);
	assert_int_equal(log_lines(stage, &position, text), 1);
	assert_non_null(strstr(text, " more since the last line"));
	end_commands(&commands);
}

static struct map_request pulse(uint32_t point, enum map_action action, uint16_t pulse_ms)
{
	struct map_request wish = request(point, action, 1, 1);

	wish.pulse_ms = pulse_ms;
	return wish;
}

static void test_no_command_until_a_pulse_has_ended(void **state)
{
	struct stage *stage = *state;
	struct command_stage commands = start_commands(stage);

	assert_true(post(&commands, pulse(1, MAP_EXECUTE, 500)));
	assert_answer(&commands, MAP_EXECUTING, MAP_RESULT_NONE);
	map_pulse_set_end(commands.owner, 1, 12345);
	map_command_finish(commands.owner, 1, MAP_RESULT_TIMEOUT, 0);
	assert_answer(&commands, MAP_REFUSED_COMMAND, MAP_RESULT_TIMEOUT);
	assert_false(post(&commands, request(1, MAP_RELEASE, 1, 0)));
	assert_command(stage, 1, MAP_INACTIVE);
	assert_false(post(&commands, request(1, MAP_SELECT, 1, 1)));
	assert_answer(&commands, MAP_REFUSED_SELECTION, MAP_RESULT_INTERLOCK);
	assert_false(post(&commands, request(1, MAP_EXECUTE, 1, 0)));
	assert_answer(&commands, MAP_REFUSED_COMMAND, MAP_RESULT_INTERLOCK);
	assert_true(map_pulse_end(commands.owner, 1) == 12345);
	map_pulse_set_end(commands.owner, 1, 0);
	assert_true(post(&commands, request(1, MAP_EXECUTE, 1, 0)));
	end_commands(&commands);
}

static void test_a_selection_binds_the_kind_of_command(void **state)
{
	struct stage *stage = *state;
	struct command_stage commands = start_commands(stage);
	struct map_request step = request(3, MAP_SELECT, 1, 0);

	assert_false(post(&commands, pulse(3, MAP_SELECT, 500)));
	assert_answer(&commands, MAP_ACCEPTED_SELECTION, MAP_RESULT_NONE);
	assert_false(post(&commands, pulse(3, MAP_EXECUTE, 0)));
	assert_answer(&commands, MAP_REFUSED_COMMAND, MAP_RESULT_NOT_SELECTED);
	step.step = 1;
	assert_false(post(&commands, step));
	assert_answer(&commands, MAP_ACCEPTED_SELECTION, MAP_RESULT_NONE);
	step.step = -1;
	step.action = MAP_EXECUTE;
	assert_false(post(&commands, step));
	assert_answer(&commands, MAP_REFUSED_COMMAND, MAP_RESULT_NOT_SELECTED);
	end_commands(&commands);
}

static void test_a_selection_binds_requester_and_value(void **state)
{
	struct stage *stage = *state;
	struct command_stage commands = start_commands(stage);

	assert_false(post(&commands, request(3, MAP_EXECUTE, 1, 9)));
	assert_answer(&commands, MAP_REFUSED_COMMAND, MAP_RESULT_NOT_SELECTED);

	assert_false(post(&commands, request(3, MAP_SELECT, 1, 9)));
	assert_answer(&commands, MAP_ACCEPTED_SELECTION, MAP_RESULT_NONE);
	assert_false(post(&commands, request(3, MAP_SELECT, 2, 9)));
	assert_answer(&commands, MAP_REFUSED_SELECTION, MAP_RESULT_INTERLOCK);
	assert_false(post(&commands, request(3, MAP_EXECUTE, 2, 9)));
	assert_answer(&commands, MAP_REFUSED_COMMAND, MAP_RESULT_INTERLOCK);
	assert_command(stage, 3, MAP_ACCEPTED_SELECTION); /* a stranger does not end it */

	assert_false(post(&commands, request(3, MAP_EXECUTE, 1, 8)));
	assert_answer(&commands, MAP_REFUSED_COMMAND, MAP_RESULT_NOT_SELECTED);
	assert_false(post(&commands, request(3, MAP_EXECUTE, 1, 9))); /* the wrong value ended it */
	assert_answer(&commands, MAP_REFUSED_COMMAND, MAP_RESULT_NOT_SELECTED);

	assert_false(post(&commands, request(3, MAP_SELECT, 1, 9)));
	assert_answer(&commands, MAP_ACCEPTED_SELECTION, MAP_RESULT_NONE);
	assert_true(post(&commands, request(3, MAP_EXECUTE, 1, 9)));
	assert_answer(&commands, MAP_EXECUTING, MAP_RESULT_NONE);
	map_command_finish(commands.owner, 3, MAP_RESULT_DONE, 0);
	assert_answer(&commands, MAP_EXECUTED_COMMAND, MAP_RESULT_DONE);
	end_commands(&commands);
}

static void test_a_selection_is_cancelled_by_its_holder(void **state)
{
	struct stage *stage = *state;
	struct command_stage commands = start_commands(stage);

	assert_false(post(&commands, request(3, MAP_SELECT, 1, 9)));
	assert_answer(&commands, MAP_ACCEPTED_SELECTION, MAP_RESULT_NONE);
	assert_false(post(&commands, request(3, MAP_CANCEL, 2, 9)));
	assert_answer(&commands, MAP_REFUSED_SELECTION, MAP_RESULT_NOT_SELECTED);
	assert_false(post(&commands, request(3, MAP_CANCEL, 1, 9)));
	assert_answer(&commands, MAP_INTERRUPTED_SELECTION, MAP_RESULT_DONE);
	assert_false(post(&commands, request(3, MAP_EXECUTE, 1, 9)));
	assert_answer(&commands, MAP_REFUSED_COMMAND, MAP_RESULT_NOT_SELECTED);
	end_commands(&commands);
}

static void test_a_selection_ends_by_itself(void **state)
{
	struct stage *stage = *state;
	struct command_stage commands = start_commands(stage);

	atomic_store(&stage->rtud->directory->select_timeout_s, 0);
	assert_false(post(&commands, request(3, MAP_SELECT, 1, 9)));
	assert_answer(&commands, MAP_ACCEPTED_SELECTION, MAP_RESULT_NONE);
	assert_command(stage, 3, MAP_INTERRUPTED_SELECTION); /* before anybody asks its owner for more */
	assert_false(post(&commands, request(3, MAP_EXECUTE, 1, 9)));
	assert_answer(&commands, MAP_REFUSED_COMMAND, MAP_RESULT_NOT_SELECTED);
	end_commands(&commands);
}

static void test_a_selection_ends_with_its_requesters_process(void **state)
{
	struct stage *stage = *state;
	struct command_stage commands = start_commands(stage);

	assert_false(post(&commands, request(3, MAP_SELECT, 1, 9)));
	assert_answer(&commands, MAP_ACCEPTED_SELECTION, MAP_RESULT_NONE);
	map_detach(commands.requester);

	assert_command(stage, 3, MAP_ACCEPTED_SELECTION);
	commands.requester = start(stage, "rtu-iec104");
	assert_command(stage, 3, MAP_INTERRUPTED_SELECTION);
	assert_false(
	    post(&commands, request(3, MAP_EXECUTE, 1, 9))); /* the same session number is another's */
	assert_answer(&commands, MAP_REFUSED_COMMAND, MAP_RESULT_NOT_SELECTED);
	assert_false(post(&commands, request(3, MAP_SELECT, 2, 8)));
	assert_answer(&commands, MAP_ACCEPTED_SELECTION, MAP_RESULT_NONE);
	end_commands(&commands);
}

static void test_a_command_ends_with_its_owners_process(void **state)
{
	struct stage *stage = *state;
	struct command_stage commands = start_commands(stage);
	struct map_command command;

	assert_true(post(&commands, request(1, MAP_EXECUTE, 1, 1)));
	assert_true(post(&commands, request(2, MAP_EXECUTE, 2, 2)));
	map_command_confirm(commands.owner, 2);
	assert_false(post(&commands, request(3, MAP_SELECT, 3, 3)));
	map_module_ended(stage->rtud, map_owner(stage->rtud, 1), true);
	assert_command(stage, 1, MAP_REFUSED_COMMAND);
	map_module_starting(stage->rtud, map_owner(stage->rtud, 1));
	assert_true(map_command_read(stage->rtud, 1, &command));
	assert_int_equal(command.state, MAP_REFUSED_COMMAND);
	assert_int_equal(command.result, MAP_RESULT_UNKNOWN_FATE);
	assert_command(stage, 2, MAP_EXECUTED_COMMAND);
	assert_command(stage, 3, MAP_INTERRUPTED_SELECTION);
	end_commands(&commands);
}

static void test_one_command_a_point_at_a_time(void **state)
{
	struct stage *stage = *state;
	struct command_stage commands = start_commands(stage);

	assert_true(post(&commands, request(1, MAP_EXECUTE, 1, 1)));
	assert_answer(&commands, MAP_EXECUTING, MAP_RESULT_NONE);
	assert_false(post(&commands, request(1, MAP_EXECUTE, 2, 2)));
	assert_answer(&commands, MAP_REFUSED_COMMAND, MAP_RESULT_INTERLOCK);
	assert_true(post(&commands, request(2, MAP_EXECUTE, 2, 2))); /* another point */
	end_commands(&commands);
}

static void test_old_and_impossible_commands_are_refused(void **state)
{
	struct stage *stage = *state;
	struct command_stage commands = start_commands(stage);
	struct map_request old = request(1, MAP_EXECUTE, 1, 1);

	old.deadline_ns = map_now_ns() - 1;
	assert_false(post(&commands, old));
	assert_answer(&commands, MAP_REFUSED_COMMAND, MAP_RESULT_TOO_OLD);
	assert_false(post(&commands, request(0, MAP_EXECUTE, 1, 1)));
	assert_answer(&commands, MAP_REFUSED_COMMAND, MAP_RESULT_NOT_COMMANDABLE);
	end_commands(&commands);
}

static void test_nothing_is_repeated_after_a_crash(void **state)
{
	struct stage *stage = *state;
	struct command_stage commands = start_commands(stage);
	struct map_request taken;
	struct map_command command;

	assert_true(post(&commands, request(1, MAP_EXECUTE, 1, 1)));
	assert_int_not_equal(map_request_post(commands.requester, request(2, MAP_EXECUTE, 1, 1)), 0);
	map_module_ended(stage->rtud, index_of(stage, FIRST), true);
	assert_int_equal(map_request_post(commands.requester, request(2, MAP_EXECUTE, 1, 1)), 0);
	map_detach(commands.owner);

	commands.owner = start(stage, FIRST);
	assert_false(map_request_next(commands.owner, &taken));
	assert_true(map_command_read(stage->rtud, 1, &command));
	assert_int_equal(command.state, MAP_REFUSED_COMMAND);
	assert_int_equal(command.result, MAP_RESULT_UNKNOWN_FATE);
	end_commands(&commands);
}

static int64_t time_of_command(const struct stage *stage, uint32_t point)
{
	struct map_command command;

	assert_true(map_command_read(stage->rtud, point, &command));
	return command.time_ns;
}

static void restart_owner(struct stage *stage, struct command_stage *commands)
{
	map_module_ended(stage->rtud, index_of(stage, FIRST), true);
	map_detach(commands->owner);
	commands->owner = start(stage, FIRST);
}

/* A release is one, and so is the end of what was under way when its owner died; what had ended before is as of then. */
static void test_a_state_is_as_of_its_last_change(void **state)
{
	struct stage *stage = *state;
	struct command_stage commands = start_commands(stage);
	int64_t since_ns;

	assert_true(post(&commands, request(1, MAP_EXECUTE, 1, 255)));
	map_command_finish(commands.owner, 1, MAP_RESULT_DONE, 0);
	since_ns = map_now_ns();
	assert_false(post(&commands, request(1, MAP_RELEASE, 1, 0)));
	assert_true(time_of_command(stage, 1) >= since_ns);
	assert_true(post(&commands, request(2, MAP_EXECUTE, 1, 255)));
	since_ns = map_now_ns();
	restart_owner(stage, &commands);
	assert_true(time_of_command(stage, 1) < since_ns);
	assert_true(time_of_command(stage, 2) >= since_ns);
	end_commands(&commands);
}

static void assert_result(const struct stage *stage, uint32_t point, enum map_command_result result)
{
	struct map_command command;

	assert_true(map_command_read(stage->rtud, point, &command));
	assert_int_equal(command.result, result);
}

static void test_a_pulse_outlives_its_owner(void **state)
{
	struct stage *stage = *state;
	struct command_stage commands = start_commands(stage);
	int64_t off_ns = map_now_ns() + 60000000000, before_ns;

	assert_true(post(&commands, pulse(1, MAP_EXECUTE, 500)));
	map_pulse_set_end(commands.owner, 1, off_ns);
	map_command_confirm(commands.owner, 1);
	assert_true(post(&commands, pulse(2, MAP_EXECUTE, 500))); /* nobody knows whether this began */
	before_ns = map_now_ns();
	restart_owner(stage, &commands);
	assert_true(map_pulse_end(commands.owner, 1) == off_ns);
	assert_true(map_pulse_end(commands.owner, 2) >= before_ns &&
		    map_pulse_end(commands.owner, 2) <= map_now_ns());
	assert_true(map_pulse_end(commands.owner, 3) == 0);
	for (uint32_t point = 1; point <= 2; point++) {
		assert_command(stage, point, MAP_REFUSED_COMMAND);
		assert_result(stage, point, MAP_RESULT_UNKNOWN_FATE);
		assert_false(post(&commands, request(point, MAP_EXECUTE, 1, 1)));
	}
	restart_owner(stage, &commands); /* once more, before anything was ended */
	assert_true(map_pulse_end(commands.owner, 1) == off_ns);
	end_commands(&commands);
}

static void test_what_the_device_confirmed_is_done_though_its_owner_died(void **state)
{
	struct stage *stage = *state;
	struct command_stage commands = start_commands(stage);

	assert_true(post(&commands, request(1, MAP_EXECUTE, 1, 1)));
	map_command_confirm(commands.owner, 1);
	restart_owner(stage, &commands);
	assert_command(stage, 1, MAP_EXECUTED_COMMAND);
	assert_result(stage, 1, MAP_RESULT_DONE);
	end_commands(&commands);
}

int main(void)
{
	const struct CMUnitTest tests[] = {
	    TEST(test_a_direct_command_is_executed_and_released),
	    TEST(test_a_command_is_confirmed_before_it_ends),
	    TEST(test_the_log_says_how_a_command_ended),
	    TEST(test_no_command_until_a_pulse_has_ended),
	    TEST(test_a_selection_binds_the_kind_of_command),
	    TEST(test_a_selection_binds_requester_and_value),
	    TEST(test_a_selection_is_cancelled_by_its_holder),
	    TEST(test_a_selection_ends_by_itself),
	    TEST(test_a_selection_ends_with_its_requesters_process),
	    TEST(test_a_command_ends_with_its_owners_process),
	    TEST(test_one_command_a_point_at_a_time),
	    TEST(test_old_and_impossible_commands_are_refused),
	    TEST(test_nothing_is_repeated_after_a_crash),
	    TEST(test_a_state_is_as_of_its_last_change),
	    TEST(test_a_pulse_outlives_its_owner),
	    TEST(test_what_the_device_confirmed_is_done_though_its_owner_died),
	};

	return cmocka_run_group_tests(tests, NULL, NULL);
}
