/* SPDX-License-Identifier: GPL-3.0-or-later */
#include <setjmp.h>
#include <stdarg.h>
#include <stddef.h>
#include <stdint.h>
#include <string.h>

#include <cmocka.h>

#include "goose/publisher.h"
#include "map/time_ns.h"

#define MS NS_PER_MS

static struct goose_publication publication = {
    .stream = {.control = "L/LLN0$GO$a", .data_set = "L/LLN0$a", .conf_rev = 1},
    .id = "a",
    .least_ms = 4,
    .most_ms = 100,
    .with_quality = true,
    .member_count = 2,
};
static uint32_t members[] = {0, 1};
static struct map_point points[] = {{.type = MAP_SINGLE}, {.type = MAP_SCALED}};
static struct map_config config = {
    .points = points,
    .point_count = 2,
    .sections = {{GOOSE_PUBLICATIONS, sizeof(publication), 1, &publication},
		 {GOOSE_MEMBERS, sizeof(members[0]), 2, members}},
    .section_count = 2,
};

static struct goose_publisher publisher;
static struct map_sample samples[2];
static struct goose_message sent;
static struct goose_item items[GOOSE_ITEMS_MAX];

static int begin(void **state)
{
	(void)state;
	goose_publisher_init(&publisher, &config, 0, samples, 0);
	return 0;
}

static void send_at(int64_t now_ns)
{
	static const uint8_t source[6] = {2};
	static uint8_t frame[GOOSE_FRAME_MAX];
	size_t size;

	assert_true(now_ns >= goose_publisher_deadline(&publisher));
	size = goose_publisher_send(&publisher, source, (struct goose_time){now_ns, 0}, now_ns, frame);
	assert_true(goose_decode(frame, size, &sent, items));
}

static void assert_numbers(uint32_t state, uint32_t sequence)
{
	assert_int_equal(sent.state, state);
	assert_int_equal(sent.sequence, sequence);
}

static void set(uint32_t member, int32_t value, uint8_t quality)
{
	goose_publisher_set(&publisher, member, &(struct map_sample){.value.i = value, .quality = quality});
}

static void test_a_change_is_repeated_ever_more_slowly(void **state)
{
	static const int64_t due_ms[] = {4, 12, 28, 60, 124, 224, 324};
	int64_t now_ns = 0;

	(void)state;
	send_at(now_ns);
	assert_numbers(1, 0);
	for (uint32_t i = 0; i < sizeof(due_ms) / sizeof(due_ms[0]); i++) {
		now_ns = goose_publisher_deadline(&publisher);
		assert_int_equal(now_ns, due_ms[i] * MS);
		send_at(now_ns);
		assert_numbers(1, i + 1);
	}
	assert_int_equal(sent.alive_ms, 300);
	assert_int_equal(sent.time.utc_ns, 0);
}

static void test_a_change_is_sent_at_once(void **state)
{
	(void)state;
	send_at(0);
	set(1, -5, MAP_GOOD);
	assert_true(goose_publisher_has_changed(&publisher, 1));
	send_at(1 * MS);
	assert_numbers(2, 0);
	assert_true(sent.time.utc_ns > 0);
	assert_int_equal(items[2].integer, -5);
	assert_false(goose_publisher_has_changed(&publisher, 1));
	assert_int_equal(goose_publisher_deadline(&publisher), 5 * MS);
}

static void test_the_same_is_no_change(void **state)
{
	(void)state;
	set(0, 1, MAP_GOOD);
	send_at(0);
	set(0, 1, MAP_GOOD);
	assert_int_equal(goose_publisher_deadline(&publisher), 4 * MS);
	set(0, 1, MAP_NOT_TOPICAL);
	send_at(0);
	assert_numbers(2, 0);
}

static void test_nothing_known_is_invalid(void **state)
{
	(void)state;
	send_at(0);
	assert_int_equal(items[1].bits >> 11, 1);
}

static void test_another_process_goes_on(void **state)
{
	(void)state;
	goose_publisher_init(&publisher, &config, 0, samples, 41);
	send_at(0);
	assert_numbers(42, 0);
	publisher.state = UINT32_MAX;
	set(0, 1, MAP_GOOD);
	send_at(0);
	assert_numbers(1, 0);
}

int main(void)
{
	const struct CMUnitTest tests[] = {
	    cmocka_unit_test_setup(test_a_change_is_repeated_ever_more_slowly, begin),
	    cmocka_unit_test_setup(test_a_change_is_sent_at_once, begin),
	    cmocka_unit_test_setup(test_the_same_is_no_change, begin),
	    cmocka_unit_test_setup(test_nothing_known_is_invalid, begin),
	    cmocka_unit_test_setup(test_another_process_goes_on, begin),
	};

	return cmocka_run_group_tests_name("goose publisher", tests, NULL, NULL);
}
