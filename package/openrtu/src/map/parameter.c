/* SPDX-License-Identifier: GPL-3.0-or-later */
/* Parameters of measured values: loaded by a requester, in force at the owner. */
#include <math.h>

#include "map/layout.h"
#include "map/time_ns.h"

static const double TENTHS_PER_S = 10;

/* Its time constant comes as a number of seconds, else as whole tenths. */
static bool sent_as_float(const struct map_point *object)
{
	return object->type == MAP_FLOAT || object->type == MAP_ANGLE;
}

static bool has_parameters(const struct map *map, uint32_t point)
{
	return is_measured(&map->config.points[point]);
}

static struct parameter_cell *cell_of(const struct map *map, uint32_t point)
{
	return &map->segments[map_owner(map, point)].parameters[map->config.points[point].extra];
}

static double loaded(const struct map *map, uint32_t point, enum map_parameter kind, double otherwise)
{
	struct parameter_cell *cell = cell_of(map, point);
	union map_value value;

	if (!(atomic_load(&cell->state) & 1u << kind))
		return otherwise;
	value.u = atomic_load(&cell->values[kind - 1]);
	return map_number((enum map_type)map->config.points[point].type, value);
}

void map_parameters_read(const struct map *map, uint32_t point, struct map_parameters *out)
{
	const struct map_point *object = &map->config.points[point];
	double unit = sent_as_float(object) ? 1 : TENTHS_PER_S;

	*out = (struct map_parameters){.threshold = object->deadband,
				       .low = -INFINITY,
				       .high = INFINITY,
				       .cyclic = object->send_period_ms != 0};
	if (!has_parameters(map, point))
		return;
	out->loaded = atomic_load(&cell_of(map, point)->state);
	if (out->loaded == 0)
		return;
	out->threshold = loaded(map, point, MAP_THRESHOLD, object->deadband);
	out->smoothing_s = loaded(map, point, MAP_SMOOTHING, 0) / unit;
	out->low = loaded(map, point, MAP_LOW_LIMIT, -INFINITY);
	out->high = loaded(map, point, MAP_HIGH_LIMIT, INFINITY);
	if (out->loaded & 1u << MAP_CYCLIC)
		out->cyclic = false;
	for (enum map_parameter kind = MAP_THRESHOLD; kind < MAP_CYCLIC; kind++)
		out->values[kind - 1].u = atomic_load(&cell_of(map, point)->values[kind - 1]);
}

/* ---- owner ------------------------------------------------------------------------------- */

static bool is_sane(const struct map *map, const struct map_request *request)
{
	double value = map_number((enum map_type)map->config.points[request->point].type, request->value);
	struct map_parameters now;

	map_parameters_read(map, request->point, &now);
	switch (request->detail) {
	case MAP_THRESHOLD:
	case MAP_SMOOTHING:
		return isfinite(value) && value >= 0;
	case MAP_LOW_LIMIT:
		return isfinite(value) && value <= now.high;
	case MAP_HIGH_LIMIT:
		return isfinite(value) && value >= now.low;
	case MAP_CYCLIC:
		return request->value.u <= 1 && map->config.points[request->point].send_period_ms != 0;
	default:
		return false;
	}
}

bool parameter_load(struct map *map, const struct map_request *request)
{
	struct parameter_cell *cell;

	if (!has_parameters(map, request->point) || !is_sane(map, request))
		return false;
	cell = cell_of(map, request->point);
	if (request->detail == MAP_CYCLIC && request->value.u == 1) {
		atomic_fetch_and(&cell->state, ~(1u << MAP_CYCLIC));
		return true;
	}
	if (request->detail != MAP_CYCLIC)
		atomic_store(&cell->values[request->detail - 1], request->value.u);
	atomic_fetch_or(&cell->state, 1u << request->detail);
	return true;
}

/* Of a value that is blocked or substituted the filter goes on: it is what the source says. */
static bool is_smoothable(const struct map_sample *sample)
{
	return (sample->quality & (MAP_INVALID | MAP_NOT_TOPICAL | MAP_OVERFLOW)) == 0;
}

static struct smoothed last_published(const struct map *map, uint32_t point)
{
	struct map_sample last = map_own_sample(map, point);
	enum map_type type = (enum map_type)map->config.points[point].type;

	return (struct smoothed){map_number(type, last.value), is_smoothable(&last) ? last.time_ns : 0};
}

/* y += (x - y) * dt / (T + dt): a first-order filter at whatever pace the source is read. */
void parameter_smooth(struct map *map, uint32_t point, struct map_sample *sample)
{
	const struct map_point *object = &map->config.points[point];
	struct parameter_cell *cell = &map->segments[map->self].parameters[object->extra];
	struct smoothed *smoothed = &map->smoothed[object->slot];
	enum map_type type = (enum map_type)object->type;
	struct map_parameters parameters;
	double value, passed_s;

	if (!(atomic_load(&cell->state) & 1u << MAP_SMOOTHING) || !is_smoothable(sample)) {
		smoothed->time_ns = 0;
		return;
	}
	map_parameters_read(map, point, &parameters);
	if (smoothed->time_ns == 0)
		*smoothed = last_published(map, point);
	value = map_number(type, sample->value);
	if (parameters.smoothing_s <= 0 || smoothed->time_ns == 0) {
		*smoothed = (struct smoothed){value, sample->time_ns};
		return;
	}
	passed_s = (double)(sample->time_ns - smoothed->time_ns) / NS_PER_S;
	smoothed->value += (value - smoothed->value) * passed_s / (parameters.smoothing_s + passed_s);
	smoothed->time_ns = sample->time_ns;
	map_value_of(type, smoothed->value, &sample->value);
}

/* -1 below the low limit, 1 above the high one; a value that is not a number is at neither side. */
static int side(const struct map_parameters *parameters, double value)
{
	return (value > parameters->high) - (value < parameters->low);
}

bool parameters_crossed(const struct map_parameters *parameters, enum map_type type, union map_value from,
			union map_value to)
{
	return side(parameters, map_number(type, from)) != side(parameters, map_number(type, to));
}
