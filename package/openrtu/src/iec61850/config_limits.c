/* SPDX-License-Identifier: GPL-3.0-or-later */
/* "limits": of measured values, for their range. */
#include <float.h>
#include <stdlib.h>

#include "config/names.h"
#include "iec61850/config.h"
#include "iec61850/config_part.h"
#include "map/limits.h"
#include "map/map.h"

enum { POINT, HIGH_HIGH, HIGH, LOW, LOW_LOW, KEYS };
static const struct config_rule rules[KEYS] = {
    [POINT] = {"point", CONFIG_TEXT, .required = true, .low = 1, .high = MAP_NAME_SIZE - 1,
	       CONFIG_SAYS("Name of a point that is an MV.", .json = CONFIG_JSON({"examples" : ["speed"]}))},
    [HIGH_HIGH] = {"high_high", CONFIG_NUMBER, .required = true, .low = -FLT_MAX, .high = FLT_MAX,
		   CONFIG_SAYS(
		       "Above it the range is high-high; in the unit of the value sent, as the others.",
		       .json = CONFIG_JSON({"examples" : [95]}))},
    [HIGH] = {"high", CONFIG_NUMBER, .required = true, .low = -FLT_MAX, .high = FLT_MAX,
	      CONFIG_SAYS("Above it the range is high; at most high_high.",
			  .json = CONFIG_JSON({"examples" : [90]}))},
    [LOW] = {"low", CONFIG_NUMBER, .required = true, .low = -FLT_MAX, .high = FLT_MAX,
	     CONFIG_SAYS("Below it the range is low; less than high.",
			 .json = CONFIG_JSON({"examples" : [10]}))},
    [LOW_LOW] = {"low_low", CONFIG_NUMBER, .required = true, .low = -FLT_MAX, .high = FLT_MAX,
		 CONFIG_SAYS("Below it the range is low-low; at most low.",
			     .json = CONFIG_JSON({"examples" : [5]}))},
};
CONFIG_SHARED_TABLE(iec61850_limits_table, .name = "limits", .rules = rules, .count = KEYS);

enum iec61850_cdc iec61850_configured_cdc(const struct map_config *config, uint32_t point)
{
	const struct iec61850_assignment *assigned = iec61850_assigned_to(config, point);
	const struct iec61850_data data = assigned == NULL
					      ? iec61850_default_data(&config->points[point])
					      : iec61850_ln_classes[assigned->class].data[assigned->data];

	return iec61850_cdc_of(&data, &config->points[point]);
}

/* MAP_NONE: it is none that can have limits, which is reported. */
static uint32_t read_point(struct config_loader *loader, const struct config_place *place, const char *name)
{
	const struct config_place here = config_key_of(place, rules[POINT].name);
	const uint32_t point = config_index_name(&loader->index, loader->config, name);
	enum iec61850_cdc cdc;

	if (point == MAP_NONE) {
		config_error(&loader->report, &here, "\"%s\" is the name of no point", name);
		return MAP_NONE;
	}
	cdc = iec61850_configured_cdc(loader->config, point);
	if (cdc == IEC61850_MV)
		return point;
	if (cdc == IEC61850_MV_RANGE)
		config_error(&loader->report, &here, "\"%s\" has limits already", name);
	else
		config_error(&loader->report, &here, "\"%s\" is %s, expected MV: a measured value", name,
			     iec61850_cdc_names[cdc]);
	return MAP_NONE;
}

/* False: they are wrong, which is reported. */
static bool read_limits(struct config_loader *loader, const struct config_place *place, const json_t *json,
			struct map_limits *out)
{
	const unsigned errors = loader->report.errors;
	struct config_value values[KEYS];

	config_read_keys(&loader->report, place, json, rules, KEYS, values);
	if (loader->report.errors != errors)
		return false;
	*out = (struct map_limits){.point = read_point(loader, place, values[POINT].text),
				   .high_high = (float)values[HIGH_HIGH].number,
				   .high = (float)values[HIGH].number,
				   .low = (float)values[LOW].number,
				   .low_low = (float)values[LOW_LOW].number};
	if (out->high_high < out->high || out->high <= out->low || out->low < out->low_low)
		config_error(&loader->report, place,
			     "expected high_high >= high > low >= low_low, has %g, %g, %g, %g",
			     values[HIGH_HIGH].number, values[HIGH].number, values[LOW].number,
			     values[LOW_LOW].number);
	return loader->report.errors == errors;
}

static int by_point(const void *a, const void *b)
{
	const struct map_limits *one = a, *other = b;

	return (one->point > other->point) - (one->point < other->point);
}

bool iec61850_take_limits(struct config_loader *loader, const struct config_place *place, const json_t *array)
{
	const size_t size = json_array_size(array);
	struct map_limits *limits;
	uint32_t count = 0;

	if (size == 0)
		return true;
	limits = config_allocate((uint32_t)size, sizeof(*limits));
	if (limits == NULL || !config_index_renew(&loader->index, loader->config)) {
		free(limits);
		return false;
	}
	for (size_t i = 0; i < size; i++) {
		const struct config_place here = config_element_of(place, i);

		if (read_limits(loader, &here, json_array_get(array, i), &limits[count]))
			loader->config->points[limits[count++].point].flags |= MAP_POINT_LIMITS;
	}
	qsort(limits, count, sizeof(*limits), by_point);
	map_add_section(loader->config, MAP_LIMITS, sizeof(*limits), count, limits);
	return true;
}
