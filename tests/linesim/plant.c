/* SPDX-License-Identifier: GPL-3.0-or-later */
#include "plant.h"

#include <arpa/inet.h>
#include <errno.h>
#include <jansson.h>
#include <stdarg.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

#define PORT_MAX    64
#define MODBUS_PORT 502

static int fail(char *error, const char *format, ...) __attribute__((format(printf, 2, 3)));

static int fail(char *error, const char *format, ...)
{
	va_list arguments;

	va_start(arguments, format);
	vsnprintf(error, PLANT_ERROR_SIZE, format, arguments);
	va_end(arguments);
	return -1;
}

bool plant_number(const char *text, long min, long max, long *value)
{
	char *end;

	errno = 0;
	*value = strtol(text, &end, 10);
	return end != text && *end == '\0' && !errno && *value >= min && *value <= max;
}

static int get_integer(json_t *object, const char *path, const char *key, long min, long max, long *value,
		       char *error)
{
	json_t *member = json_object_get(object, key);

	if (!json_is_integer(member) || json_integer_value(member) < min || json_integer_value(member) > max)
		return fail(error, "%s.%s: expected an integer %ld to %ld", path, key, min, max);
	*value = (long)json_integer_value(member);
	return 0;
}

static json_t *load(const char *path, char *error)
{
	json_error_t place;
	json_t *root = json_load_file(path, JSON_REJECT_DUPLICATES, &place);

	if (!root && place.line > 0)
		fail(error, "line %d: %s", place.line, place.text);
	else if (!root)
		fail(error, "%s", place.text);
	return root;
}

/* ---- the gateway's configuration --------------------------------------------------------- */

/* Registers of a format, and neighbours of a type without one (table 4.1); all others cover one. */
static const struct {
	const char *name;
	long width;
} formats[] = {{"int16", 1},    {"uint16", 1},   {"int32", 2},   {"uint32", 2},  {"int48", 3},
	       {"uint48", 3},   {"int64", 4},    {"uint64", 4},  {"float32", 2}, {"float64", 4},
	       {"bcd16", 1},    {"bcd32", 2},    {"bcd48", 3},   {"bcd64", 4},   {"fixed24_8", 2},
	       {"mod10_32", 2}, {"mod10_48", 3}, {"mod10_64", 4}},
  types[] = {{"double", 2}, {"float", 2}, {"counter", 2}, {"bitstring", 2}};

static long width(json_t *object)
{
	const char *type = json_string_value(json_object_get(object, "type"));
	const char *format = json_string_value(json_object_get(object, "format"));

	if (json_object_get(object, "bit") || json_object_get(object, "bits"))
		return 1;
	if (json_is_integer(json_object_get(object, "length"))) /* a text */
		return (long)json_integer_value(json_object_get(object, "length"));
	for (size_t i = 0; format && i < sizeof formats / sizeof *formats; i++)
		if (strcmp(format, formats[i].name) == 0)
			return formats[i].width;
	for (size_t i = 0; type && !format && i < sizeof types / sizeof *types; i++)
		if (strcmp(type, types[i].name) == 0)
			return types[i].width;
	return 1;
}

/* A manual's number (docs/configuration.md): its first digit is the table, the others count from 1. */
static int get_address(json_t *object, const char *path, long max, long *address, char *error)
{
	const char *number = json_string_value(json_object_get(object, "register"));

	if (!number)
		return get_integer(object, path, "address", 0, max, address, error);
	if (*number == '\0' || !plant_number(number + 1, 1, max + 1, address))
		return fail(error, "%s.register: expected a number as manuals print it", path);
	--*address;
	return 0;
}

/* What an object is read with, and all that lies between: a double's second bit, a value's power of ten. */
static int get_extent(json_t *object, const char *path, long *first, long *last, char *error)
{
	const bool apart = json_object_get(object, "second_address");
	const char *key = apart ? "second_address" : "scale_register";
	const long cells = apart ? 1 : width(object);
	long address, other;

	if (get_address(object, path, SLAVE_TABLE_CELLS - cells, &address, error))
		return -1;
	other = address;
	if (json_object_get(object, key) &&
	    get_integer(object, path, key, 0, SLAVE_TABLE_CELLS - 1, &other, error))
		return -1;
	*first = other < address ? other : address;
	*last = other > address + cells - 1 ? other : address + cells - 1;
	return 0;
}

/* Where its commands go, if not to where it is read. */
static int load_written(struct slave *slave, enum slave_table table, json_t *object, const char *path,
			char *error)
{
	const enum slave_table written = slave_table_has_bits(table) ? SLAVE_COILS : SLAVE_HOLDING_REGISTERS;
	const long cells = width(object);
	long address;

	if (!json_object_get(object, "write_address"))
		return 0;
	if (get_integer(object, path, "write_address", 0, SLAVE_TABLE_CELLS - cells, &address, error))
		return -1;
	for (long i = 0; i < cells; i++)
		slave->table[written].exists[address + i] = true;
	return 0;
}

static int load_table(struct slave *slave, enum slave_table table, json_t *objects, const char *slave_path,
		      char *error)
{
	size_t index;
	json_t *object;

	json_array_foreach(objects, index, object)
	{
		char path[128];
		long first, last;

		snprintf(path, sizeof path, "%s.%s[%zu]", slave_path, slave_table_name(table), index);
		if (get_extent(object, path, &first, &last, error) ||
		    load_written(slave, table, object, path, error))
			return -1;
		for (long i = first; i <= last; i++)
			slave->table[table].exists[i] = true;
	}
	return 0;
}

/* A register that the device is known by has the first of the values that it may have. */
static int load_known(struct slave *slave, enum slave_table table, json_t *registers, const char *path,
		      char *error)
{
	size_t index;
	json_t *known;

	json_array_foreach(registers, index, known)
	{
		const json_int_t address = json_integer_value(json_array_get(known, 0));

		if (json_array_size(known) < 2 || address < 0 || address >= SLAVE_TABLE_CELLS)
			return fail(error, "%s.identification.%s[%zu]: is no address with values", path,
				    slave_table_name(table), index);
		slave->table[table].exists[address] = true;
		slave->table[table].value[address] = (uint16_t)json_integer_value(json_array_get(known, 1));
	}
	return 0;
}

/* What the gateway expects, the device says. */
static int load_identification(struct slave *slave, json_t *texts, const char *path, char *error)
{
	static const char *const keys[SLAVE_IDENTIFIED] = {"vendor_name",     "product_code", "revision",
							   "vendor_url",      "product_name", "model_name",
							   "application_name"};

	for (unsigned i = 0; i < SLAVE_IDENTIFIED; i++) {
		const char *text = json_string_value(json_object_get(texts, keys[i]));

		if (text && strlen(text) >= SLAVE_IDENTIFIED_SIZE)
			return fail(error, "%s.identification.%s: is too long", path, keys[i]);
		if (text)
			strcpy(slave->identification[i], text);
	}
	for (enum slave_table table = SLAVE_INPUT_REGISTERS; table < SLAVE_TABLES; table++)
		if (load_known(slave, table, json_object_get(texts, slave_table_name(table)), path, error))
			return -1;
	return 0;
}

static int load_slave(struct line *line, json_t *description, const char *path, char *error)
{
	long unit;

	if (get_integer(description, path, "id", 0, SLAVE_UNIT_MAX, &unit, error))
		return -1;
	if (json_object_get(description, "template"))
		return fail(
		    error,
		    "%s.template: templates are not read here, expected a file without: see \"Try it without "
		    "devices\" in docs/configuration.md",
		    path);
	if (line->slaves[unit])
		return fail(error, "%s.id: slave %ld is on this line already", path, unit);

	struct slave *slave = calloc(1, sizeof *slave);

	if (!slave)
		return fail(error, "%s: out of memory", path);
	slave->unit = (uint8_t)unit;
	if (load_identification(slave, json_object_get(description, "identification"), path, error)) {
		free(slave);
		return -1;
	}
	line->slaves[unit] = slave;
	for (enum slave_table table = SLAVE_COILS; table < SLAVE_TABLES; table++)
		if (load_table(slave, table, json_object_get(description, slave_table_name(table)), path,
			       error))
			return -1;
	return 0;
}

static int load_pace(struct line *line, json_t *description, const char *path, int64_t latency_ns,
		     char *error)
{
	long baud, data_bits, stop_bits, parity;

	if (get_integer(description, path, "baud_rate", 300, 4000000, &baud, error) ||
	    get_integer(description, path, "data_bits", 8, 8, &data_bits, error) ||
	    get_integer(description, path, "stop_bits", 1, 2, &stop_bits, error) ||
	    get_integer(description, path, "parity", 0, 2, &parity, error))
		return -1;
	line_set_pace(line, (unsigned)baud, (unsigned)(1 + data_bits + (parity ? 1 : 0) + stop_bits),
		      latency_ns);
	return 0;
}

/* The board's six ports are these (the project report, chapter 2); "device" names another. */
static int name_line(struct line *line, json_t *description, const char *path, char *error)
{
	static const char *const board[] = {"ttyS1", "ttyS2", "ttyS3", "ttyS4", "ttyS6", "ttyS8"};
	const char *device = json_string_value(json_object_get(description, "device"));

	if (!device && line->port <= sizeof board / sizeof *board)
		device = board[line->port - 1];
	if (!device)
		return fail(error, "%s.device: port %u is not one of the board's 1 to 6 and needs a device",
			    path, line->port);

	const char *slash = strrchr(device, '/');
	const char *name = slash ? slash + 1 : device;

	if (!*name || strcmp(name, ".") == 0 || strcmp(name, "..") == 0 || strlen(name) >= sizeof line->name)
		return fail(error, "%s.device: \"%s\" does not end in the name of a device", path, device);
	snprintf(line->name, sizeof line->name, "%s", name);
	return 0;
}

static int load_address(struct line *line, json_t *description, const char *path, char *error)
{
	const char *host = json_string_value(json_object_get(description, "host"));
	long port = MODBUS_PORT;

	line->tcp.is_one = true;
	line->tcp.address.sin_family = AF_INET;
	if (!host || inet_pton(AF_INET, host, &line->tcp.address.sin_addr) != 1)
		return fail(error, "%s.host: expected an IPv4 address of this machine", path);
	if (json_object_get(description, "tcp_port") &&
	    get_integer(description, path, "tcp_port", 1, UINT16_MAX, &port, error))
		return -1;
	if (json_object_get(description, "framing"))
		return fail(error, "%s.framing: only Modbus TCP is served here", path);
	line->tcp.address.sin_port = htons((uint16_t)port);
	snprintf(line->name, sizeof line->name, "%s:%ld", host, port);
	return 0;
}

static int load_medium(struct line *line, json_t *description, const char *path, int64_t latency_ns,
		       char *error)
{
	line->latency_ns = latency_ns;
	if (json_object_get(description, "host"))
		return load_address(line, description, path, error);
	return name_line(line, description, path, error) ||
		       load_pace(line, description, path, latency_ns, error)
		   ? -1
		   : 0;
}

static int check_line_is_new(const struct plant *plant, const struct line *line, const char *path,
			     char *error)
{
	for (size_t i = 0; i < plant->line_count; i++) {
		if (plant->lines[i].port == line->port)
			return fail(error, "%s.value: port %u is there already", path, line->port);
		if (strcmp(plant->lines[i].name, line->name) == 0)
			return fail(error, "%s.device: %s is port %u's already", path, line->name,
				    plant->lines[i].port);
	}
	return 0;
}

static int load_line(struct plant *plant, json_t *description, const char *path, int64_t latency_ns,
		     char *error)
{
	struct line *line = &plant->lines[plant->line_count];
	long port;
	size_t index;
	json_t *slave;

	if (plant->line_count == PLANT_LINES_MAX)
		return fail(error, "%s: more than %d active ports", path, PLANT_LINES_MAX);
	if (get_integer(description, path, "value", 1, PORT_MAX, &port, error))
		return -1;
	line->port = (uint16_t)port;
	if (load_medium(line, description, path, latency_ns, error) ||
	    check_line_is_new(plant, line, path, error))
		return -1;
	json_array_foreach(json_object_get(description, "slaves"), index, slave)
	{
		char slave_path[64];

		snprintf(slave_path, sizeof slave_path, "%s.slaves[%zu]", path, index);
		if (load_slave(line, slave, slave_path, error))
			return -1;
	}
	plant->line_count++;
	return 0;
}

int plant_load_config(struct plant *plant, const char *path, int64_t latency_ns, bool serves_tcp, char *error)
{
	size_t index;
	json_t *port;
	json_auto_t *root = load(path, error);

	if (!root)
		return -1;

	json_t *ports = json_object_get(root, "port");

	if (!json_is_array(ports))
		return fail(error, "port: expected an array (the project report, figure 4.8)");
	json_array_foreach(ports, index, port)
	{
		char place[32];
		long active;

		snprintf(place, sizeof place, "port[%zu]", index);
		if (get_integer(port, place, "active", 0, 1, &active, error) ||
		    (active && (serves_tcp || !json_object_get(port, "host")) &&
		     load_line(plant, port, place, latency_ns, error)))
			return -1;
	}
	return 0;
}

/* ---- initial values ---------------------------------------------------------------------- */

static int load_value(struct slave *slave, enum slave_table table, const char *where, const char *address,
		      json_t *value, char *error)
{
	long cell;

	if (!plant_number(address, 0, SLAVE_TABLE_CELLS - 1, &cell) || !slave_exists(slave, table, cell))
		return fail(error, "%s: the configuration has no address \"%s\" there", where, address);
	if (!json_is_integer(value) || !slave_set(slave, table, cell, (long)json_integer_value(value)))
		return fail(error, "%s.%s: expected an integer %s", where, address,
			    slave_table_has_bits(table) ? "0 or 1" : "-32768 to 65535");
	return 0;
}

static int load_slave_values(struct slave *slave, const char *name, json_t *tables, char *error)
{
	const char *table_name, *address;
	json_t *cells, *value;

	json_object_foreach(tables, table_name, cells)
	{
		const enum slave_table table = slave_table_named(table_name);
		char where[64];

		if (table == SLAVE_TABLES)
			return fail(
			    error,
			    "%s: unknown table \"%s\", expected coils, discrete_inputs, input_registers or "
			    "holding_registers",
			    name, table_name);
		snprintf(where, sizeof where, "%s.%s", name, table_name);
		json_object_foreach(cells, address, value)
		{
			if (load_value(slave, table, where, address, value, error))
				return -1;
		}
	}
	return 0;
}

int plant_load_values(struct plant *plant, const char *path, char *error)
{
	const char *name;
	json_t *tables;
	json_auto_t *root = load(path, error);

	if (!root)
		return -1;
	if (!json_is_object(root))
		return fail(error, "expected an object with a member for each slave");
	json_object_foreach(root, name, tables)
	{
		struct slave *slave = plant_slave(plant, name);

		if (!slave)
			return fail(error,
				    "the configuration has no slave \"%s\" (port.unit) on an active port",
				    name);
		if (load_slave_values(slave, name, tables, error))
			return -1;
	}
	return 0;
}

/* ---- finding ----------------------------------------------------------------------------- */

struct line *plant_line(struct plant *plant, const char *port)
{
	long number;

	if (!plant_number(port, 1, PORT_MAX, &number))
		return NULL;
	for (size_t i = 0; i < plant->line_count; i++)
		if (plant->lines[i].port == number)
			return &plant->lines[i];
	return NULL;
}

struct slave *plant_slave(struct plant *plant, const char *name)
{
	const char *dot = strchr(name, '.');
	char port[8];
	long unit;

	if (!dot || dot - name >= (long)sizeof port || !plant_number(dot + 1, 0, SLAVE_UNIT_MAX, &unit))
		return NULL;
	memcpy(port, name, (size_t)(dot - name));
	port[dot - name] = '\0';

	struct line *line = plant_line(plant, port);

	return line ? line->slaves[unit] : NULL;
}
