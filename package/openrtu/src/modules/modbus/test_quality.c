/* SPDX-License-Identifier: GPL-3.0-or-later */
/* Status bits and lost readings, on a map of its own: what readers see, and which events there are. */
#include "map/test_stage.h"
#include "modules/modbus/quality.h"

enum { TEST_MODE, FROZEN, VALUE, OTHER }; /* points of the first device: two bits, two measured values */

static struct map *owner;
static struct map_cursor cursor;
static struct quality quality;
static struct quality_of_point points[POINTS];

static int start_stage(void **state)
{
	struct stage *stage;
	struct map_point *config;
	static struct modbus_point wire[POINTS];
	static struct modbus_extra extras[2];

	set_up(state);
	stage = *state;
	config = stage->points;
	config[TEST_MODE].type = config[FROZEN].type = MAP_SINGLE;
	wire[VALUE].extra = 1;
	extras[0].links[MODBUS_BLOCKED_BY] = 1 + TEST_MODE;
	extras[0].links[MODBUS_NOT_TOPICAL_BY] = 1 + FROZEN;
	wire[OTHER].extra = 2;
	extras[1].links[MODBUS_SUBSTITUTED_BY] = 1 + TEST_MODE;
	map_add_section(&stage->config, MODBUS_POINTS, sizeof(wire[0]), POINTS, wire);
	map_add_section(&stage->config, MODBUS_EXTRAS, sizeof(extras[0]), 2, extras);
	make_again(stage);
	owner = start(stage, FIRST);
	map_heartbeat(owner);
	map_cursor_to_end(owner, &cursor);
	quality_init(&quality, owner, points);
	return 0;
}

static int end_stage(void **state)
{
	map_detach(owner);
	return tear_down(state);
}

static void complete_and_publish(struct map_update *updates, size_t count)
{
	count = quality_complete(&quality, &map_config(owner)->sets[0], updates, count, map_now_ns());
	map_publish(owner, updates, count);
}

static void read_point(uint32_t point, int32_t value, uint8_t own)
{
	struct map_update updates[POINTS] = {scaled(point, value, own, map_now_ns())};

	complete_and_publish(updates, 1);
}

static void lose(uint32_t point, enum map_quality how)
{
	struct map_update updates[POINTS] = {quality_lost(&quality, point, how, map_now_ns())};

	complete_and_publish(updates, 1);
}

static void read_all(void)
{
	for (uint32_t point = 0; point <= OTHER; point++)
		read_point(point, 0, MAP_GOOD);
	map_cursor_to_end(owner, &cursor);
}

static void expect_event(uint32_t point, int32_t value, uint8_t is)
{
	struct map_event event;

	assert_true(map_event_next(owner, &cursor, &event));
	assert_int_equal(event.point, point);
	assert_int_equal(event.sample.value.i, value);
	assert_int_equal(event.sample.quality, is);
	assert_sample(owner, point, value, is);
}

static void expect_no_event(void)
{
	struct map_event event;

	assert_false(map_event_next(owner, &cursor, &event));
}

static void test_a_bit_read_alone_is_said_of_the_others(void **state)
{
	(void)state;
	read_all();
	read_point(VALUE, 7, MAP_GOOD);
	expect_event(VALUE, 7, MAP_GOOD);
	read_point(TEST_MODE, 1, MAP_GOOD);
	expect_event(TEST_MODE, 1, MAP_GOOD);
	expect_event(VALUE, 7, MAP_BLOCKED);
	expect_event(OTHER, 0, MAP_SUBSTITUTED);
	read_point(VALUE, 8, MAP_OVERFLOW);
	expect_event(VALUE, 8, MAP_OVERFLOW | MAP_BLOCKED);
	read_point(TEST_MODE, 1, MAP_GOOD); /* no news */
	expect_no_event();
	read_point(TEST_MODE, 0, MAP_GOOD);
	expect_event(TEST_MODE, 0, MAP_GOOD);
	expect_event(VALUE, 8, MAP_OVERFLOW);
	expect_event(OTHER, 0, MAP_GOOD);
	expect_no_event();
}

/* All of them in one read: one event each, with what the bit says now, wherever the bit stands among them. */
static void test_a_bit_counts_for_what_is_read_with_it(void **state)
{
	struct map_update updates[POINTS];
	int64_t now = map_now_ns();

	(void)state;
	read_all();
	updates[0] = scaled(VALUE, 9, MAP_GOOD, now);
	updates[1] = scaled(TEST_MODE, 1, MAP_GOOD, now);
	updates[2] = scaled(FROZEN, 1, MAP_GOOD, now);
	complete_and_publish(updates, 3);
	expect_event(VALUE, 9, MAP_BLOCKED | MAP_NOT_TOPICAL);
	expect_event(TEST_MODE, 1, MAP_GOOD);
	expect_event(FROZEN, 1, MAP_GOOD);
	expect_event(OTHER, 0, MAP_SUBSTITUTED);
	expect_no_event();
}

static void test_a_bit_that_is_not_good_leaves_nobody_knowing(void **state)
{
	(void)state;
	read_all();
	read_point(TEST_MODE, 1, MAP_GOOD);
	map_cursor_to_end(owner, &cursor);
	lose(TEST_MODE, MAP_INVALID);
	expect_event(TEST_MODE, 1, MAP_INVALID);
	expect_event(VALUE, 0, MAP_NOT_TOPICAL);
	expect_event(OTHER, 0, MAP_NOT_TOPICAL);
	read_point(TEST_MODE, 0, MAP_GOOD);
	expect_event(TEST_MODE, 0, MAP_GOOD);
	expect_event(VALUE, 0, MAP_GOOD);
	expect_event(OTHER, 0, MAP_GOOD);
	expect_no_event();
}

static void test_what_was_never_read_is_invalid_and_nothing_else(void **state)
{
	(void)state;
	read_point(TEST_MODE, 1, MAP_GOOD);
	expect_event(TEST_MODE, 1, MAP_GOOD);
	expect_no_event();
	assert_sample(owner, VALUE, 0, MAP_INVALID);
	read_point(VALUE, 3, MAP_GOOD); /* and of the other bit nobody knows */
	expect_event(VALUE, 3, MAP_BLOCKED | MAP_NOT_TOPICAL);
	expect_no_event();
}

static void test_an_old_value_is_not_topical_an_invalid_one_stays_so(void **state)
{
	(void)state;
	lose(VALUE, MAP_NOT_TOPICAL); /* there is none yet */
	expect_event(VALUE, 0, MAP_INVALID);
	read_all();
	read_point(VALUE, 5, MAP_GOOD);
	expect_event(VALUE, 5, MAP_GOOD);
	lose(VALUE, MAP_NOT_TOPICAL);
	expect_event(VALUE, 5, MAP_NOT_TOPICAL);
	lose(VALUE, MAP_NOT_TOPICAL);
	expect_no_event();
	lose(VALUE, MAP_INVALID);
	expect_event(VALUE, 5, MAP_INVALID);
	lose(VALUE, MAP_NOT_TOPICAL);
	expect_no_event();
	read_point(VALUE, 5, MAP_GOOD);
	expect_event(VALUE, 5, MAP_GOOD);
}

/* A status bit that ends leaves what the value's own reading says. */
static void test_the_bit_and_the_reading_are_kept_apart(void **state)
{
	(void)state;
	read_all();
	lose(VALUE, MAP_NOT_TOPICAL);
	expect_event(VALUE, 0, MAP_NOT_TOPICAL);
	read_point(FROZEN, 1, MAP_GOOD);
	expect_event(FROZEN, 1, MAP_GOOD);
	read_point(FROZEN, 0, MAP_GOOD);
	expect_event(FROZEN, 0, MAP_GOOD);
	assert_sample(owner, VALUE, 0, MAP_NOT_TOPICAL);
	read_point(TEST_MODE, 1, MAP_GOOD);
	expect_event(TEST_MODE, 1, MAP_GOOD);
	expect_event(VALUE, 0, MAP_NOT_TOPICAL | MAP_BLOCKED);
	expect_event(OTHER, 0, MAP_SUBSTITUTED);
	lose(VALUE, MAP_INVALID);
	expect_event(VALUE, 0, MAP_INVALID);
	expect_no_event();
}

#define QUALITY_TEST(name) cmocka_unit_test_setup_teardown(name, start_stage, end_stage)

int main(void)
{
	const struct CMUnitTest tests[] = {
	    QUALITY_TEST(test_a_bit_read_alone_is_said_of_the_others),
	    QUALITY_TEST(test_a_bit_counts_for_what_is_read_with_it),
	    QUALITY_TEST(test_a_bit_that_is_not_good_leaves_nobody_knowing),
	    QUALITY_TEST(test_what_was_never_read_is_invalid_and_nothing_else),
	    QUALITY_TEST(test_an_old_value_is_not_topical_an_invalid_one_stays_so),
	    QUALITY_TEST(test_the_bit_and_the_reading_are_kept_apart),
	};

	return cmocka_run_group_tests(tests, NULL, NULL);
}
