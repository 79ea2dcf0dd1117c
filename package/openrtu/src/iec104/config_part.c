/* SPDX-License-Identifier: GPL-3.0-or-later */
/* The part of the configuration file that is about IEC 60870-5-104, as a whole, and its object "iec104". */
#include "iec104/config_part.h"

#include <stdlib.h>

#include "channel/config_tls.h"
#include "config/address.h"
#include "iec104/config_readers.h"
#include "iec104/geoposition.h"

#define ADDRESS_DEFAULT   "0.0.0.0"
#define SECONDS_OF_2_DAYS 172800
#define ORIGINATORS       256
#define PORT_PLAIN        2404
#define PORT_TLS          19998 /* IANA: iec-104-sec */

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
	IEC104_POSITION_TYPE,
	IEC104_IGNORE_SUMMER_BIT,
	IEC104_KEYS
};
static const struct config_rule iec104_rules[IEC104_KEYS] = {
    [IEC104_ADDRESS] = {"address", CONFIG_TEXT, .low = 1, .high = MAP_ADDRESS_SIZE - 1,
			CONFIG_SAYS("IPv4 or IPv6 address to listen on.", .otherwise_text = ADDRESS_DEFAULT,
				    .json = CONFIG_JSON({"$ref" : "#/$defs/ip_address"}))},
    [IEC104_PORT] = {"port", CONFIG_INTEGER, .low = 1, .high = 65535, .fallback = PORT_PLAIN,
		     CONFIG_SAYS("TCP port; without the key and with `tls` 19998.")},
    [IEC104_K] = {"k", CONFIG_INTEGER, .low = 1, .high = 32767, .fallback = 12,
		  CONFIG_SAYS("I frames sent and not yet acknowledged, at most.")},
    [IEC104_W] = {"w", CONFIG_INTEGER, .low = 1, .high = 32767, .fallback = 8,
		  CONFIG_SAYS("I frames received before they are acknowledged, at most; not more than `k`; "
			      "two thirds of `k` is better.")},
    [IEC104_T1] = {"t1", CONFIG_INTEGER, .low = 2, .high = 255, .fallback = 15,
		   CONFIG_SAYS("Seconds until a frame that is not acknowledged closes the connection.",
			       .unit = "s")},
    [IEC104_T2] = {"t2", CONFIG_INTEGER, .low = 1, .high = 254, .fallback = 10,
		   CONFIG_SAYS("Seconds until received I frames are acknowledged; less than t1.",
			       .unit = "s")},
    [IEC104_T3] = {"t3", CONFIG_INTEGER, .low = 1, .high = SECONDS_OF_2_DAYS, .fallback = 20,
		   CONFIG_SAYS("Seconds of silence until a test frame is sent; 172800 s are 48 h.",
			       .unit = "s")},
    [IEC104_MAX_CONNECTIONS] = {"max_connections", CONFIG_INTEGER, .low = 1, .high = 16, .fallback = 8,
				CONFIG_SAYS("Connections of controlling stations at once.")},
    [IEC104_CONNECTIONS_PER_ADDRESS] = {"connections_per_address", CONFIG_INTEGER, .low = 1, .high = 16,
					CONFIG_SAYS("Connections at once from one IP address, at most "
						    "`max_connections`; not given: half of these.")},
    [IEC104_SELECT_TIMEOUT] = {"select_timeout", CONFIG_INTEGER, .low = 1, .high = 3600,
			       CONFIG_SAYS("The same as select_timeout of commands, from before that object; "
					   "not both with different values.",
					   .unit = "s")},
    [IEC104_COMMAND_TIMEOUT] = {"command_timeout", CONFIG_INTEGER, .low = 1, .high = 3600,
				CONFIG_SAYS("The same as command_timeout of commands, from before that "
					    "object; not both with different values.",
					    .unit = "s")},
    [IEC104_COMMAND_WITHOUT_CLOCK] =
	{"command_without_clock", CONFIG_BOOLEAN,
	 CONFIG_SAYS("Accepts commands with a time tag even if the gateway's clock was never set and their "
		     "age is not known. With `false`, it refuses them.")},
    [IEC104_CLOCK_MASTERS] =
	{"clock_masters", CONFIG_ARRAY, .high = IEC104_CLOCK_MASTERS_MAX,
	 CONFIG_SAYS("IP addresses of the controlling stations that may set the clock; none given: all may.",
		     .json = CONFIG_JSON({"items" : {"$ref" : "#/$defs/ip_address"}}))},
    [IEC104_OWN_CA] = {"own_ca", CONFIG_INTEGER, .low = 1, .high = 65534,
		       CONFIG_SAYS("Common address of the gateway's own station, which says whether events "
				   "were lost; not that of a device.",
				   .see = "telecontrol.md#lost-events-as-points")},
    [IEC104_POSITION_TYPE] = {"position_type", CONFIG_INTEGER, .low = IEC104_PRIVATE_FIRST,
			      .high = IEC104_PRIVATE_LAST, .fallback = IEC104_GEOPOSITION,
			      CONFIG_SAYS("Type identification, of the range for special use, of positions "
					  "that are sent as a whole: position_ioa of a receiver.")},
    [IEC104_IGNORE_SUMMER_BIT] =
	{"ignore_summer_bit", CONFIG_BOOLEAN,
	 CONFIG_SAYS(
	     "Reads the times of controlling stations that leave the bit SU 0 in summer: by `timezone`, and "
	     "in the hour that comes twice as the one that is nearer to the gateway's clock. With `false`, a "
	     "time whose bit is not that of `timezone` is refused.")},
};
CONFIG_TABLE(iec104_table, .name = "iec104", .rules = iec104_rules, .count = IEC104_KEYS);

/* Of the object "tls": who may come. */
static const struct config_rule tls_masters = {
    "masters", CONFIG_ARRAY, .high = CHANNEL_TLS_PEERS_MAX,
    CONFIG_SAYS("Common names, or SHA-256 fingerprints as AB:CD:..., of the controlling stations' "
		"certificates; none given: all that are from the CAs.",
		.json = CHANNEL_TLS_PEERS_JSON)};
CONFIG_TABLE(tls_table, .name = "tls", .rules = channel_tls_rules, .count = CHANNEL_TLS_RULES,
	     .own = &tls_masters);

enum { FILE_IEC104, FILE_TLS, FILE_MASTERS, FILE_GROUPS, FILE_ORIGINATORS, FILE_KEYS };
static const struct config_rule file_rules[FILE_KEYS] = {
    [FILE_IEC104] = {"iec104", CONFIG_OBJECT,
		     CONFIG_SAYS("The IEC 60870-5-104 side. Without it, that with all its defaults: it "
				 "listens on port 2404 of all addresses.",
				 .table = &iec104_table)},
    [FILE_TLS] = {"tls", CONFIG_OBJECT,
		  CONFIG_SAYS("IEC 62351-3: TLS on the IEC 60870-5-104 side. Without it, plain TCP.",
			      .table = &tls_table)},
    [FILE_MASTERS] = {"masters", CONFIG_ARRAY, .high = IEC104_MASTERS_MAX,
		      CONFIG_SAYS(
			  "IP addresses of the controlling stations that may connect; not given: all may. No "
			  "other connection is answered.",
			  .json = CONFIG_JSON({"minItems" : 1, "items" : {"$ref" : "#/$defs/ip_address"}}))},
    [FILE_GROUPS] = {"redundancy_groups", CONFIG_ARRAY, .high = MAP_NAMED_QUEUES_MAX,
		     CONFIG_SAYS(
			 "Controlling stations that share one queue of events; one at a time gets them.",
			 .table = &iec104_group_table)},
    [FILE_ORIGINATORS] =
	{"originators", CONFIG_ARRAY, .high = ORIGINATORS,
	 CONFIG_SAYS("Originator addresses (0 to 255) that may command, interrogate and read; not given: all "
		     "may. Others get a negative confirmation.",
		     .json = CONFIG_JSON(
			 {"minItems" : 1, "items" : {"type" : "integer", "minimum" : 0, "maximum" : 255}}))},
};

/* IEC 60870-5-104, 5.5: w should not exceed two thirds of k; more than k would never be reached. */
static void check_window(struct config_loader *loader, const struct config_place *iec104,
			 const struct config_value *values)
{
	const struct config_place here = config_key_of(iec104, iec104_rules[IEC104_W].name);

	if (!values[IEC104_W].wrong && !values[IEC104_K].wrong &&
	    values[IEC104_W].integer > values[IEC104_K].integer)
		config_error(&loader->report, &here,
			     "%lld is more than k (%lld), expected at most k; two thirds of k is better",
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

/* The former place of a time-out of the object "commands", which has been read; *of_all is 0 if it is not there. */
static void take_timeout(struct config_loader *loader, const struct config_place *iec104,
			 const struct config_value *values, unsigned key, uint16_t *of_all)
{
	const struct config_place here = config_key_of(iec104, iec104_rules[key].name);
	const uint16_t timeout_s = (uint16_t)values[key].integer;

	if (!values[key].given)
		return;
	if (*of_all != 0 && *of_all != timeout_s)
		config_error(&loader->report, &here, "%u contradicts commands.%s, which is %u", timeout_s,
			     iec104_rules[key].name, *of_all);
	*of_all = timeout_s;
}

static void read_settings(struct config_loader *loader, const struct config_place *place, const json_t *json,
			  bool tls)
{
	const struct config_place address = config_key_of(place, iec104_rules[IEC104_ADDRESS].name);
	const struct config_place clock_masters =
	    config_key_of(place, iec104_rules[IEC104_CLOCK_MASTERS].name);
	struct iec104_settings *settings = iec104_settings(loader->config);
	struct map_settings *all = &loader->config->settings;
	struct config_value values[IEC104_KEYS];

	config_read_keys(&loader->report, place, json, iec104_rules, IEC104_KEYS, values);
	check_window(loader, place, values);
	check_times(loader, place, values);
	settings->port = tls && !values[IEC104_PORT].given ? PORT_TLS : (uint16_t)values[IEC104_PORT].integer;
	settings->k = (uint16_t)values[IEC104_K].integer;
	settings->w = (uint16_t)values[IEC104_W].integer;
	settings->t1_s = (uint16_t)values[IEC104_T1].integer;
	settings->t2_s = (uint16_t)values[IEC104_T2].integer;
	settings->t3_s = (uint32_t)values[IEC104_T3].integer;
	settings->max_connections = (uint16_t)values[IEC104_MAX_CONNECTIONS].integer;
	settings->connections_per_address = connections_per_address(loader, place, values);
	take_timeout(loader, place, values, IEC104_SELECT_TIMEOUT, &all->select_timeout_s);
	take_timeout(loader, place, values, IEC104_COMMAND_TIMEOUT, &all->command_timeout_s);
	settings->command_without_clock = values[IEC104_COMMAND_WITHOUT_CLOCK].integer != 0;
	settings->ignore_summer_bit = values[IEC104_IGNORE_SUMMER_BIT].integer != 0;
	settings->own_ca = (uint16_t)values[IEC104_OWN_CA].integer;
	settings->position_type = (uint8_t)values[IEC104_POSITION_TYPE].integer;
	if (!values[IEC104_ADDRESS].wrong)
		config_read_address(&loader->report, &address,
				    values[IEC104_ADDRESS].given ? values[IEC104_ADDRESS].text
								 : ADDRESS_DEFAULT,
				    settings->address);
	if (values[IEC104_CLOCK_MASTERS].given)
		settings->clock_master_count = (uint8_t)config_read_addresses(
		    &loader->report, &clock_masters, values[IEC104_CLOCK_MASTERS].json,
		    settings->clock_masters);
}

/* Who may connect and command, and who is redundant. */
static void read_controlling_stations(struct config_loader *loader, const struct config_place *file,
				      const struct config_value *values)
{
	static const struct {
		unsigned key;
		void (*read)(struct config_loader *loader, const struct config_place *array,
			     const json_t *json);
	} keys[] = {
	    {FILE_MASTERS, iec104_read_masters},
	    {FILE_GROUPS, iec104_read_groups},
	    {FILE_ORIGINATORS, iec104_read_originators},
	};
	const struct config_place groups = config_key_of(file, file_rules[FILE_GROUPS].name);

	for (size_t i = 0; i < sizeof(keys) / sizeof(keys[0]); i++) {
		const struct config_place array = config_key_of(file, file_rules[keys[i].key].name);

		if (values[keys[i].key].given)
			keys[i].read(loader, &array, values[keys[i].key].json);
	}
	iec104_check_masters(loader, &groups);
}

static bool begin(struct config_loader *loader, void *own, const json_t *root)
{
	struct iec104_settings *settings = calloc(1, sizeof(*settings));

	(void)own;
	(void)root;
	map_add_section(loader->config, IEC104_SETTINGS, sizeof(*settings), 1, settings);
	loader->sets_max++; /* the gateway's own station */
	loader->points_max += IEC104_OWN_POINTS_MAX;
	return settings != NULL;
}

static void read_part(struct config_loader *loader, void *own, const struct config_value *values)
{
	const struct config_place file = {.in = NULL};
	const struct config_place settings = config_key_of(&file, file_rules[FILE_IEC104].name);
	const struct config_place tls = config_key_of(&file, file_rules[FILE_TLS].name);

	(void)own;
	read_settings(loader, &settings, values[FILE_IEC104].given ? values[FILE_IEC104].json : NULL,
		      values[FILE_TLS].given);
	if (values[FILE_TLS].given)
		channel_read_tls(&loader->report, &tls, values[FILE_TLS].json, &tls_masters,
				 &iec104_settings(loader->config)->tls);
	read_controlling_stations(loader, &file, values);
}

static bool finish(struct config_loader *loader, void *own)
{
	(void)own;
	iec104_add_own_station(loader);
	return true;
}

const struct config_part iec104_part = {
    .keys = file_rules,
    .key_count = FILE_KEYS,
    .begin = begin,
    .read = read_part,
    .finish = finish,
};
