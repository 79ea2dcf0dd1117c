/* SPDX-License-Identifier: GPL-3.0-or-later */
/* What a configuration's records are found by, and which number a module gets. */
#include <setjmp.h>
#include <stdarg.h>
#include <stddef.h>
#include <stdint.h>
#include <stdio.h>
#include <string.h>

#include <cmocka.h>

#include "map/config.h"

#define ID MAP_SECTION_ID('T', 'E', 'S', 'T')

struct record {
	uint32_t point;
	char what;
};

/* Points with no, one and three records; the first and the last among them. */
static void test_the_records_of_a_point_are_found(void **state)
{
	static struct record records[] = {{2, 'a'}, {2, 'b'}, {2, 'c'}, {5, 'd'},
					  {7, 'e'}, {9, 'f'}, {9, 'g'}};
	static const char *const of[] = {"", "", "abc", "", "", "d", "", "e", "", "fg", ""};
	struct map_config config = {.section_count = 0};
	uint32_t count;

	(void)state;
	assert_null(map_records_of(&config, ID, sizeof(records[0]), 2, &count));
	assert_int_equal(count, 0);
	map_add_section(&config, ID, sizeof(records[0]), sizeof(records) / sizeof(records[0]), records);
	for (uint32_t point = 0; point < sizeof(of) / sizeof(of[0]); point++) {
		const struct record *found = map_records_of(&config, ID, sizeof(*found), point, &count);

		assert_int_equal(count, strlen(of[point]));
		assert_true((found == NULL) == (count == 0));
		for (uint32_t i = 0; i < count; i++)
			assert_int_equal(found[i].what, of[point][i]);
	}
}

static void assert_name(uint32_t label, const char *expected)
{
	static char names[] = "pump/lamp";
	static struct map_set set = {.prefix = "p3.67"};
	const struct map_config config = {.sets = &set, .names = names};
	const struct map_point point = {.name = label};
	char name[MAP_NAME_SIZE];

	map_point_name(&config, &point, name);
	assert_string_equal(name, expected);
}

static void test_a_point_has_its_name_or_one_by_its_place(void **state)
{
	(void)state;
	assert_name(0, "pump/lamp");
	assert_name(5, "lamp");
	assert_name(map_label('h', 4711, 0, 0), "p3.67.h4711");
	assert_name(map_label('h', 4711, 0, 1), "p3.67.h4711.0");
	assert_name(map_label('i', UINT16_MAX, 15, 1), "p3.67.i65535.15");
	assert_name(map_label('h', 0, 8, 8), "p3.67.h0.8-15");
	assert_name(map_label('h', 0, 0, 2), "p3.67.h0.0-1");
}

/* ---- modules ----------------------------------------------------------------------------- */

static struct map_module_plan plans[MAP_MODULES_MAX];

static uint32_t plan(struct map_config *config, const char *name)
{
	struct map_module_plan module = {.kind = "kind"};

	snprintf(module.name, sizeof(module.name), "%s", name);
	return map_plan_module(config, &module);
}

static struct map_config begin_plan(uint32_t modules)
{
	struct map_config config = {.modules = plans};
	char name[MAP_NAME_SIZE];

	memset(plans, 0, sizeof(plans));
	for (uint32_t i = 0; i < modules; i++) {
		snprintf(name, sizeof(name), "module-%u", i);
		assert_int_equal(plan(&config, name), i);
	}
	return config;
}

/* As of a former configuration, in which it was the gone-th to go. */
static void let_go(uint32_t module, uint32_t gone)
{
	plans[module].kind[0] = '\0';
	plans[module].flags = MAP_IS_GONE;
	plans[module].gone = gone;
}

static void test_a_module_keeps_its_number(void **state)
{
	struct map_config config = begin_plan(3);

	(void)state;
	plans[1].kind[0] = '\0'; /* it was there before, and is planned again */
	assert_int_equal(plan(&config, "module-1"), 1);
	assert_string_equal(plans[1].kind, "kind");
	assert_int_equal(plan(&config, "another"), 3);
	assert_int_equal(config.module_count, 4);
}

/* A number of one that is gone stays free as long as there are others: who reads by it is not to read another's. */
static void test_the_number_of_who_is_gone_longest_is_taken_when_too_many_are(void **state)
{
	struct map_config config = begin_plan(MAP_GONE_MAX + 1);

	(void)state;
	for (uint32_t i = 0; i < MAP_GONE_MAX - 1; i++)
		let_go(i, 100 - i);
	assert_int_equal(plan(&config, "first"), MAP_GONE_MAX + 1);
	let_go(MAP_GONE_MAX - 1, 100 - (MAP_GONE_MAX - 1));
	assert_int_equal(plan(&config, "second"), MAP_GONE_MAX - 1);
	assert_int_equal(plan(&config, "third"), MAP_GONE_MAX + 2);
}

static void test_where_all_numbers_are_used_one_of_who_is_gone_is_taken(void **state)
{
	struct map_config config = begin_plan(MAP_MODULES_MAX);

	(void)state;
	assert_int_equal(plan(&config, "first"), UINT32_MAX);
	let_go(3, 7);
	let_go(2, 8);
	assert_int_equal(plan(&config, "second"), 3);
	assert_int_equal(plan(&config, "third"), 2);
	assert_int_equal(plan(&config, "fourth"), UINT32_MAX);
	assert_int_equal(config.module_count, MAP_MODULES_MAX);
}

int main(void)
{
	const struct CMUnitTest tests[] = {
	    cmocka_unit_test(test_the_records_of_a_point_are_found),
	    cmocka_unit_test(test_a_point_has_its_name_or_one_by_its_place),
	    cmocka_unit_test(test_a_module_keeps_its_number),
	    cmocka_unit_test(test_the_number_of_who_is_gone_longest_is_taken_when_too_many_are),
	    cmocka_unit_test(test_where_all_numbers_are_used_one_of_who_is_gone_is_taken),
	};
	return cmocka_run_group_tests_name("map config", tests, NULL, NULL);
}
