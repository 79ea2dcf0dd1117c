/* SPDX-License-Identifier: GPL-3.0-or-later */
/*
 * libFuzzer on a module of others gone wild: it has mapped its segment, and writes into it what the input says, right requests and
 * any octets. Whoever reads that segment, an owner of points, rtud, a controlled station, sees only what the file lists, keeps
 * within the tables, and comes to an end.
 *
 * The input is a list of steps, each an octet, and the octets that it takes. Each begins with the same map.
 */
#include <stdio.h>
#include <string.h>
#include <unistd.h>

#include "fuzz/input.h"
#include "map/layout.h"
#include "map/supervise.h"
#include "map/test_modules.h"
#include "map/time_ns.h"

#define POINTS      8
#define OWNED       4 /* points of the line; the others are the wild module's own */
#define LISTED      2 /* in "listed" below */
#define STEPS       64
#define ROUNDS      300 /* of a loop that ends after a ring's worth */
#define WILD        "wild"
#define SECTION     (8 * sizeof(uint32_t))
#define SMALL_RINGS 16

enum { OWNER, STATION, OTHERS, PARTIES }; /* who has attached, beside rtud */

static const uint32_t listed[LISTED] = {1, 3};

static struct map_set sets[2];
static struct map_point points[POINTS];
static struct map_module_plan modules[MAP_MODULES_MAX];
static struct map_config config;
static char folder[] = "/tmp/fuzz_requests.XXXXXX";
static struct map *rtud, *parties[PARTIES];
static struct map_cursor cursor; /* the station's */

static void plan(void)
{
	const uint16_t processes[2] = {1, 2};
	uint32_t wild;

	config = (struct map_config){
	    .settings = {.event_ring = SMALL_RINGS, .select_timeout_s = 30, .command_timeout_s = 10},
	    .set_count = 2,
	    .point_count = POINTS,
	    .sets = sets,
	    .points = points};
	for (uint16_t i = 0; i < 2; i++)
		sets[i] = (struct map_set){.ca = i + 1, .first_point = i * OWNED, .point_count = OWNED};
	for (uint16_t i = 0; i < POINTS; i++)
		points[i] = (struct map_point){.set = i / OWNED,
					       .type = (uint8_t)(i % OWNED == 0 ? MAP_COUNTER : MAP_SCALED),
					       .flags = MAP_POINT_COMMAND,
					       .ioa = i + 1u};
	points[3].flags |= MAP_POINT_SELECT;
	plan_modules(&config, modules, processes);
	wild = sets[1].module;
	strcpy(modules[wild].name, WILD);
	modules[wild].flags |= MAP_MAY_REQUEST | MAP_REQUESTS_LISTED;
	modules[wild].rings = (struct map_rings){SMALL_RINGS, SMALL_RINGS, SMALL_RINGS, SMALL_RINGS};
	modules[wild].section_size = SECTION;
	modules[wild].listed_count = LISTED;
	map_add_section(&config, MAP_LISTED, sizeof(*listed), LISTED, (void *)(uintptr_t)listed);
}

static struct map *start(const char *name)
{
	char error[MAP_ERROR_SIZE];
	struct map *map;

	for (uint32_t i = 0; i < map_module_count(rtud); i++)
		if (strcmp(modules[i].name, name) == 0)
			map_module_starting(rtud, i);
	CHECK(map_attach(&map, folder, name, error) == 0);
	return map;
}

/* ---- the wild one ------------------------------------------------------------------------- */

static uint32_t next_word(void)
{
	uint32_t word = next_octet();

	word |= (uint32_t)next_octet() << 8;
	word |= (uint32_t)next_octet() << 16;
	return word | (uint32_t)next_octet() << 24;
}

static void write_anywhere(void)
{
	const struct segment *own = &parties[OTHERS]->segments[parties[OTHERS]->self];
	const size_t at = next_word() % own->size;
	uint8_t *octets = (uint8_t *)own->header;

	for (size_t i = at, end = at + next_octet() % 32; i < end && i < own->size; i++)
		octets[i] = next_octet();
}

static struct map_request any_request(void)
{
	const struct map *map = parties[OTHERS];
	const int64_t now_ns = map_now_ns();

	return (struct map_request){
	    .id = next_octet(),
	    .point = next_octet() % 16,
	    .generation = atomic_load(&map->directory->modules[sets[0].module].generation),
	    .requester = next_octet(),
	    .action = next_octet() % 16,
	    .detail = next_octet(),
	    .session = next_octet(),
	    .value.u = next_word(),
	    .pulse_ms = next_octet(),
	    .step = (int8_t)next_octet(),
	    .owner = (uint8_t)(next_octet() % 4 ? sets[0].module : MAP_RTUD),
	    .time_ns = now_ns,
	    .deadline_ns = now_ns + NS_PER_S,
	    .wall_ns = next_word(),
	    .ioa = next_octet() % 16,
	    .ca = next_octet() % 4,
	};
}

static void post(bool forged)
{
	struct map_request request = any_request();
	const struct segment *own = &parties[OTHERS]->segments[parties[OTHERS]->self];

	/* The library's own function believes its segment: its head is that of an honest module. */
	if (forged)
		ring_put(&own->requests, &request);
	else if (request.point < POINTS && request.action <= MAP_RELEASE)
		map_request_post(parties[OTHERS], request);
}

/* ---- who reads it ------------------------------------------------------------------------- */

static bool is_listed(uint32_t point)
{
	return point == listed[0] || point == listed[1];
}

static void serve_owner(void)
{
	struct map *map = parties[OWNER];
	struct map_request request;
	int rounds = 0;

	map_bell_clear(map);
	while (map_request_next(map, &request)) {
		CHECK(++rounds < ROUNDS);
		CHECK(request.requester == sets[1].module && request.action <= MAP_RELEASE);
		CHECK(is_listed(request.point));
		if (!map_command_request(map, &request))
			continue;
		map_command_confirm(map, request.point);
		map_command_finish(map, request.point, MAP_RESULT_DONE, 0);
	}
	map_heartbeat(map);
}

/* A module of others may ask rtud for nothing. */
static void serve_rtud(void)
{
	struct map_request request;
	struct map_log_line line;
	struct map_module module;
	struct map_counter counter;
	uint32_t position = next_word(), lost = 0;

	map_bell_clear(rtud);
	CHECK(!map_request_next(rtud, &request));
	map_module(rtud, sets[1].module, &module);
	CHECK(strcmp(module.name, WILD) == 0);
	for (int i = 0; i < SMALL_RINGS + 1 && map_log_next(rtud, sets[1].module, &position, &line, &lost);
	     i++)
		CHECK(memchr(line.text, '\0', sizeof(line.text)) != NULL && line.time_ns <= map_now_ns());
	for (uint32_t i = 0; i < modules[sets[1].module].counters + 1; i++)
		if (map_counter(rtud, sets[1].module, i, &counter))
			CHECK(memchr(counter.name, '\0', sizeof(counter.name)) != NULL);
}

static void serve_station(void)
{
	struct map *map = parties[STATION];
	struct map_command command;
	struct map_answer answer;
	struct map_sample sample;
	struct map_event event;
	int rounds = 0;

	map_bell_clear(map);
	while (map_event_next(map, &cursor, &event)) {
		CHECK(++rounds < ROUNDS);
		CHECK(event.kind != MAP_EVENT_CHANGE || event.point < POINTS);
	}
	while (map_answer_next(map, &answer))
		CHECK(++rounds < 2 * ROUNDS);
	for (uint32_t i = 0; i < POINTS; i++) {
		map_command_read(map, i, &command);
		if (map_read(map, i, &sample))
			CHECK(sample.time_ns <= map_now_ns() || (sample.quality & MAP_INVALID));
	}
}

/* ------------------------------------------------------------------------------------------ */

/* What each party has of its own, as it was before the first input: making a map takes a hundred times as long. */
static struct {
	struct map map;
	uint8_t *segment;
} former[PARTIES + 1];

static struct map *party(int i)
{
	return i < PARTIES ? parties[i] : rtud;
}

static void make(void)
{
	char error[MAP_ERROR_SIZE];

	plan();
	CHECK(mkdtemp(folder) != NULL && map_create(&rtud, folder, &config, 0, error) == 0);
	parties[OWNER] = start("rtu-modbus-1");
	parties[STATION] = start("rtu-iec104");
	parties[OTHERS] = start(WILD);
	for (int i = 0; i <= PARTIES; i++) {
		const struct segment *own = &party(i)->segments[party(i)->self];

		former[i].map = *party(i);
		former[i].segment = malloc(own->size);
		CHECK(former[i].segment != NULL);
		memcpy(former[i].segment, own->header, own->size);
	}
	map_sweep(rtud->directory_fd, NULL);
	rmdir(folder);
}

static void begin(void)
{
	if (rtud == NULL)
		make();
	cursor = (struct map_cursor){.lost = 0};
	for (int i = 0; i <= PARTIES; i++) {
		const struct segment *own = &party(i)->segments[party(i)->self];

		*party(i) = former[i].map;
		memcpy(own->header, former[i].segment, own->size);
		map_bell_clear(party(i));
		map_heartbeat(party(i));
	}
}

int LLVMFuzzerTestOneInput(const uint8_t *data, size_t size)
{
	input = (struct input){data, data + size};
	begin();
	for (int step = 0; step < STEPS && input.at < input.end; step++) {
		switch (next_octet() % 8) {
		case 0:
			write_anywhere();
			break;
		case 1:
			post(false);
			break;
		case 2:
		case 3:
			post(true);
			break;
		case 4:
			map_heartbeat(parties[OTHERS]);
			break;
		case 5:
			serve_rtud();
			break;
		case 6:
			serve_station();
			break;
		default:
			serve_owner();
		}
	}
	serve_owner();
	serve_rtud();
	serve_station();
	return 0;
}
