/* SPDX-License-Identifier: GPL-3.0-or-later */
/* What all files of the configuration need. */
#include "rtud/config_parts.h"

#include <stdio.h>
#include <string.h>

const char *const config_table_names[CONFIG_TABLES] = {
    [MAP_COILS] = "coils",
    [MAP_DISCRETE_INPUTS] = "discrete_inputs",
    [MAP_INPUT_REGISTERS] = "input_registers",
    [MAP_HOLDING_REGISTERS] = "holding_registers",
};

void config_keep_name(struct map_config *config, struct map_point *point, const char *name)
{
	point->name = config->names_size;
	strcpy(config->names + config->names_size, name);
	config->names_size += (uint32_t)strlen(name) + 1;
}

void config_out_of_memory(struct config_loader *loader)
{
	fputs("out of memory\n", loader->report.messages);
	loader->report.errors++;
}
