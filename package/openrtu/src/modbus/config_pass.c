/* SPDX-License-Identifier: GPL-3.0-or-later */
/* What of a line is open to a tool of the devices' maker: the object pass_through of a port. */
#include <string.h>

#include "config/address.h"
#include "modbus/config_loader.h"
#include "modbus/line.h"

#define FUNCTION_MAX      127
#define CONNECTIONS_USUAL 2
#define SHARE_USUAL       10
#define SHARE_MAX         50

enum {
	PASS_ADDRESS,
	PASS_TCP_PORT,
	PASS_UNITS,
	PASS_FUNCTIONS,
	PASS_WRITE_FUNCTIONS,
	PASS_CONNECTIONS,
	PASS_SHARE,
	PASS_KEYS
};
static const struct config_rule pass_rules[PASS_KEYS] = {
    [PASS_ADDRESS] = {"address", CONFIG_TEXT, .required = true, .low = 1, .high = MAP_ADDRESS_SIZE - 1,
		      CONFIG_SAYS(
			  "IP address of the gateway at which the tool connects. Whoever reaches it may "
			  "ask what is allowed here: nobody is asked who he is.",
			  .json = CONFIG_JSON({
				  "anyOf" : [ {"format" : "ipv4"}, {"format" : "ipv6"} ],
				  "examples" : [ "127.0.0.1", "192.0.2.1" ]
			  }))},
    [PASS_TCP_PORT] = {"tcp_port", CONFIG_INTEGER, .low = 1, .high = UINT16_MAX, .fallback = 502,
		       CONFIG_SAYS("TCP port at which it listens.")},
    [PASS_UNITS] =
	{"units", CONFIG_ARRAY, .required = true, .high = MODBUS_UNIT_MAX + 1,
	 CONFIG_SAYS("Ids of the slaves of this port that may be asked. One without objects is passed on "
		     "to, and not polled.",
		     .json = CONFIG_JSON(
			 {"minItems" : 1, "items" : {"type" : "integer", "minimum" : 0, "maximum" : 255}}))},
    [PASS_FUNCTIONS] =
	{"functions", CONFIG_ARRAY, .high = FUNCTION_MAX,
	 CONFIG_SAYS("Functions that may be asked for and change nothing: of 1, 2, 3, 4, 7, 11, "
		     "12, 17, 20, 24 and 43. Not given: 1 to 4. Of 43, device identification.",
		     .json = CONFIG_JSON({"items" : {"enum" : [ 1, 2, 3, 4, 7, 11, 12, 17, 20, 24, 43 ]}}))},
    [PASS_WRITE_FUNCTIONS] =
	{"write_functions", CONFIG_ARRAY, .high = FUNCTION_MAX,
	 CONFIG_SAYS("Functions that may be asked for and may change something: any other one, as "
		     "5, 6, 8, 15, 16, 22 and 23. Not given: none. Each such request is logged.",
		     .json = CONFIG_JSON({
			     "items" : {
				     "type" : "integer",
				     "minimum" : 5,
				     "maximum" : 127,
				     "not" : {"enum" : [ 7, 11, 12, 17, 20, 24 ]}
			     }
		     }))},
    [PASS_CONNECTIONS] = {"connections", CONFIG_INTEGER, .low = 1, .high = MODBUS_PASS_CONNECTIONS_MAX,
			  .fallback = CONNECTIONS_USUAL,
			  CONFIG_SAYS("Connections at a time; of each, one request is under way.")},
    [PASS_SHARE] = {"share_percent", CONFIG_INTEGER, .low = 1, .high = SHARE_MAX, .fallback = SHARE_USUAL,
		    CONFIG_SAYS("Percent of the line's time that all of it may take at most.", .unit = "%")},
};
CONFIG_SHARED_TABLE(modbus_pass_table, .name = "pass_through", .rules = pass_rules, .count = PASS_KEYS);

static void put(uint8_t *bits, int64_t number)
{
	bits[number / 8] |= (uint8_t)(1u << number % 8);
}

/* ---- whom may be asked ----------------------------------------------------------------------- */

static bool has_slave(const struct map_config *config, const struct modbus_port *line, int64_t unit)
{
	for (uint32_t i = 0; i < line->device_count; i++)
		if (modbus_slaves(config)[line->first_device + i].unit == unit)
			return true;
	return false;
}

static void read_units(struct modbus_loader *loader, const struct config_place *array, const json_t *units,
		       const struct modbus_port *line, struct modbus_pass *pass)
{
	const json_t *json;
	size_t i;

	if (json_array_size(units) == 0)
		config_error(loader->report, array, "is empty, expected ids of slaves of this port");
	json_array_foreach(units, i, json)
	{
		const struct config_place place = config_element_of(array, i);
		const json_int_t unit = json_integer_value(json);

		if (!json_is_integer(json) || !has_slave(loader->config, line, unit))
			config_error(loader->report, &place,
				     "is not the id of a slave of this port, expected one: a slave may have "
				     "no objects");
		else if (unit == MODBUS_BROADCAST && line->framing != MODBUS_FRAMING_TCP)
			config_error(loader->report, &place,
				     "0 is the broadcast, which no device answers, expected another id");
		else
			put(pass->units, unit);
	}
}

/* ---- what may be asked ----------------------------------------------------------------------- */

static bool is_reading(int64_t function)
{
	const uint8_t body[] = {0, (uint8_t)function, MODBUS_IDENTIFICATION};

	return modbus_reads_only(body, sizeof(body));
}

static void read_function(struct modbus_loader *loader, const struct config_place *place, const json_t *json,
			  bool reading, uint8_t *bits)
{
	const json_int_t function = json_integer_value(json);

	if (!json_is_integer(json) || function < 1 || function > FUNCTION_MAX)
		config_error(loader->report, place, "is not a function of Modbus, expected 1 to %d",
			     FUNCTION_MAX);
	else if (reading && !is_reading(function))
		config_error(loader->report, place,
			     "function %lld may change something, expected it in write_functions",
			     (long long)function);
	else if (!reading && is_reading(function) && function != MODBUS_ENCAPSULATED)
		config_error(loader->report, place, "function %lld changes nothing, expected it in functions",
			     (long long)function);
	else
		put(bits, function);
}

static void read_functions(struct modbus_loader *loader, const struct config_place *pass, unsigned key,
			   const struct config_value *value, uint8_t *bits)
{
	const struct config_place array = config_key_of(pass, pass_rules[key].name);
	const json_t *json;
	size_t i;

	json_array_foreach(value->json, i, json)
	{
		const struct config_place place = config_element_of(&array, i);

		read_function(loader, &place, json, key == PASS_FUNCTIONS, bits);
	}
}

/* ---------------------------------------------------------------------------------------------- */

/* rtud hands one socket to a process. */
static void claim_process(struct modbus_loader *loader, const struct config_place *place,
			  const struct modbus_port *line)
{
	const struct map_config *config = loader->config;
	const uint32_t last = map_record_count(config, MODBUS_PASSES) - 1;

	for (uint32_t i = 0; i < last; i++)
		if (modbus_ports(config)[modbus_passes(config)[i].port].process == line->process)
			config_error(
			    loader->report, place,
			    "process %u listens for port[%u] already, expected another process of this port",
			    line->process, loader->port_of_line[modbus_passes(config)[i].port]);
}

void modbus_read_pass(struct modbus_loader *loader, const struct config_place *port, const char *key,
		      const json_t *json)
{
	const struct config_place place = config_key_of(port, key);
	const struct config_place address = config_key_of(&place, pass_rules[PASS_ADDRESS].name);
	const struct config_place units = config_key_of(&place, pass_rules[PASS_UNITS].name);
	const uint32_t number = modbus_port_count(loader->config) - 1;
	const struct modbus_port *line = &modbus_ports(loader->config)[number];
	struct modbus_pass *pass = map_next_record(loader->config, MODBUS_PASSES);
	struct config_value values[PASS_KEYS];

	config_read_keys(loader->report, &place, json, pass_rules, PASS_KEYS, values);
	*pass = (struct modbus_pass){.port = number,
				     .tcp_port = (uint16_t)values[PASS_TCP_PORT].integer,
				     .connections = (uint8_t)values[PASS_CONNECTIONS].integer,
				     .share = (uint8_t)values[PASS_SHARE].integer};
	claim_process(loader, &place, line);
	if (values[PASS_ADDRESS].given)
		config_read_address(loader->report, &address, values[PASS_ADDRESS].text, pass->address);
	if (values[PASS_UNITS].given)
		read_units(loader, &units, values[PASS_UNITS].json, line, pass);
	if (values[PASS_FUNCTIONS].given)
		read_functions(loader, &place, PASS_FUNCTIONS, &values[PASS_FUNCTIONS], pass->functions);
	else
		for (uint8_t i = MODBUS_READ_COILS; i <= MODBUS_READ_INPUT_REGISTERS; i++)
			put(pass->functions, i);
	if (values[PASS_WRITE_FUNCTIONS].given)
		read_functions(loader, &place, PASS_WRITE_FUNCTIONS, &values[PASS_WRITE_FUNCTIONS],
			       pass->write_functions);
}
