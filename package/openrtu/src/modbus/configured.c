/* SPDX-License-Identifier: GPL-3.0-or-later */
#include "configured.h"

#include <stdlib.h>

#include "map/time_ns.h"

unsigned modbus_bits_per_char(const struct modbus_port *line)
{
	return 1u + line->data_bits + (line->parity != MODBUS_PARITY_NONE) + line->stop_bits;
}

struct modbus_wire modbus_wire_of(const struct modbus_port *line)
{
	const unsigned bits = modbus_bits_per_char(line);
	struct modbus_wire wire = modbus_is_udp(line)   ? modbus_wire_udp()
				  : modbus_is_tcp(line) ? modbus_wire_tcp((enum modbus_framing)line->framing)
				  : line->framing == MODBUS_FRAMING_ASCII
				      ? modbus_wire_ascii(line->baud, bits)
				      : modbus_wire(line->baud, bits);

	if (line->rs485 != MODBUS_RS485_NONE)
		wire.before_ns = line->before_ms * NS_PER_MS;
	return wire;
}

struct modbus_limits modbus_limits_of(const struct modbus_slave *slave)
{
	return (struct modbus_limits){.bits = slave->max_bits,
				      .registers = slave->max_registers,
				      .no_holes = slave->no_holes,
				      .reaction_ns = slave->reaction_us * NS_PER_US};
}

const struct modbus_pass *modbus_pass_of(const struct map_config *config, uint16_t process)
{
	const struct modbus_pass *passes = modbus_passes(config);

	for (uint32_t i = 0; i < map_record_count(config, MODBUS_PASSES); i++)
		if (modbus_ports(config)[passes[i].port].process == process)
			return &passes[i];
	return NULL;
}

/* An array of at least one element, so that NULL means no memory. */
static void *allocate(size_t count, size_t size)
{
	return calloc(count > 0 ? count : 1, size);
}

uint8_t modbus_read_function(enum modbus_table table)
{
	switch (table) {
	case MODBUS_COILS:
		return MODBUS_READ_COILS;
	case MODBUS_DISCRETE_INPUTS:
		return MODBUS_READ_DISCRETE_INPUTS;
	case MODBUS_INPUT_REGISTERS:
		return MODBUS_READ_INPUT_REGISTERS;
	case MODBUS_HOLDING_REGISTERS:
		break;
	}
	return MODBUS_READ_HOLDING_REGISTERS;
}

/* Two bits, or a value and its scale register, are read with what lies between: only in one answer they belong together. */
static struct modbus_object object_of(const struct modbus_point *point, uint32_t number)
{
	const struct modbus_extent extent = modbus_extent_of(point);

	return (struct modbus_object){.tag = number,
				      .address = (uint16_t)extent.first,
				      .function = modbus_read_function((enum modbus_table)point->table) & 15u,
				      .width = (extent.last - extent.first + 1) & 0xFFFu,
				      .period_ms = point->scan_period_ms};
}

/* The points of the set that the gateway itself writes, once each. */
static bool begins(const struct modbus_keep *keeps, uint32_t i, const struct map_set *set)
{
	return keeps[i].point >= set->first_point && keeps[i].point < set->first_point + set->point_count &&
	       (i == 0 || keeps[i - 1].point != keeps[i].point);
}

/* Its constants have no values yet: whoever writes makes them. */
static bool configure_constants(const struct map_config *config, struct modbus_kept *kept)
{
	const struct modbus_keep *first;
	const uint32_t count = modbus_keeps_of(config, kept->tag, &first);

	kept->period_ns = first->period_ms * NS_PER_MS;
	if (!first->has_value)
		return true;
	kept->constants = calloc(count, sizeof(*kept->constants));
	kept->constant_count = count;
	return kept->constants != NULL;
}

static bool configure_kept(const struct map_config *config, const struct map_set *set,
			   struct modbus_device *device)
{
	const struct modbus_keep *keeps = modbus_keeps(config);
	const uint32_t records = map_record_count(config, MODBUS_KEEPS);
	uint32_t count = 0;

	for (uint32_t i = 0; i < records; i++)
		count += begins(keeps, i, set);
	if (count == 0)
		return true;
	device->kept = calloc(count, sizeof(*device->kept));
	if (device->kept == NULL)
		return false;
	for (uint32_t i = 0; i < records; i++) {
		if (!begins(keeps, i, set))
			continue;
		device->kept[device->kept_count].tag = keeps[i].point;
		if (!configure_constants(config, &device->kept[device->kept_count++]))
			return false;
	}
	return true;
}

/* The place of a page among the device's, and 1. */
static uint8_t place_of_page(struct modbus_pages *pages, uint16_t value)
{
	uint8_t place = 0;

	while (place < pages->count && pages->values[place] != value)
		place++;
	if (place == pages->count)
		pages->values[pages->count++] = value;
	return (uint8_t)(place + 1);
}

/* There are no more than fit: check_pages of config_slave.c. */
static bool configure_pages(const struct map_config *config, uint16_t address, struct modbus_device *device)
{
	for (uint32_t i = 0; i < device->object_count; i++) {
		const struct modbus_extra *extra =
		    modbus_extra_of(config, &modbus_points(config)[device->objects[i].tag]);

		if (extra == NULL || !extra->is_paged)
			continue;
		if (device->pages == NULL)
			device->pages = calloc(1, sizeof(*device->pages));
		if (device->pages == NULL)
			return false;
		device->pages->address = address;
		device->objects[i].page = place_of_page(device->pages, extra->page) & 31u;
	}
	return true;
}

static bool configure_device(const struct map_config *config, uint32_t slave, struct modbus_device *device)
{
	const struct modbus_slave *from = &modbus_slaves(config)[slave];
	const struct map_set *set = &config->sets[slave];

	*device = (struct modbus_device){
	    .unit = from->unit,
	    .retries = from->retries,
	    .limits = modbus_limits_of(from),
	    .response_timeout_ns = from->response_timeout_ms * NS_PER_MS,
	    .response_timeout_min_ns = from->response_timeout_min_ms * NS_PER_MS,
	    .probe_max_ns = from->probe_max_s * NS_PER_S,
	    .pause_ns = from->pause_ms * NS_PER_MS,
	    .writes_multiple = from->writes_multiple,
	    .objects = allocate(set->point_count, sizeof(*device->objects)),
	    .reads = allocate(set->point_count, sizeof(*device->reads)),
	};
	if (device->objects == NULL || device->reads == NULL)
		return false;
	for (uint32_t i = 0; i < set->point_count; i++) {
		const uint32_t number = set->first_point + i;

		if (!(config->points[number].flags & MAP_POINT_NEVER_READ))
			device->objects[device->object_count++] =
			    object_of(&modbus_points(config)[number], number);
	}
	if (modbus_is_asked(config, slave)) {
		device->identity = calloc(1, sizeof(*device->identity));
		if (device->identity == NULL)
			return false;
	}
	return configure_pages(config, from->page_address, device) && configure_kept(config, set, device);
}

static uint32_t commands_of_device(const struct map_config *config, const struct map_set *device)
{
	uint32_t count = 0;

	for (uint32_t i = 0; i < device->point_count; i++)
		count += (config->points[device->first_point + i].flags & MAP_POINT_COMMAND) != 0;
	return count;
}

/* A point has one command at a time: a line's queue with room for each that takes them is never full. */
static uint32_t commands_of_line(const struct map_config *config, const struct modbus_port *line)
{
	uint32_t count = 0;

	for (uint32_t i = 0; i < line->device_count; i++)
		count += commands_of_device(config, &config->sets[line->first_device + i]);
	return count;
}

bool modbus_line_configure(struct modbus_line *line, const struct map_config *config, uint32_t number)
{
	const struct modbus_port *from = &modbus_ports(config)[number];

	line->wire = modbus_wire_of(from);
	line->connection.settle_least_ns = from->settle_ms * NS_PER_MS;
	line->command_capacity = commands_of_line(config, from);
	line->commands = allocate(line->command_capacity, sizeof(*line->commands));
	line->devices = allocate(from->device_count, sizeof(*line->devices));
	if (line->commands == NULL || line->devices == NULL)
		return false;
	line->device_count = from->device_count;
	for (uint32_t i = 0; i < line->device_count; i++)
		if (!configure_device(config, from->first_device + i, &line->devices[i]))
			return false;
	modbus_line_init(line);
	return true;
}

void modbus_line_release(struct modbus_line *line)
{
	for (uint32_t i = 0; i < line->device_count; i++) {
		free(line->devices[i].objects);
		free(line->devices[i].reads);
		free(line->devices[i].identity);
		free(line->devices[i].pages);
		for (uint32_t j = 0; j < line->devices[i].kept_count; j++)
			free(line->devices[i].kept[j].constants);
		free(line->devices[i].kept);
	}
	free(line->devices);
	free(line->commands);
}
