/* SPDX-License-Identifier: GPL-3.0-or-later */
/* Texts of points: what readers have, whatever their owner does, and what stays of them. */
#include "map/test_stage.h"

#include <string.h>

#include "map/text.h"

enum { SERIAL, VERSION };

static int set_up_texts(void **state)
{
	struct stage *stage;

	set_up(state);
	stage = *state;
	stage->points[SERIAL] = (struct map_point){.type = MAP_BITSTRING, .flags = MAP_POINT_TEXT, .ioa = 1};
	stage->points[VERSION] = (struct map_point){.type = MAP_BITSTRING, .flags = MAP_POINT_TEXT, .ioa = 2};
	make_again(stage);
	return 0;
}

#define TEXTS(name) cmocka_unit_test_setup_teardown(name, set_up_texts, tear_down)

static void publish(struct map *owner, uint32_t point, const char *text, uint8_t quality)
{
	struct map_update update = {.point = point, .sample = {.quality = quality, .time_ns = map_now_ns()}};

	update.sample.value = map_text_put(owner, point, text);
	map_publish(owner, &update, 1);
}

static void assert_text(const struct map *map, uint32_t point, const char *expected)
{
	struct map_sample sample;
	char text[MAP_TEXT_SIZE];

	assert_true(map_read(map, point, &sample));
	assert_true(map_text_of(map, point, sample.value, text));
	assert_string_equal(text, expected);
}

static void assert_none(const struct map *map, union map_value value)
{
	char text[MAP_TEXT_SIZE] = "x";

	assert_false(map_text_of(map, SERIAL, value, text));
	assert_string_equal(text, "");
}

static void test_each_point_has_its_own_text(void **state)
{
	struct stage *stage = *state;
	struct map *owner = start(stage, FIRST);

	publish(owner, SERIAL, "A-17", MAP_GOOD);
	publish(owner, VERSION, "4.2 \xC2\xB5", MAP_GOOD);
	publish(owner, SERIAL, "A-18", MAP_GOOD);
	assert_text(stage->rtud, SERIAL, "A-18");
	assert_text(stage->rtud, VERSION, "4.2 \xC2\xB5");
	map_detach(owner);
}

static void test_a_text_is_there_once_it_is_published(void **state)
{
	struct stage *stage = *state;
	struct map *owner = start(stage, FIRST);

	publish(owner, SERIAL, "before", MAP_GOOD);
	map_text_put(owner, SERIAL, "killed");
	map_text_put(owner, SERIAL, "again");
	assert_text(stage->rtud, SERIAL, "before");
	publish(owner, SERIAL, "again", MAP_GOOD);
	assert_text(stage->rtud, SERIAL, "again");
	map_detach(owner);
}

static void test_another_text_is_an_event_which_tells_the_one_before_too(void **state)
{
	struct stage *stage = *state;
	struct map *owner = start(stage, FIRST);
	struct map_cursor cursor;
	struct map_event events[3];
	char text[MAP_TEXT_SIZE];
	unsigned count = 0;

	map_cursor_to_end(stage->rtud, &cursor);
	publish(owner, SERIAL, "one", MAP_GOOD);
	publish(owner, SERIAL, "one", MAP_GOOD);
	publish(owner, SERIAL, "two", MAP_GOOD);
	while (count < 3 && map_event_next(stage->rtud, &cursor, &events[count]))
		count++;
	assert_int_equal(count, 2);
	assert_true(map_text_of(stage->rtud, SERIAL, events[0].sample.value, text));
	assert_string_equal(text, "one");
	publish(owner, SERIAL, "three", MAP_GOOD);
	assert_none(stage->rtud, events[0].sample.value);
	map_detach(owner);
}

static void test_a_new_process_of_its_owner_leaves_the_text(void **state)
{
	struct stage *stage = *state;
	struct map *owner = start(stage, FIRST);
	struct map_sample sample;

	publish(owner, SERIAL, "A-17", MAP_GOOD);
	map_detach(owner);
	owner = start(stage, FIRST);
	assert_true(map_read(stage->rtud, SERIAL, &sample));
	assert_int_equal(sample.quality, MAP_INVALID);
	assert_text(stage->rtud, SERIAL, "A-17");
	map_detach(owner);
}

/* Of an owner gone wild: no end, no UTF-8, a control character. */
static void test_what_is_no_text_is_given_to_nobody(void **state)
{
	static const char *const texts[] = {"\xC3",     "\xE2\x82",         "\x1b[2J",
					    "\xC2\x85", "\xF0\x9F\x98\x80", "\xED\xA0\x80"};
	struct stage *stage = *state;
	struct map *owner = start(stage, FIRST);
	char endless[MAP_TEXT_SIZE + 1];

	for (size_t i = 0; i < sizeof(texts) / sizeof(texts[0]); i++)
		assert_none(stage->rtud, map_text_put(owner, SERIAL, texts[i]));
	memset(endless, 'x', MAP_TEXT_SIZE);
	endless[MAP_TEXT_SIZE] = '\0';
	memcpy(owner->segments[owner->self].texts[0].texts[0], endless, MAP_TEXT_SIZE);
	assert_none(stage->rtud, (union map_value){.u = 0});
	map_detach(owner);
}

static void test_a_text_is_not_forced(void **state)
{
	struct stage *stage = *state;

	assert_string_equal(map_unforceable(map_config(stage->rtud), SERIAL),
			    "is a text, for which nobody can enter another");
}

int main(void)
{
	const struct CMUnitTest tests[] = {
	    TEXTS(test_each_point_has_its_own_text),
	    TEXTS(test_a_text_is_there_once_it_is_published),
	    TEXTS(test_another_text_is_an_event_which_tells_the_one_before_too),
	    TEXTS(test_a_new_process_of_its_owner_leaves_the_text),
	    TEXTS(test_what_is_no_text_is_given_to_nobody),
	    TEXTS(test_a_text_is_not_forced),
	};

	return cmocka_run_group_tests(tests, NULL, NULL);
}
