/* SPDX-License-Identifier: GPL-3.0-or-later */
/* Which time has what a module's loss and return change. The test holds the map and the buffer in its hand. */
#include <setjmp.h>
#include <stdarg.h>
#include <stddef.h>
#include <stdint.h>

#include <cmocka.h>

#include "iec61850/list.h"
#include "iec61850/note.h"
#include "iec61850/value.h"

#define READ_NS   1000
#define LOST_NS   1200
#define RETURN_NS 1500
#define OWNER     1u

enum { LOST, OTHERS, POINTS };

static struct map_sample held[POINTS];
static bool alive;
static struct map_history_entry added[8];
static unsigned added_count;

bool map_read(const struct map *map, uint32_t point, struct map_sample *out)
{
	(void)map;
	*out = held[point];
	if (point == LOST && !alive)
		out->quality |= MAP_INVALID;
	return true;
}

uint32_t map_owner(const struct map *map, uint32_t point)
{
	(void)map;
	return point == LOST ? OWNER : OWNER + 1;
}

void iec61850_buffer_add(struct iec61850_buffer *buffer, uint32_t point, uint8_t reason,
			 const struct map_sample *sample, int64_t noted_ns)
{
	(void)buffer;
	assert_true(added_count < sizeof(added) / sizeof(added[0]));
	added[added_count++] = (struct map_history_entry){
	    .point = point, .reason = reason, .sample = *sample, .noted_ns = noted_ns};
}

void iec61850_buffer_settle(struct iec61850_buffer *buffer, const struct map_cursor *cursor)
{
	(void)buffer, (void)cursor;
}

enum iec61850_ctl_kind iec61850_ctl_model(const struct iec61850_model *model, uint32_t point)
{
	(void)model, (void)point;
	return IEC61850_STATUS_ONLY;
}

bool iec61850_is_selected(const struct iec61850_model *model, uint32_t point)
{
	(void)model, (void)point;
	return false;
}

uint32_t iec61850_last_member(const struct iec61850_model *model, uint32_t point, uint32_t set)
{
	(void)model, (void)point, (void)set;
	return IEC61850_NO_MEMBER;
}

static struct map_point points[POINTS];
static const struct map_config config = {.points = points, .point_count = POINTS};
static struct iec61850_device device;
static struct iec61850_place places[POINTS] = {{.member = IEC61850_NO_MEMBER},
					       {.member = IEC61850_NO_MEMBER}};
static struct map_sample image[POINTS];
static bool selected[POINTS];
static struct iec61850_server server = {
    .model = {.config = &config, .devices = &device, .places = places, .image = image, .selected = selected}};

static int set_up(void **state)
{
	(void)state;
	alive = true;
	added_count = 0;
	for (unsigned i = 0; i < POINTS; i++)
		image[i] = held[i] = (struct map_sample){.value.u = 1, .time_ns = READ_NS};
	return 0;
}

static void note_module(enum map_event_kind kind, int64_t time_ns)
{
	const struct map_event event = {
	    .kind = (uint8_t)kind, .point = OWNER, .sample = {.quality = MAP_INVALID, .time_ns = time_ns}};

	iec61850_note_event(&server, &event, time_ns);
}

static void expect_quality(unsigned entry, uint8_t quality, int64_t time_ns)
{
	assert_int_equal(added_count, entry + 1);
	assert_int_equal(added[entry].point, LOST);
	assert_int_equal(added[entry].reason, IEC61850_QUALITY_CHANGE);
	assert_int_equal(added[entry].sample.quality, quality);
	assert_int_equal(added[entry].sample.time_ns, time_ns);
	assert_int_equal(image[LOST].time_ns, time_ns);
}

static void test_the_time_is_that_of_loss_and_return(void **state)
{
	(void)state;
	alive = false;
	note_module(MAP_EVENT_MODULE_DOWN, LOST_NS);
	expect_quality(0, MAP_INVALID, LOST_NS);
	alive = true;
	note_module(MAP_EVENT_MODULE_UP, RETURN_NS);
	expect_quality(1, MAP_GOOD, RETURN_NS);
	assert_int_equal(image[OTHERS].time_ns, READ_NS);
}

static void test_a_value_that_is_newer_has_its_own_time(void **state)
{
	(void)state;
	alive = false;
	note_module(MAP_EVENT_MODULE_DOWN, LOST_NS);
	alive = true;
	held[LOST].time_ns = RETURN_NS + 100;
	note_module(MAP_EVENT_MODULE_UP, RETURN_NS);
	expect_quality(1, MAP_GOOD, RETURN_NS + 100);
}

/* It was back before anybody looked: nothing has changed, and what had the same quality all the time keeps its time. */
static void test_what_did_not_change_keeps_its_time(void **state)
{
	(void)state;
	note_module(MAP_EVENT_MODULE_DOWN, LOST_NS);
	note_module(MAP_EVENT_MODULE_UP, RETURN_NS);
	assert_int_equal(added_count, 0);
	assert_int_equal(image[LOST].time_ns, READ_NS);
}

int main(void)
{
	const struct CMUnitTest tests[] = {
	    cmocka_unit_test_setup(test_the_time_is_that_of_loss_and_return, set_up),
	    cmocka_unit_test_setup(test_a_value_that_is_newer_has_its_own_time, set_up),
	    cmocka_unit_test_setup(test_what_did_not_change_keeps_its_time, set_up),
	};

	return cmocka_run_group_tests(tests, NULL, NULL);
}
