/* SPDX-License-Identifier: GPL-3.0-or-later */
/* The object "snmp": where the agent listens, who may do what, and who is notified. */
#include "snmp/config_part.h"

#include <stdlib.h>
#include <string.h>

#include "config/address.h"
#include "snmp/config.h"

#define ADDRESS_DEFAULT "0.0.0.0"
#define STATION_DEFAULT "OpenRTU"
#define KEYS_DEFAULT    "/data/openrtu/snmp.keys"
#define STATE_DEFAULT   "/data/openrtu/snmp"
#define PORT_AGENT      161
#define PORT_SINK       162
/* netSnmpPlaypen 104: no enterprise number is the project's yet. OPENRTU-MIB.txt has it too. */
#define BASE "1.3.6.1.4.1.8072.9999.9999.104"

enum { USER_NAME, USER_ROLE, USER_KEYS };
static const char *const roles[] = {"viewer", "operator", "engineer", NULL};
static const struct config_rule user_rules[USER_KEYS] = {
    [USER_NAME] = {"name", CONFIG_TEXT, .required = true, .low = 1, .high = SNMP_NAME_SIZE - 1,
		   CONFIG_SAYS("Its securityName.", .pattern = "^[^ \\u0000-\\u001f\\u007f]*$")},
    [USER_ROLE] = {"role", CONFIG_CHOICE, .required = true, .choices = roles,
		   CONFIG_SAYS("What it may: read (viewer), command besides (operator), all (engineer).")},
};
CONFIG_TABLE(user_table, .name = "snmp_user", .rules = user_rules, .count = USER_KEYS);

enum {
	SINK_NAME,
	SINK_ADDRESS,
	SINK_PORT,
	SINK_USER,
	SINK_KIND,
	SINK_WINDOW,
	SINK_TIMEOUT,
	SINK_RETRIES,
	SINK_KEYS
};
static const char *const sink_kinds[] = {"inform", "trap", NULL};
static const struct config_rule sink_rules[SINK_KEYS] = {
    [SINK_NAME] = {"name", CONFIG_TEXT, .required = true, .low = 1, .high = SNMP_NAME_SIZE - 1,
		   CONFIG_SAYS("Its name, here and in the file of keys.",
			       .pattern = "^[^ \\u0000-\\u001f\\u007f]*$")},
    [SINK_ADDRESS] = {"address", CONFIG_TEXT, .required = true, .low = 1, .high = MAP_ADDRESS_SIZE - 1,
		      CONFIG_SAYS("Its IP address.", .json = CONFIG_JSON({"$ref" : "#/$defs/ip_address"}))},
    [SINK_PORT] = {"port", CONFIG_INTEGER, .low = 1, .high = 65535, .fallback = PORT_SINK,
		   CONFIG_SAYS("Its UDP port.")},
    [SINK_USER] = {"user", CONFIG_TEXT, .required = true, .low = 1, .high = SNMP_NAME_SIZE - 1,
		   CONFIG_SAYS("As which of the users it is notified.",
			       .pattern = "^[^ \\u0000-\\u001f\\u007f]*$",
			       .json = CONFIG_JSON({"examples" : ["centre"]}))},
    [SINK_KIND] = {"kind", CONFIG_CHOICE, .choices = sink_kinds,
		   CONFIG_SAYS("Informs, which it confirms, or traps.")},
    [SINK_WINDOW] = {"window", CONFIG_INTEGER, .low = 1, .high = SNMP_WINDOW_MAX, .fallback = 8,
		     CONFIG_SAYS("Informs that may wait for their confirmation at a time.")},
    [SINK_TIMEOUT] = {"timeout_ms", CONFIG_INTEGER, .low = 100, .high = 60000, .fallback = 1500,
		      CONFIG_SAYS(
			  "Milliseconds until an inform is sent again; twice as many with each try.")},
    [SINK_RETRIES] = {"retries", CONFIG_INTEGER, .low = 0, .high = 10, .fallback = 4,
		      CONFIG_SAYS("How often an inform is sent again before the sink counts as silent.")},
};
CONFIG_TABLE(sink_table, .name = "snmp_sink", .rules = sink_rules, .count = SINK_KEYS);

enum {
	SNMP_ADDRESS,
	SNMP_PORT,
	SNMP_BASE,
	SNMP_STATION,
	SNMP_CONTACT,
	SNMP_LOCATION,
	SNMP_KEYS_FILE,
	SNMP_STATE,
	SNMP_MANAGERS,
	SNMP_CLOCK_MASTERS,
	SNMP_MAX_MESSAGE,
	SNMP_RATE,
	SNMP_RELEASE,
	SNMP_USERS,
	SNMP_SINKS,
	SNMP_KEYS
};
static const struct config_rule snmp_rules[SNMP_KEYS] = {
    [SNMP_ADDRESS] = {"address", CONFIG_TEXT, .low = 1, .high = MAP_ADDRESS_SIZE - 1,
		      CONFIG_SAYS("IP address that it listens on.", .otherwise_text = ADDRESS_DEFAULT,
				  .json = CONFIG_JSON({"$ref" : "#/$defs/ip_address"}))},
    [SNMP_PORT] = {"port", CONFIG_INTEGER, .low = 1, .high = 65535, .fallback = PORT_AGENT,
		   CONFIG_SAYS("UDP port.")},
    [SNMP_BASE] = {"base", CONFIG_TEXT, .low = 1, .high = 100,
		   CONFIG_SAYS("Place of OPENRTU-MIB, below enterprises.", .otherwise_text = BASE,
			       .pattern = "^1\\.3\\.6\\.1\\.4\\.1(\\.[0-9]+){1,10}$")},
    [SNMP_STATION] = {"station", CONFIG_TEXT, .low = 1, .high = MAP_NAME_SIZE - 1,
		      CONFIG_SAYS("Name of the station: rtuStationName and sysName.",
				  .otherwise_text = STATION_DEFAULT)},
    [SNMP_CONTACT] = {"contact", CONFIG_TEXT, .low = 1, .high = SNMP_TEXT_SIZE - 1,
		      CONFIG_SAYS("Who is responsible for the gateway: sysContact.")},
    [SNMP_LOCATION] = {"location", CONFIG_TEXT, .low = 1, .high = SNMP_TEXT_SIZE - 1,
		       CONFIG_SAYS("Where it is: sysLocation.")},
    [SNMP_KEYS_FILE] = {"keys", CONFIG_TEXT, .low = 1, .high = MAP_FILE_SIZE - 1,
			CONFIG_SAYS("File of the localized keys that openrtu snmp-keys has made.",
				    .otherwise_text = KEYS_DEFAULT,
				    .pattern = "^/[^\\u0000-\\u001f\\u007f]*$")},
    [SNMP_STATE] = {"state", CONFIG_TEXT, .low = 1, .high = MAP_FILE_SIZE - 1,
		    CONFIG_SAYS("Folder for the number of boots, which has to outlive a power cut.",
				.otherwise_text = STATE_DEFAULT, .pattern = "^/[^\\u0000-\\u001f\\u007f]*$")},
    [SNMP_MANAGERS] = {"managers", CONFIG_ARRAY, .high = SNMP_MANAGERS_MAX,
		       CONFIG_SAYS("IP addresses that are answered; not given: all are.",
				   .json = CONFIG_JSON({"items" : {"$ref" : "#/$defs/ip_address"}}))},
    [SNMP_CLOCK_MASTERS] =
	{"clock_masters", CONFIG_ARRAY, .high = SNMP_MANAGERS_MAX,
	 CONFIG_SAYS("IP addresses of the managers that may set the clock; not given: all operators may.",
		     .json = CONFIG_JSON({"items" : {"$ref" : "#/$defs/ip_address"}}))},
    [SNMP_MAX_MESSAGE] = {"max_message", CONFIG_INTEGER, .low = 484, .high = 65507, .fallback = 1472,
			  CONFIG_SAYS("Octets of the longest message that it sends.")},
    [SNMP_RATE] = {"rate", CONFIG_INTEGER, .low = 1, .high = 100000, .fallback = 500,
		   CONFIG_SAYS("Messages a second from one address; what is beyond is dropped and counted.")},
    [SNMP_RELEASE] = {"release_time", CONFIG_INTEGER, .low = 1, .high = 3600, .fallback = 60,
		      CONFIG_SAYS("Seconds after which the agent makes a command inactive that a manager has "
				  "left in a last state.",
				  .unit = "s")},
    [SNMP_USERS] = {"users", CONFIG_ARRAY, .required = true, .high = SNMP_USERS_MAX,
		    CONFIG_SAYS("Who may ask.", .table = &user_table, .json = CONFIG_JSON({"minItems" : 1}))},
    [SNMP_SINKS] = {"sinks", CONFIG_ARRAY, .high = SNMP_SINKS_MAX,
		    CONFIG_SAYS("Who is notified.", .table = &sink_table)},
};
CONFIG_TABLE(agent_table, .name = "snmp", .rules = snmp_rules, .count = SNMP_KEYS);

static const struct config_rule file_rule = {
    .name = "snmp",
    .kind = CONFIG_OBJECT,
    CONFIG_SAYS("The agent of SNMPv3: rtu-snmp.", .table = &agent_table)};

/* ---- texts ------------------------------------------------------------------------------- */

static void copy(char *out, size_t size, const struct config_value *value, const char *fallback)
{
	snprintf(out, size, "%s", value->given ? value->text : fallback);
}

static void read_path(struct config_loader *loader, const struct config_place *snmp, unsigned key,
		      const struct config_value *value, const char *fallback, char out[MAP_FILE_SIZE])
{
	const struct config_place here = config_key_of(snmp, snmp_rules[key].name);

	copy(out, MAP_FILE_SIZE, value, fallback);
	if (!value->wrong && out[0] != '/')
		config_error(&loader->report, &here, "is not an absolute path, expected one like %s",
			     fallback);
}

/* Numbers with dots. False: it is something else, or longer. */
static bool read_arcs(const char *text, struct snmp_settings *settings)
{
	for (settings->base_length = 0; settings->base_length < SNMP_BASE_MAX;) {
		char *end;
		const unsigned long arc = strtoul(text, &end, 10);

		if (text[0] < '0' || text[0] > '9' || arc > UINT32_MAX)
			return false;
		settings->base[settings->base_length++] = (uint32_t)arc;
		if (*end == '\0')
			return true;
		if (*end != '.')
			return false;
		text = end + 1;
	}
	return false;
}

/* The tree is in the order of its names: the system's group, the station, the engine's. */
static void read_base(struct config_loader *loader, const struct config_place *snmp,
		      const struct config_value *value, struct snmp_settings *settings)
{
	static const uint32_t enterprises[] = {1, 3, 6, 1, 4, 1};
	const struct config_place here = config_key_of(snmp, snmp_rules[SNMP_BASE].name);

	if (value->wrong)
		return;
	if (!read_arcs(value->given ? value->text : BASE, settings) || settings->base_length < 7 ||
	    memcmp(settings->base, enterprises, sizeof(enterprises)) != 0)
		config_error(&loader->report, &here,
			     "is no place below enterprises of %d arcs at most, expected one like " BASE,
			     SNMP_BASE_MAX);
}

/* The file of keys has names between spaces. */
static void check_word(struct config_loader *loader, const struct config_place *place, const char *key,
		       const struct config_value *value)
{
	const struct config_place here = config_key_of(place, key);

	if (value->given && strchr(value->text, ' ') != NULL)
		config_error(&loader->report, &here, "\"%s\" has a space, expected a name of one word",
			     value->text);
}

/* ---- users ------------------------------------------------------------------------------- */

static uint8_t find_user(const struct snmp_settings *settings, const char *name)
{
	uint8_t i = 0;

	while (i < settings->user_count && strcmp(settings->users[i].name, name) != 0)
		i++;
	return i;
}

static void read_user(struct config_loader *loader, const struct config_place *place, const json_t *json,
		      struct snmp_settings *settings)
{
	struct snmp_user *user = &settings->users[settings->user_count];
	struct config_value values[USER_KEYS];

	config_read_keys(&loader->report, place, json, user_rules, USER_KEYS, values);
	check_word(loader, place, user_rules[USER_NAME].name, &values[USER_NAME]);
	copy(user->name, sizeof(user->name), &values[USER_NAME], "");
	user->role = (uint8_t)values[USER_ROLE].integer;
	if (values[USER_NAME].given && find_user(settings, user->name) < settings->user_count)
		config_error(&loader->report, place, "\"%s\" is another user's name too", user->name);
	settings->user_count++;
}

static void read_users(struct config_loader *loader, const struct config_place *array, const json_t *json,
		       struct snmp_settings *settings)
{
	const json_t *user;
	size_t i;

	json_array_foreach(json, i, user)
	{
		const struct config_place place = config_element_of(array, i);

		read_user(loader, &place, user, settings);
	}
	if (settings->user_count == 0)
		config_error(&loader->report, array, "is empty, expected at least one user");
}

/* ---- sinks ------------------------------------------------------------------------------- */

static void read_sink(struct config_loader *loader, const struct config_place *place, const json_t *json,
		      struct snmp_settings *settings)
{
	const struct config_place address = config_key_of(place, sink_rules[SINK_ADDRESS].name);
	const struct config_place user = config_key_of(place, sink_rules[SINK_USER].name);
	struct snmp_sink *sink = &settings->sinks[settings->sink_count++];
	struct config_value values[SINK_KEYS];

	config_read_keys(&loader->report, place, json, sink_rules, SINK_KEYS, values);
	check_word(loader, place, sink_rules[SINK_NAME].name, &values[SINK_NAME]);
	copy(sink->name, sizeof(sink->name), &values[SINK_NAME], "");
	sink->port = (uint16_t)values[SINK_PORT].integer;
	sink->inform = values[SINK_KIND].integer == 0;
	sink->window = (uint8_t)values[SINK_WINDOW].integer;
	sink->timeout_ms = (uint16_t)values[SINK_TIMEOUT].integer;
	sink->retries = (uint8_t)values[SINK_RETRIES].integer;
	if (values[SINK_ADDRESS].given)
		config_read_address(&loader->report, &address, values[SINK_ADDRESS].text, sink->address);
	if (!values[SINK_USER].given)
		return;
	sink->user = find_user(settings, values[SINK_USER].text);
	if (sink->user == settings->user_count)
		config_error(&loader->report, &user, "\"%s\" is none of \"users\", expected one of them",
			     values[SINK_USER].text);
}

static void read_sinks(struct config_loader *loader, const struct config_place *array, const json_t *json,
		       struct snmp_settings *settings)
{
	const json_t *sink;
	size_t i;

	json_array_foreach(json, i, sink)
	{
		const struct config_place place = config_element_of(array, i);

		read_sink(loader, &place, sink, settings);
	}
}

/* ---- the object -------------------------------------------------------------------------- */

static void read_settings(struct config_loader *loader, const struct config_place *place, const json_t *json,
			  struct snmp_settings *settings)
{
	const struct config_place address = config_key_of(place, snmp_rules[SNMP_ADDRESS].name);
	const struct config_place managers = config_key_of(place, snmp_rules[SNMP_MANAGERS].name);
	const struct config_place clock_masters = config_key_of(place, snmp_rules[SNMP_CLOCK_MASTERS].name);
	const struct config_place users = config_key_of(place, snmp_rules[SNMP_USERS].name);
	const struct config_place sinks = config_key_of(place, snmp_rules[SNMP_SINKS].name);
	struct config_value values[SNMP_KEYS];

	config_read_keys(&loader->report, place, json, snmp_rules, SNMP_KEYS, values);
	settings->port = (uint16_t)values[SNMP_PORT].integer;
	settings->max_message = (uint32_t)values[SNMP_MAX_MESSAGE].integer;
	settings->rate = (uint32_t)values[SNMP_RATE].integer;
	settings->release_s = (uint32_t)values[SNMP_RELEASE].integer;
	copy(settings->station, sizeof(settings->station), &values[SNMP_STATION], STATION_DEFAULT);
	copy(settings->contact, sizeof(settings->contact), &values[SNMP_CONTACT], "");
	copy(settings->location, sizeof(settings->location), &values[SNMP_LOCATION], "");
	read_path(loader, place, SNMP_KEYS_FILE, &values[SNMP_KEYS_FILE], KEYS_DEFAULT, settings->keys);
	read_path(loader, place, SNMP_STATE, &values[SNMP_STATE], STATE_DEFAULT, settings->state);
	read_base(loader, place, &values[SNMP_BASE], settings);
	if (!values[SNMP_ADDRESS].wrong)
		config_read_address(&loader->report, &address,
				    values[SNMP_ADDRESS].given ? values[SNMP_ADDRESS].text : ADDRESS_DEFAULT,
				    settings->address);
	if (values[SNMP_MANAGERS].given)
		settings->manager_count = config_read_addresses(
		    &loader->report, &managers, values[SNMP_MANAGERS].json, settings->managers);
	if (values[SNMP_CLOCK_MASTERS].given)
		settings->clock_master_count =
		    config_read_addresses(&loader->report, &clock_masters, values[SNMP_CLOCK_MASTERS].json,
					  settings->clock_masters);
	if (values[SNMP_USERS].given)
		read_users(loader, &users, values[SNMP_USERS].json, settings);
	if (values[SNMP_SINKS].given)
		read_sinks(loader, &sinks, values[SNMP_SINKS].json, settings);
}

static void read_part(struct config_loader *loader, void *own, const struct config_value *values)
{
	const struct config_place file = {.in = NULL};
	const struct config_place place = config_key_of(&file, file_rule.name);
	struct snmp_settings *settings;

	(void)own;
	if (!values->given)
		return;
	settings = calloc(1, sizeof(*settings));
	if (settings == NULL) {
		config_out_of_memory(&loader->report);
		return;
	}
	map_add_section(loader->config, SNMP_SETTINGS, sizeof(*settings), 1, settings);
	read_settings(loader, &place, values->json, settings);
}

const struct config_part snmp_part = {.keys = &file_rule, .key_count = 1, .read = read_part};
