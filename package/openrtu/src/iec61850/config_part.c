/* SPDX-License-Identifier: GPL-3.0-or-later */
/* The object "iec61850": where the server listens, for whom, and what it is called. */
#include "iec61850/config_part.h"

#include <ctype.h>
#include <stdlib.h>

#include "channel/config_tls.h"
#include "config/address.h"
#include "iec61850/config.h"

#define IED_DEFAULT   "OpenRTU"
#define PORT          102
#define PORT_TLS      3782 /* IANA: iso-tp0s */
#define MAX_PDU       16000
#define REPORT_BUFFER 2048

/* Of its object "tls": who may come. */
static const struct config_rule tls_clients = {
    "clients", CONFIG_ARRAY, .high = CHANNEL_TLS_PEERS_MAX,
    CONFIG_SAYS("Common names, or SHA-256 fingerprints as AB:CD:..., of the clients' certificates; none "
		"given: all that are from the CAs.",
		.json = CHANNEL_TLS_PEERS_JSON)};
CONFIG_TABLE(tls_table, .name = "iec61850_tls", .rules = channel_tls_rules, .count = CHANNEL_TLS_RULES,
	     .own = &tls_clients);

enum {
	ADDRESS,
	PORT_KEY,
	TLS,
	IED,
	CLIENTS,
	CONTROLLERS,
	SECURITY,
	ASSOCIATIONS,
	PDU,
	BUFFER,
	LIMITS,
	DATA_SETS,
	KEYS
};
static const char *const securities[] = {"enhanced", "normal", NULL};
static const struct config_rule rules[KEYS] = {
    [ADDRESS] = {"address", CONFIG_TEXT, .required = true, .low = 1, .high = MAP_ADDRESS_SIZE - 1,
		 CONFIG_SAYS("IP address that it listens on.",
			     .json = CONFIG_JSON({"$ref" : "#/$defs/ip_address"}))},
    [PORT_KEY] = {"port", CONFIG_INTEGER, .low = 1, .high = 65535, .fallback = PORT,
		  CONFIG_SAYS("TCP port; without the key and with `tls` 3782.")},
    [TLS] = {"tls", CONFIG_OBJECT, CONFIG_SAYS("IEC 62351-3 and -4: MMS on TLS alone.", .table = &tls_table)},
    [IED] = {"ied", CONFIG_TEXT, .low = 1, .high = MAP_NAME_SIZE - 1,
	     CONFIG_SAYS("What the names of the logical devices begin with: a letter, then letters, digits "
			 "and underscores.",
			 .otherwise_text = IED_DEFAULT, .pattern = "^[A-Za-z][A-Za-z0-9_]*$")},
    [CLIENTS] = {"clients", CONFIG_ARRAY, .high = IEC61850_CLIENTS_MAX,
		 CONFIG_SAYS("IP addresses that may connect; not given: all may.",
			     .json = CONFIG_JSON({"items" : {"$ref" : "#/$defs/ip_address"}}))},
    [CONTROLLERS] = {"controllers", CONFIG_ARRAY, .high = IEC61850_CLIENTS_MAX,
		     CONFIG_SAYS("IP addresses whose clients may command; not given: nobody.",
				 .json = CONFIG_JSON({"items" : {"$ref" : "#/$defs/ip_address"}}))},
    [SECURITY] = {"control_security", CONFIG_CHOICE, .choices = securities,
		  CONFIG_SAYS(
		      "Of commands: enhanced tells their end by CommandTermination, normal does not.")},
    [ASSOCIATIONS] = {"associations", CONFIG_INTEGER, .low = 1, .high = IEC61850_ASSOCIATIONS_MAX,
		      .fallback = 8, CONFIG_SAYS("Clients at a time.")},
    [PDU] = {"max_pdu", CONFIG_INTEGER, .low = IEC61850_PDU_MIN, .high = IEC61850_PDU_MAX,
	     .fallback = MAX_PDU, CONFIG_SAYS("Octets of the longest MMS PDU.")},
    [BUFFER] = {"report_buffer", CONFIG_INTEGER, .low = IEC61850_BUFFER_MIN, .high = IEC61850_BUFFER_MAX,
		.fallback = REPORT_BUFFER,
		CONFIG_SAYS("Changes that are kept for buffered reports, of all points together; rounded up "
			    "to a power of two.")},
    [LIMITS] = {"limits", CONFIG_ARRAY, .high = UINT16_MAX,
		CONFIG_SAYS("Limits of measured values, of each point once: clients see its range, and "
			    "crossing a limit is an event, within the deadband too.",
			    .see = "iec61850.md#ranges", .table = &iec61850_limits_table)},
    [DATA_SETS] =
	{"data_sets", CONFIG_ARRAY, .high = IEC61850_DATA_SETS_MAX,
	 CONFIG_SAYS(
	     "Data sets in place of `status` and `measured`, of the devices that have one here, 256 at most.",
	     .table = &iec61850_set_table)},
};
CONFIG_TABLE(iec61850_table, .name = "iec61850", .rules = rules, .count = KEYS);

static const struct config_rule file_rule = {
    .name = "iec61850",
    .kind = CONFIG_OBJECT,
    CONFIG_SAYS("The server of IEC 61850: rtu-iec61850.", .table = &iec61850_table)};

/* What is read when all points are there. */
struct own {
	const json_t *limits, *data_sets; /* NULL: none */
};

/* As an IED's name is (IEC 61850-6, tIEDName): a letter, then letters, digits and underscores. */
static bool is_name(const char *text)
{
	if (!isalpha((unsigned char)*text))
		return false;
	while (*++text != '\0')
		if (!isalnum((unsigned char)*text) && *text != '_')
			return false;
	return true;
}

static void read_ied(struct config_loader *loader, const struct config_place *place,
		     const struct config_value *value, struct iec61850_settings *settings)
{
	const struct config_place here = config_key_of(place, rules[IED].name);

	snprintf(settings->ied, sizeof(settings->ied), "%s", value->given ? value->text : IED_DEFAULT);
	if (!value->wrong && !is_name(settings->ied))
		config_error(&loader->report, &here,
			     "\"%s\" is no name of an IED, expected a letter, then letters, digits and _",
			     settings->ied);
}

/* IEC 62351-4: the secure profile has a port of its own. */
static void read_tls(struct config_loader *loader, const struct config_place *place,
		     const struct config_value *keys, struct iec61850_settings *settings)
{
	const struct config_place here = config_key_of(place, rules[TLS].name);

	if (!keys[TLS].given)
		return;
	channel_read_tls(&loader->report, &here, keys[TLS].json, &tls_clients, &settings->tls);
	if (!keys[PORT_KEY].given)
		settings->port = PORT_TLS;
}

static uint32_t power_above(uint32_t number)
{
	uint32_t power = IEC61850_BUFFER_MIN;

	while (power < number && power < IEC61850_BUFFER_MAX)
		power *= 2;
	return power;
}

static void read_part(struct config_loader *loader, void *own_memory, const struct config_value *values)
{
	const struct config_place file = {.in = NULL};
	const struct config_place place = config_key_of(&file, file_rule.name);
	const struct config_place address = config_key_of(&place, rules[ADDRESS].name);
	const struct config_place clients = config_key_of(&place, rules[CLIENTS].name);
	const struct config_place controllers = config_key_of(&place, rules[CONTROLLERS].name);
	struct config_value keys[KEYS];
	struct iec61850_settings *settings;
	struct own *own = own_memory;

	if (!values->given)
		return;
	settings = calloc(1, sizeof(*settings));
	if (settings == NULL) {
		config_out_of_memory(&loader->report);
		return;
	}
	map_add_section(loader->config, IEC61850_SETTINGS, sizeof(*settings), 1, settings);
	config_read_keys(&loader->report, &place, values->json, rules, KEYS, keys);
	settings->port = (uint16_t)keys[PORT_KEY].integer;
	settings->associations = (uint32_t)keys[ASSOCIATIONS].integer;
	settings->max_pdu = (uint32_t)keys[PDU].integer;
	settings->report_buffer = power_above((uint32_t)keys[BUFFER].integer);
	read_tls(loader, &place, keys, settings);
	read_ied(loader, &place, &keys[IED], settings);
	if (keys[ADDRESS].given)
		config_read_address(&loader->report, &address, keys[ADDRESS].text, settings->address);
	if (keys[CLIENTS].given)
		settings->client_count =
		    config_read_addresses(&loader->report, &clients, keys[CLIENTS].json, settings->clients);
	if (keys[CONTROLLERS].given)
		settings->controller_count = config_read_addresses(
		    &loader->report, &controllers, keys[CONTROLLERS].json, settings->controllers);
	settings->normal_security = keys[SECURITY].integer == 1;
	own->limits = keys[LIMITS].given ? keys[LIMITS].json : NULL;
	own->data_sets = keys[DATA_SETS].given ? keys[DATA_SETS].json : NULL;
}

static bool begin(struct config_loader *loader, void *own, const json_t *root)
{
	void *assignments = config_allocate(1, sizeof(struct iec61850_assignment));

	(void)own, (void)root;
	map_add_section(loader->config, IEC61850_ASSIGNMENTS, sizeof(struct iec61850_assignment), 0,
			assignments);
	loader->take_ln = iec61850_take_ln;
	return assignments != NULL;
}

/* A name of a data object of GGIO1 ends with the point's address, and is too short for the longest of them. */
static bool link_points(struct config_loader *loader, void *own_memory)
{
	const struct config_place file = {.in = NULL};
	const struct config_place place = config_key_of(&file, file_rule.name);
	const struct config_place limits = config_key_of(&place, rules[LIMITS].name);
	const struct config_place sets = config_key_of(&place, rules[DATA_SETS].name);
	const struct map_config *config = loader->config;
	const struct own *own = own_memory;
	const struct iec61850_assignment *assigned = iec61850_assignments(config);
	uint32_t left = map_record_count(config, IEC61850_ASSIGNMENTS);

	if (!iec61850_check_lns(loader, &place) || !iec61850_take_limits(loader, &limits, own->limits) ||
	    !iec61850_take_sets(loader, &sets, own->data_sets))
		return false;
	if (iec61850_settings(config) == NULL)
		return true;
	for (uint32_t i = 0; i < config->point_count; i++) {
		char name[MAP_NAME_SIZE];

		if (left > 0 && assigned->point == i) {
			assigned++;
			left--;
			continue;
		}
		if (config->points[i].ioa <= IEC61850_IOA_MAX)
			continue;
		map_point_name(config, &config->points[i], name);
		config_error(&loader->report, &place,
			     "\"%s\" has the IOA %u, which is no number of a data object; give it one of %u "
			     "at most, or \"ln\"",
			     name, (unsigned)config->points[i].ioa, IEC61850_IOA_MAX);
	}
	return true;
}

const struct config_part iec61850_part = {.keys = &file_rule,
					  .key_count = 1,
					  .own_size = sizeof(struct own),
					  .begin = begin,
					  .read = read_part,
					  .link = link_points};
