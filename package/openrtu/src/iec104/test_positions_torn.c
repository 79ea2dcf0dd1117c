/* SPDX-License-Identifier: GPL-3.0-or-later */
/*
 * A position is of one fix, wherever its owner or its reader is stopped: each fix carries one number in all of its four points. An
 * argument says how often each is stopped.
 */
#include <sched.h>
#include <setjmp.h>
#include <signal.h>
#include <stdarg.h>
#include <stddef.h>
#include <stdint.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <sys/mman.h>
#include <sys/wait.h>
#include <unistd.h>

#include <cmocka.h>

#include "iec104/station_parts.h"
#include "map/supervise.h"
#include "map/test_modules.h"

#define POINTS      IEC104_SAMPLES
#define RING        64
#define OWNER       3
#define PATIENCE_MS 600000    /* of a busy host */
#define LAST        (1 << 20) /* number that a float has exactly */
/*
 * Fixes while the reader is stopped. One of the positioning paper's four buffers (figure 5) is being filled again two fixes after it
 * was given to the reader: these fill all of them twice.
 */
#define MEANWHILE 8

static unsigned stops = 100;
static char dir[32];
static struct map *rtud;
static struct map_config config;
static struct map_module_plan modules[MAP_MODULES_MAX];
static struct map_set set = {.ca = 7001, .point_count = POINTS};
static struct map_point points[POINTS] = {
    {.type = MAP_BITSTRING, .flags = MAP_POINT_POSITION, .ioa = 200},
    {.type = MAP_ANGLE, .ioa = 1},
    {.type = MAP_ANGLE, .ioa = 2},
    {.type = MAP_FLOAT, .ioa = 3},
};
static struct iec104_station station;

/* How far both have got, and what a reader has found. */
struct findings {
	volatile uint32_t published, read, of_events, of_map, torn;
};
static struct findings *findings;

static struct map *attach(uint32_t module)
{
	char error[MAP_ERROR_SIZE];
	struct map *map;

	if (map_attach(&map, dir, modules[module].name, error) < 0)
		abort();
	map_heartbeat(map);
	return map;
}

static int begin(void **state)
{
	char error[MAP_ERROR_SIZE];

	(void)state;
	config = (struct map_config){.settings = {.event_ring = RING, .command_timeout_s = 10},
				     .set_count = 1,
				     .point_count = POINTS,
				     .sets = &set,
				     .points = points};
	plan_modules(&config, modules, NULL);
	for (uint32_t i = 0; i < config.module_count; i++)
		modules[i].heartbeat_limit_ms = PATIENCE_MS;
	strcpy(dir, "/tmp/test_map.XXXXXX");
	assert_non_null(mkdtemp(dir));
	if (map_create(&rtud, dir, &config, 0, error) < 0)
		fail_msg("%s", error);
	map_module_starting(rtud, OWNER);
	map_module_starting(rtud, 1);
	findings = mmap(NULL, sizeof(*findings), PROT_READ | PROT_WRITE, MAP_SHARED | MAP_ANONYMOUS, -1, 0);
	assert_true(findings != MAP_FAILED);
	station.config = map_config(rtud);
	return 0;
}

static int end(void **state)
{
	(void)state;
	map_remove(rtud);
	map_detach(rtud);
	munmap(findings, sizeof(*findings));
	return rmdir(dir);
}

__attribute__((noreturn)) static void publish_for_ever(void)
{
	struct map *map = attach(OWNER);

	for (int32_t i = 1;; i = i % LAST + 1) {
		const struct map_sample now = {.time_ns = map_now_ns()};
		struct map_update updates[POINTS];

		for (uint32_t point = 0; point < POINTS; point++)
			updates[point] = (struct map_update){
			    .point = point, .event_rule = MAP_EVENT_ALWAYS, .sample = now};
		updates[0].sample.value.u = (uint8_t)i;
		updates[1].sample.value.i = i;
		updates[2].sample.value.i = -i;
		updates[3].sample.value.f = (float)i;
		map_publish(map, updates, POINTS);
		map_heartbeat(map);
		findings->published++;
	}
}

static bool is_of_one_fix(const struct map_sample samples[POINTS])
{
	const int32_t number = samples[1].value.i;

	return samples[0].value.u == (uint8_t)number && samples[2].value.i == -number &&
	       (int32_t)samples[3].value.f == number;
}

static void read_map(void)
{
	struct map_sample samples[POINTS];

	if (!iec104_read_position(&station, 0, samples) || (samples[0].quality & MAP_INVALID))
		return;
	findings->read++;
	findings->torn += !is_of_one_fix(samples);
}

/* The oldest event that is left. False: there is none. */
static bool read_event(struct map_cursor *cursor)
{
	struct map_sample samples[POINTS], latest[POINTS];
	struct map_event event;

	if (!map_event_next(station.map, cursor, &event))
		return false;
	cursor->lost = 0;
	if (event.point != 0 || !iec104_complete_event(&station, cursor, &event, samples))
		return true;
	findings->of_events++;
	findings->torn += !is_of_one_fix(samples);
	findings->of_map += map_events_behind(station.map, cursor) < POINTS - 1 &&
			    iec104_read_position(&station, 0, latest) &&
			    latest[0].time_ns == event.sample.time_ns;
	return true;
}

static pid_t started(void (*process)(void))
{
	const pid_t child = fork();

	if (child == 0)
		process();
	assert_true(child > 0);
	return child;
}

/* When it has got on since, by a while that is another one each time. */
static void stop(pid_t child, volatile const uint32_t *progress, unsigned round)
{
	const uint32_t before = *progress;
	int64_t until;
	int status;

	while (*progress == before)
		sched_yield();
	until = map_now_ns() + round * 7919 % 40000;
	while (map_now_ns() < until)
		;
	kill(child, SIGSTOP);
	assert_int_equal(waitpid(child, &status, WUNTRACED), child);
	assert_true(WIFSTOPPED(status));
}

static void finish(pid_t child)
{
	kill(child, SIGKILL);
	waitpid(child, NULL, 0);
}

static void test_its_owner_is_stopped(void **state)
{
	const pid_t writer = started(publish_for_ever);
	struct map_cursor cursor;

	(void)state;
	station.map = attach(1);
	map_cursor_to_end(station.map, &cursor);
	for (unsigned round = 0; round < stops; round++) {
		stop(writer, &findings->published, round);
		read_map();
		while (read_event(&cursor))
			;
		kill(writer, SIGCONT);
	}
	finish(writer);
	map_detach(station.map);
	assert_int_equal(findings->torn, 0);
	assert_true(findings->read == stops && findings->of_events > stops / 2);
	printf("%u read, %u events, %u of them by the map\n", findings->read, findings->of_events,
	       findings->of_map);
}

__attribute__((noreturn)) static void read_for_ever(void)
{
	struct map_cursor cursor;

	station.map = attach(1);
	map_cursor_to_end(station.map, &cursor);
	for (;;) {
		read_map();
		read_event(&cursor);
	}
}

static void test_its_reader_is_stopped(void **state)
{
	const pid_t writer = started(publish_for_ever), reader = started(read_for_ever);

	(void)state;
	for (unsigned round = 0; round < stops; round++) {
		uint32_t before;

		stop(reader, &findings->read, round);
		before = findings->published;
		while (findings->published - before < MEANWHILE)
			sched_yield();
		kill(reader, SIGCONT);
	}
	finish(reader);
	finish(writer);
	assert_int_equal(findings->torn, 0);
	assert_true(findings->read > stops / 2 && findings->of_events > 0);
	printf("%u read, %u events\n", findings->read, findings->of_events);
}

int main(int argc, char **argv)
{
	const struct CMUnitTest tests[] = {
	    cmocka_unit_test_setup_teardown(test_its_owner_is_stopped, begin, end),
	    cmocka_unit_test_setup_teardown(test_its_reader_is_stopped, begin, end),
	};

	if (argc > 1)
		stops = (unsigned)strtoul(argv[1], NULL, 10);
	return cmocka_run_group_tests(tests, NULL, NULL);
}
