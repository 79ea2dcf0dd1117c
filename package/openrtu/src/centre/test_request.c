/* SPDX-License-Identifier: GPL-3.0-or-later */
#include <setjmp.h>
#include <stdarg.h>
#include <stddef.h>
#include <stdint.h>
#include <string.h>

#include <cmocka.h>

#include "centre/request.h"

/* A selection of single command 1 on IOA 0x030201 of CA 0x0605, station 2, id 9; as in docs/centre.md. */
static const uint8_t select_single[32] = {2, 0, 5, 6, 2, 0, 0, 0, 9, 0, 0, 0, 0, 0, 0, 0,
					  1, 2, 3, 0, 1, 0, 0, 0, 3, 0, 0, 0, 0, 0, 0, 0};

static bool is_command(struct centre_request request)
{
	struct iec104_command command;

	return centre_request_command(&request, &command);
}

static void test_layout(void **state)
{
	struct centre_request request;
	struct iec104_command command;

	(void)state;
	assert_true(centre_request_read(select_single, sizeof(select_single), &request));
	assert_int_equal(request.kind, CENTRE_COMMAND);
	assert_int_equal(request.ca, 0x0605);
	assert_int_equal(request.station, 2);
	assert_int_equal(request.id, 9);
	assert_true(centre_request_command(&request, &command));
	assert_int_equal(command.ioa, 0x030201);
	assert_int_equal(command.type, MAP_SINGLE);
	assert_int_equal(command.value.u, 1);
	assert_true(command.select && command.tagged);
}

static void test_what_is_no_request(void **state)
{
	/* Kind 0 and 9; id 0; an unknown flag; octets that are to be zero; flags of what is no command. */
	static const struct {
		size_t place;
		uint8_t octet;
	} changes[] = {{0, 0}, {0, 9}, {8, 0}, {24, 4}, {27, 1}, {31, 1}, {0, CENTRE_READ}};
	uint8_t octets[sizeof(select_single)];
	struct centre_request request;

	(void)state;
	for (size_t size = 0; size < sizeof(octets); size++)
		assert_false(centre_request_read(select_single, size, &request));
	for (size_t i = 0; i < sizeof(changes) / sizeof(changes[0]); i++) {
		memcpy(octets, select_single, sizeof(octets));
		octets[changes[i].place] = changes[i].octet;
		assert_false(centre_request_read(octets, sizeof(octets), &request));
	}
}

static void test_values_of_commands(void **state)
{
	(void)state;
	assert_true(is_command((struct centre_request){.type = MAP_SINGLE, .value.u = 1, .qualifier = 31}));
	assert_false(is_command((struct centre_request){.type = MAP_SINGLE, .value.u = 2}));
	assert_false(is_command((struct centre_request){.type = MAP_SINGLE, .qualifier = 32}));
	assert_false(is_command((struct centre_request){.type = MAP_DOUBLE, .value.u = 0}));
	assert_true(is_command((struct centre_request){.type = MAP_DOUBLE, .value.u = 2}));
	assert_false(is_command((struct centre_request){.type = MAP_DOUBLE, .value.u = 3}));
	assert_true(is_command((struct centre_request){.type = MAP_STEP, .step = -1}));
	assert_false(is_command((struct centre_request){.type = MAP_STEP, .step = 0}));
	assert_true(is_command((struct centre_request){.type = MAP_BITSTRING, .value.u = UINT32_MAX}));
	assert_false(is_command((struct centre_request){.type = MAP_BITSTRING, .qualifier = 1}));
	assert_true(
	    is_command((struct centre_request){.type = MAP_SCALED, .value.i = -32768, .qualifier = 127}));
	assert_false(is_command((struct centre_request){.type = MAP_SCALED, .value.i = -32769}));
	assert_false(is_command((struct centre_request){.type = MAP_NORMALIZED, .qualifier = 128}));
	assert_true(is_command((struct centre_request){.type = MAP_FLOAT, .value.f = -1.5f}));
	assert_false(is_command((struct centre_request){.type = MAP_FLOAT, .value.u = 0x7f800000}));
	assert_false(is_command((struct centre_request){.type = MAP_FLOAT, .value.u = 0x7fc00000}));
	assert_false(is_command((struct centre_request){.type = MAP_COUNTER}));
	assert_false(is_command((struct centre_request){.type = 255}));
}

int main(void)
{
	const struct CMUnitTest tests[] = {
	    cmocka_unit_test(test_layout),
	    cmocka_unit_test(test_what_is_no_request),
	    cmocka_unit_test(test_values_of_commands),
	};

	return cmocka_run_group_tests(tests, NULL, NULL);
}
