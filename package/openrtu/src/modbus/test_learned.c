/* SPDX-License-Identifier: GPL-3.0-or-later */
/* What follows from a plan, some reads of which were divided, and what does not. */
#include "modbus/learned.h"

#include <setjmp.h>
#include <stdarg.h>
#include <stddef.h>
#include <string.h>

#include <cmocka.h>

#define OBJECTS_MAX 256
#define BUSY        6

static struct modbus_object objects[OBJECTS_MAX];
static struct modbus_read reads[OBJECTS_MAX];
static uint32_t object_count, read_count;

static void add(uint8_t function, uint16_t address, uint16_t count)
{
	for (uint16_t i = 0; i < count; i++)
		objects[object_count++] =
		    (struct modbus_object){0, (uint16_t)(address + i), function & 15u, 1, 0, 0};
}

static void plan(void)
{
	const struct modbus_wire wire = modbus_wire(9600, 11);
	const struct modbus_limits unlimited = {.bits = 0};

	modbus_objects_sort(objects, object_count);
	read_count = modbus_plan(&wire, &unlimited, objects, object_count, reads);
}

static int set_up(void **state)
{
	(void)state;
	object_count = 0;
	return 0;
}

static void refuse(uint32_t index, uint8_t exception)
{
	assert_true(modbus_plan_split(objects, reads, &read_count, index, exception));
}

static void give_all(void)
{
	for (uint32_t i = 0; i < read_count; i++)
		reads[i].given = true;
}

static void lack(uint32_t index, uint8_t exception)
{
	reads[index].given = true; /* once */
	reads[index].exception = exception;
	reads[index].pause_ns = 1;
}

static struct modbus_learned learn(void)
{
	return modbus_learn(reads, read_count);
}

static void test_what_was_not_asked_is_open(void **state)
{
	(void)state;
	add(3, 0, 10);
	add(1, 0, 40);
	plan();
	assert_int_equal(learn().open, 2);
	give_all();
	assert_int_equal(learn().open, 0);
	assert_int_equal(learn().given_bits, 40);
	assert_int_equal(learn().given_registers, 10);
	assert_int_equal(learn().refused_bits, 0);
	assert_int_equal(learn().refused_registers, 0);
	assert_int_equal(learn().hole.count, 0);
	assert_int_equal(learn().lacking.count, 0);
}

/* It may be given now: the shortest refused read is what bounds a length. */
static void test_halves_without_a_hole_between_bound_the_length(void **state)
{
	(void)state;
	add(3, 0, 40);
	plan();
	refuse(0, 3);
	assert_int_equal(learn().refused_registers, 0);
	give_all();
	assert_int_equal(learn().refused_registers, 40);
	refuse(1, 2);
	give_all(); /* 20, 10, 10 */
	assert_int_equal(read_count, 3);
	assert_int_equal(learn().refused_registers, 20);
	assert_int_equal(learn().given_registers, 20); /* as long: it was no limit */
	refuse(0, 3);
	give_all();
	assert_int_equal(learn().refused_registers, 20);
	assert_int_equal(learn().given_registers, 10);
	assert_int_equal(learn().refused_bits, 0);
}

static void test_bits_have_a_length_of_their_own(void **state)
{
	(void)state;
	add(2, 0, 64);
	add(4, 0, 5);
	plan();
	refuse(0, 3);
	give_all();
	assert_int_equal(learn().refused_bits, 64);
	assert_int_equal(learn().given_bits, 32);
	assert_int_equal(learn().refused_registers, 0);
	assert_int_equal(learn().given_registers, 5);
}

static void test_an_illegal_address_is_looked_for_at_the_widest_hole(void **state)
{
	(void)state;
	add(3, 0, 2);
	add(3, 3, 3);
	add(3, 8, 1);
	add(3, 11, 4);
	plan();
	assert_int_equal(read_count, 1);
	refuse(0, 2); /* of the holes 6..7 and 9..10 the one nearest to the middle */
	assert_int_equal(reads[0].count, 6);
	assert_int_equal(reads[1].address, 8);
	give_all();
	assert_int_equal(learn().hole.function, 3);
	assert_int_equal(learn().hole.exception, 2);
	assert_int_equal(learn().hole.address, 6);
	assert_int_equal(learn().hole.count, 2);
	assert_int_equal(learn().hole.read, 15);
	assert_int_equal(learn().holes_given, 2); /* 2 and 9..10 */
	assert_int_equal(learn().refused_registers, 0);
	refuse(1, 2);
	give_all();
	assert_int_equal(learn().hole.address, 9); /* the shorter read says more */
	assert_int_equal(learn().hole.count, 2);
	assert_int_equal(learn().hole.read, 7);
	assert_int_equal(learn().holes_given, 1);
}

static void test_an_illegal_quantity_is_halved_whatever_the_holes(void **state)
{
	(void)state;
	add(3, 0, 1);
	add(3, 5, 7);
	plan();
	refuse(0, 3);
	assert_int_equal(reads[0].objects, 4);
	give_all();
	assert_int_equal(learn().refused_registers, 12);
	assert_int_equal(learn().hole.count, 0);
	assert_int_equal(learn().holes_given, 1);
}

/* The object explains all refusals around it. */
static void test_an_object_that_is_not_there_is_neither_length_nor_hole(void **state)
{
	(void)state;
	add(3, 0, 8);
	plan();
	refuse(0, 2); /* 0-3 4-7 */
	refuse(1, 2); /* 4-5 6-7 */
	refuse(1, 2); /* 4 5 */
	give_all();
	lack(2, 2);
	assert_int_equal(read_count, 4);
	assert_int_equal(learn().lacking.count, 1);
	assert_int_equal(learn().lacking.function, 3);
	assert_int_equal(learn().lacking.address, 5);
	assert_int_equal(learn().lacking.exception, 2);
	assert_int_equal(learn().refused_registers, 0);
	assert_int_equal(learn().given_registers, 4);
	assert_int_equal(learn().open, 0);
	lack(3, 1);
	assert_int_equal(learn().lacking.count, 2);
	assert_int_equal(learn().lacking.address, 5);
}

static void test_nothing_follows_from_silence_or_another_exception(void **state)
{
	static const uint8_t exceptions[] = {0, 1, 4};

	(void)state;
	for (size_t i = 0; i < sizeof(exceptions); i++) {
		object_count = 0;
		add(3, 0, 8);
		plan();
		refuse(0, exceptions[i]);
		give_all();
		assert_int_equal(learn().unclear, 1);
		assert_int_equal(learn().refused_registers, 0);
		assert_int_equal(learn().silent_registers, exceptions[i] == 0 ? 8 : 0);
	}
}

static void test_a_busy_device_leaves_it_open(void **state)
{
	(void)state;
	add(3, 0, 8);
	plan();
	lack(0, BUSY);
	assert_int_equal(learn().open, 1);
	assert_int_equal(learn().lacking.count, 0);
	assert_int_equal(learn().given_registers, 0);
}

static void test_latency_has_its_least_its_most_and_what_is_usual(void **state)
{
	struct modbus_latency latency = {.least_us = 0};

	(void)state;
	modbus_latency_add(&latency, 3200);
	assert_int_equal(latency.least_us, 3200);
	assert_int_equal(latency.typical_us, 3200);
	modbus_latency_add(&latency, 1600);
	assert_int_equal(latency.least_us, 1600);
	assert_int_equal(latency.most_us, 3200);
	assert_int_equal(latency.typical_us, 3100);
	modbus_latency_add(&latency, 0);
	modbus_latency_add(&latency, UINT32_MAX);
	assert_int_equal(latency.least_us, 0);
	assert_int_equal(latency.most_us, UINT32_MAX);
	for (int i = 0; i < 1000; i++)
		modbus_latency_add(&latency, 5000);
	assert_in_range(latency.typical_us, 5000, 5000 + 16);
}

/* ---- devices of all kinds --------------------------------------------------------------------- */

#define ADDRESSES 600

/* What is true of a device. */
static struct {
	uint16_t limit;   /* registers of a read */
	uint8_t too_long; /* the exception to more */
	bool missing[ADDRESSES];
} truth;

static uint32_t random_next(uint32_t *seed)
{
	*seed = *seed * 1664525u + 1013904223u;
	return *seed >> 8;
}

static bool lies_in_a_hole(uint32_t address)
{
	for (uint32_t i = 0; i < object_count; i++)
		if (address >= objects[i].address &&
		    address < (uint32_t)objects[i].address + objects[i].width)
			return false;
	return true;
}

static void make_device(uint32_t *seed, bool limited, bool holed, bool lacks)
{
	uint32_t address = 0;

	object_count = 0;
	while (object_count < 60) {
		uint16_t width = (uint16_t)(1 + (random_next(seed) % 4 == 0));

		objects[object_count++] =
		    (struct modbus_object){0, (uint16_t)address, 3, width & 0xFFFu, 0, 0};
		address += width + (random_next(seed) % 8 == 0) * (1 + random_next(seed) % 8);
	}
	truth.limit = limited ? (uint16_t)(2 + random_next(seed) % 80) : 125;
	truth.too_long = random_next(seed) % 2 ? MODBUS_ILLEGAL_VALUE : MODBUS_ILLEGAL_ADDRESS;
	for (uint32_t i = 0; i < ADDRESSES; i++)
		truth.missing[i] = lies_in_a_hole(i) ? holed : lacks && random_next(seed) % 40 == 0;
}

static uint8_t answer(const struct modbus_read *read)
{
	if (read->count > truth.limit)
		return truth.too_long;
	for (uint32_t i = 0; i < read->count; i++)
		if (truth.missing[read->address + i])
			return MODBUS_ILLEGAL_ADDRESS;
	return 0;
}

/* As a line does, with this plan. Returns how often the device refused. */
static uint32_t ask_everything(const struct modbus_limits *limits)
{
	const struct modbus_wire wire = modbus_wire(9600, 11);
	uint32_t refused = 0;

	modbus_objects_sort(objects, object_count);
	read_count = modbus_plan(&wire, limits, objects, object_count, reads);
	for (uint32_t i = 0; i < read_count; i += reads[i].given || reads[i].pause_ns > 0) {
		uint8_t exception = answer(&reads[i]);

		refused += exception > 0;
		if (exception == 0)
			reads[i].given = true;
		else if (!modbus_plan_split(objects, reads, &read_count, i, exception))
			lack(i, exception);
	}
	return refused;
}

static bool some_are_missing(uint32_t address, uint32_t count)
{
	for (uint32_t i = 0; i < count; i++)
		if (truth.missing[address + i])
			return true;
	return false;
}

static void assert_true_of_device(const struct modbus_learned *learned)
{
	assert_int_equal(learned->open, 0);
	assert_int_equal(learned->unclear, 0);
	assert_true(learned->given_registers <= truth.limit);
	if (learned->refused_registers > learned->given_registers)
		assert_true(truth.limit < learned->refused_registers);
	if (learned->hole.count > 0 && learned->hole.read <= learned->given_registers)
		assert_true(some_are_missing(learned->hole.address, learned->hole.count));
}

static void test_what_is_learned_is_true(void **state)
{
	const struct modbus_limits unlimited = {.bits = 0};
	uint32_t seed = 3;

	(void)state;
	for (unsigned round = 0; round < 4000; round++) {
		struct modbus_learned learned;

		make_device(&seed, round & 1, round & 2, round & 4);
		ask_everything(&unlimited);
		learned = learn();
		assert_true_of_device(&learned);
	}
}

/* Where there is one cause, the key that follows from it spares every refusal, and costs no request. */
static void test_what_is_learned_spares_the_refusals(void **state)
{
	const struct modbus_limits unlimited = {.bits = 0};
	unsigned lengths = 0, holes = 0;
	uint32_t seed = 5;

	(void)state;
	for (unsigned round = 0; round < 2000; round++) {
		struct modbus_limits limits = {.bits = 0};
		struct modbus_learned learned;
		uint32_t planned;

		make_device(&seed, round & 1, !(round & 1), false);
		ask_everything(&unlimited);
		learned = learn();
		planned = read_count;
		if (learned.refused_registers > learned.given_registers)
			limits.registers = learned.given_registers;
		else if (learned.hole.count > 0 && learned.hole.read <= learned.given_registers)
			limits.no_holes = learned.holes_given == 0;
		if (limits.registers == 0 && !limits.no_holes)
			continue;
		lengths += limits.registers > 0;
		holes += limits.no_holes;
		assert_int_equal(ask_everything(&limits), 0);
		assert_true(read_count <= planned);
	}
	assert_true(lengths > 300);
	assert_true(holes > 300);
}

int main(void)
{
	const struct CMUnitTest tests[] = {
	    cmocka_unit_test_setup(test_what_was_not_asked_is_open, set_up),
	    cmocka_unit_test_setup(test_halves_without_a_hole_between_bound_the_length, set_up),
	    cmocka_unit_test_setup(test_bits_have_a_length_of_their_own, set_up),
	    cmocka_unit_test_setup(test_an_illegal_address_is_looked_for_at_the_widest_hole, set_up),
	    cmocka_unit_test_setup(test_an_illegal_quantity_is_halved_whatever_the_holes, set_up),
	    cmocka_unit_test_setup(test_an_object_that_is_not_there_is_neither_length_nor_hole, set_up),
	    cmocka_unit_test_setup(test_nothing_follows_from_silence_or_another_exception, set_up),
	    cmocka_unit_test_setup(test_a_busy_device_leaves_it_open, set_up),
	    cmocka_unit_test(test_what_is_learned_is_true),
	    cmocka_unit_test(test_what_is_learned_spares_the_refusals),
	    cmocka_unit_test(test_latency_has_its_least_its_most_and_what_is_usual),
	};
	return cmocka_run_group_tests_name("modbus learned", tests, NULL, NULL);
}
