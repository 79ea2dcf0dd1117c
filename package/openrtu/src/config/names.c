/* SPDX-License-Identifier: GPL-3.0-or-later */
#include "config/names.h"

#include <stdio.h>
#include <string.h>

void config_keep_name(struct map_config *config, struct map_point *point, const char *name)
{
	point->name = config->names_size;
	strcpy(config->names + config->names_size, name);
	config->names_size += (uint32_t)strlen(name) + 1;
}

void config_keep_unit(struct map_config *config, struct map_point *point, const char *unit)
{
	const struct map_unit *units = map_records(config, MAP_UNITS, sizeof(*units));
	const uint32_t count = map_record_count(config, MAP_UNITS);
	uint32_t i = 0;

	while (i < count && strcmp(units[i].text, unit) != 0)
		i++;
	if (i == MAP_UNITS_MAX)
		return;
	if (i == count)
		snprintf(((struct map_unit *)map_next_record(config, MAP_UNITS))->text, sizeof(units->text),
			 "%s", unit);
	point->unit = (uint8_t)(i + 1);
}

void config_check_name(struct config_report *report, const struct config_place *place, const char *name)
{
	if (strpbrk(name, " *?[]\\") != NULL)
		config_error(report, place,
			     "has a space or one of *?[]\\, which patterns use, expected "
			     "a name without them");
}
