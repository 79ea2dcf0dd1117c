/* SPDX-License-Identifier: GPL-3.0-or-later */
/* The contract with the real map. */
#include <stdlib.h>
#include <string.h>
#include <unistd.h>

#include "iec104/test_contract.h"
#include "map/supervise.h"
#include "map/test_modules.h"

#define RING        64
#define PATIENCE_MS 600000 /* of a busy host */

static char dir[32];
static struct map *rtud, *station_map, *owners[DEVICES];
static struct map_config config;
static struct map_module_plan modules[MAP_MODULES_MAX];

static struct map *attach(uint32_t module)
{
	char error[MAP_ERROR_SIZE];
	struct map *map;

	map_module_starting(rtud, module);
	if (map_attach(&map, dir, modules[module].name, error) < 0)
		fail_msg("%s", error);
	map_heartbeat(map);
	return map;
}

struct map *contract_begin(void)
{
	char error[MAP_ERROR_SIZE];

	config = (struct map_config){.settings = {.event_ring = RING, .command_timeout_s = 10},
				     .set_count = DEVICES,
				     .point_count = POINTS,
				     .sets = devices,
				     .points = points};
	plan_modules(&config, modules, NULL);
	for (uint32_t i = 0; i < config.module_count; i++)
		modules[i].heartbeat_limit_ms = PATIENCE_MS;
	strcpy(dir, "/tmp/test_map.XXXXXX");
	assert_non_null(mkdtemp(dir));
	if (map_create(&rtud, dir, &config, 0, error) < 0)
		fail_msg("%s", error);
	for (uint32_t i = 0; i < DEVICES; i++)
		owners[i] = attach(devices[i].module);
	station_map = attach(1);
	return station_map;
}

void contract_end(void)
{
	for (uint32_t i = 0; i < DEVICES; i++)
		map_detach(owners[i]);
	map_detach(station_map);
	map_remove(rtud);
	map_detach(rtud);
	assert_int_equal(rmdir(dir), 0);
}

void contract_publish(uint32_t point, int32_t value, uint8_t quality)
{
	struct map *owner = owners[points[point].set];
	struct map_update update = {
	    .point = point, .sample = {.value.i = value, .quality = quality, .time_ns = map_now_ns()}};

	map_publish(owner, &update, 1);
}

void contract_end_owner(void)
{
	map_module_ended(rtud, devices[points[CONTRACT_POINT].set].module, true);
}

void contract_answer(uint32_t id)
{
	struct map *owner = owners[points[CONTRACT_POINT].set];
	struct map_request request;

	do
		assert_true(map_request_next(owner, &request));
	while (request.id != id);
	assert_true(map_command_request(owner, &request));
}

int64_t contract_now(void)
{
	return map_now_ns();
}
