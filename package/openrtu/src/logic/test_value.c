/* SPDX-License-Identifier: GPL-3.0-or-later */
/* Points as values of a program and back; what the blocks COMMAND and REQUEST say. */
#include <setjmp.h>
#include <stdarg.h>
#include <stddef.h>
#include <stdint.h>

#include <cmocka.h>

#include "logic/logic.h"
#include "logic/value.h"

static struct logic_value taken(enum map_type map_type, enum logic_type type, struct map_sample sample)
{
	struct logic_value value;

	logic_take_sample(map_type, type, &sample, &value);
	return value;
}

static struct map_sample made(enum map_type map_type, enum logic_type type, union logic_cell cell)
{
	struct logic_value value = {.value = cell};
	struct map_sample sample = {0};

	logic_make_sample(map_type, type, &value, &sample);
	return sample;
}

static void test_a_double_point_as_bool_has_two_values(void **state)
{
	(void)state;
	for (uint32_t u = 0; u < 4; u++) {
		struct logic_value value = taken(MAP_DOUBLE, LOGIC_BOOL, (struct map_sample){.value.u = u});

		assert_int_equal(value.value.i, u == 2);
		assert_int_equal(value.quality, u == 1 || u == 2 ? 0 : MAP_INVALID);
		assert_int_equal(taken(MAP_DOUBLE, LOGIC_USINT, (struct map_sample){.value.u = u}).value.i,
				 u);
	}
	assert_int_equal(made(MAP_DOUBLE, LOGIC_BOOL, (union logic_cell){.i = 1}).value.u, 2);
	assert_int_equal(made(MAP_DOUBLE, LOGIC_BOOL, (union logic_cell){.i = 0}).value.u, 1);
}

static void test_quality_goes_both_ways(void **state)
{
	struct logic_value value =
	    taken(MAP_SCALED, LOGIC_INT, (struct map_sample){.value.i = -7, .quality = MAP_NOT_TOPICAL});
	struct map_sample sample;

	(void)state;
	assert_int_equal(value.value.i, -7);
	assert_int_equal(value.quality, MAP_NOT_TOPICAL);
	value.quality = LOGIC_INVALID;
	logic_make_sample(MAP_SCALED, LOGIC_INT, &value, &sample);
	assert_int_equal(sample.quality, MAP_INVALID);
	assert_int_equal(sample.value.i, -7);
}

static void test_normalized_is_a_fraction_as_real(void **state)
{
	(void)state;
	assert_true(taken(MAP_NORMALIZED, LOGIC_REAL, (struct map_sample){.value.i = -16384}).value.r ==
		    -0.5F);
	assert_int_equal(taken(MAP_NORMALIZED, LOGIC_INT, (struct map_sample){.value.i = -16384}).value.i,
			 -16384);
	assert_int_equal(made(MAP_ANGLE, LOGIC_LREAL, (union logic_cell){.d = 44.5}).value.i, 445000000);
	assert_int_equal(made(MAP_NORMALIZED, LOGIC_REAL, (union logic_cell){.r = 0.25F}).value.i, 8192);
}

static void test_an_output_beyond_its_point_is_the_nearest_with_overflow(void **state)
{
	struct map_sample high = made(MAP_SCALED, LOGIC_DINT, (union logic_cell){.i = 40000});
	struct map_sample low = made(MAP_BITSTRING, LOGIC_DINT, (union logic_cell){.i = -1});
	struct map_sample real = made(MAP_FLOAT, LOGIC_LREAL, (union logic_cell){.d = 1e300});
	struct map_sample whole = made(MAP_BITSTRING, LOGIC_DWORD, (union logic_cell){.i = UINT32_MAX});

	(void)state;
	assert_int_equal(high.value.i, 32767);
	assert_int_equal(high.quality, MAP_OVERFLOW);
	assert_int_equal(low.value.u, 0);
	assert_int_equal(low.quality, MAP_OVERFLOW);
	assert_true(real.value.f == FLT_MAX);
	assert_int_equal(real.quality, MAP_OVERFLOW);
	assert_true(whole.value.u == UINT32_MAX);
	assert_int_equal(whole.quality, MAP_GOOD);
}

static void test_a_command_that_the_point_cannot_have_is_none(void **state)
{
	union map_value value;

	(void)state;
	assert_true(logic_map_value(MAP_SINGLE, LOGIC_BOOL, 1, &value));
	assert_int_equal(value.u, 1);
	assert_false(logic_map_value(MAP_SINGLE, LOGIC_BOOL, 0.5, &value));
	assert_false(logic_map_value(MAP_SINGLE, LOGIC_BOOL, 2, &value));
	assert_false(logic_map_value(MAP_DOUBLE, LOGIC_USINT, 4, &value));
	assert_false(logic_map_value(MAP_SCALED, LOGIC_INT, 32768, &value));
}

static void test_an_input_needs_a_type_that_has_all_its_values(void **state)
{
	(void)state;
	assert_true(logic_value_fits(MAP_SCALED, LOGIC_INT, false));
	assert_false(logic_value_fits(MAP_SCALED, LOGIC_UINT, false));
	assert_true(logic_value_fits(MAP_SCALED, LOGIC_UINT, true));
	assert_true(logic_value_fits(MAP_COUNTER, LOGIC_DINT, false));
	assert_false(logic_value_fits(MAP_COUNTER, LOGIC_INT, false));
	assert_false(logic_value_fits(MAP_FLOAT, LOGIC_LINT, true));
	assert_false(logic_value_fits(MAP_SINGLE, LOGIC_USINT, false));
	assert_false(logic_value_fits(MAP_BITSTRING, LOGIC_WORD, false));
	assert_false(logic_value_fits(MAP_FLOAT, LOGIC_TIME, true));
	assert_int_equal(logic_map_type(LOGIC_DINT), MAP_INTEGER);
	assert_int_equal(logic_map_type(LOGIC_LINT), MAP_TYPES);
	assert_false(logic_value_fits(MAP_ANGLE, LOGIC_DINT, true));
}

/* ---- blocks ------------------------------------------------------------------------------ */

enum { EXECUTE, VALUE, SELECT, STATE, RESULT, REFUSE, SLOTS };

static union logic_cell cells[SLOTS];
static uint8_t quality[SLOTS];
static const struct logic machine = {.cells = cells, .quality = quality};

static struct logic_verdict judged(int64_t refuse, int64_t at, int64_t result)
{
	const struct logic_request request = {.refuse = REFUSE, .state = STATE, .result = RESULT};

	cells[REFUSE].i = refuse;
	cells[STATE].i = at;
	cells[RESULT].i = result;
	return logic_judge(&machine, &request);
}

static int forget(void **state)
{
	(void)state;
	for (unsigned i = 0; i < SLOTS; i++) {
		cells[i].bits = 0;
		quality[i] = 0;
	}
	return 0;
}

static void test_a_doubt_refuses_but_not_what_is_on_its_way(void **state)
{
	(void)state;
	assert_int_equal(judged(0, MAP_INACTIVE, 0).decision, LOGIC_PENDING);
	assert_int_equal(judged(1, MAP_INACTIVE, 0).result, MAP_RESULT_INTERLOCK);
	assert_int_equal(judged(1, MAP_EXECUTING, 0).decision, LOGIC_PENDING);
	quality[REFUSE] = LOGIC_INVALID;
	assert_int_equal(judged(0, MAP_INACTIVE, 0).decision, LOGIC_REFUSED);
	assert_int_equal(judged(0, MAP_EXECUTING, 0).decision, LOGIC_PENDING);
	quality[STATE] = LOGIC_INVALID;
	assert_int_equal(judged(0, MAP_EXECUTED_COMMAND, MAP_RESULT_DONE).decision, LOGIC_PENDING);
}

static void test_the_devices_answer_becomes_the_requests(void **state)
{
	(void)state;
	assert_int_equal(judged(0, MAP_EXECUTING, MAP_RESULT_DONE).decision, LOGIC_CONFIRMED);
	assert_int_equal(judged(0, MAP_EXECUTED_COMMAND, MAP_RESULT_DONE).decision, LOGIC_EXECUTED);
	assert_int_equal(judged(0, MAP_REFUSED_COMMAND, MAP_RESULT_EXCEPTION).result, MAP_RESULT_EXCEPTION);
	assert_int_equal(judged(0, MAP_REFUSED_SELECTION, MAP_RESULT_DONE).result, MAP_RESULT_INTERLOCK);
	assert_int_equal(judged(0, MAP_REFUSED_COMMAND, 200).result, MAP_RESULT_INTERLOCK);
}

static void test_a_doubtful_command_is_not_sent(void **state)
{
	const struct logic_command command = {.execute = EXECUTE, .value = VALUE, .select = SELECT};

	(void)state;
	assert_int_equal(logic_wish(&machine, &command), LOGIC_NOTHING);
	cells[EXECUTE].i = 1;
	assert_int_equal(logic_wish(&machine, &command), LOGIC_EXECUTE);
	for (unsigned slot = EXECUTE; slot <= SELECT; slot++) {
		quality[slot] = LOGIC_NOT_TOPICAL;
		assert_int_equal(logic_wish(&machine, &command), LOGIC_DOUBTFUL);
		quality[slot] = LOGIC_SUBSTITUTED; /* somebody vouches for it */
		assert_int_equal(logic_wish(&machine, &command), LOGIC_EXECUTE);
		quality[slot] = 0;
	}
}

int main(void)
{
	const struct CMUnitTest tests[] = {
	    cmocka_unit_test(test_a_double_point_as_bool_has_two_values),
	    cmocka_unit_test(test_quality_goes_both_ways),
	    cmocka_unit_test(test_normalized_is_a_fraction_as_real),
	    cmocka_unit_test(test_an_output_beyond_its_point_is_the_nearest_with_overflow),
	    cmocka_unit_test(test_a_command_that_the_point_cannot_have_is_none),
	    cmocka_unit_test(test_an_input_needs_a_type_that_has_all_its_values),
	    cmocka_unit_test_setup(test_a_doubt_refuses_but_not_what_is_on_its_way, forget),
	    cmocka_unit_test_setup(test_the_devices_answer_becomes_the_requests, forget),
	    cmocka_unit_test_setup(test_a_doubtful_command_is_not_sent, forget),
	};

	return cmocka_run_group_tests(tests, NULL, NULL);
}
