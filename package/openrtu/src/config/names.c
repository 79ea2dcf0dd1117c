/* SPDX-License-Identifier: GPL-3.0-or-later */
#include "config/names.h"

#include <string.h>

void config_keep_name(struct map_config *config, struct map_point *point, const char *name)
{
	point->name = config->names_size;
	strcpy(config->names + config->names_size, name);
	config->names_size += (uint32_t)strlen(name) + 1;
}

void config_check_name(struct config_report *report, const struct config_place *place, const char *name)
{
	if (strpbrk(name, " *?[]\\") != NULL)
		config_error(report, place,
			     "has a space or one of *?[]\\, which patterns use, expected "
			     "a name without them");
}
