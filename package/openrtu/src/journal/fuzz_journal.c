/* SPDX-License-Identifier: GPL-3.0-or-later */
/*
 * libFuzzer on the journal's file. The input is a row of records without their heads, two octets with the length of each
 * in front: magic, number and CRC are made, since chance does not find them. A length beyond the rest: what follows is the
 * file's end as it stands. Whatever it says, the map has only what can be, and each queue a place in its rings.
 */
#include <stdatomic.h>
#include <stdio.h>
#include <string.h>
#include <unistd.h>

#include "fuzz/input.h"
#include "journal/record.h"
#include "journal/restore.h"
#include "map/retained.h"
#include "map/test_modules.h"

#define POINTS   4
#define RETAINED 2 /* the first of them */
#define FILE_MAX 8192
/* Of the history, which this module keeps. */
#define KEEPER  2
#define READERS 3
#define ENTRIES 8

/* Of the first line's module. */
#define VALUES 3

static struct map_retained_name names[VALUES] = {{0, 0}, {1, 0}, {1, 1}};
static char directory[] = "/dev/shm/fuzz_journal.XXXXXX";
static struct map *map;

static void remove_map(void)
{
	map_remove(map);
	rmdir(directory);
}

static void make_map(void)
{
	struct map_set set = {.ca = 1001, .point_count = POINTS};
	struct map_point points[POINTS];
	struct map_config config = {
	    .settings = {.event_ring = 64, .queue_count = 1, .queues = {{.name = "A"}}},
	    .set_count = 1,
	    .point_count = POINTS,
	    .sets = &set,
	    .points = points};
	struct map_module_plan modules[MAP_MODULES_MAX];
	char error[MAP_ERROR_SIZE];

	for (uint16_t i = 0; i < POINTS; i++)
		points[i] = (struct map_point){
		    .type = MAP_SCALED, .ioa = i + 1u, .flags = i < RETAINED ? MAP_POINT_RETAIN : 0};
	CHECK(mkdtemp(directory) != NULL);
	plan_modules(&config, modules, NULL);
	modules[KEEPER].section_size = (uint32_t)map_history_size(READERS, ENTRIES);
	modules[KEEPER].history = (struct map_history_plan){.readers = READERS, .entries = ENTRIES};
	map_add_section(&config, MAP_RETAINED, sizeof(names[0]), VALUES, names);
	modules[set.module].section_size = (uint32_t)map_retained_size(VALUES);
	modules[set.module].retained = (struct map_retained_plan){.values = VALUES, .names = VALUES};
	CHECK(map_create(&map, directory, &config, 0, error) == 0);
	atexit(remove_map);
}

/* What journal_end writes of the octets that stand behind the head. */
static size_t make_record(uint8_t *at, uint32_t number, size_t length)
{
	struct journal_builder builder = {.bytes = at, .size = JOURNAL_HEAD_SIZE + length};

	journal_begin(&builder, number, 0, NULL, 0);
	for (size_t i = 0; i < length; i++)
		at[JOURNAL_HEAD_SIZE + i] = next_octet();
	builder.events = length < 8 ? 0 : at[JOURNAL_HEAD_SIZE + 4];
	builder.used = builder.size;
	journal_end(&builder);
	return builder.used;
}

static size_t make_file(uint8_t file[FILE_MAX])
{
	size_t size = 0;

	for (uint32_t number = 0; input.at < input.end; number++) {
		size_t length = next_octet() | (size_t)next_octet() << 8;

		if (length < JOURNAL_RECORD_LEAST || length > (size_t)(input.end - input.at) ||
		    JOURNAL_HEAD_SIZE + length > FILE_MAX - size)
			break;
		size += make_record(file + size, number, length);
	}
	while (input.at < input.end && size < FILE_MAX)
		file[size++] = next_octet();
	return size;
}

static void check_kept(const struct map_kept *kept, const struct journal_findings *findings, size_t size)
{
	CHECK(findings->unread <= size && kept->event_count <= size / JOURNAL_EVENT_SIZE);
	CHECK(kept->addresses[0][0] == '\0'); /* the group's */
	for (uint32_t i = 0; i < kept->event_count; i++) {
		const struct map_event *event = &kept->events[i].event;

		CHECK(kept->events[i].wanted != 0 && event->point < POINTS &&
		      event->kind == MAP_EVENT_CHANGE);
		CHECK(event->time == MAP_TIME_WALL || event->time == MAP_TIME_WALL_UNSET);
		CHECK(event->sample.time_ns >= 0);
	}
}

static void check_samples(const struct map_kept *kept, size_t size)
{
	CHECK(kept->sample_count <= size / JOURNAL_EVENT_SIZE);
	for (uint32_t i = 0; i < kept->sample_count; i++) {
		const struct map_kept_sample *found = &kept->samples[i];
		struct map_sample sample;

		CHECK(found->point < RETAINED && found->sample.quality & MAP_NOT_TOPICAL);
		CHECK(found->sample.value.i >= INT16_MIN && found->sample.value.i <= INT16_MAX);
		CHECK(map_read_own(map, found->point, &sample)); /* its time is past */
	}
}

static void check_values(const struct map_kept *kept, size_t size)
{
	CHECK(kept->value_count <= size / JOURNAL_EVENT_SIZE);
	for (uint32_t i = 0; i < kept->value_count; i++)
		CHECK(kept->values[i].name < VALUES);
}

static void check_queues(void)
{
	for (uint32_t slot = 0; slot < MAP_QUEUES; slot++) {
		struct map_queue_place place;
		struct map_event event;

		map_queue_place(map, slot, &place);
		CHECK(place.refresh_all == 0 && place.refresh_modules == 0);
		while (map_event_next(map, &place.cursor, &event))
			CHECK(event.point < POINTS && event.time != MAP_TIME_MONOTONIC);
		CHECK(map_events_behind(map, &place.cursor) == 0);
	}
}

static void check_history(const struct map_kept_history *kept, size_t size)
{
	struct map_history history;
	struct map_history_entry entry;

	CHECK(kept->entry_count <= size / JOURNAL_EVENT_SIZE && kept->reader_count == READERS);
	CHECK(map_history(map, &history) && history.head->start == 0);
	for (uint32_t i = 0; i < ENTRIES; i++) {
		const uint32_t number = history.entries[i].number;

		if (!map_history_read(&history, number, &entry))
			continue;
		CHECK(number % ENTRIES == i && entry.point < POINTS && entry.start != 0);
		CHECK(entry.time == MAP_TIME_WALL || entry.time == MAP_TIME_WALL_UNSET);
	}
}

int LLVMFuzzerTestOneInput(const uint8_t *data, size_t size)
{
	static uint8_t file[FILE_MAX];
	struct journal_findings findings;
	char error[MAP_ERROR_SIZE];
	struct map_kept kept;
	size_t file_size;

	if (map == NULL)
		make_map();
	input.at = data;
	input.end = data + size;
	file_size = make_file(file);
	CHECK(journal_restore(map, file, file_size, &kept, &findings));
	check_kept(&kept, &findings, file_size);
	CHECK(map_restore(map, &kept, error) == 0);
	check_samples(&kept, file_size);
	check_values(&kept, file_size);
	check_history(&kept.history, file_size);
	check_queues();
	journal_forget(&kept);
	return 0;
}
