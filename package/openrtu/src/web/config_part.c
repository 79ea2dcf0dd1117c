/* SPDX-License-Identifier: GPL-3.0-or-later */
/* The object "web": where the page is served, to whom, and what it may. */
#include "web/config_part.h"

#include <netinet/in.h>
#include <stdlib.h>
#include <string.h>

#include "config/address.h"
#include "map/address.h"
#include "web/config.h"

#define ADDRESS_DEFAULT "127.0.0.1"
#define STATION_DEFAULT "OpenRTU"
#define USERS_DEFAULT   "/data/openrtu/web.users"

enum {
	WEB_ADDRESS,
	WEB_PORT,
	WEB_CLIENTS,
	WEB_STATION,
	WEB_USERS,
	WEB_CERTIFICATE,
	WEB_KEY,
	WEB_SESSION,
	WEB_COMMANDS,
	WEB_SETUP,
	WEB_KEYS
};
static const struct config_rule rules[WEB_KEYS] = {
    [WEB_ADDRESS] = {"address", CONFIG_TEXT, .low = 1, .high = MAP_ADDRESS_SIZE - 1,
		     CONFIG_SAYS("IP address that it listens on. Without TLS, 127.0.0.1 or ::1 alone.",
				 .otherwise_text = ADDRESS_DEFAULT,
				 .json = CONFIG_JSON({"$ref" : "#/$defs/ip_address"}))},
    [WEB_PORT] = {"port", CONFIG_INTEGER, .low = 1, .high = 65535, .fallback = 8080,
		  CONFIG_SAYS("TCP port.")},
    [WEB_CLIENTS] = {"clients", CONFIG_ARRAY, .high = WEB_CLIENTS_MAX,
		     CONFIG_SAYS("IP addresses that may connect; not given: all may.",
				 .json = CONFIG_JSON({"items" : {"$ref" : "#/$defs/ip_address"}}))},
    [WEB_STATION] = {"station", CONFIG_TEXT, .low = 1, .high = MAP_NAME_SIZE - 1,
		     CONFIG_SAYS("Name of the station, in the page's head.",
				 .otherwise_text = STATION_DEFAULT)},
    [WEB_USERS] = {"users", CONFIG_TEXT, .low = 1, .high = MAP_FILE_SIZE - 1,
		   CONFIG_SAYS("File of the users that openrtu web-users has made.",
			       .otherwise_text = USERS_DEFAULT, .pattern = "^/[^\\u0000-\\u001f\\u007f]*$")},
    [WEB_CERTIFICATE] =
	{"certificate", CONFIG_TEXT, .low = 1, .high = MAP_FILE_SIZE - 1,
	 CONFIG_SAYS("Absolute path of its certificate, PEM, with those that lead from it to the CA: TLS.",
		     .pattern = "^/[^\\u0000-\\u001f\\u007f]*$")},
    [WEB_KEY] = {"key", CONFIG_TEXT, .low = 1, .high = MAP_FILE_SIZE - 1,
		 CONFIG_SAYS("Absolute path of its key, PEM without a passphrase. Only rtu-web's user, or "
			     "its group, may read it.",
			     .pattern = "^/[^\\u0000-\\u001f\\u007f]*$")},
    [WEB_SESSION] = {"session_time", CONFIG_INTEGER, .low = 60, .high = 86400, .fallback = 28800,
		     CONFIG_SAYS("Seconds after which a user has to log in again.", .unit = "s")},
    [WEB_COMMANDS] =
	{"commands", CONFIG_BOOLEAN,
	 CONFIG_SAYS(
	     "Whether operators and engineers may command points; without it, the page is read-only.")},
    [WEB_SETUP] = {"setup", CONFIG_BOOLEAN,
		   CONFIG_SAYS(
		       "Whether installers may change lines, devices, points and periods of this file; "
		       "the page itself may never change this.",
		       .see = "web.md#set-up")},
};
CONFIG_TABLE(web_table, .name = "web", .rules = rules, .count = WEB_KEYS,
	     .json = CONFIG_JSON({"dependentRequired" : {"certificate" : ["key"], "key" : ["certificate"]}}));

static const struct config_rule file_rule = {
    .name = "web", .kind = CONFIG_OBJECT, CONFIG_SAYS("A page for a browser: rtu-web.", .table = &web_table)};

static void read_path(struct config_loader *loader, const struct config_place *web, unsigned key,
		      const struct config_value *value, const char *fallback, char out[MAP_FILE_SIZE])
{
	const struct config_place here = config_key_of(web, rules[key].name);

	snprintf(out, MAP_FILE_SIZE, "%s", value->given ? value->text : fallback);
	if (value->given && out[0] != '/')
		config_error(&loader->report, &here,
			     "is not an absolute path, expected one like /data/openrtu/web.%s",
			     rules[key].name);
}

/* What is not encrypted stays on the gateway. */
static void check_tls(struct config_loader *loader, const struct config_place *web,
		      const struct web_settings *settings)
{
	const struct config_place address = config_key_of(web, rules[WEB_ADDRESS].name);
	struct in6_addr known;

	if ((settings->certificate[0] == '\0') != (settings->key[0] == '\0'))
		config_error(&loader->report, web,
			     "has only one of \"certificate\" and \"key\": TLS needs both");
	if (settings->certificate[0] != '\0' || !map_address_parse(settings->address, &known))
		return;
	if (!IN6_IS_ADDR_LOOPBACK(&known) &&
	    !(IN6_IS_ADDR_V4MAPPED(&known) && known.s6_addr[12] == IN_LOOPBACKNET))
		config_error(&loader->report, &address,
			     "%s needs \"certificate\" and \"key\": without TLS, expected 127.0.0.1 or ::1",
			     settings->address);
}

static void read_settings(struct config_loader *loader, const struct config_place *place, const json_t *json,
			  struct web_settings *settings)
{
	const struct config_place address = config_key_of(place, rules[WEB_ADDRESS].name);
	const struct config_place clients = config_key_of(place, rules[WEB_CLIENTS].name);
	struct config_value values[WEB_KEYS];

	config_read_keys(&loader->report, place, json, rules, WEB_KEYS, values);
	settings->port = (uint16_t)values[WEB_PORT].integer;
	settings->session_s = (uint32_t)values[WEB_SESSION].integer;
	settings->commands = values[WEB_COMMANDS].integer != 0;
	settings->setup = values[WEB_SETUP].integer != 0;
	snprintf(settings->station, sizeof(settings->station), "%s",
		 values[WEB_STATION].given ? values[WEB_STATION].text : STATION_DEFAULT);
	read_path(loader, place, WEB_USERS, &values[WEB_USERS], USERS_DEFAULT, settings->users);
	read_path(loader, place, WEB_CERTIFICATE, &values[WEB_CERTIFICATE], "", settings->certificate);
	read_path(loader, place, WEB_KEY, &values[WEB_KEY], "", settings->key);
	if (!values[WEB_ADDRESS].wrong)
		config_read_address(&loader->report, &address,
				    values[WEB_ADDRESS].given ? values[WEB_ADDRESS].text : ADDRESS_DEFAULT,
				    settings->address);
	if (values[WEB_CLIENTS].given)
		settings->client_count = config_read_addresses(&loader->report, &clients,
							       values[WEB_CLIENTS].json, settings->clients);
	if (!values[WEB_CERTIFICATE].wrong && !values[WEB_KEY].wrong)
		check_tls(loader, place, settings);
}

static void read_part(struct config_loader *loader, void *own, const struct config_value *values)
{
	const struct config_place file = {.in = NULL};
	const struct config_place place = config_key_of(&file, file_rule.name);
	struct web_settings *settings;

	(void)own;
	if (!values->given)
		return;
	settings = calloc(1, sizeof(*settings));
	if (settings == NULL) {
		config_out_of_memory(&loader->report);
		return;
	}
	map_add_section(loader->config, WEB_SETTINGS, sizeof(*settings), 1, settings);
	read_settings(loader, &place, values->json, settings);
}

const struct config_part web_part = {.keys = &file_rule, .key_count = 1, .read = read_part};
