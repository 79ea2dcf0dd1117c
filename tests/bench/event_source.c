/* SPDX-License-Identifier: GPL-3.0-or-later */
/*
 * Stands in the place of rtu-modbus, so that no line bounds how fast values change: all points are good at once. A
 * set-point for a register, in tens a second, makes events at that rate for a second, EVENTS_MAX at most. They
 * count the input registers upwards, one after the other; those of a device that are due are published together.
 */
#include <getopt.h>
#include <poll.h>
#include <signal.h>
#include <stdio.h>
#include <stdlib.h>
#include <sys/prctl.h>

#include "map/map.h"
#include "modbus/config.h"

#define EVENTS_MAX    100000
#define PERIOD_MS     1 /* between two looks at the clock */
#define NS_PER_S      1000000000LL
#define BATCH_MAX     256
#define REGISTERS_MAX 8192

static struct map *map;
static const struct map_config *config;
static uint32_t registers[REGISTERS_MAX], register_count;
static uint32_t wanted, made, rate; /* events of this run, so far, a second */
static uint32_t runs; /* each begins at another register, so that none is given the value that it has */
static int64_t begun_ns;
static struct map_update updates[BATCH_MAX];

static void publish_all(void)
{
	for (uint32_t i = 0; i < config->point_count; i++) {
		struct map_update update = {.point = i, .sample.time_ns = map_now_ns()};

		if (map_owner(map, i) == map_self(map))
			map_publish(map, &update, 1);
	}
}

static void find_registers(void)
{
	for (uint32_t i = 0; i < config->point_count && register_count < REGISTERS_MAX; i++)
		if (modbus_points(config)[i].table == MODBUS_INPUT_REGISTERS)
			registers[register_count++] = i;
}

static void take_requests(void)
{
	struct map_request request;

	map_bell_clear(map);
	while (map_request_next(map, &request)) {
		if (!map_command_request(map, &request))
			continue;
		map_command_finish(map, request.point, MAP_RESULT_DONE, 0);
		rate = (uint32_t)(uint16_t)request.value.i * 10;
		wanted = rate < EVENTS_MAX ? rate : EVENTS_MAX;
		made = 0;
		runs++;
		begun_ns = map_now_ns();
	}
}

static void make_events(void)
{
	int64_t now_ns = map_now_ns();
	int64_t due = (now_ns - begun_ns) * rate / NS_PER_S;

	while (made < wanted && made < due) {
		uint32_t count = 0;

		for (; made < wanted && made < due && count < BATCH_MAX; count++, made++) {
			const uint32_t point = registers[(made + runs) % register_count];

			if (count > 0 && config->points[point].set != config->points[updates[0].point].set)
				break;
			updates[count] = (struct map_update){
			    .point = point, .sample = {.value.i = (int16_t)(made + 1), .time_ns = now_ns}};
		}
		map_publish(map, updates, count);
	}
}

int main(int argc, char **argv)
{
	static const struct option options[] = {{"map", required_argument, NULL, 'm'},
						{"module", required_argument, NULL, 'n'},
						{"dev", required_argument, NULL, 'd'},
						{"filter", required_argument, NULL, 'f'},
						{0}};
	const char *directory = NULL, *module = NULL;
	char error[MAP_ERROR_SIZE];
	int option;

	while ((option = getopt_long(argc, argv, "", options, NULL)) >= 0)
		*(option == 'm' ? &directory : option == 'n' ? &module : &(const char *){NULL}) = optarg;
	if (directory == NULL || module == NULL || map_attach(&map, directory, module, error) < 0)
		return EXIT_FAILURE;
	prctl(PR_SET_NAME, module);
	signal(SIGTERM, SIG_DFL);
	config = map_config(map);
	find_registers();
	if (register_count < BATCH_MAX)
		return EXIT_FAILURE;
	publish_all();
	while (map_may_run(map)) {
		struct pollfd bell = {.fd = map_bell_fd(map), .events = POLLIN};

		map_heartbeat(map);
		if (poll(&bell, 1, made < wanted ? PERIOD_MS : MAP_HEARTBEAT_PERIOD_MS) > 0)
			take_requests();
		make_events();
	}
	return EXIT_SUCCESS;
}
