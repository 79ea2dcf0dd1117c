/* SPDX-License-Identifier: GPL-3.0-or-later */
/* What the journal says of a map, and what the next map has of it, whatever became of the file. */
#include "map/test_stage.h"

#include <stdio.h>
#include <stdlib.h>
#include <string.h>

#include "journal/follow.h"
#include "journal/restore.h"
#include "map/retained.h"

#define STATION  "rtu-iec104"
#define CENTRE   0                          /* the group's queue */
#define OWN      (MAP_NAMED_QUEUES_MAX + 5) /* a queue of an address */
#define ADDRESS  "192.0.2.7"
#define S        1000000000LL
#define WALL_NS  (1700000000 * S)
#define FILE_MAX 16384

/* A map with a station, and the journal's file as it grows. */
struct scene {
	struct stage *stage;
	struct map *first, *second, *station;
	struct journal_follower follower;
	uint8_t memory[4096], file[FILE_MAX];
	size_t size;
	int32_t value; /* published last */
};

static void set_clock(struct scene *scene, int64_t wall_ns, bool set)
{
	map_clock_write(scene->stage->rtud,
			(struct map_clock){.offset_ns = wall_ns - map_now_ns(), .set = set});
}

static void begin(struct scene *scene, void **state)
{
	*scene = (struct scene){.stage = *state};
	strcpy(scene->stage->config.settings.queues[0].name, "Centre");
	scene->stage->config.settings.queue_count = 1;
	make_again(scene->stage);
	scene->first = start(scene->stage, FIRST);
	scene->second = start(scene->stage, SECOND);
	scene->station = start(scene->stage, STATION);
	set_clock(scene, WALL_NS, true);
	journal_follow(&scene->follower, scene->stage->rtud, scene->memory, sizeof(scene->memory));
}

static void end(struct scene *scene)
{
	map_detach(scene->first);
	map_detach(scene->second);
	map_detach(scene->station);
}

/* Values count up, of both lines by turns. */
static void publish(struct scene *scene, int count)
{
	for (int32_t value = scene->value + 1; value <= scene->value + count; value++) {
		struct map_update update = scaled(value % 2 ? 1 : 5, value, MAP_GOOD, map_now_ns());

		map_publish(value % 2 ? scene->first : scene->second, &update, 1);
	}
	scene->value += count;
}

static void assign(struct scene *scene)
{
	struct map_queue_place place = {.refresh_all = 0};

	map_cursor_to_end(scene->station, &place.cursor);
	map_queue_assign(scene->station, OWN, ADDRESS, &place);
	map_queue_use(scene->station, OWN);
}

static void acknowledge(struct scene *scene, uint32_t slot, int count)
{
	struct map_queue_place place;
	struct map_event event;

	map_queue_place(scene->station, slot, &place);
	while (count-- > 0)
		assert_true(map_event_next(scene->station, &place.cursor, &event));
	map_queue_move(scene->station, slot, &place);
}

/* What rtu-journal does each interval_s. */
static bool write_news(struct scene *scene)
{
	if (!journal_make(&scene->follower, false))
		return false;
	if (journal_is_first(&scene->follower))
		scene->size = 0;
	assert_true(scene->follower.record.used <= FILE_MAX - scene->size);
	memcpy(scene->file + scene->size, scene->follower.record.bytes, scene->follower.record.used);
	scene->size += scene->follower.record.used;
	journal_written(&scene->follower);
	return true;
}

/* The power is cut: a new map, whose clock was never set, has what the journal says. */
static struct journal_findings cut_power(struct scene *scene)
{
	struct journal_findings findings;
	char error[MAP_ERROR_SIZE];
	struct map_kept kept;

	end(scene);
	make_again(scene->stage);
	set_clock(scene, 5 * S, false);
	assert_true(journal_restore(scene->stage->rtud, scene->file, scene->size, &kept, &findings));
	if (map_restore(scene->stage->rtud, &kept, error) < 0)
		fail_msg("%s", error);
	journal_forget(&kept);
	scene->first = start(scene->stage, FIRST);
	scene->second = start(scene->stage, SECOND);
	scene->station = start(scene->stage, STATION);
	journal_follow(&scene->follower, scene->stage->rtud, scene->memory, sizeof(scene->memory));
	return findings;
}

/* A queue has values from..to and no other. */
static void assert_waits(struct scene *scene, uint32_t slot, int32_t from, int32_t to)
{
	struct map_clock clock = map_clock_read(scene->stage->rtud);
	struct map_queue_place place;
	struct map_event event;

	map_queue_place(scene->station, slot, &place);
	for (int32_t value = from; value <= to; value++) {
		assert_true(map_event_next(scene->station, &place.cursor, &event));
		assert_int_equal(event.sample.value.i, value);
		assert_int_equal(event.point, value % 2 ? 1 : 5);
		assert_in_range(map_event_wall_ns(&event, clock), WALL_NS, WALL_NS + 60 * S);
		assert_true(map_event_time_is_set(&event, clock));
	}
	assert_false(map_event_next(scene->station, &place.cursor, &event));
	assert_int_equal(place.cursor.lost, 0);
	assert_false(place.refresh_all);
	assert_true(place.refresh_modules == 0);
}

/* ---- what outlives the power cut --------------------------------------------------------- */

static void test_each_queue_has_what_it_did_not_acknowledge(void **state)
{
	struct scene scene;
	struct map_queue queue;

	begin(&scene, state);
	publish(&scene, 3);
	assert_true(write_news(&scene));
	assign(&scene);
	publish(&scene, 4);
	acknowledge(&scene, CENTRE, 2);
	assert_true(write_news(&scene));
	acknowledge(&scene, OWN, 3);
	assert_true(write_news(&scene));
	assert_int_equal(journal_pending(&scene.follower), 5);
	assert_int_equal(cut_power(&scene).records, 3);
	assert_waits(&scene, CENTRE, 3, 7);
	assert_waits(&scene, MAP_NAMED_QUEUES_MAX, 7, 7); /* the first queue behind the groups' */
	map_queue(scene.station, MAP_NAMED_QUEUES_MAX, &queue);
	assert_string_equal(queue.name, ADDRESS);
	end(&scene);
}

static void test_restored_events_come_before_new_ones(void **state)
{
	struct scene scene;
	struct map_queue_place place;
	struct map_event event;

	begin(&scene, state);
	publish(&scene, 3);
	write_news(&scene);
	cut_power(&scene);
	publish(&scene, 2);
	map_queue_place(scene.station, CENTRE, &place);
	for (int32_t value = 1; value <= 5; value++) {
		assert_true(map_event_next(scene.station, &place.cursor, &event));
		assert_int_equal(event.sample.value.i, value);
		assert_int_equal(event.time, value <= 3 ? MAP_TIME_WALL : MAP_TIME_MONOTONIC);
	}
	end(&scene);
}

/* A second cut finds what the first one left, with the times of before both. */
static void test_power_is_cut_again(void **state)
{
	struct scene scene;

	begin(&scene, state);
	publish(&scene, 5);
	write_news(&scene);
	cut_power(&scene);
	acknowledge(&scene, CENTRE, 2);
	assert_true(write_news(&scene));
	assert_false(write_news(&scene));
	cut_power(&scene);
	assert_waits(&scene, CENTRE, 3, 5);
	end(&scene);
}

static void test_nothing_new_is_nothing_written(void **state)
{
	struct scene scene;

	begin(&scene, state);
	assert_true(write_news(&scene)); /* in the place of what is there from another time */
	assert_false(write_news(&scene));
	publish(&scene, 4);
	acknowledge(&scene, CENTRE, 4);
	assert_false(write_news(&scene)); /* acknowledged before it was in the file */
	publish(&scene, 2);
	assert_true(write_news(&scene));
	assert_false(write_news(&scene));
	publish(&scene, 2);
	acknowledge(&scene, CENTRE, 4);
	assert_true(write_news(&scene)); /* or these two would come again */
	assert_int_equal(journal_pending(&scene.follower), 0);
	assert_false(write_news(&scene));
	cut_power(&scene);
	assert_waits(&scene, CENTRE, 1, 0);
	end(&scene);
}

static void test_a_failed_record_is_made_again(void **state)
{
	struct scene scene;

	begin(&scene, state);
	publish(&scene, 2);
	write_news(&scene);
	publish(&scene, 2);
	assert_true(journal_make(&scene.follower, false)); /* and is not written */
	publish(&scene, 1);
	assert_true(write_news(&scene));
	cut_power(&scene);
	assert_waits(&scene, CENTRE, 1, 5);
	publish(&scene, 1);
	assert_true(write_news(&scene));
	journal_abandon(&scene.follower);
	assert_true(write_news(&scene));
	assert_true(journal_is_first(&scene.follower));
	end(&scene);
}

static void test_a_record_holds_the_newest(void **state)
{
	struct scene scene;
	int32_t left_out;

	begin(&scene, state);
	journal_follow(&scene.follower, scene.stage->rtud, scene.memory, 1000);
	publish(&scene, 100);
	assert_true(write_news(&scene));
	left_out = (int32_t)scene.follower.left_out;
	assert_int_equal(scene.follower.record.events + scene.follower.left_out, 100);
	assert_in_range(left_out, 60, 70);
	cut_power(&scene);
	assert_waits(&scene, CENTRE, left_out + 1, 100);
	end(&scene);
}

/* What one record has no room for is in the next: nothing is left out of a file that goes on. */
static void test_a_further_record_goes_on_where_the_last_one_ended(void **state)
{
	struct scene scene;

	begin(&scene, state);
	journal_follow(&scene.follower, scene.stage->rtud, scene.memory, 300);
	write_news(&scene);
	publish(&scene, 20);
	while (write_news(&scene))
		assert_int_equal(scene.follower.left_out, 0);
	assert_int_equal(journal_pending(&scene.follower), 20);
	cut_power(&scene);
	assert_waits(&scene, CENTRE, 1, 20);
	end(&scene);
}

/* ---- the clock --------------------------------------------------------------------------- */

static void test_a_clock_that_is_set_later_dates_all(void **state)
{
	struct scene scene;

	begin(&scene, state);
	set_clock(&scene, 5 * S, false);
	publish(&scene, 3);
	assert_true(write_news(&scene));
	assert_false(write_news(&scene));
	set_clock(&scene, WALL_NS + S, true);
	assert_true(write_news(&scene));
	assert_true(journal_is_first(&scene.follower));
	set_clock(&scene, WALL_NS + 3 * S / 2, true);
	assert_false(write_news(&scene));
	cut_power(&scene);
	assert_waits(&scene, CENTRE, 1, 3);
	end(&scene);
}

static void test_a_clock_that_was_never_set_stays_so(void **state)
{
	struct scene scene;
	struct map_queue_place place;
	struct map_event event;

	begin(&scene, state);
	set_clock(&scene, 5 * S, false);
	publish(&scene, 1);
	write_news(&scene);
	cut_power(&scene);
	set_clock(&scene, WALL_NS, true);
	map_queue_place(scene.station, CENTRE, &place);
	assert_true(map_event_next(scene.station, &place.cursor, &event));
	assert_false(map_event_time_is_set(&event, map_clock_read(scene.stage->rtud)));
	assert_in_range(map_event_wall_ns(&event, map_clock_read(scene.stage->rtud)), 0, 60 * S);
	end(&scene);
}

/* ---- another configuration --------------------------------------------------------------- */

static void test_what_is_configured_no_more_is_dropped(void **state)
{
	struct scene scene;
	struct map_queue_place place;
	struct map_event event;

	begin(&scene, state);
	publish(&scene, 4);
	write_news(&scene);
	scene.stage->points[5].type = MAP_SINGLE;
	assert_int_equal(cut_power(&scene).unknown, 2);
	map_queue_place(scene.station, CENTRE, &place);
	for (int32_t value = 1; value <= 3; value += 2) {
		assert_true(map_event_next(scene.station, &place.cursor, &event));
		assert_int_equal(event.sample.value.i, value);
	}
	assert_false(map_event_next(scene.station, &place.cursor, &event));
	end(&scene);
}

/* Both lines' events are in one ring now. */
static void test_lines_of_one_process_keep_the_order(void **state)
{
	struct scene scene;
	struct journal_findings findings;
	char error[MAP_ERROR_SIZE];
	struct map_kept kept;

	begin(&scene, state);
	publish(&scene, 6);
	acknowledge(&scene, CENTRE, 1);
	write_news(&scene);
	end(&scene);
	scene.stage->processes[1] = 1;
	make_again(scene.stage);
	assert_true(journal_restore(scene.stage->rtud, scene.file, scene.size, &kept, &findings));
	assert_int_equal(map_restore(scene.stage->rtud, &kept, error), 0);
	journal_forget(&kept);
	scene.station = start(scene.stage, STATION);
	assert_waits(&scene, CENTRE, 2, 6);
	map_detach(scene.station);
}

static void test_a_group_of_another_name_begins_anew(void **state)
{
	struct scene scene;

	begin(&scene, state);
	publish(&scene, 4);
	write_news(&scene);
	strcpy(scene.stage->config.settings.queues[0].name, "Other");
	cut_power(&scene);
	assert_waits(&scene, CENTRE, 1, 0);
	end(&scene);
}

/* A module cannot pass off what it says now as what was before the power cut, which would go before all else. */
static void test_what_is_new_cannot_be_restored(void **state)
{
	struct scene scene;
	struct map_queue_place place;
	struct map_event event = {.point = 1, .time = MAP_TIME_WALL, .sample = {.time_ns = WALL_NS}};

	begin(&scene, state);
	publish(&scene, 1);
	write_news(&scene);
	cut_power(&scene);
	ring_put(&scene.first->segments[scene.first->self].events, &event);
	map_queue_place(scene.station, CENTRE, &place);
	assert_true(map_event_next(scene.station, &place.cursor, &event));
	assert_int_equal(event.sample.value.i, 1);
	assert_false(map_event_next(scene.station, &place.cursor, &event));
	end(&scene);
}

/* ---- the file, broken -------------------------------------------------------------------- */

static void write_three(struct scene *scene, void **state, size_t ends[3])
{
	begin(scene, state);
	for (int i = 0; i < 3; i++) {
		publish(scene, 2);
		if (i == 1)
			acknowledge(scene, CENTRE, 1);
		assert_true(write_news(scene));
		ends[i] = scene->size;
	}
}

/* What the first whole records say, and nothing else: values 1, 2; then 2..4; then 2..6. */
static void assert_says(const struct scene *scene, const uint8_t *bytes, size_t size, uint32_t records)
{
	static const int32_t firsts[] = {1, 1, 2, 2}, lasts[] = {0, 2, 4, 6};
	struct journal_findings findings;
	struct map_kept kept;

	assert_true(journal_restore(scene->stage->rtud, bytes, size, &kept, &findings));
	assert_int_equal(findings.records, records);
	assert_int_equal(findings.unknown, 0);
	assert_int_equal(kept.event_count, lasts[records] - firsts[records] + 1);
	for (uint32_t i = 0; i < kept.event_count; i++) {
		int32_t value = firsts[records] + (int32_t)i;

		assert_int_equal(kept.events[i].event.sample.value.i, value);
		assert_int_equal(kept.events[i].event.point, value % 2 ? 1 : 5);
		assert_int_equal(kept.events[i].wanted, 1u << CENTRE);
	}
	journal_forget(&kept);
}

static uint32_t whole_records(const size_t ends[3], size_t size)
{
	uint32_t records = 0;

	while (records < 3 && ends[records] <= size)
		records++;
	return records;
}

/* Each copy has the length it says, so that AddressSanitizer sees a look behind it. */
static void test_a_file_that_ends_anywhere(void **state)
{
	struct scene scene;
	size_t ends[3];

	write_three(&scene, state, ends);
	for (size_t size = 0; size <= scene.size; size++) {
		uint8_t *copy = malloc(size + 1);

		assert_non_null(copy);
		memcpy(copy + 1, scene.file, size); /* nothing in it is aligned */
		assert_says(&scene, copy + 1, size, whole_records(ends, size));
		free(copy);
	}
	end(&scene);
}

static void test_a_file_with_any_bit_flipped(void **state)
{
	struct scene scene;
	size_t ends[3];

	write_three(&scene, state, ends);
	for (size_t bit = 0; bit < scene.size * 8; bit++) {
		scene.file[bit / 8] ^= (uint8_t)(1u << bit % 8);
		assert_says(&scene, scene.file, scene.size, whole_records(ends, bit / 8));
		scene.file[bit / 8] ^= (uint8_t)(1u << bit % 8);
	}
	end(&scene);
}

static void test_records_in_another_order(void **state)
{
	struct scene scene;
	size_t ends[3];
	uint8_t last[512];

	write_three(&scene, state, ends);
	assert_says(&scene, scene.file + ends[0], scene.size - ends[0], 0);
	memcpy(last, scene.file + ends[1], scene.size - ends[1]);
	memmove(scene.file + ends[0], last, scene.size - ends[1]);
	assert_says(&scene, scene.file, scene.size - (ends[1] - ends[0]), 1);
	end(&scene);
}

/* A CRC is no signature: the numbers in a record may be anything, and are looked at. */
static void test_records_that_lie(void **state)
{
	static const struct journal_event event = {.ca = 1001,
						   .type = MAP_SCALED,
						   .ioa = 40002,
						   .module = 3,
						   .time = MAP_TIME_WALL,
						   .wall_ns = WALL_NS};
	struct journal_queue queues[MAP_QUEUES] = {{.kind = JOURNAL_GROUP, .name = "Centre"}};
	struct journal_event lies[6];
	struct journal_findings findings;
	struct map_kept kept;
	struct scene scene;

	begin(&scene, state);
	for (unsigned i = 0; i < 6; i++)
		lies[i] = event;
	lies[0].module = 200;
	lies[1].cause = 77;
	lies[2].time = MAP_TIME_MONOTONIC;
	lies[3].wall_ns = -1;
	lies[4].ioa = 40009;
	journal_begin(&scene.follower.record, 0, 5, queues, 1);
	for (unsigned i = 0; i < 6; i++)
		assert_true(journal_add(&scene.follower.record, &lies[i]));
	journal_end(&scene.follower.record);
	assert_true(
	    journal_restore(scene.stage->rtud, scene.memory, scene.follower.record.used, &kept, &findings));
	assert_int_equal(findings.unknown, 5);
	assert_int_equal(kept.event_count, 1);
	journal_forget(&kept);

	for (unsigned i = 0; i < MAP_QUEUES;
	     i++) { /* more addresses than there is room for beside the groups */
		queues[i].kind = JOURNAL_ADDRESS;
		snprintf(queues[i].name, sizeof(queues[i].name), "192.0.2.%u", i);
	}
	journal_begin(&scene.follower.record, 0, 5, queues, MAP_QUEUES);
	journal_end(&scene.follower.record);
	assert_true(
	    journal_restore(scene.stage->rtud, scene.memory, scene.follower.record.used, &kept, &findings));
	assert_int_equal(findings.records, 1);
	assert_string_equal(kept.addresses[0], "");
	assert_string_equal(kept.addresses[MAP_NAMED_QUEUES_MAX],
			    "192.0.2.8"); /* those before were unused longest */
	assert_string_equal(kept.addresses[MAP_QUEUES - 1], "192.0.2.31");
	journal_forget(&kept);
	end(&scene);
}

/* ---- retained points --------------------------------------------------------------------- */

#define KEPT  2 /* of the first line, as is OTHER; the rest is not retained */
#define OTHER 3

static void begin_retained(struct scene *scene, void **state)
{
	struct stage *stage = *state;

	stage->points[KEPT].flags |= MAP_POINT_RETAIN;
	stage->points[OTHER].flags |= MAP_POINT_RETAIN;
	begin(scene, state);
}

static void write_point(struct scene *scene, uint32_t point, int32_t value, uint8_t quality, int64_t time_ns)
{
	struct map_update update = scaled(point, value, quality, time_ns);

	update.event_rule = MAP_EVENT_BY_QUALITY;
	map_publish(scene->first, &update, 1);
}

static struct map_sample read_own(const struct scene *scene, uint32_t point)
{
	struct map_sample sample;

	assert_true(map_read_own(scene->stage->rtud, point, &sample));
	return sample;
}

static void assert_kept(const struct scene *scene, int32_t value, uint8_t quality)
{
	assert_sample(scene->stage->rtud, KEPT, value, quality);
	assert_int_equal(read_own(scene, OTHER).time_ns, 0); /* it was never written */
	assert_int_equal(read_own(scene, 0).time_ns, 0);     /* it is not retained */
}

static void test_a_retained_point_outlives_the_power(void **state)
{
	const int64_t written_ns = map_now_ns() - 3 * S;
	struct journal_findings findings;
	struct map_sample sample;
	struct scene scene;

	begin_retained(&scene, state);
	write_point(&scene, KEPT, 41, MAP_BLOCKED, written_ns);
	write_point(&scene, 0, 5, MAP_GOOD, written_ns);
	assert_true(write_news(&scene));
	write_point(&scene, KEPT, 41, MAP_BLOCKED, map_now_ns());
	assert_false(write_news(&scene)); /* the same again is worth no record */
	findings = cut_power(&scene);
	assert_int_equal(findings.dropped, 0);
	assert_kept(&scene, 41, MAP_BLOCKED | MAP_NOT_TOPICAL);
	assert_true(write_news(&scene)); /* and is in the file again, before anybody has written it */
	cut_power(&scene);
	assert_kept(&scene, 41, MAP_BLOCKED | MAP_NOT_TOPICAL);
	sample = read_own(&scene, KEPT);
	assert_true(sample.time_ns <= map_now_ns()); /* neither clock was set */
	write_point(&scene, KEPT, 42, MAP_GOOD, map_now_ns());
	assert_true(write_news(&scene));
	write_point(&scene, KEPT, 43, MAP_GOOD, map_now_ns());
	assert_true(write_news(&scene));
	assert_int_equal(scene.follower.record.events, 1); /* though it is no event */
	cut_power(&scene);
	assert_kept(&scene, 43, MAP_NOT_TOPICAL);
	end(&scene);
}

/* By the wall clock, which both sides have set; after an hour without power. */
static void test_a_retained_point_has_its_old_time(void **state)
{
	static const struct {
		int64_t later_ns;
		bool dated;
	} cases[] = {{3600 * S, true}, {-60 * S, false}, {MAP_PAST_DAYS * 86400 * S, false}};
	const int64_t written_ns = map_now_ns() - 3 * S;
	struct scene scene;

	begin_retained(&scene, state);
	write_point(&scene, KEPT, -7, MAP_GOOD, written_ns);
	assert_true(write_news(&scene));
	for (size_t i = 0; i < sizeof(cases) / sizeof(cases[0]); i++) {
		struct journal_findings findings;
		struct map_kept kept;
		int64_t age_ns;

		set_clock(&scene, WALL_NS + cases[i].later_ns, true);
		assert_true(journal_restore(scene.stage->rtud, scene.file, scene.size, &kept, &findings));
		assert_int_equal(kept.sample_count, 1);
		age_ns = map_now_ns() - kept.samples[0].sample.time_ns;
		if (cases[i].dated)
			assert_in_range(age_ns, cases[i].later_ns + 3 * S, cases[i].later_ns + 60 * S);
		else
			assert_in_range(age_ns, 0, 60 * S);
		journal_forget(&kept);
	}
	end(&scene);
}

/* A forced value is nobody's but the force's, and who is dead has said what it has said. */
static void test_what_is_kept_is_what_its_owner_said(void **state)
{
	const struct map_force force = {
	    .point = KEPT, .value.i = 99, .since_ns = 1, .until_ns = map_now_ns() + 3600 * S};
	struct scene scene;

	begin_retained(&scene, state);
	write_point(&scene, KEPT, 8, MAP_GOOD, map_now_ns());
	assert_true(map_force(scene.stage->rtud, &force));
	map_heartbeat(scene.first);
	assert_sample(scene.stage->rtud, KEPT, 99, MAP_SUBSTITUTED);
	map_module_ended(scene.stage->rtud, map_self(scene.first), true);
	assert_true(write_news(&scene));
	cut_power(&scene);
	assert_kept(&scene, 8, MAP_NOT_TOPICAL);
	end(&scene);
}

/* Of what is retained now and has the type that it had. */
static void test_a_changed_configuration_keeps_what_is_the_same(void **state)
{
	struct scene scene;

	begin_retained(&scene, state);
	write_point(&scene, KEPT, 8, MAP_GOOD, map_now_ns());
	write_point(&scene, OTHER, 9, MAP_GOOD, map_now_ns());
	assert_true(write_news(&scene));
	scene.stage->points[OTHER].type = MAP_FLOAT;
	assert_int_equal(cut_power(&scene).dropped, 1);
	assert_kept(&scene, 8, MAP_NOT_TOPICAL);
	scene.stage->points[KEPT].flags = 0;
	assert_int_equal(cut_power(&scene).dropped, 2);
	assert_int_equal(read_own(&scene, KEPT).time_ns, 0);
	scene.stage->points[KEPT].flags = MAP_POINT_RETAIN;
	scene.stage->points[KEPT].ioa += 100;
	assert_int_equal(cut_power(&scene).dropped, 2);
	end(&scene);
}

static unsigned points_said(const struct scene *scene, size_t size)
{
	struct journal_findings findings;
	struct map_kept kept;
	unsigned count;

	assert_true(journal_restore(scene->stage->rtud, scene->file, size, &kept, &findings));
	count = kept.sample_count;
	journal_forget(&kept);
	return count;
}

/* Nor does a record of another version, of which a bit of the head is another, say anything. */
static void test_a_retained_point_in_a_torn_file(void **state)
{
	struct scene scene;
	size_t whole;

	begin_retained(&scene, state);
	write_point(&scene, KEPT, 8, MAP_GOOD, map_now_ns());
	assert_true(write_news(&scene));
	whole = scene.size;
	write_point(&scene, OTHER, 9, MAP_GOOD, map_now_ns());
	assert_true(write_news(&scene));
	for (size_t size = 0; size <= scene.size; size++)
		assert_int_equal(points_said(&scene, size), size == scene.size ? 2 : size >= whole);
	for (size_t i = 0; i < whole; i++) {
		scene.file[i] ^= 1;
		assert_int_equal(points_said(&scene, scene.size), 0);
		scene.file[i] ^= 1;
	}
	end(&scene);
}

static void test_retained_points_that_lie(void **state)
{
	struct scene scene;
	struct journal_findings findings;
	struct map_kept kept;
	struct journal_event lies[6];
	const struct journal_queue queue = {.kind = JOURNAL_GROUP};

	begin_retained(&scene, state);
	for (unsigned i = 0; i < 6; i++)
		lies[i] = (struct journal_event){.ca = scene.stage->sets[0].ca,
						 .type = MAP_SCALED,
						 .ioa = scene.stage->points[KEPT].ioa,
						 .time = MAP_TIME_WALL,
						 .value = 3};
	lies[0].value = 40000; /* beyond a scaled value */
	lies[1].type = 200;
	lies[2].time = 77; /* and what has no time that can be, was some time */
	lies[3].wall_ns = INT64_MIN;
	lies[4].wall_ns = INT64_MAX;
	journal_begin(&scene.follower.record, 0, 5, &queue, 1);
	for (unsigned i = 0; i < 6; i++)
		assert_true(journal_keep(&scene.follower.record, &lies[i]));
	journal_end(&scene.follower.record);
	assert_true(
	    journal_restore(scene.stage->rtud, scene.memory, scene.follower.record.used, &kept, &findings));
	assert_int_equal(findings.dropped, 2);
	assert_int_equal(findings.unknown + kept.event_count, 0);
	assert_int_equal(kept.sample_count, 4);
	for (unsigned i = 0; i < 4; i++) {
		assert_int_equal(kept.samples[i].sample.value.i, 3);
		assert_in_range(map_now_ns() - kept.samples[i].sample.time_ns, 0, 60 * S);
	}
	journal_forget(&kept);
	end(&scene);
}

/* ---- retained values --------------------------------------------------------------------- */

#define VALUES 4 /* of the first line; the last one has no name: it does not outlive the power */
#define NAMED  3

static struct map_retained_name names[NAMED] = {{1, 10}, {1, 11}, {2, 10}};

static void begin_values(struct scene *scene, void **state)
{
	struct stage *stage = *state;

	names[1] = (struct map_retained_name){1, 11};
	map_add_section(&stage->config, MAP_RETAINED, sizeof(names[0]), NAMED, names);
	stage->retained = (struct map_retained_plan){.at = 16, .values = VALUES, .names = NAMED};
	begin(scene, state);
}

/* As its module does in each scan. */
static void retain(struct scene *scene, uint32_t low, uint32_t high, uint8_t quality)
{
	const struct map_retained_plan *plan;
	struct map_retained *retained = map_retained(scene->first, map_self(scene->first), &plan);
	struct map_retained_value *values = map_retained_other(retained, plan->values);

	for (uint32_t i = 0; i < VALUES; i++)
		values[i] =
		    (struct map_retained_value){low + i, high, quality | (uint32_t)MAP_RETAINED_KNOWN};
	latch_flip(&retained->latch);
}

static void assert_value(const struct scene *scene, uint32_t number, struct map_retained_value wanted)
{
	const struct map_retained_plan *plan;
	struct map_retained *retained = map_retained(scene->first, map_self(scene->first), &plan);
	const struct map_retained_value *value = &map_retained_whole(retained, plan->values)[number];

	assert_int_equal(value->low, wanted.low);
	assert_int_equal(value->high, wanted.high);
	assert_int_equal(value->quality, wanted.quality);
}

static void assert_retained(const struct scene *scene, uint32_t low, uint32_t high, uint8_t quality)
{
	for (uint32_t i = 0; i < NAMED; i++)
		assert_value(
		    scene, i,
		    (struct map_retained_value){low + i, high, quality | (uint32_t)MAP_RETAINED_KNOWN});
	assert_value(scene, NAMED, (struct map_retained_value){0, 0, 0});
}

static void test_retained_values_outlive_the_power(void **state)
{
	struct scene scene;

	begin_values(&scene, state);
	assert_true(write_news(&scene)); /* that there are queues; of the values nothing is known yet */
	assert_int_equal(scene.follower.record.states, 0);
	retain(&scene, 7, UINT32_MAX, MAP_INVALID);
	assert_true(write_news(&scene));
	retain(&scene, 7, UINT32_MAX, MAP_INVALID);
	assert_false(write_news(&scene)); /* the same again is worth no record */
	cut_power(&scene);
	assert_retained(&scene, 7, UINT32_MAX, MAP_INVALID);
	assert_true(write_news(&scene)); /* before the module has said them again */
	cut_power(&scene);
	assert_retained(&scene, 7, UINT32_MAX, MAP_INVALID);
	retain(&scene, 7, 1, MAP_INVALID);
	assert_true(write_news(&scene));
	retain(&scene, 7, 1, MAP_GOOD);
	assert_true(write_news(&scene));
	cut_power(&scene);
	assert_retained(&scene, 7, 1, MAP_GOOD);
	end(&scene);
}

/* What has another name now is another value, and another order means nothing. */
static void test_values_go_by_their_names(void **state)
{
	static const struct map_retained_name other = {9, 9};
	struct journal_findings findings;
	struct scene scene;

	begin_values(&scene, state);
	retain(&scene, 20, 0, MAP_GOOD);
	assert_true(write_news(&scene));
	names[1] = other;
	findings = cut_power(&scene);
	assert_int_equal(findings.dropped_values, 1);
	assert_value(&scene, 0, (struct map_retained_value){20, 0, MAP_RETAINED_KNOWN});
	assert_value(&scene, 1, (struct map_retained_value){0, 0, 0});
	assert_value(&scene, 2, (struct map_retained_value){22, 0, MAP_RETAINED_KNOWN});
	names[1] = names[0];
	names[0] = (struct map_retained_name){1, 11};
	cut_power(&scene);
	assert_value(&scene, 0, (struct map_retained_value){21, 0, MAP_RETAINED_KNOWN});
	assert_value(&scene, 1, (struct map_retained_value){20, 0, MAP_RETAINED_KNOWN});
	names[0] = (struct map_retained_name){1, 10};
	end(&scene);
}

static unsigned values_said(const struct scene *scene, size_t size)
{
	struct journal_findings findings;
	struct map_kept kept;
	unsigned count;

	assert_true(journal_restore(scene->stage->rtud, scene->file, size, &kept, &findings));
	count = kept.value_count;
	journal_forget(&kept);
	return count;
}

/* All of a record's values or none. */
static void test_retained_values_in_a_torn_file(void **state)
{
	struct scene scene;
	size_t whole;

	begin_values(&scene, state);
	retain(&scene, 1, 0, MAP_GOOD);
	assert_true(write_news(&scene));
	whole = scene.size;
	for (size_t size = 0; size <= whole; size++)
		assert_int_equal(values_said(&scene, size), size == whole ? NAMED : 0);
	for (size_t i = 0; i < whole; i++) {
		scene.file[i] ^= 1;
		assert_int_equal(values_said(&scene, whole), 0);
		scene.file[i] ^= 1;
	}
	end(&scene);
}

int main(void)
{
	const struct CMUnitTest tests[] = {
	    TEST(test_each_queue_has_what_it_did_not_acknowledge),
	    TEST(test_restored_events_come_before_new_ones),
	    TEST(test_power_is_cut_again),
	    TEST(test_nothing_new_is_nothing_written),
	    TEST(test_a_failed_record_is_made_again),
	    TEST(test_a_record_holds_the_newest),
	    TEST(test_a_further_record_goes_on_where_the_last_one_ended),
	    TEST(test_a_clock_that_is_set_later_dates_all),
	    TEST(test_a_clock_that_was_never_set_stays_so),
	    TEST(test_what_is_configured_no_more_is_dropped),
	    TEST(test_lines_of_one_process_keep_the_order),
	    TEST(test_a_group_of_another_name_begins_anew),
	    TEST(test_what_is_new_cannot_be_restored),
	    TEST(test_a_file_that_ends_anywhere),
	    TEST(test_a_file_with_any_bit_flipped),
	    TEST(test_records_in_another_order),
	    TEST(test_records_that_lie),
	    TEST(test_a_retained_point_outlives_the_power),
	    TEST(test_a_retained_point_has_its_old_time),
	    TEST(test_what_is_kept_is_what_its_owner_said),
	    TEST(test_a_changed_configuration_keeps_what_is_the_same),
	    TEST(test_a_retained_point_in_a_torn_file),
	    TEST(test_retained_points_that_lie),
	    TEST(test_retained_values_outlive_the_power),
	    TEST(test_values_go_by_their_names),
	    TEST(test_retained_values_in_a_torn_file),
	};

	return cmocka_run_group_tests(tests, NULL, NULL);
}
