/* SPDX-License-Identifier: GPL-3.0-or-later */
/* The file's outermost object, and the settings: what belongs to no port. */
#include "map/map.h"
#include "rtud/config_parts.h"

#define EVENT_RING_LEAST  64
#define SECONDS_OF_2_DAYS 172800
#define ORIGINATORS       256
#define PORT_PLAIN        2404
#define PORT_TLS          19998 /* IANA: iec-104-sec */

static const char *const clocks[] = {
    [MAP_CLOCK_GATEWAY] = "gateway", [MAP_CLOCK_MASTERS] = "masters", [MAP_CLOCK_SYSTEM] = "system", NULL};

enum {
	FILE_PORT,
	FILE_IEC104,
	FILE_TLS,
	FILE_CLOCK,
	FILE_TIMEZONE,
	FILE_MODBUS,
	FILE_EVENT_RING,
	FILE_MASTERS,
	FILE_GROUPS,
	FILE_ORIGINATORS,
	FILE_JOURNAL,
	FILE_INCLUDE,
	FILE_TEMPLATES,
	FILE_KEYS
};
static const struct config_rule file_rules[FILE_KEYS] = {
    [FILE_PORT] = {CONFIG_KEY_PORTS, CONFIG_ARRAY, .required = true, .high = CONFIG_PORTS_MAX},
    [FILE_IEC104] = {"iec104", CONFIG_OBJECT},
    [FILE_TLS] = {"tls", CONFIG_OBJECT},
    [FILE_CLOCK] = {"clock", CONFIG_CHOICE, .choices = clocks},
    [FILE_TIMEZONE] = {"timezone", CONFIG_TEXT, .low = 4, .high = 63},
    [FILE_MODBUS] = {"modbus", CONFIG_OBJECT},
    [FILE_EVENT_RING] = {"event_ring", CONFIG_INTEGER, .low = EVENT_RING_LEAST, .high = 65536,
			 .fallback = 4096},
    [FILE_MASTERS] = {"masters", CONFIG_ARRAY, .high = MAP_MASTERS_MAX},
    [FILE_GROUPS] = {"redundancy_groups", CONFIG_ARRAY, .high = MAP_GROUPS_MAX},
    [FILE_ORIGINATORS] = {"originators", CONFIG_ARRAY, .high = ORIGINATORS},
    [FILE_JOURNAL] = {"journal", CONFIG_OBJECT},
    [FILE_INCLUDE] = {CONFIG_KEY_INCLUDE, CONFIG_ARRAY, .high = CONFIG_FILES_MAX},
    [FILE_TEMPLATES] = {CONFIG_KEY_TEMPLATES, CONFIG_OBJECT},
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
	IEC104_CONNECTIONS_PER_ADDRESS,
	IEC104_SELECT_TIMEOUT,
	IEC104_COMMAND_TIMEOUT,
	IEC104_COMMAND_WITHOUT_CLOCK,
	IEC104_CLOCK_MASTERS,
	IEC104_OWN_CA,
	IEC104_KEYS
};
static const struct config_rule iec104_rules[IEC104_KEYS] = {
    [IEC104_ADDRESS] = {"address", CONFIG_TEXT, .low = 1, .high = MAP_ADDRESS_SIZE - 1},
    [IEC104_PORT] = {"port", CONFIG_INTEGER, .low = 1, .high = 65535, .fallback = PORT_PLAIN},
    [IEC104_K] = {"k", CONFIG_INTEGER, .low = 1, .high = 32767, .fallback = 12},
    [IEC104_W] = {"w", CONFIG_INTEGER, .low = 1, .high = 32767, .fallback = 8},
    [IEC104_T1] = {"t1", CONFIG_INTEGER, .low = 2, .high = 255, .fallback = 15},
    [IEC104_T2] = {"t2", CONFIG_INTEGER, .low = 1, .high = 254, .fallback = 10},
    [IEC104_T3] = {"t3", CONFIG_INTEGER, .low = 1, .high = SECONDS_OF_2_DAYS, .fallback = 20},
    [IEC104_MAX_CONNECTIONS] = {"max_connections", CONFIG_INTEGER, .low = 1, .high = 16, .fallback = 8},
    [IEC104_CONNECTIONS_PER_ADDRESS] = {"connections_per_address", CONFIG_INTEGER, .low = 1, .high = 16},
    [IEC104_SELECT_TIMEOUT] = {"select_timeout", CONFIG_INTEGER, .low = 1, .high = 3600, .fallback = 30},
    [IEC104_COMMAND_TIMEOUT] = {"command_timeout", CONFIG_INTEGER, .low = 1, .high = 3600, .fallback = 10},
    [IEC104_COMMAND_WITHOUT_CLOCK] = {"command_without_clock", CONFIG_BOOLEAN},
    [IEC104_CLOCK_MASTERS] = {"clock_masters", CONFIG_ARRAY, .high = MAP_CLOCK_MASTERS_MAX},
    [IEC104_OWN_CA] = {"own_ca", CONFIG_INTEGER, .low = 1, .high = 65534},
};

enum { MODBUS_PRIORITY, MODBUS_HEARTBEAT_LIMIT, MODBUS_KEYS };
static const struct config_rule modbus_rules[MODBUS_KEYS] = {
    [MODBUS_PRIORITY] = {"priority", CONFIG_INTEGER, .low = 0, .high = 99, .fallback = 45},
    [MODBUS_HEARTBEAT_LIMIT] = {"heartbeat_limit_ms", CONFIG_INTEGER, .low = MAP_HEARTBEAT_LIMIT_MS,
				.high = MAP_IDLE_HEARTBEAT_LIMIT_MS, .fallback = MAP_HEARTBEAT_LIMIT_MS},
};

/* IEC 60870-5-104, 5.5: w should not exceed two thirds of k; more than k would never be reached. */
static void check_window(struct config_loader *loader, const struct config_place *iec104,
			 const struct config_value *values)
{
	const struct config_place here = config_key_of(iec104, iec104_rules[IEC104_W].name);

	if (!values[IEC104_W].wrong && !values[IEC104_K].wrong &&
	    values[IEC104_W].integer > values[IEC104_K].integer)
		config_error(&loader->report, &here,
			     "%lld is more than k (%lld), expected at most k, better two thirds of it",
			     (long long)values[IEC104_W].integer, (long long)values[IEC104_K].integer);
}

/* IEC 60870-5-104, 9.6: an acknowledgement later than t1 would come when the peer has closed. */
static void check_times(struct config_loader *loader, const struct config_place *iec104,
			const struct config_value *values)
{
	const struct config_place here = config_key_of(iec104, iec104_rules[IEC104_T2].name);

	if (!values[IEC104_T1].wrong && !values[IEC104_T2].wrong &&
	    values[IEC104_T2].integer >= values[IEC104_T1].integer)
		config_error(&loader->report, &here,
			     "%lld s is not shorter than t1 (%lld s), expected less than t1",
			     (long long)values[IEC104_T2].integer, (long long)values[IEC104_T1].integer);
}

/* Without the key half of all, so that no address takes every place. */
static uint16_t connections_per_address(struct config_loader *loader, const struct config_place *iec104,
					const struct config_value *values)
{
	const struct config_value *most = &values[IEC104_MAX_CONNECTIONS],
				  *given = &values[IEC104_CONNECTIONS_PER_ADDRESS];
	const struct config_place here =
	    config_key_of(iec104, iec104_rules[IEC104_CONNECTIONS_PER_ADDRESS].name);

	if (!given->given)
		return (uint16_t)((most->integer + 1) / 2);
	if (!most->wrong && !given->wrong && given->integer > most->integer)
		config_error(&loader->report, &here,
			     "%lld is more than max_connections (%lld), expected at most as many",
			     (long long)given->integer, (long long)most->integer);
	return (uint16_t)given->integer;
}

static void read_iec104(struct config_loader *loader, const struct config_place *file, const json_t *json,
			bool tls)
{
	const struct config_place place = config_key_of(file, file_rules[FILE_IEC104].name);
	const struct config_place address = config_key_of(&place, iec104_rules[IEC104_ADDRESS].name);
	const struct config_place clock_masters =
	    config_key_of(&place, iec104_rules[IEC104_CLOCK_MASTERS].name);
	struct map_settings *settings = &loader->config->settings;
	struct config_value values[IEC104_KEYS];

	config_read_keys(&loader->report, &place, json, iec104_rules, IEC104_KEYS, values);
	check_window(loader, &place, values);
	check_times(loader, &place, values);
	settings->port = tls && !values[IEC104_PORT].given ? PORT_TLS : (uint16_t)values[IEC104_PORT].integer;
	settings->k = (uint16_t)values[IEC104_K].integer;
	settings->w = (uint16_t)values[IEC104_W].integer;
	settings->t1_s = (uint16_t)values[IEC104_T1].integer;
	settings->t2_s = (uint16_t)values[IEC104_T2].integer;
	settings->t3_s = (uint32_t)values[IEC104_T3].integer;
	settings->max_connections = (uint16_t)values[IEC104_MAX_CONNECTIONS].integer;
	settings->connections_per_address = connections_per_address(loader, &place, values);
	settings->select_timeout_s = (uint16_t)values[IEC104_SELECT_TIMEOUT].integer;
	settings->command_timeout_s = (uint16_t)values[IEC104_COMMAND_TIMEOUT].integer;
	settings->command_without_clock = values[IEC104_COMMAND_WITHOUT_CLOCK].integer != 0;
	settings->own_ca = (uint16_t)values[IEC104_OWN_CA].integer;
	if (!values[IEC104_ADDRESS].wrong)
		config_read_address(loader, &address,
				    values[IEC104_ADDRESS].given ? values[IEC104_ADDRESS].text : "0.0.0.0",
				    settings->address);
	if (values[IEC104_CLOCK_MASTERS].given)
		settings->clock_master_count = (uint8_t)config_read_addresses(
		    loader, &clock_masters, values[IEC104_CLOCK_MASTERS].json, settings->clock_masters);
}

static void read_modbus(struct config_loader *loader, const struct config_place *file, const json_t *json)
{
	const struct config_place place = config_key_of(file, file_rules[FILE_MODBUS].name);
	struct config_value values[MODBUS_KEYS];

	config_read_keys(&loader->report, &place, json, modbus_rules, MODBUS_KEYS, values);
	loader->config->settings.modbus_priority = (uint8_t)values[MODBUS_PRIORITY].integer;
	loader->config->settings.heartbeat_limit_ms = (uint16_t)values[MODBUS_HEARTBEAT_LIMIT].integer;
}

static void read_event_ring(struct config_loader *loader, const struct config_place *file,
			    const struct config_value *value)
{
	const struct config_place here = config_key_of(file, file_rules[FILE_EVENT_RING].name);

	loader->config->settings.event_ring = (uint32_t)value->integer;
	if (value->given && (value->integer & (value->integer - 1)) != 0)
		config_error(&loader->report, &here,
			     "%lld is not a power of two, expected 64, 128, ... 65536",
			     (long long)value->integer);
}

static void read_timezone(struct config_loader *loader, const struct config_place *file,
			  const struct config_value *value)
{
	const struct config_place here = config_key_of(file, file_rules[FILE_TIMEZONE].name);

	if (value->given && !config_read_zone(value->text, &loader->config->settings.zone))
		config_error(&loader->report, &here,
			     "is not a time zone, expected one like UTC0 or CET-1CEST,M3.5.0,M10.5.0/3");
}

/* Who may connect and command, and who is redundant. After event_ring, which queues are measured by. */
static void read_controlling_stations(struct config_loader *loader, const struct config_place *file,
				      const struct config_value *values)
{
	static const struct {
		unsigned key;
		void (*read)(struct config_loader *loader, const struct config_place *array,
			     const json_t *json);
	} keys[] = {
	    {FILE_MASTERS, config_read_masters},
	    {FILE_GROUPS, config_read_groups},
	    {FILE_ORIGINATORS, config_read_originators},
	};
	const struct config_place groups = config_key_of(file, file_rules[FILE_GROUPS].name);

	for (size_t i = 0; i < sizeof(keys) / sizeof(keys[0]); i++) {
		const struct config_place array = config_key_of(file, file_rules[keys[i].key].name);

		if (values[keys[i].key].given)
			keys[i].read(loader, &array, values[keys[i].key].json);
	}
	config_check_masters(loader, &groups);
}

static void check_point_count(struct config_loader *loader, const struct config_place *file)
{
	const struct config_place here = config_key_of(file, file_rules[FILE_PORT].name);

	if (loader->objects > CONFIG_POINTS_MAX)
		config_error(&loader->report, &here, "has %u objects, expected at most %d", loader->objects,
			     CONFIG_POINTS_MAX);
}

void config_read_file(struct config_loader *loader, const json_t *root)
{
	const struct config_place file = {.in = NULL};
	const struct config_place tls = config_key_of(&file, file_rules[FILE_TLS].name);
	const struct config_place journal = config_key_of(&file, file_rules[FILE_JOURNAL].name);
	struct config_value values[FILE_KEYS];

	config_read_keys(&loader->report, &file, root, file_rules, FILE_KEYS, values);
	if (!json_is_object(root))
		return;
	read_iec104(loader, &file, values[FILE_IEC104].given ? values[FILE_IEC104].json : NULL,
		    values[FILE_TLS].given);
	if (values[FILE_TLS].given)
		config_read_tls(loader, &tls, values[FILE_TLS].json);
	if (values[FILE_JOURNAL].given)
		config_read_journal(loader, &journal, values[FILE_JOURNAL].json);
	read_modbus(loader, &file, values[FILE_MODBUS].given ? values[FILE_MODBUS].json : NULL);
	read_event_ring(loader, &file, &values[FILE_EVENT_RING]);
	read_timezone(loader, &file, &values[FILE_TIMEZONE]);
	read_controlling_stations(loader, &file, values);
	loader->config->settings.clock = (uint8_t)values[FILE_CLOCK].integer;
	config_check_templates(loader);
	if (values[FILE_PORT].given)
		config_read_ports(loader, &file, values[FILE_PORT].json);
	check_point_count(loader, &file);
}

void config_check_modules(struct config_loader *loader, const json_t *root, struct config_modules modules)
{
	const struct config_place file = {.in = NULL};
	static const unsigned iec104_keys[] = {FILE_IEC104, FILE_MASTERS, FILE_GROUPS, FILE_ORIGINATORS,
					       FILE_JOURNAL};
	const struct config_place tls = config_key_of(&file, file_rules[FILE_TLS].name);
	const struct config_place ports = config_key_of(&file, file_rules[FILE_PORT].name);

	for (size_t i = 0; i < sizeof(iec104_keys) / sizeof(iec104_keys[0]); i++) {
		const struct config_place here = config_key_of(&file, file_rules[iec104_keys[i]].name);

		if (!modules.iec104 && json_object_get(root, here.key) != NULL)
			config_error(&loader->report, &here,
				     "this build has no rtu-iec104: remove the key, or build with "
				     "-Diec104=true, in Buildroot BR2_PACKAGE_OPENRTU_IEC104");
	}
	if (!modules.tls && json_object_get(root, file_rules[FILE_TLS].name) != NULL)
		config_error(&loader->report, &tls,
			     "this build has no rtu-iec104-tls: remove the object, or build with "
			     "-Dtls=true, in Buildroot BR2_PACKAGE_OPENRTU_TLS");
	if (!modules.modbus && map_modbus_lines(loader->config) > 0)
		config_error(&loader->report, &ports,
			     "this build has no rtu-modbus: make no port active, or build with "
			     "-Dmodbus=true, in Buildroot BR2_PACKAGE_OPENRTU_MODBUS");
}
