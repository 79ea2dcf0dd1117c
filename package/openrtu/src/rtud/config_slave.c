/* SPDX-License-Identifier: GPL-3.0-or-later */
/* One slave of a port, and the device it becomes. */
#include "rtud/config_parts.h"

#define UNIT_BROADCAST 0
#define CA_PER_PORT    1000

const char *const config_table_names[CONFIG_TABLES] = {
    [MAP_COILS] = "coils",
    [MAP_DISCRETE_INPUTS] = "discrete_inputs",
    [MAP_INPUT_REGISTERS] = "input_registers",
    [MAP_HOLDING_REGISTERS] = "holding_registers",
};

/* A slave's tables come first, so that enum map_table indexes them. */
enum {
	SLAVE_ID = CONFIG_TABLES,
	SLAVE_DESCRIPTION,
	SLAVE_RESPONSE_TIMEOUT,
	SLAVE_RESPONSE_TIMEOUT_MIN,
	SLAVE_RETRIES,
	SLAVE_PERIOD,
	SLAVE_KEYS
};
static const struct config_rule slave_rules[SLAVE_KEYS] = {
    [MAP_COILS] = {"coils", CONFIG_ARRAY, .high = CONFIG_POINTS_MAX},
    [MAP_DISCRETE_INPUTS] = {"discrete_inputs", CONFIG_ARRAY, .high = CONFIG_POINTS_MAX},
    [MAP_INPUT_REGISTERS] = {"input_registers", CONFIG_ARRAY, .high = CONFIG_POINTS_MAX},
    [MAP_HOLDING_REGISTERS] = {"holding_registers", CONFIG_ARRAY, .high = CONFIG_POINTS_MAX},
    [SLAVE_ID] = {"id", CONFIG_INTEGER, .required = true, .low = UNIT_BROADCAST, .high = CONFIG_UNIT_MAX},
    [SLAVE_DESCRIPTION] = {"description", CONFIG_TEXT, .low = 0, .high = MAP_NAME_SIZE - 1},
    [SLAVE_RESPONSE_TIMEOUT] = {"response_timeout_ms", CONFIG_INTEGER, .low = 20, .high = 10000,
				.fallback = 500},
    [SLAVE_RESPONSE_TIMEOUT_MIN] = {"response_timeout_min_ms", CONFIG_INTEGER, .low = 10, .high = 10000,
				    .fallback = 100},
    [SLAVE_RETRIES] = {"retries", CONFIG_INTEGER, .low = 0, .high = 5, .fallback = 1},
    [SLAVE_PERIOD] = {"period_ms", CONFIG_INTEGER, .low = 10, .high = 60000},
};

static void check_broadcast(struct config_loader *loader, const struct config_place *slave,
			    const struct config_value *values)
{
	const struct config_place period = config_key_of(slave, slave_rules[SLAVE_PERIOD].name);

	for (size_t table = 0; table < CONFIG_TABLES; table++) {
		const struct config_place here = config_key_of(slave, config_table_names[table]);

		if (!config_is_writable((enum map_table)table) && json_array_size(values[table].json) > 0)
			config_error(&loader->report, &here,
				     "slave 0 is the broadcast address, which is never read, expected only "
				     "coils and holding_registers");
	}
	if (values[SLAVE_PERIOD].given)
		config_error(&loader->report, &period,
			     "has no meaning for slave 0: the broadcast address is never read");
}

/* The floor of a time-out, which is the ceiling where that is lower than the default. */
static uint16_t least_timeout_ms(struct config_loader *loader, const struct config_place *slave,
				 const struct config_value *values)
{
	const struct config_place here = config_key_of(slave, slave_rules[SLAVE_RESPONSE_TIMEOUT_MIN].name);
	int64_t least_ms = values[SLAVE_RESPONSE_TIMEOUT_MIN].integer;
	int64_t whole_ms = values[SLAVE_RESPONSE_TIMEOUT].integer;

	if (least_ms <= whole_ms)
		return (uint16_t)least_ms;
	if (values[SLAVE_RESPONSE_TIMEOUT_MIN].given)
		config_error(&loader->report, &here, "%lld is above response_timeout_ms, %lld",
			     (long long)least_ms, (long long)whole_ms);
	return (uint16_t)whole_ms;
}

static void add_device(struct config_loader *loader, const struct config_place *place,
		       const struct config_value *values)
{
	struct map_config *config = loader->config;
	struct map_line *line = &config->lines[config->line_count - 1];
	struct map_device *device = &config->devices[config->device_count++];
	uint8_t unit = (uint8_t)values[SLAVE_ID].integer;

	*device = (struct map_device){
	    .line = (uint16_t)(config->line_count - 1),
	    .ca = (uint16_t)(CA_PER_PORT * line->port + unit),
	    .unit = unit,
	    .retries = (uint8_t)values[SLAVE_RETRIES].integer,
	    .response_timeout_ms = (uint16_t)values[SLAVE_RESPONSE_TIMEOUT].integer,
	    .response_timeout_min_ms = least_timeout_ms(loader, place, values),
	    .first_point = config->point_count,
	};
	if (values[SLAVE_DESCRIPTION].given && values[SLAVE_DESCRIPTION].text[0] != '\0')
		snprintf(device->name, sizeof(device->name), "%s", values[SLAVE_DESCRIPTION].text);
	else
		snprintf(device->name, sizeof(device->name), "p%u.%u", line->port, unit);
	line->device_count++;
}

/* slave_of[id]: 1 + index of the slave of this port that has the id */
static void claim_unit(struct config_loader *loader, const struct config_place *slave, int64_t unit,
		       size_t slave_of[CONFIG_UNIT_MAX + 1])
{
	const struct config_place here = config_key_of(slave, slave_rules[SLAVE_ID].name);

	if (slave_of[unit] != 0)
		config_error(&loader->report, &here, "%lld is already the id of slaves[%zu] of this port",
			     (long long)unit, slave_of[unit] - 1);
	else
		slave_of[unit] = slave->index + 1;
}

static void read_slave(struct config_loader *loader, const struct config_place *place, const json_t *json,
		       struct config_entry entry, size_t slave_of[CONFIG_UNIT_MAX + 1])
{
	struct config_value values[SLAVE_KEYS];
	struct map_device *device;

	config_read_keys(&loader->report, place, json, slave_rules, SLAVE_KEYS, values);
	if (values[SLAVE_ID].given) {
		claim_unit(loader, place, values[SLAVE_ID].integer, slave_of);
		if (values[SLAVE_ID].integer == UNIT_BROADCAST)
			check_broadcast(loader, place, values);
	}
	add_device(loader, place, values);
	entry.period_ms = (uint16_t)values[SLAVE_PERIOD].integer;
	device = &loader->config->devices[loader->config->device_count - 1];
	for (size_t table = 0; table < CONFIG_TABLES; table++)
		config_read_objects(loader, place, values[table].json, (enum map_table)table, entry);
	device->point_count = loader->config->point_count - device->first_point;
}

void config_read_slaves(struct config_loader *loader, const struct config_place *port, const json_t *slaves)
{
	const struct config_place array = config_key_of(port, CONFIG_KEY_SLAVES);
	size_t slave_of[CONFIG_UNIT_MAX + 1] = {0};
	const json_t *json;
	size_t i;

	json_array_foreach(slaves, i, json)
	{
		const struct config_place place = config_element_of(&array, i);

		read_slave(loader, &place, json,
			   (struct config_entry){.port = (uint32_t)port->index, .slave = (uint32_t)i},
			   slave_of);
	}
}
