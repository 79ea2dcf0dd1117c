/* SPDX-License-Identifier: GPL-3.0-or-later */
#include <setjmp.h>
#include <stdarg.h>
#include <stddef.h>
#include <stdint.h>

#include <cmocka.h>

#include "modbus/frame.h"
#include "modbus/plan.h"

#define OBJECTS_MAX 4096
#define COUNT(a)    ((uint32_t)(sizeof(a) / sizeof((a)[0])))

static struct modbus_read reads[OBJECTS_MAX];
static struct modbus_object many[OBJECTS_MAX];
static const struct modbus_limits unlimited;

static struct modbus_wire slow_wire(void)
{
	return modbus_wire(9600, 10);
}

static void assert_read(const struct modbus_read *read, uint8_t function, uint16_t address, uint16_t count,
			uint32_t objects)
{
	assert_int_equal(read->function, function);
	assert_int_equal(read->address, address);
	assert_int_equal(read->count, count);
	assert_int_equal(read->objects, objects);
}

static void test_durations_of_the_wire(void **state)
{
	(void)state;
	struct modbus_wire slow = modbus_wire(9600, 11);
	struct modbus_wire fast = modbus_wire(38400, 11);

	assert_int_equal(slow.char_ns, 1145833);
	assert_int_equal(slow.silence_ns, 4010415);
	assert_int_equal(modbus_wire(19200, 11).silence_ns, 2005206);
	assert_int_equal(fast.silence_ns, 1750000);
}

static void test_neighbours_are_one_request_and_tables_are_not(void **state)
{
	(void)state;
	struct modbus_object objects[] = {{0, 2, 3, 1, 0, 0},
					  {1, 0, 3, 2, 0, 0},
					  {2, 0, 1, 1, 0, 0},
					  {3, 1, 1, 2, 0, 0},
					  {4, 0, 4, 1, 0, 0}};
	struct modbus_wire wire = slow_wire();

	modbus_objects_sort(objects, COUNT(objects));
	assert_int_equal(modbus_plan(&wire, &unlimited, objects, COUNT(objects), reads), 3);
	assert_read(&reads[0], 1, 0, 3, 2);
	assert_read(&reads[1], 3, 0, 3, 2);
	assert_read(&reads[2], 4, 0, 1, 1);
	assert_int_equal(objects[reads[1].first].tag, 1);
}

/*
 * 9600 8N1: a request of its own costs 13 characters, two silences of 3.5 and 5 ms (4.8 characters): 24.8 characters.
 * A register of the hole costs two.
 */
static void test_holes_are_carried_while_that_is_shorter(void **state)
{
	(void)state;
	struct modbus_wire wire = slow_wire();
	struct modbus_object near[] = {{0, 0, 3, 1, 0, 0}, {0, 13, 3, 1, 0, 0}};
	struct modbus_object far[] = {{0, 0, 3, 1, 0, 0}, {0, 14, 3, 1, 0, 0}};

	assert_int_equal(modbus_plan(&wire, &unlimited, near, 2, reads), 1);
	assert_read(&reads[0], 3, 0, 14, 2);
	assert_int_equal(modbus_plan(&wire, &unlimited, far, 2, reads), 2);
	assert_read(&reads[0], 3, 0, 1, 1);
	assert_read(&reads[1], 3, 14, 1, 1);
}

/* Known to take 20 ms instead of 5, a device is spared requests: 39.2 characters for one. */
static void test_a_hole_is_weighed_against_the_device_s_reaction(void **state)
{
	(void)state;
	struct modbus_wire wire = slow_wire();
	const struct modbus_limits slow = {.reaction_ns = 20000000}, fast = {.reaction_ns = 100000};
	struct modbus_object near[] = {{0, 0, 3, 1, 0, 0}, {0, 20, 3, 1, 0, 0}};
	struct modbus_object far[] = {{0, 0, 3, 1, 0, 0}, {0, 21, 3, 1, 0, 0}};

	assert_int_equal(modbus_plan(&wire, &slow, near, 2, reads), 1);
	assert_int_equal(modbus_plan(&wire, &slow, far, 2, reads), 2);
	near[1].address = 10; /* 20.1 characters for one */
	far[1].address = 12;
	assert_int_equal(modbus_plan(&wire, &fast, near, 2, reads), 1);
	assert_int_equal(modbus_plan(&wire, &fast, far, 2, reads), 2);
	assert_int_equal(modbus_reaction_ns(&fast), 100000);
	assert_int_equal(modbus_reaction_ns(&unlimited), MODBUS_REACTION_NS);
}

/* As on a serial line of 19200 8E1, 0.573 ms a character: 13 of them, 4 ms of silences and 5 ms are 28.7 characters. */
static void test_holes_on_tcp_are_those_of_a_line_behind(void **state)
{
	(void)state;
	struct modbus_wire wire = modbus_wire_tcp(MODBUS_FRAMING_TCP);
	struct modbus_object near[] = {{0, 0, 3, 1, 0, 0}, {0, 15, 3, 1, 0, 0}};
	struct modbus_object far[] = {{0, 0, 3, 1, 0, 0}, {0, 16, 3, 1, 0, 0}};

	assert_int_equal(modbus_plan(&wire, &unlimited, near, 2, reads), 1);
	assert_int_equal(modbus_plan(&wire, &unlimited, far, 2, reads), 2);
	assert_int_equal(modbus_read_ns(&wire, 3, 125, 5000000), 10000000);
	assert_int_equal(modbus_read_ns(&wire, 3, 125, 30000000), 30000000);
}

static void test_bits_bridge_wider_holes(void **state)
{
	(void)state;
	struct modbus_wire wire = slow_wire();
	struct modbus_object near[] = {{0, 0, 1, 1, 0, 0}, {0, 190, 1, 1, 0, 0}};
	struct modbus_object far[] = {{0, 0, 1, 1, 0, 0}, {0, 230, 1, 1, 0, 0}};

	assert_int_equal(modbus_plan(&wire, &unlimited, near, 2, reads), 1);
	assert_int_equal(modbus_plan(&wire, &unlimited, far, 2, reads), 2);
}

static void test_limits_are_kept_and_no_object_is_torn(void **state)
{
	(void)state;
	struct modbus_wire wire = slow_wire();

	for (uint32_t i = 0; i < 100; i++)
		many[i] = (struct modbus_object){i, (uint16_t)(2 * i), 3, 2, 0, 0};
	assert_int_equal(modbus_plan(&wire, &unlimited, many, 100, reads), 2);
	assert_read(&reads[0], 3, 0, 124, 62);
	assert_read(&reads[1], 3, 124, 76, 38);

	for (uint32_t i = 0; i < 2001; i++)
		many[i] = (struct modbus_object){i, (uint16_t)i, 2, 1, 0, 0};
	assert_int_equal(modbus_plan(&wire, &unlimited, many, 2001, reads), 2);
	assert_read(&reads[0], 2, 0, 2000, 2000);
	assert_read(&reads[1], 2, 2000, 1, 1);
}

/* What a device is known to take bounds every request, but for an object that cannot be torn. */
static void test_limits_of_the_device_are_kept(void **state)
{
	(void)state;
	struct modbus_wire wire = slow_wire();
	const struct modbus_limits limits = {.bits = 16, .registers = 5};
	struct modbus_object objects[] = {{0, 0, 1, 1, 0, 0}, {1, 14, 1, 2, 0, 0}, {2, 16, 1, 1, 0, 0},
					  {3, 0, 3, 1, 0, 0}, {4, 1, 3, 2, 0, 0},  {5, 3, 3, 2, 0, 0},
					  {6, 5, 3, 1, 0, 0}, {7, 0, 4, 1, 0, 0},  {8, 10, 4, 6, 0, 0},
					  {9, 16, 4, 1, 0, 0}};

	assert_int_equal(modbus_plan(&wire, &limits, objects, COUNT(objects), reads), 7);
	assert_read(&reads[0], 1, 0, 16, 2);
	assert_read(&reads[1], 1, 16, 1, 1);
	assert_read(&reads[2], 3, 0, 5, 3);
	assert_read(&reads[3], 3, 5, 1, 1);
	assert_read(&reads[4], 4, 0, 1, 1);
	assert_read(&reads[5], 4, 10, 6, 1);
	assert_read(&reads[6], 4, 16, 1, 1);
}

static void test_without_holes_only_neighbours_are_merged(void **state)
{
	(void)state;
	struct modbus_wire wire = slow_wire();
	const struct modbus_limits limits = {.no_holes = true};
	struct modbus_object objects[] = {{0, 0, 2, 1, 0, 0}, {1, 1, 2, 1, 0, 0}, {2, 3, 2, 1, 0, 0},
					  {3, 7, 3, 2, 0, 0}, {4, 9, 3, 1, 0, 0}, {5, 11, 3, 2, 0, 0}};

	assert_int_equal(modbus_plan(&wire, &limits, objects, COUNT(objects), reads), 4);
	assert_read(&reads[0], 2, 0, 2, 2);
	assert_read(&reads[1], 2, 3, 1, 1);
	assert_read(&reads[2], 3, 7, 3, 2);
	assert_read(&reads[3], 3, 11, 2, 1);
}

static void test_the_ends_of_the_address_space(void **state)
{
	(void)state;
	struct modbus_wire wire = slow_wire();
	struct modbus_object objects[] = {{0, 0, 3, 1, 0, 0}, {0, 65534, 3, 1, 0, 0}, {0, 65535, 3, 1, 0, 0}};

	assert_int_equal(modbus_plan(&wire, &unlimited, objects, 3, reads), 2);
	assert_read(&reads[0], 3, 0, 1, 1);
	assert_read(&reads[1], 3, 65534, 2, 2);
}

static void test_halving_ends_at_single_objects(void **state)
{
	(void)state;
	struct modbus_wire wire = slow_wire();
	struct modbus_object objects[] = {
	    {0, 0, 3, 1, 0, 0}, {1, 1, 3, 1, 0, 0}, {2, 4, 3, 2, 0, 0}, {3, 40, 3, 1, 0, 0}};
	uint32_t count = modbus_plan(&wire, &unlimited, objects, 4, reads);

	assert_int_equal(count, 2);
	assert_true(modbus_plan_split(objects, reads, &count, 0, 3));
	assert_int_equal(count, 3);
	assert_read(&reads[0], 3, 0, 1, 1);
	assert_read(&reads[1], 3, 1, 5, 2);
	assert_read(&reads[2], 3, 40, 1, 1);
	assert_true(modbus_plan_split(objects, reads, &count, 1, 3));
	assert_read(&reads[1], 3, 1, 1, 1);
	assert_read(&reads[2], 3, 4, 2, 1);
	for (uint32_t i = 0; i < count; i++)
		assert_false(modbus_plan_split(objects, reads, &count, i, 3));
	assert_int_equal(count, 4);
}

static uint32_t random_next(uint32_t *seed)
{
	*seed = *seed * 1664525u + 1013904223u;
	return *seed >> 8;
}

/* Whatever the objects: each is read whole, once, within the limits, also when all reads are halved to the end. */
static void test_every_object_is_in_one_read(void **state)
{
	(void)state;
	uint32_t seed = 7;

	for (int round = 0; round < 200; round++) {
		struct modbus_wire wire = modbus_wire(round % 2 ? 9600 : 115200, 11);
		uint32_t total = 1 + random_next(&seed) % 300, address = 0;

		for (uint32_t i = 0; i < total; i++) {
			many[i] = (struct modbus_object){i,
							 (uint16_t)address,
							 (1 + i * 4 / total) & 15u,
							 (uint8_t)(1 + random_next(&seed) % 2),
							 0,
							 0};
			address += 2 + random_next(&seed) % 3 * (random_next(&seed) % 60);
		}
		uint32_t count = modbus_plan(&wire, &unlimited, many, total, reads);
		for (uint32_t i = 0, next = 0; i < count; i++) {
			const struct modbus_read *read = &reads[i];

			assert_int_equal(read->first, next);
			next += read->objects;
			assert_in_range(read->count, 1, modbus_is_bit_function(read->function) ? 2000 : 125);
			for (uint32_t j = read->first; j < next; j++) {
				assert_int_equal(many[j].function, read->function);
				assert_true(many[j].address >= read->address);
				assert_true(many[j].address + many[j].width <= read->address + read->count);
			}
			if (i + 1 == count)
				assert_int_equal(next, total);
		}
		for (uint32_t i = 0; i < count; i++)
			while (modbus_plan_split(many, reads, &count, i, (uint8_t)(round % 5)))
				;
		assert_int_equal(count, total);
	}
}

/* What is read every 100 ms does not wait for, nor hasten, what is read in turn; in either class neighbours merge. */
static void test_objects_with_a_period_have_requests_of_their_own(void **state)
{
	(void)state;
	struct modbus_wire wire = slow_wire();
	struct modbus_object objects[] = {{0, 0, 3, 1, 0, 0},
					  {1, 1, 3, 1, 100, 0},
					  {2, 2, 3, 1, 0, 0},
					  {3, 3, 3, 1, 100, 0},
					  {4, 4, 3, 1, 500, 0}};

	modbus_objects_sort(objects, COUNT(objects));
	assert_int_equal(modbus_plan(&wire, &unlimited, objects, COUNT(objects), reads), 3);
	assert_read(&reads[0], 3, 0, 3, 2);
	assert_int_equal(reads[0].period_ns, 0);
	assert_read(&reads[1], 3, 1, 3, 2);
	assert_int_equal(reads[1].period_ns, 100000000);
	assert_read(&reads[2], 3, 4, 1, 1);
	assert_int_equal(reads[2].period_ns, 500000000);
}

int main(void)
{
	const struct CMUnitTest tests[] = {
	    cmocka_unit_test(test_durations_of_the_wire),
	    cmocka_unit_test(test_neighbours_are_one_request_and_tables_are_not),
	    cmocka_unit_test(test_holes_are_carried_while_that_is_shorter),
	    cmocka_unit_test(test_a_hole_is_weighed_against_the_device_s_reaction),
	    cmocka_unit_test(test_holes_on_tcp_are_those_of_a_line_behind),
	    cmocka_unit_test(test_bits_bridge_wider_holes),
	    cmocka_unit_test(test_limits_are_kept_and_no_object_is_torn),
	    cmocka_unit_test(test_limits_of_the_device_are_kept),
	    cmocka_unit_test(test_without_holes_only_neighbours_are_merged),
	    cmocka_unit_test(test_the_ends_of_the_address_space),
	    cmocka_unit_test(test_halving_ends_at_single_objects),
	    cmocka_unit_test(test_every_object_is_in_one_read),
	    cmocka_unit_test(test_objects_with_a_period_have_requests_of_their_own),
	};
	return cmocka_run_group_tests_name("modbus plan", tests, NULL, NULL);
}
