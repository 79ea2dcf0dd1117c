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

	stage->rtud->directory->settings.select_timeout_s = 0;
	commands.owner->config.settings.select_timeout_s = 0;
	assert_false(post(&commands, request(3, MAP_SELECT, 1, 9)));
	assert_answer(&commands, MAP_ACCEPTED_SELECTION, MAP_RESULT_NONE);
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

	commands.requester = start(stage, "rtu-iec104");
	assert_false(
	    post(&commands, request(3, MAP_EXECUTE, 1, 9))); /* the same session number is another's */
	assert_answer(&commands, MAP_REFUSED_COMMAND, MAP_RESULT_NOT_SELECTED);
	assert_false(post(&commands, request(3, MAP_SELECT, 2, 8)));
	assert_answer(&commands, MAP_ACCEPTED_SELECTION, MAP_RESULT_NONE);
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

int main(void)
{
	const struct CMUnitTest tests[] = {
	    TEST(test_a_direct_command_is_executed_and_released),
	    TEST(test_a_selection_binds_requester_and_value),
	    TEST(test_a_selection_is_cancelled_by_its_holder),
	    TEST(test_a_selection_ends_by_itself),
	    TEST(test_a_selection_ends_with_its_requesters_process),
	    TEST(test_one_command_a_point_at_a_time),
	    TEST(test_old_and_impossible_commands_are_refused),
	    TEST(test_nothing_is_repeated_after_a_crash),
	};

	return cmocka_run_group_tests(tests, NULL, NULL);
}
