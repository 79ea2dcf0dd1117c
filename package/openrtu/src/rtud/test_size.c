/* SPDX-License-Identifier: GPL-3.0-or-later */
/* What a station of 5 000 points takes of the board's memory, with what Modbus knows of them. */
#include <setjmp.h>
#include <stdarg.h>
#include <stddef.h>
#include <stdint.h>
#include <stdio.h>
#include <stdlib.h>
#include <unistd.h>

#include <cmocka.h>

#include "iec104/config.h"
#include "map/layout.h"
#include "map/supervise.h"
#include "modbus/config.h"
#include "rtud/kinds.h"

#define POINTS     5000u
#define SIZE_MOST  (1024u * 1024u) /* the events apart */
#define EVENT_MOST 64u

/* A measured value, which has parameters. */
static struct map_point input_register(uint32_t i)
{
	return (struct map_point){.type = MAP_SCALED, .ioa = i + 1};
}

/* As tests/bench/stations.py has them: three fifths are bits, and half can be commanded. */
static struct map_point point_of_bench(uint32_t i)
{
	return (struct map_point){
	    .type = i % 5 < 3 ? MAP_SINGLE : MAP_SCALED,
	    .flags = i % 2 ? MAP_POINT_COMMAND : 0,
	    .ioa = i + 1,
	};
}

static size_t size_without_events(const struct map *map)
{
	size_t size = 0;

	for (uint32_t i = 0; i < map_module_count(map); i++)
		size += map->segments[i].size -
			(size_t)map->segments[i].events.capacity * sizeof(struct map_event);
	return size;
}

/* A map with such points of one device is made and removed. */
static size_t size_of_map(struct map_point (*point_of)(uint32_t i), uint32_t event_ring)
{
	static struct map_point points[POINTS];
	static struct modbus_point wire[POINTS];
	struct modbus_port port = {.port = 1, .process = 1, .device_count = 1};
	struct modbus_slave slave = {.unit = 1};
	struct modbus_settings modbus = {.priority = 45};
	struct iec104_settings iec104 = {.port = 2404};
	struct map_set set = {.ca = 1001, .point_count = POINTS};
	struct map_module_plan modules[MAP_MODULES_MAX];
	struct map_config config = {
	    .settings.event_ring = event_ring,
	    .set_count = 1,
	    .point_count = POINTS,
	    .sets = &set,
	    .points = points,
	};
	char dir[] = "/tmp/test_map.XXXXXX", error[MAP_ERROR_SIZE];
	struct map *map;
	size_t size;

	for (uint32_t i = 0; i < POINTS; i++)
		points[i] = point_of(i);
	assert_non_null(mkdtemp(dir));
	config.modules = modules;
	map_add_section(&config, MODBUS_PORTS, sizeof(port), 1, &port);
	map_add_section(&config, MODBUS_SLAVES, sizeof(slave), 1, &slave);
	map_add_section(&config, MODBUS_POINTS, sizeof(wire[0]), POINTS, wire);
	map_add_section(&config, MODBUS_SETTINGS, sizeof(modbus), 1, &modbus);
	map_add_section(&config, IEC104_SETTINGS, sizeof(iec104), 1, &iec104);
	assert_true(kinds_plan(&config));
	if (map_create(&map, dir, &config, 0, error) < 0)
		fail_msg("%s", error);
	size = size_without_events(map);
	map_remove(map);
	map_detach(map);
	assert_int_equal(rmdir(dir), 0);
	return size;
}

static void test_map_of_5000_points(void **state)
{
	const struct {
		const char *what;
		size_t size;
	} maps[] = {
	    {"5 000 registers, none can be commanded", size_of_map(input_register, 64)},
	    {"5 000 points of the bench, half can be commanded", size_of_map(point_of_bench, 64)},
	};

	(void)state;
	for (size_t i = 0; i < sizeof(maps) / sizeof(maps[0]); i++) {
		print_message("%s: %zu octets without events\n", maps[i].what, maps[i].size);
		assert_true(maps[i].size <= SIZE_MOST);
	}
}

/* A queue of a controlling station is a place in the ring, so that an event takes no more for many of them. */
static void test_event(void **state)
{
	(void)state;
	print_message("an event: %zu octets\n", sizeof(struct map_event));
	assert_true(sizeof(struct map_event) <= EVENT_MOST);
	assert_int_equal(size_of_map(input_register, 64), size_of_map(input_register, 16384));
}

int main(void)
{
	const struct CMUnitTest tests[] = {
	    cmocka_unit_test(test_map_of_5000_points),
	    cmocka_unit_test(test_event),
	};

	return cmocka_run_group_tests(tests, NULL, NULL);
}
