/* SPDX-License-Identifier: GPL-3.0-or-later */
#include "rtud/config.h"

#include <arpa/inet.h>
#include <ctype.h>
#include <errno.h>
#include <float.h>
#include <math.h>
#include <stdlib.h>
#include <string.h>

#include "rtud/config_keys.h"

#define COUNT(array) (sizeof(array) / sizeof((array)[0]))
#define BIT(n)       (1u << (n))

#define PORTS_MAX      64 /* 1000 * 64 + 247 is still a common address */
#define UNIT_MAX       247
#define UNIT_BROADCAST 0
#define CA_PER_PORT    1000
#define SCHEME_LAST                                                                                          \
	9999 /* report 003, section 4.3: from here on coils would reach the discrete inputs' IOA */
#define MODBUS_LAST       65535
#define IOA_MAX           16777215
#define DATA_BITS_RTU     8
#define EVENT_RING_LEAST  64
#define SECONDS_OF_2_DAYS 172800

/* The report's /dev names of ports 1 to 6: the NUC980's UARTs behind the board's RS-485 terminals. */
static const char *const board_devices[] = {"ttyS1", "ttyS2", "ttyS3", "ttyS4", "ttyS6", "ttyS8"};

static const char *const table_names[] = {
    [MAP_COILS] = "coils",
    [MAP_DISCRETE_INPUTS] = "discrete_inputs",
    [MAP_INPUT_REGISTERS] = "input_registers",
    [MAP_HOLDING_REGISTERS] = "holding_registers",
};
#define TABLES COUNT(table_names)

static const char table_letters[] = {'c', 'd', 'i', 'h'};
static const uint32_t first_ioa[] = {1, 10001, 30001, 40001};

static const char *const type_names[] = {
    [MAP_SINGLE] = "single",       [MAP_DOUBLE] = "double",         [MAP_STEP] = "step",
    [MAP_BITSTRING] = "bitstring", [MAP_NORMALIZED] = "normalized", [MAP_SCALED] = "scaled",
    [MAP_FLOAT] = "float",         [MAP_COUNTER] = "counter",       NULL,
};
static const uint8_t type_widths[] = {
    [MAP_SINGLE] = 1,     [MAP_DOUBLE] = 2, [MAP_STEP] = 1,  [MAP_BITSTRING] = 2,
    [MAP_NORMALIZED] = 1, [MAP_SCALED] = 1, [MAP_FLOAT] = 2, [MAP_COUNTER] = 2,
};

#define OF_BITS      (BIT(MAP_SINGLE) | BIT(MAP_DOUBLE))
#define OF_MEASURED  (BIT(MAP_NORMALIZED) | BIT(MAP_SCALED) | BIT(MAP_FLOAT))
#define OF_TWO_WORDS (BIT(MAP_BITSTRING) | BIT(MAP_FLOAT) | BIT(MAP_COUNTER))
#define OF_REGISTERS (BIT(MAP_STEP) | OF_MEASURED | OF_TWO_WORDS)

static const char *const orders[] = {"big", "little", NULL};
static const char *const bit_orders[] = {"off_on", "on_off", NULL};
static const char *const clocks[] = {[MAP_CLOCK_GATEWAY] = "gateway", [MAP_CLOCK_SYSTEM] = "system", NULL};

/* ---- the keys ---------------------------------------------------------------------------- */

enum { FILE_PORT, FILE_IEC104, FILE_CLOCK, FILE_MODBUS, FILE_EVENT_RING, FILE_KEYS };
static const struct config_rule file_rules[FILE_KEYS] = {
    [FILE_PORT] = {"port", CONFIG_ARRAY, .required = true, .high = PORTS_MAX},
    [FILE_IEC104] = {"iec104", CONFIG_OBJECT},
    [FILE_CLOCK] = {"clock", CONFIG_CHOICE, .choices = clocks},
    [FILE_MODBUS] = {"modbus", CONFIG_OBJECT},
    [FILE_EVENT_RING] = {"event_ring", CONFIG_INTEGER, .low = EVENT_RING_LEAST, .high = 65536,
			 .fallback = 4096},
};

enum {
	IEC104_ADDRESS,
	IEC104_PORT,
	IEC104_K,
	IEC104_W,
	IEC104_T1,
	IEC104_T2,
	IEC104_T3,
	IEC104_MAX_CONNECTIONS,
	IEC104_SELECT_TIMEOUT,
	IEC104_COMMAND_TIMEOUT,
	IEC104_CLOCK_MASTERS,
	IEC104_KEYS
};
static const struct config_rule iec104_rules[IEC104_KEYS] = {
    [IEC104_ADDRESS] = {"address", CONFIG_TEXT, .low = 1, .high = MAP_ADDRESS_SIZE - 1},
    [IEC104_PORT] = {"port", CONFIG_INTEGER, .low = 1, .high = 65535, .fallback = 2404},
    [IEC104_K] = {"k", CONFIG_INTEGER, .low = 1, .high = 32767, .fallback = 12},
    [IEC104_W] = {"w", CONFIG_INTEGER, .low = 1, .high = 32767, .fallback = 8},
    [IEC104_T1] = {"t1", CONFIG_INTEGER, .low = 2, .high = 255, .fallback = 15},
    [IEC104_T2] = {"t2", CONFIG_INTEGER, .low = 1, .high = 254, .fallback = 10},
    [IEC104_T3] = {"t3", CONFIG_INTEGER, .low = 1, .high = SECONDS_OF_2_DAYS, .fallback = 20},
    [IEC104_MAX_CONNECTIONS] = {"max_connections", CONFIG_INTEGER, .low = 1, .high = 16, .fallback = 8},
    [IEC104_SELECT_TIMEOUT] = {"select_timeout", CONFIG_INTEGER, .low = 1, .high = 3600, .fallback = 30},
    [IEC104_COMMAND_TIMEOUT] = {"command_timeout", CONFIG_INTEGER, .low = 1, .high = 3600, .fallback = 10},
    [IEC104_CLOCK_MASTERS] = {"clock_masters", CONFIG_ARRAY, .high = MAP_CLOCK_MASTERS_MAX},
};

enum { MODBUS_PRIORITY, MODBUS_KEYS };
static const struct config_rule modbus_rules[MODBUS_KEYS] = {
    [MODBUS_PRIORITY] = {"priority", CONFIG_INTEGER, .low = 0, .high = 99, .fallback = 50},
};

enum {
	PORT_VALUE,
	PORT_ACTIVE,
	PORT_BAUD_RATE,
	PORT_DATA_BITS,
	PORT_STOP_BITS,
	PORT_PARITY,
	PORT_SLAVES,
	PORT_DEVICE,
	PORT_PROCESS,
	PORT_KEYS
};
static const struct config_rule port_rules[PORT_KEYS] = {
    [PORT_VALUE] = {"value", CONFIG_INTEGER, .required = true, .low = 1, .high = PORTS_MAX},
    [PORT_ACTIVE] = {"active", CONFIG_INTEGER, .required = true, .low = 0, .high = 1},
    [PORT_BAUD_RATE] = {"baud_rate", CONFIG_INTEGER, .required = true, .low = 300, .high = 460800},
    [PORT_DATA_BITS] = {"data_bits", CONFIG_INTEGER, .required = true, .low = 4, .high = 8},
    [PORT_STOP_BITS] = {"stop_bits", CONFIG_INTEGER, .required = true, .low = 1, .high = 2},
    [PORT_PARITY] = {"parity", CONFIG_INTEGER, .required = true, .low = 0, .high = 2},
    [PORT_SLAVES] = {"slaves", CONFIG_ARRAY, .required = true, .high = UNIT_MAX + 1},
    [PORT_DEVICE] = {"device", CONFIG_TEXT, .low = 1, .high = MAP_PATH_SIZE - 1},
    [PORT_PROCESS] = {"process", CONFIG_INTEGER, .low = 1, .high = 6, .fallback = 1},
};
/* Figure 4.8: the parameters of a port that is not active are zeros and mean nothing. */
static const struct config_rule inactive_port_rules[PORT_KEYS] = {
    [PORT_VALUE] = {"value", CONFIG_INTEGER, .required = true, .low = 1, .high = PORTS_MAX},
    [PORT_ACTIVE] = {"active", CONFIG_INTEGER, .required = true, .low = 0, .high = 1},
    [PORT_BAUD_RATE] = {"baud_rate", CONFIG_ANYTHING},
    [PORT_DATA_BITS] = {"data_bits", CONFIG_ANYTHING},
    [PORT_STOP_BITS] = {"stop_bits", CONFIG_ANYTHING},
    [PORT_PARITY] = {"parity", CONFIG_ANYTHING},
    [PORT_SLAVES] = {"slaves", CONFIG_ANYTHING},
    [PORT_DEVICE] = {"device", CONFIG_ANYTHING},
    [PORT_PROCESS] = {"process", CONFIG_ANYTHING},
};

/* A slave's tables come first, so that enum map_table indexes them. */
enum { SLAVE_ID = TABLES, SLAVE_DESCRIPTION, SLAVE_RESPONSE_TIMEOUT, SLAVE_RETRIES, SLAVE_KEYS };
static const struct config_rule slave_rules[SLAVE_KEYS] = {
    [MAP_COILS] = {"coils", CONFIG_ARRAY, .high = CONFIG_POINTS_MAX},
    [MAP_DISCRETE_INPUTS] = {"discrete_inputs", CONFIG_ARRAY, .high = CONFIG_POINTS_MAX},
    [MAP_INPUT_REGISTERS] = {"input_registers", CONFIG_ARRAY, .high = CONFIG_POINTS_MAX},
    [MAP_HOLDING_REGISTERS] = {"holding_registers", CONFIG_ARRAY, .high = CONFIG_POINTS_MAX},
    [SLAVE_ID] = {"id", CONFIG_INTEGER, .required = true, .low = UNIT_BROADCAST, .high = UNIT_MAX},
    [SLAVE_DESCRIPTION] = {"description", CONFIG_TEXT, .low = 0, .high = MAP_NAME_SIZE - 1},
    [SLAVE_RESPONSE_TIMEOUT] = {"response_timeout_ms", CONFIG_INTEGER, .low = 20, .high = 10000,
				.fallback = 500},
    [SLAVE_RETRIES] = {"retries", CONFIG_INTEGER, .low = 0, .high = 5, .fallback = 1},
};

enum {
	OBJECT_ADDRESS,
	OBJECT_TYPE,
	OBJECT_NAME,
	OBJECT_IOA,
	OBJECT_GROUP,
	OBJECT_SELECT,
	OBJECT_SIGNED,
	OBJECT_WORD_ORDER,
	OBJECT_BYTE_ORDER,
	OBJECT_BIT_ORDER,
	OBJECT_SCALE,
	OBJECT_OFFSET,
	OBJECT_DEADBAND,
	OBJECT_CYCLIC,
	OBJECT_KEYS
};
static const struct config_rule object_rules[OBJECT_KEYS] = {
    [OBJECT_ADDRESS] = {"address", CONFIG_INTEGER, .required = true, .low = 0, .high = MODBUS_LAST},
    [OBJECT_TYPE] = {"type", CONFIG_CHOICE, .choices = type_names},
    [OBJECT_NAME] = {"name", CONFIG_TEXT, .low = 1, .high = MAP_NAME_SIZE - 1},
    [OBJECT_IOA] = {"ioa", CONFIG_INTEGER, .low = 1, .high = IOA_MAX},
    [OBJECT_GROUP] = {"group", CONFIG_INTEGER, .low = 1, .high = 16},
    [OBJECT_SELECT] = {"select", CONFIG_BOOLEAN},
    [OBJECT_SIGNED] = {"signed", CONFIG_BOOLEAN, .fallback = true},
    [OBJECT_WORD_ORDER] = {"word_order", CONFIG_CHOICE, .choices = orders},
    [OBJECT_BYTE_ORDER] = {"byte_order", CONFIG_CHOICE, .choices = orders},
    [OBJECT_BIT_ORDER] = {"bit_order", CONFIG_CHOICE, .choices = bit_orders},
    [OBJECT_SCALE] = {"scale", CONFIG_NUMBER, .low = -FLT_MAX, .high = FLT_MAX, .fallback = 1},
    [OBJECT_OFFSET] = {"offset", CONFIG_NUMBER, .low = -FLT_MAX, .high = FLT_MAX},
    [OBJECT_DEADBAND] = {"deadband", CONFIG_NUMBER, .low = 0, .high = FLT_MAX},
    [OBJECT_CYCLIC] = {"cyclic_ms", CONFIG_INTEGER, .low = 100, .high = 86400000},
};
/* The types that give a key a meaning; 0: all do. */
static const unsigned object_key_types[OBJECT_KEYS] = {
    [OBJECT_SIGNED] = BIT(MAP_NORMALIZED) | BIT(MAP_SCALED),
    [OBJECT_WORD_ORDER] = OF_TWO_WORDS,
    [OBJECT_BYTE_ORDER] = OF_REGISTERS,
    [OBJECT_BIT_ORDER] = BIT(MAP_DOUBLE),
    [OBJECT_SCALE] = OF_MEASURED,
    [OBJECT_OFFSET] = OF_MEASURED,
    [OBJECT_DEADBAND] = OF_MEASURED | BIT(MAP_COUNTER),
    [OBJECT_CYCLIC] = OF_MEASURED, /* IEC 60870-5-101, 7.2.3: only measured values know COT 1 */
};

/* ---- what is being built ----------------------------------------------------------------- */

/* A point, and the indices that lead to it in the file. */
struct entry {
	struct map_point point;
	uint32_t port, slave, object;
	bool named; /* by the file */
};

struct loader {
	struct config_report report;
	struct map_config *config;
	struct entry *entries;
	uint32_t entries_max;
	uint32_t objects;                 /* in the file, of active ports */
	size_t port_of[PORTS_MAX + 1];    /* 1 + index in the file of the port with that value */
	uint32_t port_of_line[PORTS_MAX]; /* index in the file */
};

static bool is_bit_table(enum map_table table)
{
	return table == MAP_COILS || table == MAP_DISCRETE_INPUTS;
}

static bool is_writable_table(enum map_table table)
{
	return table == MAP_COILS || table == MAP_HOLDING_REGISTERS;
}

static struct config_place key_of(const struct config_place *in, const char *key)
{
	return (struct config_place){.in = in, .key = key};
}

static struct config_place element_of(const struct config_place *in, size_t index)
{
	return (struct config_place){.in = in, .index = index};
}

/* ---- one object -------------------------------------------------------------------------- */

static enum map_type object_type(const struct config_value *values, enum map_table table)
{
	if (values[OBJECT_TYPE].given)
		return (enum map_type)values[OBJECT_TYPE].integer;
	return is_bit_table(table) ? MAP_SINGLE : MAP_SCALED;
}

static void check_type(struct loader *loader, const struct config_place *object, enum map_type type,
		       enum map_table table)
{
	const struct config_place here = key_of(object, object_rules[OBJECT_TYPE].name);
	bool bits = is_bit_table(table);

	if (bits != ((BIT(type) & OF_BITS) != 0))
		config_error(&loader->report, &here, "%s hold no \"%s\", expected one of %s",
			     table_names[table], type_names[type],
			     bits ? "single, double" : "step, bitstring, normalized, scaled, float, counter");
}

static void check_meaning(struct loader *loader, const struct config_place *object,
			  const struct config_value *values, enum map_type type, enum map_table table)
{
	for (size_t key = 0; key < OBJECT_KEYS; key++) {
		const struct config_place here = key_of(object, object_rules[key].name);

		if (values[key].given && object_key_types[key] != 0 && !(object_key_types[key] & BIT(type)))
			config_error(&loader->report, &here, "has no meaning for type %s", type_names[type]);
		if (values[key].given && key == OBJECT_SELECT && !is_writable_table(table))
			config_error(&loader->report, &here,
				     "has no meaning for %s: they cannot be commanded", table_names[table]);
	}
}

static void check_extent(struct loader *loader, const struct config_place *object, int64_t address,
			 enum map_type type)
{
	const struct config_place here = key_of(object, object_rules[OBJECT_ADDRESS].name);

	if (address + type_widths[type] - 1 > MODBUS_LAST)
		config_error(&loader->report, &here,
			     "%lld is out of range for type %s, which covers two addresses, expected 0 to %d",
			     (long long)address, type_names[type], MODBUS_LAST - 1);
}

static void check_name(struct loader *loader, const struct config_place *object, const char *name)
{
	const struct config_place here = key_of(object, object_rules[OBJECT_NAME].name);

	if (strpbrk(name, " *?[]\\") != NULL)
		config_error(&loader->report, &here,
			     "has a space or one of *?[]\\, which are for patterns, expected a name without");
}

static void check_scale(struct loader *loader, const struct config_place *object, double scale)
{
	const struct config_place here = key_of(object, object_rules[OBJECT_SCALE].name);

	if (fpclassify(scale) == FP_ZERO)
		config_error(&loader->report, &here, "is 0, expected another number");
}

static void check_scheme(struct loader *loader, const struct config_place *object, int64_t address)
{
	const struct config_place here = key_of(object, object_rules[OBJECT_IOA].name);

	if (address > SCHEME_LAST)
		config_error(
		    &loader->report, &here,
		    "is missing: addresses from %d on have no IOA by themselves, expected an integer from "
		    "1 to %d",
		    SCHEME_LAST + 1, IOA_MAX);
}

static uint8_t object_flags(const struct config_value *values, enum map_type type, enum map_table table)
{
	unsigned flags = 0;

	if ((object_key_types[OBJECT_SIGNED] & BIT(type)) && values[OBJECT_SIGNED].integer)
		flags |= MAP_POINT_SIGNED;
	if (values[OBJECT_WORD_ORDER].integer)
		flags |= MAP_POINT_WORDS_SWAPPED;
	if (values[OBJECT_BYTE_ORDER].integer)
		flags |= MAP_POINT_BYTES_SWAPPED;
	if (values[OBJECT_BIT_ORDER].integer)
		flags |= MAP_POINT_BITS_SWAPPED;
	if (values[OBJECT_SELECT].integer)
		flags |= MAP_POINT_SELECT;
	if (is_writable_table(table))
		flags |= MAP_POINT_COMMAND;
	return (uint8_t)flags;
}

static struct map_point object_point(const struct config_value *values, enum map_type type,
				     enum map_table table)
{
	uint16_t address = (uint16_t)values[OBJECT_ADDRESS].integer;

	return (struct map_point){
	    .address = address,
	    .table = (uint8_t)table,
	    .type = (uint8_t)type,
	    .width = type_widths[type],
	    .flags = object_flags(values, type, table),
	    .ioa =
		values[OBJECT_IOA].given ? (uint32_t)values[OBJECT_IOA].integer : first_ioa[table] + address,
	    .group = (uint8_t)values[OBJECT_GROUP].integer,
	    .cyclic_ms = (uint32_t)values[OBJECT_CYCLIC].integer,
	    .scale = values[OBJECT_SCALE].number,
	    .offset = values[OBJECT_OFFSET].number,
	    .deadband = values[OBJECT_DEADBAND].number,
	};
}

static void name_point(struct loader *loader, struct entry *entry, const struct config_value *name)
{
	const struct map_device *device = &loader->config->devices[entry->point.device];
	const struct map_line *line = &loader->config->lines[device->line];

	entry->named = name->given;
	if (name->given)
		snprintf(entry->point.name, sizeof(entry->point.name), "%s", name->text);
	else
		snprintf(entry->point.name, sizeof(entry->point.name), "p%u.%u.%c%u", line->port,
			 device->unit, table_letters[entry->point.table], entry->point.address);
}

static void check_object(struct loader *loader, const struct config_place *place,
			 const struct config_value *values, enum map_type type, enum map_table table)
{
	if (!values[OBJECT_TYPE].wrong) {
		check_type(loader, place, type, table);
		check_meaning(loader, place, values, type, table);
	}
	if (!values[OBJECT_TYPE].wrong && !values[OBJECT_ADDRESS].wrong)
		check_extent(loader, place, values[OBJECT_ADDRESS].integer, type);
	if (!values[OBJECT_IOA].given && !values[OBJECT_IOA].wrong && !values[OBJECT_ADDRESS].wrong)
		check_scheme(loader, place, values[OBJECT_ADDRESS].integer);
	if (values[OBJECT_NAME].given)
		check_name(loader, place, values[OBJECT_NAME].text);
	if (values[OBJECT_SCALE].given)
		check_scale(loader, place, values[OBJECT_SCALE].number);
}

/* entry: where it is in the file */
static void read_object(struct loader *loader, const struct config_place *place, const json_t *json,
			enum map_table table, struct entry entry)
{
	struct config_value values[OBJECT_KEYS];
	unsigned errors = loader->report.errors;
	enum map_type type;

	config_read_keys(&loader->report, place, json, object_rules, OBJECT_KEYS, values);
	type = object_type(values, table);
	check_object(loader, place, values, type, table);
	loader->objects++;
	if (loader->report.errors != errors || loader->config->point_count == loader->entries_max)
		return;
	entry.point = object_point(values, type, table);
	entry.point.device = (uint16_t)(loader->config->device_count - 1);
	name_point(loader, &entry, &values[OBJECT_NAME]);
	loader->entries[loader->config->point_count++] = entry;
}

/* ---- one slave --------------------------------------------------------------------------- */

static void read_table(struct loader *loader, const struct config_place *slave, const json_t *objects,
		       enum map_table table, struct entry entry)
{
	const struct config_place array = key_of(slave, table_names[table]);
	const json_t *json;
	size_t i;

	json_array_foreach(objects, i, json)
	{
		const struct config_place place = element_of(&array, i);

		entry.object = (uint32_t)i;
		read_object(loader, &place, json, table, entry);
	}
}

static void check_broadcast(struct loader *loader, const struct config_place *slave,
			    const struct config_value *values)
{
	for (size_t table = 0; table < TABLES; table++) {
		const struct config_place here = key_of(slave, table_names[table]);

		if (!is_writable_table((enum map_table)table) && json_array_size(values[table].json) > 0)
			config_error(&loader->report, &here,
				     "slave 0 is the broadcast address, which is never read, expected only "
				     "coils and holding_registers");
	}
}

static void add_device(struct loader *loader, const struct config_value *values)
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
	    .first_point = config->point_count,
	};
	if (values[SLAVE_DESCRIPTION].given && values[SLAVE_DESCRIPTION].text[0] != '\0')
		snprintf(device->name, sizeof(device->name), "%s", values[SLAVE_DESCRIPTION].text);
	else
		snprintf(device->name, sizeof(device->name), "p%u.%u", line->port, unit);
	line->device_count++;
}

/* slave_of[id]: 1 + index of the slave of this port that has the id */
static void claim_unit(struct loader *loader, const struct config_place *slave, int64_t unit,
		       size_t slave_of[UNIT_MAX + 1])
{
	const struct config_place here = key_of(slave, slave_rules[SLAVE_ID].name);

	if (slave_of[unit] != 0)
		config_error(&loader->report, &here, "%lld is already the id of slaves[%zu] of this port",
			     (long long)unit, slave_of[unit] - 1);
	else
		slave_of[unit] = slave->index + 1;
}

static void read_slave(struct loader *loader, const struct config_place *place, const json_t *json,
		       struct entry entry, size_t slave_of[UNIT_MAX + 1])
{
	struct config_value values[SLAVE_KEYS];
	struct map_device *device;

	config_read_keys(&loader->report, place, json, slave_rules, SLAVE_KEYS, values);
	if (values[SLAVE_ID].given) {
		claim_unit(loader, place, values[SLAVE_ID].integer, slave_of);
		if (values[SLAVE_ID].integer == UNIT_BROADCAST)
			check_broadcast(loader, place, values);
	}
	add_device(loader, values);
	device = &loader->config->devices[loader->config->device_count - 1];
	for (size_t table = 0; table < TABLES; table++)
		read_table(loader, place, values[table].json, (enum map_table)table, entry);
	device->point_count = loader->config->point_count - device->first_point;
}

/* ---- one port ---------------------------------------------------------------------------- */

static bool is_inactive(const json_t *port)
{
	const json_t *active = json_object_get(port, port_rules[PORT_ACTIVE].name);

	return json_is_integer(active) && json_integer_value(active) == 0;
}

static void claim_value(struct loader *loader, const struct config_place *port,
			const struct config_value *value)
{
	const struct config_place here = key_of(port, port_rules[PORT_VALUE].name);
	size_t *claimed;

	if (!value->given)
		return;
	claimed = &loader->port_of[value->integer];
	if (*claimed != 0)
		config_error(&loader->report, &here, "%lld is already the value of port[%zu]",
			     (long long)value->integer, *claimed - 1);
	else
		*claimed = port->index + 1;
}

static void check_data_bits(struct loader *loader, const struct config_place *port,
			    const struct config_value *value)
{
	const struct config_place here = key_of(port, port_rules[PORT_DATA_BITS].name);

	if (value->given && value->integer != DATA_BITS_RTU)
		config_error(&loader->report, &here, "%lld, expected %d: Modbus RTU sends whole bytes",
			     (long long)value->integer, DATA_BITS_RTU);
}

/* The path of the port's serial device, NULL when the file does not say it. */
static const char *port_device(struct loader *loader, const struct config_place *port,
			       const struct config_value *values)
{
	const struct config_place here = key_of(port, port_rules[PORT_DEVICE].name);
	int64_t value = values[PORT_VALUE].integer;

	if (values[PORT_DEVICE].given)
		return values[PORT_DEVICE].text;
	if (values[PORT_DEVICE].wrong || !values[PORT_VALUE].given)
		return NULL;
	if (value <= (int64_t)COUNT(board_devices))
		return board_devices[value - 1];
	config_error(&loader->report, &here,
		     "is missing: the board has only ports 1 to %zu, expected a device "
		     "name for port %lld",
		     COUNT(board_devices), (long long)value);
	return NULL;
}

static void claim_device(struct loader *loader, const struct config_place *port, const char *device)
{
	const struct config_place here = key_of(port, port_rules[PORT_DEVICE].name);
	const struct map_config *config = loader->config;

	for (uint32_t line = 0; device != NULL && line < config->line_count; line++)
		if (strcmp(config->lines[line].device, device) == 0)
			config_error(&loader->report, &here, "%s is already the device of port[%u]", device,
				     loader->port_of_line[line]);
}

static void add_line(struct loader *loader, const struct config_place *port,
		     const struct config_value *values, const char *device)
{
	struct map_config *config = loader->config;
	struct map_line *line = &config->lines[config->line_count];

	*line = (struct map_line){
	    .port = (uint16_t)values[PORT_VALUE].integer,
	    .process = (uint16_t)values[PORT_PROCESS].integer,
	    .first_device = (uint16_t)config->device_count,
	    .stop_bits = (uint8_t)values[PORT_STOP_BITS].integer,
	    .parity = (uint8_t)values[PORT_PARITY].integer,
	    .baud = (uint32_t)values[PORT_BAUD_RATE].integer,
	};
	if (device != NULL)
		snprintf(line->device, sizeof(line->device), "%s", device);
	loader->port_of_line[config->line_count++] = (uint32_t)port->index;
}

static void read_slaves(struct loader *loader, const struct config_place *port, const json_t *slaves)
{
	const struct config_place array = key_of(port, port_rules[PORT_SLAVES].name);
	size_t slave_of[UNIT_MAX + 1] = {0};
	const json_t *json;
	size_t i;

	json_array_foreach(slaves, i, json)
	{
		const struct config_place place = element_of(&array, i);

		read_slave(loader, &place, json,
			   (struct entry){.port = (uint32_t)port->index, .slave = (uint32_t)i}, slave_of);
	}
}

static void read_inactive_port(struct loader *loader, const struct config_place *place, const json_t *json)
{
	struct config_value values[PORT_KEYS];
	size_t slaves;

	config_read_keys(&loader->report, place, json, inactive_port_rules, PORT_KEYS, values);
	claim_value(loader, place, &values[PORT_VALUE]);
	slaves = json_array_size(values[PORT_SLAVES].json);
	if (slaves > 0)
		config_note(&loader->report, place,
			    "not active, its slaves (%zu) are not polled and have no points", slaves);
}

static void read_active_port(struct loader *loader, const struct config_place *place, const json_t *json)
{
	struct config_value values[PORT_KEYS];
	const char *device;

	config_read_keys(&loader->report, place, json, port_rules, PORT_KEYS, values);
	claim_value(loader, place, &values[PORT_VALUE]);
	check_data_bits(loader, place, &values[PORT_DATA_BITS]);
	device = port_device(loader, place, values);
	claim_device(loader, place, device);
	add_line(loader, place, values, device);
	if (values[PORT_SLAVES].given)
		read_slaves(loader, place, values[PORT_SLAVES].json);
}

static void read_ports(struct loader *loader, const struct config_place *file, const json_t *ports)
{
	const struct config_place array = key_of(file, file_rules[FILE_PORT].name);
	const json_t *json;
	size_t i;

	json_array_foreach(ports, i, json)
	{
		const struct config_place place = element_of(&array, i);

		if (is_inactive(json))
			read_inactive_port(loader, &place, json);
		else
			read_active_port(loader, &place, json);
	}
}

/* ---- what belongs to no port ------------------------------------------------------------- */

static bool is_ip_address(const char *text)
{
	struct in6_addr parsed;

	return inet_pton(AF_INET, text, &parsed) == 1 || inet_pton(AF_INET6, text, &parsed) == 1;
}

static void read_address(struct loader *loader, const struct config_place *place, const char *text,
			 char out[MAP_ADDRESS_SIZE])
{
	if (is_ip_address(text))
		snprintf(out, MAP_ADDRESS_SIZE, "%s", text);
	else
		config_error(&loader->report, place,
			     "is no IP address, expected one like 192.0.2.1 or 2001:db8::1");
}

static void read_clock_masters(struct loader *loader, const struct config_place *iec104,
			       const json_t *masters)
{
	const struct config_place array = key_of(iec104, iec104_rules[IEC104_CLOCK_MASTERS].name);
	struct map_settings *settings = &loader->config->settings;
	const json_t *json;
	size_t i;

	json_array_foreach(masters, i, json)
	{
		const struct config_place place = element_of(&array, i);

		if (json_is_string(json))
			read_address(loader, &place, json_string_value(json), settings->clock_masters[i]);
		else
			config_error(&loader->report, &place, "is not a string, expected an IP address");
	}
	settings->clock_master_count = (uint8_t)json_array_size(masters);
}

/* IEC 60870-5-104, 5.5: w should not exceed two thirds of k; more than k would never be reached. */
static void check_window(struct loader *loader, const struct config_place *iec104,
			 const struct config_value *values)
{
	const struct config_place here = key_of(iec104, iec104_rules[IEC104_W].name);

	if (!values[IEC104_W].wrong && !values[IEC104_K].wrong &&
	    values[IEC104_W].integer > values[IEC104_K].integer)
		config_error(&loader->report, &here,
			     "%lld is more than k (%lld), expected at most k, better two thirds of it",
			     (long long)values[IEC104_W].integer, (long long)values[IEC104_K].integer);
}

/* IEC 60870-5-104, 9.6: an acknowledgement later than t1 would come when the peer has closed. */
static void check_times(struct loader *loader, const struct config_place *iec104,
			const struct config_value *values)
{
	const struct config_place here = key_of(iec104, iec104_rules[IEC104_T2].name);

	if (!values[IEC104_T1].wrong && !values[IEC104_T2].wrong &&
	    values[IEC104_T2].integer >= values[IEC104_T1].integer)
		config_error(&loader->report, &here,
			     "%lld s is not shorter than t1 (%lld s), expected less than t1",
			     (long long)values[IEC104_T2].integer, (long long)values[IEC104_T1].integer);
}

static void read_iec104(struct loader *loader, const struct config_place *file, const json_t *json)
{
	const struct config_place place = key_of(file, file_rules[FILE_IEC104].name);
	const struct config_place address = key_of(&place, iec104_rules[IEC104_ADDRESS].name);
	struct map_settings *settings = &loader->config->settings;
	struct config_value values[IEC104_KEYS];

	config_read_keys(&loader->report, &place, json, iec104_rules, IEC104_KEYS, values);
	check_window(loader, &place, values);
	check_times(loader, &place, values);
	settings->port = (uint16_t)values[IEC104_PORT].integer;
	settings->k = (uint16_t)values[IEC104_K].integer;
	settings->w = (uint16_t)values[IEC104_W].integer;
	settings->t1_s = (uint16_t)values[IEC104_T1].integer;
	settings->t2_s = (uint16_t)values[IEC104_T2].integer;
	settings->t3_s = (uint32_t)values[IEC104_T3].integer;
	settings->max_connections = (uint16_t)values[IEC104_MAX_CONNECTIONS].integer;
	settings->select_timeout_s = (uint16_t)values[IEC104_SELECT_TIMEOUT].integer;
	settings->command_timeout_s = (uint16_t)values[IEC104_COMMAND_TIMEOUT].integer;
	if (!values[IEC104_ADDRESS].wrong)
		read_address(loader, &address,
			     values[IEC104_ADDRESS].given ? values[IEC104_ADDRESS].text : "0.0.0.0",
			     settings->address);
	if (values[IEC104_CLOCK_MASTERS].given)
		read_clock_masters(loader, &place, values[IEC104_CLOCK_MASTERS].json);
}

static void read_modbus(struct loader *loader, const struct config_place *file, const json_t *json)
{
	const struct config_place place = key_of(file, file_rules[FILE_MODBUS].name);
	struct config_value values[MODBUS_KEYS];

	config_read_keys(&loader->report, &place, json, modbus_rules, MODBUS_KEYS, values);
	loader->config->settings.modbus_priority = (uint8_t)values[MODBUS_PRIORITY].integer;
}

static void read_event_ring(struct loader *loader, const struct config_place *file,
			    const struct config_value *value)
{
	const struct config_place here = key_of(file, file_rules[FILE_EVENT_RING].name);

	loader->config->settings.event_ring = (uint32_t)value->integer;
	if (value->given && (value->integer & (value->integer - 1)) != 0)
		config_error(&loader->report, &here, "%lld is no power of two, expected 64, 128, ... 65536",
			     (long long)value->integer);
}

/* ---- what must hold between points -------------------------------------------------------- */

/* Negative, 0 or positive, for qsort. */
static int order(uint32_t a, uint32_t b)
{
	return (a > b) - (a < b);
}

static int by_file(const struct entry *a, const struct entry *b)
{
	int by_device = order(a->point.device, b->point.device);
	int by_table = order(a->point.table, b->point.table);

	return by_device != 0 ? by_device : by_table != 0 ? by_table : order(a->object, b->object);
}

static int by_address(const void *left, const void *right)
{
	const struct entry *a = left, *b = right;
	int by_device = order(a->point.device, b->point.device);
	int by_table = order(a->point.table, b->point.table);
	int by_start = order(a->point.address, b->point.address);
	int by_width = order(a->point.width, b->point.width);

	if (by_device != 0 || by_table != 0)
		return by_device != 0 ? by_device : by_table;
	if (by_start != 0 || by_width != 0)
		return by_start != 0 ? by_start : by_width;
	return by_file(a, b);
}

static int by_ioa(const void *left, const void *right)
{
	const struct entry *a = left, *b = right;
	int by_device = order(a->point.device, b->point.device);
	int by_number = order(a->point.ioa, b->point.ioa);

	if (by_device != 0)
		return by_device;
	return by_number != 0 ? by_number : by_file(a, b);
}

static int by_name(const void *left, const void *right)
{
	const struct entry *a = left, *b = right;
	int by_text = strcmp(a->point.name, b->point.name);

	return by_text != 0 ? by_text : by_file(a, b);
}

#define ENTRY_LINKS 7

static const struct config_place *entry_place(const struct entry *entry,
					      struct config_place links[ENTRY_LINKS])
{
	links[0] = (struct config_place){.in = NULL};
	links[1] = key_of(&links[0], file_rules[FILE_PORT].name);
	links[2] = element_of(&links[1], entry->port);
	links[3] = key_of(&links[2], port_rules[PORT_SLAVES].name);
	links[4] = element_of(&links[3], entry->slave);
	links[5] = key_of(&links[4], table_names[entry->point.table]);
	links[6] = element_of(&links[5], entry->object);
	return &links[6];
}

/* what: how the entry collides with the other one */
static void refuse_pair(struct loader *loader, const struct entry *entry, const struct entry *other,
			const char *what)
{
	struct config_place links[ENTRY_LINKS], other_links[ENTRY_LINKS];
	char there[CONFIG_PLACE_SIZE];

	config_place_text(entry_place(other, other_links), there);
	config_error(&loader->report, entry_place(entry, links), "%s %s", what, there);
}

static uint32_t end_of(const struct entry *entry)
{
	return entry->point.address + (uint32_t)entry->point.width;
}

static bool in_one_table(const struct entry *a, const struct entry *b)
{
	return a->point.device == b->point.device && a->point.table == b->point.table;
}

static bool overlap(const struct entry *a, const struct entry *b)
{
	return in_one_table(a, b) && a->point.address < end_of(b) && b->point.address < end_of(a);
}

/* The widest object covers two addresses: in the order of address and width, neighbours show every overlap. */
static void check_overlaps(struct loader *loader, const struct entry *entries, uint32_t count)
{
	for (uint32_t i = 1; i < count; i++)
		if (overlap(&entries[i - 1], &entries[i]))
			refuse_pair(loader, &entries[i], &entries[i - 1], "covers an address of");
}

static void check_ioas(struct loader *loader, const struct entry *entries, uint32_t count)
{
	for (uint32_t i = 1; i < count; i++) {
		const struct entry *one = &entries[i - 1], *other = &entries[i];
		char what[64];

		if (one->point.device != other->point.device || one->point.ioa != other->point.ioa ||
		    overlap(one, other))
			continue;
		snprintf(what, sizeof(what), "has the CA %u and IOA %u of",
			 loader->config->devices[one->point.device].ca, one->point.ioa);
		refuse_pair(loader, other, one, what);
	}
}

/* Default names differ when addresses do, and what is wrong with those has been said. */
static void check_names(struct loader *loader, const struct entry *entries, uint32_t count)
{
	for (uint32_t i = 1; i < count; i++) {
		const struct entry *one = &entries[i - 1], *other = &entries[i];
		char what[MAP_NAME_SIZE + 32];

		if (strcmp(one->point.name, other->point.name) != 0 || (!one->named && !other->named))
			continue;
		snprintf(what, sizeof(what), "has the name \"%s\" of", one->point.name);
		refuse_pair(loader, other, one, what);
	}
}

/* Leaves the entries in the order map/config.h asks for. */
static void check_entries(struct loader *loader)
{
	struct entry *entries = loader->entries;
	uint32_t count = loader->config->point_count;

	qsort(entries, count, sizeof(*entries), by_ioa);
	check_ioas(loader, entries, count);
	qsort(entries, count, sizeof(*entries), by_name);
	check_names(loader, entries, count);
	qsort(entries, count, sizeof(*entries), by_address);
	check_overlaps(loader, entries, count);
}

/* ---- the whole file ---------------------------------------------------------------------- */

static void check_point_count(struct loader *loader, const struct config_place *file)
{
	const struct config_place here = key_of(file, file_rules[FILE_PORT].name);

	if (loader->objects > CONFIG_POINTS_MAX)
		config_error(&loader->report, &here, "has %u objects, expected at most %d", loader->objects,
			     CONFIG_POINTS_MAX);
}

static void read_file(struct loader *loader, const json_t *root)
{
	const struct config_place file = {.in = NULL};
	struct config_value values[FILE_KEYS];

	config_read_keys(&loader->report, &file, root, file_rules, FILE_KEYS, values);
	if (!json_is_object(root))
		return;
	read_iec104(loader, &file, values[FILE_IEC104].given ? values[FILE_IEC104].json : NULL);
	read_modbus(loader, &file, values[FILE_MODBUS].given ? values[FILE_MODBUS].json : NULL);
	read_event_ring(loader, &file, &values[FILE_EVENT_RING]);
	loader->config->settings.clock = (uint8_t)values[FILE_CLOCK].integer;
	if (values[FILE_PORT].given)
		read_ports(loader, &file, values[FILE_PORT].json);
	check_point_count(loader, &file);
	check_entries(loader);
}

static uint32_t count_objects(const json_t *slave)
{
	size_t count = 0;

	for (size_t table = 0; table < TABLES; table++)
		count += json_array_size(json_object_get(slave, table_names[table]));
	return (uint32_t)count;
}

/* How many lines, devices and points the file can have at most, with every array as its rule allows it. */
static void count_records(const json_t *root, struct map_config *counts)
{
	const json_t *ports = json_object_get(root, file_rules[FILE_PORT].name);
	const json_t *port, *slave;
	size_t i, j;

	if (json_array_size(ports) > PORTS_MAX)
		return;
	json_array_foreach(ports, i, port)
	{
		const json_t *slaves = json_object_get(port, port_rules[PORT_SLAVES].name);

		counts->line_count++;
		if (json_array_size(slaves) > UNIT_MAX + 1)
			continue;
		json_array_foreach(slaves, j, slave)
		{
			counts->device_count++;
			counts->point_count += count_objects(slave);
		}
	}
	if (counts->point_count > CONFIG_POINTS_MAX)
		counts->point_count = CONFIG_POINTS_MAX;
}

/* An array of at least one element, so that NULL means no memory. */
static void *allocate(uint32_t count, size_t size)
{
	return calloc(count > 0 ? count : 1, size);
}

static bool allocate_records(struct loader *loader, const json_t *root)
{
	struct map_config counts = {.line_count = 0};

	count_records(root, &counts);
	loader->entries_max = counts.point_count;
	loader->entries = allocate(counts.point_count, sizeof(*loader->entries));
	loader->config->lines = allocate(counts.line_count, sizeof(struct map_line));
	loader->config->devices = allocate(counts.device_count, sizeof(struct map_device));
	loader->config->points = allocate(counts.point_count, sizeof(struct map_point));
	return loader->entries != NULL && loader->config->lines != NULL && loader->config->devices != NULL &&
	       loader->config->points != NULL;
}

static enum config_result build(struct loader *loader, const json_t *root)
{
	if (!allocate_records(loader, root)) {
		fputs("out of memory\n", loader->report.messages);
		return CONFIG_UNUSABLE;
	}
	read_file(loader, root);
	for (uint32_t i = 0; i < loader->config->point_count; i++)
		loader->config->points[i] = loader->entries[i].point;
	return loader->report.errors == 0 ? CONFIG_GOOD : CONFIG_WRONG;
}

/* ---- bytes to JSON ----------------------------------------------------------------------- */

/* Reads up to CONFIG_FILE_SIZE_MAX + 1 bytes, so that the caller sees a larger file. NULL with errno when it cannot. */
static char *read_bytes(const char *path, size_t *length)
{
	FILE *file = fopen(path, "rbe");
	char *bytes = malloc(CONFIG_FILE_SIZE_MAX + 1);
	int error;

	if (file != NULL && bytes != NULL) {
		*length = fread(bytes, 1, CONFIG_FILE_SIZE_MAX + 1, file);
		if (!ferror(file)) {
			fclose(file);
			return bytes;
		}
	}
	error = errno;
	if (file != NULL)
		fclose(file);
	free(bytes);
	errno = error;
	return NULL;
}

static void report_json_error(struct config_report *report, const char *path, const json_error_t *error)
{
	fprintf(report->messages, "%s:%d:%d: ", path, error->line, error->column);
	for (const char *c = error->text; *c != '\0'; c++)
		fputc(iscntrl((unsigned char)*c) ? '?' : *c, report->messages);
	fputc('\n', report->messages);
}

/* A key that is given twice is an error, but not one that hides all others. */
static json_t *parse(struct config_report *report, const char *path, const char *bytes, size_t length)
{
	json_error_t error;
	json_t *root = json_loadb(bytes, length, JSON_REJECT_DUPLICATES, &error);

	if (root == NULL) {
		report_json_error(report, path, &error);
		report->errors++;
	}
	if (root == NULL && json_error_code(&error) == json_error_duplicate_key)
		root = json_loadb(bytes, length, 0, &error);
	return root;
}

static json_t *read_json(struct config_report *report, const char *path)
{
	size_t length;
	char *bytes = read_bytes(path, &length);
	json_t *root = NULL;

	if (bytes == NULL)
		fprintf(report->messages, "%s: cannot be read: %s\n", path, strerror(errno));
	else if (length > CONFIG_FILE_SIZE_MAX)
		fprintf(report->messages, "%s: is too large, expected at most %u bytes\n", path,
			CONFIG_FILE_SIZE_MAX);
	else
		root = parse(report, path, bytes, length);
	free(bytes);
	return root;
}

enum config_result config_load(const char *path, struct map_config *out, FILE *messages)
{
	struct loader loader = {.report.messages = messages, .config = out};
	enum config_result result = CONFIG_UNUSABLE;
	json_t *root;

	*out = (struct map_config){.line_count = 0};
	root = read_json(&loader.report, path);
	if (root != NULL)
		result = build(&loader, root);
	if (result != CONFIG_GOOD)
		config_free(out);
	free(loader.entries);
	json_decref(root);
	return result;
}

void config_free(struct map_config *config)
{
	free(config->lines);
	free(config->devices);
	free(config->points);
	*config = (struct map_config){.line_count = 0};
}

int config_check(const char *path)
{
	struct map_config config;
	enum config_result result = config_load(path, &config, stderr);

	if (result == CONFIG_GOOD)
		printf("%s: good: lines %u, devices %u, points %u\n", path, config.line_count,
		       config.device_count, config.point_count);
	config_free(&config);
	return (int)result;
}
