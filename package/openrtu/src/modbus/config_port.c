/* SPDX-License-Identifier: GPL-3.0-or-later */
/* One port, and the line it becomes. */

#include <string.h>

#include "config/address.h"
#include "modbus/config_loader.h"

#define COUNT(array) (sizeof(array) / sizeof((array)[0]))

#define KEY_HOST      "host"
#define KEY_TCP_PORT  "tcp_port"
#define KEY_SETTLE    "settle_ms"
#define KEY_FRAMING   "framing"
#define KEY_TRANSPORT "transport"

#define TCP_PORT_DEFAULT 502
#define DATA_BITS_RTU    8
#define DATA_BITS_ASCII  7      /* at least */
#define BOARD_BAUD_MAX   460800 /* the last usual speed below its transceivers' 500 kbit/s */

/* The report's /dev names of ports 1 to 6: the NUC980's UARTs behind the board's RS-485 terminals. */
static const char *const board_devices[] = {"ttyS1", "ttyS2", "ttyS3", "ttyS4", "ttyS6", "ttyS8"};

/* The kernel holds the delays to 100 ms. */
enum { RS485_RTS_ON_SEND, RS485_DELAY_BEFORE, RS485_DELAY_AFTER, RS485_KEYS };
static const char *const levels[] = {"high", "low", NULL};
static const struct config_rule rs485_rules[RS485_KEYS] = {
    [RS485_RTS_ON_SEND] = {"rts_on_send", CONFIG_CHOICE, .page = true, .choices = levels,
			   CONFIG_SAYS("Level of the RTS pin while sending.")},
    [RS485_DELAY_BEFORE] = {"delay_before_ms", CONFIG_INTEGER, .page = true, .low = 0, .high = 100,
			    CONFIG_SAYS(
				"Milliseconds from the switch of direction to the first character sent.")},
    [RS485_DELAY_AFTER] = {"delay_after_ms", CONFIG_INTEGER, .page = true, .low = 0, .high = 100,
			   CONFIG_SAYS(
			       "Milliseconds from the last character sent to the switch of direction.")},
};
static const struct config_inside modbus_rs485_inside = {.rules = rs485_rules, .count = RS485_KEYS};
CONFIG_TABLE(rs485_table, .name = "rs485", .rules = rs485_rules, .count = RS485_KEYS);

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
	PORT_RS485,
	PORT_FRAMING,
	PORT_PASS,
	PORT_KEYS,
	PORT_HOST = PORT_KEYS, /* the keys of Modbus TCP, of a port that is not active */
	PORT_TCP_PORT,
	PORT_SETTLE,
	PORT_TRANSPORT,
	INACTIVE_PORT_KEYS
};
enum { LINE_RTU, LINE_ASCII };
static const char *const line_framings[] = {[LINE_RTU] = "rtu", [LINE_ASCII] = "ascii", NULL};
static const struct config_rule port_rules[PORT_KEYS] = {
    [PORT_VALUE] =
	{"value", CONFIG_INTEGER, .page = true, .stays = true, .required = true, .low = 1,
	 .high = MODBUS_PORTS_MAX,
	 CONFIG_SAYS(
	     "Number of the port, once in the file. 1 to 6 are the board's; beyond, device is needed.")},
    [PORT_ACTIVE] = {"active", CONFIG_INTEGER, .page = true, .stays = true, .required = true, .low = 0,
		     .high = 1,
		     CONFIG_SAYS("1: the line is used; 0: it is not, and nothing else of the port counts.")},
    [PORT_BAUD_RATE] =
	{"baud_rate", CONFIG_INTEGER, .page = true, .required = true, .low = 300, .high = 4000000,
	 CONFIG_SAYS(
	     "Bit/s. Without a `device` at most 460800: the transceivers of the board end at 500 kbit/s.",
	     .unit = "bit/s")},
    [PORT_DATA_BITS] = {"data_bits", CONFIG_INTEGER, .page = true, .required = true, .low = 4, .high = 8,
			CONFIG_SAYS(
			    "Data bits of a character. Modbus RTU sends whole bytes, so only 8 will do; of "
			    "ASCII, 7 or 8.",
			    .json = CONFIG_JSON({"minimum" : 7}))},
    [PORT_STOP_BITS] = {"stop_bits", CONFIG_INTEGER, .page = true, .required = true, .low = 1, .high = 2,
			CONFIG_SAYS("Stop bits of a character.")},
    [PORT_PARITY] = {"parity", CONFIG_INTEGER, .page = true, .required = true, .low = 0, .high = 2,
		     CONFIG_SAYS("0: none, 1: odd, 2: even.")},
    [PORT_SLAVES] = {MODBUS_KEY_SLAVES, CONFIG_ARRAY, .page = true, .inside = &modbus_slave_inside,
		     .required = true, .high = MODBUS_UNIT_MAX + 1,
		     CONFIG_SAYS("The Modbus devices on the line.", .table = &modbus_slave_table)},
    [PORT_DEVICE] = {"device", CONFIG_TEXT, .low = 1, .high = MODBUS_PATH_SIZE - 1,
		     CONFIG_SAYS("Serial device, absolute or below rtud's --dev directory. Without it, ports "
				 "1 to 6 are ttyS1, ttyS2, ttyS3, ttyS4, ttyS6 and ttyS8.")},
    [PORT_PROCESS] = {"process", CONFIG_INTEGER, .low = 1, .high = 6, .fallback = 1,
		      CONFIG_SAYS("Lines with one number share one rtu-modbus process.")},
    [PORT_RS485] = {"rs485", CONFIG_OBJECT, .page = true, .inside = &modbus_rs485_inside,
		    CONFIG_SAYS("The port's driver switches an RS-485 transceiver with its RTS pin. Without "
				"it, the transceiver finds the direction itself, as those of the board do.",
				.table = &rs485_table)},
    [PORT_FRAMING] = {KEY_FRAMING, CONFIG_CHOICE, .page = true, .choices = line_framings,
		      .fallback = LINE_RTU,
		      CONFIG_SAYS(
			  "How frames stand on the line: rtu, as octets with a CRC, or ascii, as text.",
			  .see = "configuration.md#ascii")},
    [PORT_PASS] = {MODBUS_KEY_PASS, CONFIG_OBJECT,
		   CONFIG_SAYS(
		       "What a tool of the devices' maker may ask through this line. Not given: nothing, "
		       "and nobody can connect.",
		       .see = "configuration.md#pass-through", .table = &modbus_pass_table)},
};
CONFIG_SHARED_TABLE(
    modbus_port_table, .name = "port", .rules = port_rules, .count = PORT_KEYS,
    .json = CONFIG_JSON({
	    "allOf" : [
		    {
			    "if" : {
				    "anyOf" : [
					    {
						    "required" : ["value"],
						    "properties" :
							{"value" : {"type" : "integer", "minimum" : 7}}
					    },
					    {
						    "required" : ["baud_rate"],
						    "properties" : {
							    "baud_rate" :
								{"type" : "integer", "minimum" : 460801}
						    }
					    }
				    ]
			    },
			    "then" : {"required" : ["device"]}
		    },
		    {
			    "if" :
				{"required" : ["framing"], "properties" : {"framing" : {"const" : "ascii"}}},
			    "else" : {"properties" : {"data_bits" : {"minimum" : 8}}}
		    }
	    ]
    }));
/* Figure 4.8: the parameters of a port that is not active are zeros and mean nothing. */
static const struct config_rule inactive_port_rules[INACTIVE_PORT_KEYS] = {
    [PORT_VALUE] = {"value", CONFIG_INTEGER, .page = true, .required = true, .low = 1,
		    .high = MODBUS_PORTS_MAX},
    [PORT_ACTIVE] = {"active", CONFIG_INTEGER, .page = true, .required = true, .low = 0, .high = 1},
    [PORT_BAUD_RATE] = {"baud_rate", CONFIG_ANYTHING, .page = true},
    [PORT_DATA_BITS] = {"data_bits", CONFIG_ANYTHING, .page = true},
    [PORT_STOP_BITS] = {"stop_bits", CONFIG_ANYTHING, .page = true},
    [PORT_PARITY] = {"parity", CONFIG_ANYTHING, .page = true},
    [PORT_SLAVES] = {MODBUS_KEY_SLAVES, CONFIG_ANYTHING, .page = true, .inside = &modbus_slave_inside},
    [PORT_DEVICE] = {"device", CONFIG_ANYTHING},
    [PORT_PROCESS] = {"process", CONFIG_ANYTHING},
    [PORT_RS485] = {"rs485", CONFIG_ANYTHING, .page = true, .inside = &modbus_rs485_inside},
    [PORT_HOST] = {KEY_HOST, CONFIG_ANYTHING, .page = true},
    [PORT_TCP_PORT] = {KEY_TCP_PORT, CONFIG_ANYTHING, .page = true},
    [PORT_SETTLE] = {KEY_SETTLE, CONFIG_ANYTHING, .page = true},
    [PORT_TRANSPORT] = {KEY_TRANSPORT, CONFIG_ANYTHING, .page = true},
    [PORT_FRAMING] = {KEY_FRAMING, CONFIG_ANYTHING, .page = true},
    [PORT_PASS] = {MODBUS_KEY_PASS, CONFIG_ANYTHING},
};

CONFIG_SHARED_TABLE(modbus_inactive_table, .name = "inactive_port", .rules = inactive_port_rules,
		    .count = INACTIVE_PORT_KEYS,
		    .json = CONFIG_JSON({
			    "description" : "Only value and active count; figure 4.8 has zeros for the rest.",
			    "properties" : {"active" : {"const" : 0}}
		    }));

/* A Modbus TCP connection has nothing of a serial port, and none of the board's numbers. */
enum {
	TCP_VALUE,
	TCP_ACTIVE,
	TCP_HOST,
	TCP_PORT,
	TCP_SLAVES,
	TCP_PROCESS,
	TCP_SETTLE,
	TCP_FRAMING,
	TCP_TRANSPORT,
	TCP_PASS,
	TCP_KEYS
};
static const char *const framings[] = {
    [MODBUS_FRAMING_RTU] = "rtu", [MODBUS_FRAMING_TCP] = "tcp", [MODBUS_FRAMING_ASCII] = "ascii", NULL};
static const char *const transports[] = {[MODBUS_OVER_TCP] = "tcp", [MODBUS_OVER_UDP] = "udp", NULL};
static const struct config_rule tcp_rules[TCP_KEYS] = {
    [TCP_VALUE] =
	{"value", CONFIG_INTEGER, .page = true, .stays = true, .required = true,
	 .low = COUNT(board_devices) + 1, .high = MODBUS_PORTS_MAX,
	 CONFIG_SAYS(
	     "Number of the connection, which is a port like others, once in the file; 1 to 6 are serial.")},
    [TCP_ACTIVE] = {"active", CONFIG_INTEGER, .page = true, .stays = true, .required = true, .low = 0,
		    .high = 1,
		    CONFIG_SAYS("1: the connection is used; 0: it is not, and nothing else of it counts.")},
    [TCP_HOST] = {KEY_HOST, CONFIG_TEXT, .page = true, .stays = true, .required = true, .low = 1,
		  .high = MAP_ADDRESS_SIZE - 1,
		  CONFIG_SAYS("IPv4 or IPv6 address of the device, or of the gateway before its devices. Not "
			      "a name: to look it up may take long.",
			      .json = CONFIG_JSON({
				      "anyOf" : [ {"format" : "ipv4"}, {"format" : "ipv6"} ],
				      "examples" : [ "192.0.2.7", "2001:db8::7" ]
			      }))},
    [TCP_PORT] = {KEY_TCP_PORT, CONFIG_INTEGER, .page = true, .stays = true, .low = 1, .high = UINT16_MAX,
		  .fallback = TCP_PORT_DEFAULT,
		  CONFIG_SAYS("TCP port; with transport udp, the port of UDP.")},
    [TCP_SLAVES] = {MODBUS_KEY_SLAVES, CONFIG_ARRAY, .page = true, .inside = &modbus_slave_inside,
		    .required = true, .high = MODBUS_UNIT_MAX + 1,
		    CONFIG_SAYS("The Modbus devices behind it.", .table = &modbus_tcp_slave_table)},
    [TCP_PROCESS] = {"process", CONFIG_INTEGER, .low = 1, .high = 6, .fallback = 1,
		     CONFIG_SAYS("Lines with one number share one rtu-modbus process.")},
    [TCP_SETTLE] = {KEY_SETTLE, CONFIG_INTEGER, .page = true, .low = 0, .high = 10000, .fallback = 0,
		    CONFIG_SAYS(
			"Milliseconds between a connection and the first request on it, at least. A longer "
			"time that the peer needs is learned.",
			.see = "limit.md#connections")},
    [TCP_FRAMING] =
	{KEY_FRAMING, CONFIG_CHOICE, .page = true, .choices = framings, .fallback = MODBUS_FRAMING_TCP,
	 CONFIG_SAYS(
	     "How frames stand on the connection: tcp, with the header of Modbus TCP; rtu or ascii, as "
	     "on a serial line: of a serial device server that passes on what it is sent. "
	     "Then the slaves are those of a line, and id 0 is the broadcast.",
	     .see = "configuration.md#rtu-over-tcp")},
    [TCP_TRANSPORT] = {KEY_TRANSPORT, CONFIG_CHOICE, .page = true, .choices = transports,
		       .fallback = MODBUS_OVER_TCP,
		       CONFIG_SAYS("What carries the frames: tcp, a connection, or udp, a datagram each.",
				   .see = "configuration.md#modbus-udp")},
    [TCP_PASS] = {MODBUS_KEY_PASS, CONFIG_OBJECT,
		  CONFIG_SAYS(
		      "What a tool of the devices' maker may ask through this line. Not given: nothing, "
		      "and nobody can connect.",
		      .see = "configuration.md#pass-through", .table = &modbus_pass_table)},
};
CONFIG_SHARED_TABLE(
    modbus_tcp_table, .name = "tcp_connection", .rules = tcp_rules, .count = TCP_KEYS,
    .json = CONFIG_JSON({
	    "if" : {"required" : ["framing"], "properties" : {"framing" : {"enum" : [ "rtu", "ascii" ]}}},
	    "then" : {
		    "properties" :
			{"slaves" : {"items" : {"$ref" : "#/$defs/slave"}},
			 "transport" : {"const" : "tcp"}}
	    }
    }));

/* A port may become another kind of port, so each may have the keys of all. */
static const struct config_inside tcp_inside = {.rules = tcp_rules, .count = TCP_KEYS};
const struct config_inside modbus_port_inside = {
    .rules = port_rules, .count = PORT_KEYS, .further = &tcp_inside};

static bool is_inactive(const json_t *port)
{
	const json_t *active = json_object_get(port, port_rules[PORT_ACTIVE].name);

	return json_is_integer(active) && json_integer_value(active) == 0;
}

static void claim_value(struct modbus_loader *loader, const struct config_place *port,
			const struct config_value *value)
{
	const struct config_place here = config_key_of(port, port_rules[PORT_VALUE].name);
	size_t *claimed;

	if (!value->given)
		return;
	claimed = &loader->port_of[value->integer];
	if (*claimed != 0)
		config_error(loader->report, &here, "%lld is already the value of port[%zu]",
			     (long long)value->integer, *claimed - 1);
	else
		*claimed = port->index + 1;
}

static void check_data_bits(struct modbus_loader *loader, const struct config_place *port,
			    const struct config_value *values)
{
	const struct config_place here = config_key_of(port, port_rules[PORT_DATA_BITS].name);
	const struct config_value *value = &values[PORT_DATA_BITS];
	const bool is_text = values[PORT_FRAMING].integer == LINE_ASCII;

	if (!value->given || value->integer == DATA_BITS_RTU)
		return;
	if (!is_text)
		config_error(loader->report, &here, "%lld, expected %d: Modbus RTU sends whole bytes",
			     (long long)value->integer, DATA_BITS_RTU);
	else if (value->integer < DATA_BITS_ASCII)
		config_error(loader->report, &here, "%lld, expected %d or %d: Modbus ASCII sends text",
			     (long long)value->integer, DATA_BITS_ASCII, DATA_BITS_RTU);
}

static void check_baud_rate(struct modbus_loader *loader, const struct config_place *port,
			    const struct config_value *values)
{
	const struct config_place here = config_key_of(port, port_rules[PORT_BAUD_RATE].name);

	if (values[PORT_BAUD_RATE].integer > BOARD_BAUD_MAX && !values[PORT_DEVICE].given)
		config_error(
		    loader->report, &here,
		    "%lld, expected at most %d: the board's transceivers end at 500 kbit/s, a faster port "
		    "needs a device",
		    (long long)values[PORT_BAUD_RATE].integer, BOARD_BAUD_MAX);
}

/* The path of the port's serial device, NULL when the file does not say it. */
static const char *port_device(struct modbus_loader *loader, const struct config_place *port,
			       const struct config_value *values)
{
	const struct config_place here = config_key_of(port, port_rules[PORT_DEVICE].name);
	int64_t value = values[PORT_VALUE].integer;

	if (values[PORT_DEVICE].given)
		return values[PORT_DEVICE].text;
	if (values[PORT_DEVICE].wrong || !values[PORT_VALUE].given)
		return NULL;
	if (value <= (int64_t)COUNT(board_devices))
		return board_devices[value - 1];
	config_error(loader->report, &here,
		     "is missing: the board has only ports 1 to %zu, expected a device "
		     "name for port %lld",
		     COUNT(board_devices), (long long)value);
	return NULL;
}

static void claim_device(struct modbus_loader *loader, const struct config_place *port, const char *device)
{
	const struct config_place here = config_key_of(port, port_rules[PORT_DEVICE].name);
	const struct map_config *config = loader->config;

	for (uint32_t line = 0; device != NULL && line < modbus_port_count(config); line++)
		if (!modbus_is_tcp(&modbus_ports(config)[line]) &&
		    strcmp(modbus_ports(config)[line].device, device) == 0)
			config_error(loader->report, &here, "%s is already the device of port[%u]", device,
				     loader->port_of_line[line]);
}

static void add_line(struct modbus_loader *loader, const struct config_place *port,
		     const struct config_value *values, const char *device)
{
	struct map_config *config = loader->config;
	struct modbus_port *line = map_next_record(config, MODBUS_PORTS);

	*line = (struct modbus_port){
	    .port = (uint16_t)values[PORT_VALUE].integer,
	    .process = (uint16_t)values[PORT_PROCESS].integer,
	    .first_device = (uint16_t)config->set_count,
	    .data_bits = (uint8_t)values[PORT_DATA_BITS].integer,
	    .framing = values[PORT_FRAMING].integer == LINE_ASCII ? MODBUS_FRAMING_ASCII : MODBUS_FRAMING_RTU,
	    .stop_bits = (uint8_t)values[PORT_STOP_BITS].integer,
	    .parity = (uint8_t)values[PORT_PARITY].integer,
	    .baud = (uint32_t)values[PORT_BAUD_RATE].integer,
	};
	if (device != NULL)
		snprintf(line->device, sizeof(line->device), "%s", device);
	loader->port_of_line[modbus_port_count(config) - 1] = (uint32_t)port->index;
}

static void read_rs485(struct modbus_loader *loader, const struct config_place *port, const json_t *json,
		       struct modbus_port *line)
{
	const struct config_place place = config_key_of(port, port_rules[PORT_RS485].name);
	struct config_value values[RS485_KEYS];

	config_read_keys(loader->report, &place, json, rs485_rules, RS485_KEYS, values);
	line->rs485 = values[RS485_RTS_ON_SEND].integer == 0 ? MODBUS_RS485_HIGH : MODBUS_RS485_LOW;
	line->before_ms = (uint8_t)values[RS485_DELAY_BEFORE].integer;
	line->after_ms = (uint8_t)values[RS485_DELAY_AFTER].integer;
}

static void read_inactive_port(struct modbus_loader *loader, const struct config_place *place,
			       const json_t *json)
{
	struct config_value values[INACTIVE_PORT_KEYS];
	size_t slaves;

	config_read_keys(loader->report, place, json, inactive_port_rules, INACTIVE_PORT_KEYS, values);
	claim_value(loader, place, &values[PORT_VALUE]);
	slaves = json_array_size(values[PORT_SLAVES].json);
	if (slaves > 0)
		config_note(loader->report, place,
			    "not active, its slaves (%zu) are not polled and have no points", slaves);
}

static void read_active_port(struct modbus_loader *loader, const struct config_place *place,
			     const json_t *json)
{
	struct config_value values[PORT_KEYS];
	const char *device;

	config_read_keys(loader->report, place, json, port_rules, PORT_KEYS, values);
	claim_value(loader, place, &values[PORT_VALUE]);
	check_data_bits(loader, place, values);
	check_baud_rate(loader, place, values);
	device = port_device(loader, place, values);
	claim_device(loader, place, device);
	add_line(loader, place, values, device);
	if (values[PORT_RS485].given)
		read_rs485(loader, place, values[PORT_RS485].json,
			   &modbus_ports(loader->config)[modbus_port_count(loader->config) - 1]);
	if (values[PORT_SLAVES].given)
		modbus_read_slaves(loader, place, values[PORT_SLAVES].json);
	if (values[PORT_PASS].given)
		modbus_read_pass(loader, place, port_rules[PORT_PASS].name, values[PORT_PASS].json);
}

static bool is_tcp(const json_t *port)
{
	return json_object_get(port, KEY_HOST) != NULL || json_object_get(port, KEY_TCP_PORT) != NULL;
}

static void check_transport(struct modbus_loader *loader, const struct config_place *port,
			    const struct config_value *values)
{
	const struct config_place framing = config_key_of(port, KEY_FRAMING);

	if (values[TCP_TRANSPORT].integer == MODBUS_OVER_UDP &&
	    values[TCP_FRAMING].integer != MODBUS_FRAMING_TCP)
		config_error(loader->report, &framing,
			     "%s is not carried by UDP here, expected tcp, or transport tcp",
			     framings[values[TCP_FRAMING].integer]);
}

/* Many devices take one connection only, and all units behind it share that. */
static void claim_host(struct modbus_loader *loader, const struct config_place *host,
		       const struct modbus_port *line)
{
	for (const struct modbus_port *other = modbus_ports(loader->config); other < line; other++)
		if (other->tcp_port == line->tcp_port && other->transport == line->transport &&
		    config_is_same_address(other->device, line->device))
			config_error(loader->report, host, "%s port %u is already that of port[%u]",
				     line->device, line->tcp_port,
				     loader->port_of_line[other - modbus_ports(loader->config)]);
}

static void read_tcp_port(struct modbus_loader *loader, const struct config_place *place, const json_t *json)
{
	const struct config_place host = config_key_of(place, KEY_HOST);
	struct config_value values[TCP_KEYS];
	struct map_config *config = loader->config;
	struct modbus_port *line;

	config_read_keys(loader->report, place, json, tcp_rules, TCP_KEYS, values);
	check_transport(loader, place, values);
	claim_value(loader, place, &values[TCP_VALUE]);
	line = map_next_record(config, MODBUS_PORTS);
	*line = (struct modbus_port){
	    .port = (uint16_t)values[TCP_VALUE].integer,
	    .process = (uint16_t)values[TCP_PROCESS].integer,
	    .first_device = (uint16_t)config->set_count,
	    .settle_ms = (uint16_t)values[TCP_SETTLE].integer,
	    .framing = (uint8_t)values[TCP_FRAMING].integer,
	    .transport = (uint8_t)values[TCP_TRANSPORT].integer,
	    .tcp_port = values[TCP_PORT].wrong ? TCP_PORT_DEFAULT : (uint16_t)values[TCP_PORT].integer,
	};
	if (values[TCP_HOST].given) {
		config_read_address(loader->report, &host, values[TCP_HOST].text, line->device);
		claim_host(loader, &host, line);
	}
	loader->port_of_line[modbus_port_count(config) - 1] = (uint32_t)place->index;
	if (values[TCP_SLAVES].given)
		modbus_read_slaves(loader, place, values[TCP_SLAVES].json);
	if (values[TCP_PASS].given)
		modbus_read_pass(loader, place, tcp_rules[TCP_PASS].name, values[TCP_PASS].json);
}

void modbus_read_ports(struct modbus_loader *loader, const struct config_place *file, const json_t *ports)
{
	const struct config_place array = config_key_of(file, MODBUS_KEY_PORTS);
	const json_t *json;
	size_t i;

	json_array_foreach(ports, i, json)
	{
		const struct config_place place = config_element_of(&array, i);

		if (is_inactive(json))
			read_inactive_port(loader, &place, json);
		else if (is_tcp(json))
			read_tcp_port(loader, &place, json);
		else
			read_active_port(loader, &place, json);
	}
}
