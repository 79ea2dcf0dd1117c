/* SPDX-License-Identifier: GPL-3.0-or-later */
#include "rtud/force.h"

#include "map/supervise.h"
#include "map/time_ns.h"

static const char *name_of(const struct map *map, uint32_t point, char name[MAP_NAME_SIZE])
{
	map_point_name(map_config(map), &map_config(map)->points[point], name);
	return name;
}

/* A module gone wild may ask for anything. */
static bool may_force(const struct map *map, const struct map_request *request)
{
	const struct map_config *config = map_config(map);
	struct map_module requester;

	map_module(map, request->requester, &requester);
	return (requester.flags & MAP_IS_LOCAL) && request->session == map_epoch(map) &&
	       request->point < config->point_count && config->settings.force_max_s != 0 &&
	       request->hold_ms >= 0 &&
	       request->hold_ms <= (int64_t)config->settings.force_max_s * MS_PER_S &&
	       map_unforceable(config, request->point) == NULL;
}

static enum map_command_result begin(struct map *map, const struct map_request *request)
{
	const int64_t now_ns = map_now_ns();
	const struct map_force force = {.point = request->point,
					.value = request->value,
					.since_ns = now_ns,
					.until_ns = now_ns + request->hold_ms * NS_PER_MS};
	char name[MAP_NAME_SIZE];

	if (!map_force(map, &force))
		return MAP_RESULT_OUT_OF_RANGE;
	map_log(map, MAP_LOG_WARNING, "%s is forced by rtuctl for %lld s", name_of(map, request->point, name),
		(long long)(request->hold_ms / MS_PER_S));
	return MAP_RESULT_DONE;
}

static enum map_command_result end(struct map *map, uint32_t point)
{
	char name[MAP_NAME_SIZE];

	if (!map_unforce(map, point))
		return MAP_RESULT_NOT_SELECTED;
	map_log(map, MAP_LOG_WARNING, "%s is no longer forced: rtuctl asked", name_of(map, point, name));
	return MAP_RESULT_DONE;
}

void force_take(struct map *map, const struct map_request *request)
{
	enum map_command_result result = MAP_RESULT_NOT_COMMANDABLE;

	if (may_force(map, request))
		result = request->hold_ms != 0 ? begin(map, request) : end(map, request->point);
	map_request_answer(map, request, result);
}

void force_tick(struct map *map)
{
	struct map_force forces[MAP_FORCES_MAX];
	const unsigned count = map_forces(map, forces);
	const int64_t now_ns = map_now_ns();
	/* Another one than when it began, if a reload has changed it. */
	const int64_t longest_ns = map_config(map)->settings.force_max_s * NS_PER_S;
	char name[MAP_NAME_SIZE];

	for (unsigned i = 0; i < count; i++)
		if ((now_ns >= forces[i].until_ns || now_ns >= forces[i].since_ns + longest_ns) &&
		    map_unforce(map, forces[i].point))
			map_log(map, MAP_LOG_WARNING, "%s is no longer forced: its time is over",
				name_of(map, forces[i].point, name));
}
