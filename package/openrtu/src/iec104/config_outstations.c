/* SPDX-License-Identifier: GPL-3.0-or-later */
/* The array "outstations": controlled stations, which of their common addresses are sets, and which objects are points. */
#include "iec104/config_outstations.h"

#include <stdlib.h>
#include <string.h>

#include "channel/config_tls.h"
#include "config/address.h"
#include "config/commands.h"
#include "config/names.h"
#include "config/sets.h"
#include "config/zone.h"
#include "iec104/geoposition.h"
#include "iec104/outstations.h"

#define SECONDS_OF_2_DAYS 172800
#define PORT_PLAIN        2404
#define PORT_TLS          19998
#define PERIOD_MAX_S      604800 /* a week */
#define WAIT_MAX_MS       3600000
#define CA_MAX            65534
#define IOA_MAX           16777215
#define IOA_BITS          24
#define COUNT_MAX         1000

/* Those that the standard has, and a position. */
#define POSITION      (MAP_COUNTER + 1) /* after the last of the standard's types */
#define POSITION_TYPE "position"
static const char *const types[] = {MAP_STANDARD_TYPES(MAP_TYPE_NAME) POSITION_TYPE, NULL};

enum {
	POINT_NAME,
	POINT_TYPE,
	POINT_IOA,
	POINT_REMOTE_IOA,
	POINT_COUNT,
	POINT_GROUP,
	POINT_READ,
	POINT_COMMAND,
	POINT_COMMAND_IOA,
	POINT_SELECT,
	POINT_SHORT_PULSE,
	POINT_LONG_PULSE,
	POINT_KEYS
};
static const struct config_rule point_rules[POINT_KEYS] = {
    [POINT_NAME] = {CONFIG_KEY_NAME, CONFIG_TEXT, .low = 1, .high = MAP_NAME_SIZE - 1,
		    CONFIG_SAYS("Name, once in the file; of several objects each has its number behind it. "
				"Without it, the set's, a dot and ioa.",
				.pattern = "^[^ *?\\[\\]\\\\\\u0000-\\u001f\\u007f]*$")},
    [POINT_TYPE] = {"type", CONFIG_CHOICE, .required = true, .choices = types, CONFIG_SAYS("What it sends.")},
    [POINT_IOA] = {"ioa", CONFIG_INTEGER, .required = true, .low = 1, .high = IOA_MAX,
		   CONFIG_SAYS("Information object address here; of a position the first of four.")},
    [POINT_REMOTE_IOA] = {"remote_ioa", CONFIG_INTEGER, .low = 1, .high = IOA_MAX,
			  CONFIG_SAYS("Information object address there, as ioa unless it is given.")},
    [POINT_COUNT] = {"count", CONFIG_INTEGER, .low = 1, .high = COUNT_MAX, .fallback = 1,
		     CONFIG_SAYS("So many objects at consecutive addresses.")},
    [POINT_GROUP] = {"group", CONFIG_INTEGER, .low = 1, .high = 16, CONFIG_SAYS("Interrogation group.")},
    [POINT_READ] =
	{"read_ms", CONFIG_INTEGER, .low = 100, .high = WAIT_MAX_MS,
	 CONFIG_SAYS(
	     "Milliseconds between reads of the object (C_RD_NA_1). Without it, it is not read by itself.")},
    [POINT_COMMAND] = {"command", CONFIG_BOOLEAN, CONFIG_SAYS("It can be commanded.")},
    [POINT_COMMAND_IOA] =
	{"command_ioa", CONFIG_INTEGER, .low = 1, .high = IOA_MAX,
	 CONFIG_SAYS("Information object address of its command there, as remote_ioa unless it is given.")},
    [POINT_SELECT] = {"select", CONFIG_BOOLEAN,
		      CONFIG_SAYS("A command needs a selection first, here and there.")},
    [POINT_SHORT_PULSE] = {"short_pulse_ms", CONFIG_INTEGER, .low = 1, .high = 65535,
			   CONFIG_SAYS("Length of the short pulse that its command makes there.")},
    [POINT_LONG_PULSE] = {"long_pulse_ms", CONFIG_INTEGER, .low = 1, .high = 65535,
			  CONFIG_SAYS("Length of the long pulse that its command makes there.")},
};
CONFIG_TABLE(outstation_point_table, .name = "outstation_point", .rules = point_rules, .count = POINT_KEYS);

enum { SET_CA, SET_REMOTE_CA, SET_POINTS, SET_KEYS };
static const struct config_rule set_rules[SET_KEYS] = {
    [SET_CA] = {"ca", CONFIG_INTEGER, .required = true, .low = 1, .high = CA_MAX,
		CONFIG_SAYS("Common address here, which no other set has.")},
    [SET_REMOTE_CA] = {"remote_ca", CONFIG_INTEGER, .low = 1, .high = CA_MAX,
		       CONFIG_SAYS("Common address there, as ca unless it is given.")},
    [SET_POINTS] = {"points", CONFIG_ARRAY, .required = true, .high = IEC104_OUTSTATION_POINTS_MAX,
		    CONFIG_SAYS("Its objects that are points; what else it sends is counted.",
				.table = &outstation_point_table)},
};
CONFIG_TABLE(outstation_set_table, .name = "outstation_set", .rules = set_rules, .count = SET_KEYS);

enum {
	OUTSTATION_NAME,
	OUTSTATION_ADDRESSES,
	OUTSTATION_PORT,
	OUTSTATION_SECURE,
	OUTSTATION_CERTIFICATE,
	OUTSTATION_K,
	OUTSTATION_W,
	OUTSTATION_T1,
	OUTSTATION_T2,
	OUTSTATION_T3,
	OUTSTATION_ORIGINATOR,
	OUTSTATION_TIMEZONE,
	OUTSTATION_TERMINATES,
	OUTSTATION_CONFIRMATION,
	OUTSTATION_TERMINATION,
	OUTSTATION_INTERROGATION_TIME,
	OUTSTATION_RETRY,
	OUTSTATION_RETRY_MAX,
	OUTSTATION_INTERROGATES,
	OUTSTATION_INTERROGATION,
	OUTSTATION_COUNTERS,
	OUTSTATION_CLOCK,
	OUTSTATION_POSITION_TYPE,
	OUTSTATION_SETS,
	OUTSTATION_KEYS
};
static const struct config_rule outstation_rules[OUTSTATION_KEYS] = {
    [OUTSTATION_NAME] = {CONFIG_KEY_NAME, CONFIG_TEXT, .required = true, .low = 1,
			 .high = IEC104_OUTSTATION_NAME_SIZE - 1,
			 CONFIG_SAYS("Name, once in the file: that of its sets begins with it.",
				     .pattern = "^[^ *?\\[\\]\\\\\\u0000-\\u001f\\u007f]*$")},
    [OUTSTATION_ADDRESSES] =
	{"addresses", CONFIG_ARRAY, .required = true, .high = IEC104_OUTSTATION_LINKS_MAX,
	 CONFIG_SAYS("Its IP address; with a second one, two links, of which one has data transfer.",
		     .json = CONFIG_JSON({"minItems" : 1, "items" : {"$ref" : "#/$defs/ip_address"}}))},
    [OUTSTATION_PORT] = {"port", CONFIG_INTEGER, .low = 1, .high = 65535, .fallback = PORT_PLAIN,
			 CONFIG_SAYS(
			     "TCP port of its addresses; of a secure one, 19998 unless it is given.")},
    [OUTSTATION_SECURE] = {"secure", CONFIG_BOOLEAN, CONFIG_SAYS("It is reached with TLS.")},
    [OUTSTATION_CERTIFICATE] =
	{"certificate", CONFIG_TEXT, .low = 1, .high = CHANNEL_TLS_PEER_SIZE - 1,
	 CONFIG_SAYS("Common name of its certificate, or SHA-256 fingerprint as AB:CD:...; without it, "
		     "whoever has a certificate from the CAs.",
		     .json = CONFIG_JSON({
			     "anyOf" : [
				     {"maxLength" : 64, "pattern" : "^[^\\u0000-\\u001f\\u007f]*$"},
				     {"pattern" : "^([0-9A-Fa-f]{2}:){31}[0-9A-Fa-f]{2}$"}
			     ],
			     "examples" : ["town 7"]
		     }))},
    [OUTSTATION_K] = {"k", CONFIG_INTEGER, .low = 1, .high = 32767, .fallback = 12,
		      CONFIG_SAYS("I frames sent to it that it may leave unacknowledged.")},
    [OUTSTATION_W] = {"w", CONFIG_INTEGER, .low = 1, .high = 32767, .fallback = 8,
		      CONFIG_SAYS("I frames of it after which the gateway acknowledges, at most k.")},
    [OUTSTATION_T1] = {"t1", CONFIG_INTEGER, .low = 2, .high = 255, .fallback = 15,
		       CONFIG_SAYS("Seconds that it has to acknowledge.", .unit = "s")},
    [OUTSTATION_T2] = {"t2", CONFIG_INTEGER, .low = 1, .high = 254, .fallback = 10,
		       CONFIG_SAYS("Seconds after which the gateway acknowledges, less than t1.",
				   .unit = "s")},
    [OUTSTATION_T3] = {"t3", CONFIG_INTEGER, .low = 1, .high = SECONDS_OF_2_DAYS, .fallback = 20,
		       CONFIG_SAYS("Seconds of silence after which a link is tested.", .unit = "s")},
    [OUTSTATION_ORIGINATOR] = {"originator", CONFIG_INTEGER, .low = 0, .high = 255,
			       CONFIG_SAYS("Originator address of all that it is asked.")},
    [OUTSTATION_TIMEZONE] = {"timezone", CONFIG_TEXT, .low = 4, .high = 63,
			     CONFIG_SAYS("Time zone of its time tags. Without it, that of the file.",
					 .json = CONFIG_JSON({"$ref" : "#/properties/timezone"}))},
    [OUTSTATION_TERMINATES] = {"terminates", CONFIG_BOOLEAN, .fallback = 1,
			       CONFIG_SAYS(
				   "It ends a command with ACT_TERM; false: its confirmation is the end.")},
    [OUTSTATION_CONFIRMATION] = {"confirmation_ms", CONFIG_INTEGER, .low = 10, .high = WAIT_MAX_MS,
				 .fallback = 10000,
				 CONFIG_SAYS("Milliseconds that it has to confirm what it is asked.")},
    [OUTSTATION_TERMINATION] = {"termination_ms", CONFIG_INTEGER, .low = 10, .high = WAIT_MAX_MS,
				.fallback = 60000,
				CONFIG_SAYS("Milliseconds from the confirmation of a command to its end.")},
    [OUTSTATION_INTERROGATION_TIME] =
	{"interrogation_ms", CONFIG_INTEGER, .low = 10, .high = WAIT_MAX_MS, .fallback = 60000,
	 CONFIG_SAYS("Milliseconds from the confirmation of an interrogation to its end.")},
    [OUTSTATION_RETRY] = {"retry_ms", CONFIG_INTEGER, .low = 10, .high = WAIT_MAX_MS, .fallback = 1000,
			  CONFIG_SAYS(
			      "Milliseconds until a link is tried again; they double with each failure.")},
    [OUTSTATION_RETRY_MAX] = {"retry_max_ms", CONFIG_INTEGER, .low = 10, .high = WAIT_MAX_MS,
			      .fallback = 60000,
			      CONFIG_SAYS("Milliseconds until a link is tried again, at most.")},
    [OUTSTATION_INTERROGATES] = {"interrogate_at_start", CONFIG_BOOLEAN, .fallback = 1,
				 CONFIG_SAYS("A general interrogation when data transfer starts.")},
    [OUTSTATION_INTERROGATION] =
	{"interrogation_s", CONFIG_INTEGER, .low = 0, .high = PERIOD_MAX_S,
	 CONFIG_SAYS(
	     "Seconds between general interrogations, 0: only at the start, and when it was initialised.")},
    [OUTSTATION_COUNTERS] = {"counters_s", CONFIG_INTEGER, .low = 0, .high = PERIOD_MAX_S,
			     CONFIG_SAYS(
				 "Seconds between counter interrogations, the first at the start, 0: none.")},
    [OUTSTATION_CLOCK] = {"clock_s", CONFIG_INTEGER, .low = 0, .high = PERIOD_MAX_S,
			  CONFIG_SAYS("Seconds between clock synchronisations, the first at the start, 0: "
				      "none. The clock of the gateway must be set.")},
    [OUTSTATION_POSITION_TYPE] = {"position_type", CONFIG_INTEGER, .low = IEC104_PRIVATE_FIRST,
				  .high = IEC104_PRIVATE_LAST, .fallback = IEC104_GEOPOSITION,
				  CONFIG_SAYS("Private type of its positions.")},
    [OUTSTATION_SETS] = {"sets", CONFIG_ARRAY, .required = true, .high = IEC104_OUTSTATION_SETS_MAX,
			 CONFIG_SAYS("Its common addresses, each with its points.",
				     .table = &outstation_set_table, .json = CONFIG_JSON({"minItems" : 1}))},
};
CONFIG_TABLE(outstation_table, .name = "outstation", .rules = outstation_rules, .count = OUTSTATION_KEYS);

CONFIG_TABLE(tls_table, .name = "outstations_tls", .rules = channel_tls_rules, .count = CHANNEL_TLS_RULES);

enum { FILE_OUTSTATIONS, FILE_TLS, FILE_KEYS };
static const struct config_rule file_rules[FILE_KEYS] = {
    [FILE_OUTSTATIONS] = {"outstations", CONFIG_ARRAY, .high = IEC104_OUTSTATIONS_MAX,
			  CONFIG_SAYS("Other stations of IEC 60870-5-104, whose objects become points.",
				      .see = "concentrator.md", .table = &outstation_table)},
    [FILE_TLS] = {"outstations_tls", CONFIG_OBJECT,
		  CONFIG_SAYS("IEC 62351-3: who the gateway is for outstations with TLS.",
			      .table = &tls_table)},
};

/* ---- points ------------------------------------------------------------------------------ */

static struct config_commands commands_of(const struct config_value *values)
{
	return (struct config_commands){&values[POINT_COMMAND], &values[POINT_SELECT],
					&values[POINT_SHORT_PULSE], &values[POINT_LONG_PULSE]};
}

static void check_command(struct config_loader *loader, const struct config_place *place,
			  const struct config_value *values)
{
	const struct config_place ioa = config_key_of(place, point_rules[POINT_COMMAND_IOA].name);
	const struct config_commands commands = commands_of(values);
	const bool pulses = values[POINT_SHORT_PULSE].given || values[POINT_LONG_PULSE].given;
	const int64_t type = values[POINT_TYPE].integer;

	config_check_commands(&loader->report, place, &commands);
	if (values[POINT_COMMAND_IOA].given && values[POINT_COMMAND].integer == 0)
		config_error(&loader->report, &ioa, CONFIG_NEEDS_COMMAND);
	if (values[POINT_COMMAND].integer == 0 || values[POINT_TYPE].wrong)
		return;
	if (type == POSITION)
		config_error(&loader->report, place, "is a position, for which there is no command");
	if (type == MAP_COUNTER)
		config_error(&loader->report, place, "is a counter, for which there is no command");
	if (type == MAP_BITSTRING && values[POINT_SELECT].integer != 0)
		config_error(&loader->report, place, "is a bitstring, whose command has no selection");
	if (pulses && type != MAP_SINGLE && type != MAP_DOUBLE)
		config_error(&loader->report, place,
			     "has a pulse, expected that of a single or double point");
	if (pulses && values[POINT_SHORT_PULSE].integer == values[POINT_LONG_PULSE].integer)
		config_error(&loader->report, place, "has two pulses of one length, expected different ones");
}

static void check_range(struct config_loader *loader, const struct config_place *place,
			const struct config_value *values, int64_t first, int key)
{
	const struct config_place here = config_key_of(place, point_rules[key].name);

	if (first + values[POINT_COUNT].integer - 1 > IOA_MAX)
		config_error(&loader->report, &here, "is too high for %lld objects, the last address is %d",
			     (long long)values[POINT_COUNT].integer, IOA_MAX);
}

static void check_remote_ioa(struct config_loader *loader, const struct config_place *place,
			     const struct iec104_outstation_set *set, uint32_t ioa)
{
	const struct iec104_outstation_point *points = iec104_outstation_points(loader->config);
	const uint32_t count = map_record_count(loader->config, IEC104_OUTSTATION_POINTS);

	for (uint32_t i = set->first_point; i < count; i++)
		if (points[i].ioa == ioa)
			config_error(&loader->report, place,
				     "%u is the remote_ioa of another point of this set", ioa);
}

static void name_point(const struct config_value *values, const char *set, uint32_t ioa, uint32_t number,
		       char out[MAP_NAME_SIZE])
{
	if (!values[POINT_NAME].given)
		snprintf(out, MAP_NAME_SIZE, "%.28s.%u", set, ioa);
	else if (values[POINT_COUNT].integer == 1)
		snprintf(out, MAP_NAME_SIZE, "%s", values[POINT_NAME].text);
	else
		snprintf(out, MAP_NAME_SIZE, "%.33s%u", values[POINT_NAME].text, number);
}

/* As those of a receiver: the position as a whole, and behind it what masters take that do not know its type. */
static void add_position(struct config_loader *loader, const struct config_place *place,
			 const struct iec104_outstation_set *set, const struct config_value *values)
{
	static const struct {
		const char *name;
		enum map_type type;
	} parts[IEC104_OUTSTATION_POSITION_POINTS] = {{"position", MAP_BITSTRING},
						      {"latitude", MAP_ANGLE},
						      {"longitude", MAP_ANGLE},
						      {"altitude", MAP_FLOAT}};
	const uint32_t ioa = (uint32_t)values[POINT_IOA].integer;
	const uint32_t remote =
	    values[POINT_REMOTE_IOA].given ? (uint32_t)values[POINT_REMOTE_IOA].integer : ioa;

	check_remote_ioa(loader, place, set, remote);
	for (uint32_t i = 0; i < IEC104_OUTSTATION_POSITION_POINTS; i++) {
		struct iec104_outstation_point *there;
		struct map_point *point;
		char whole[MAP_NAME_SIZE], name[MAP_NAME_SIZE];

		name_point(values, loader->config->sets[set->set].name, ioa, 1, whole);
		snprintf(name, sizeof(name), "%.28s.%s", whole, parts[i].name);
		point = config_add_point(loader, place, name, parts[i].type, ioa + i);
		point->group = (uint8_t)values[POINT_GROUP].integer;
		if (i == 0)
			point->flags |= MAP_POINT_POSITION;
		there = map_next_record(loader->config, IEC104_OUTSTATION_POINTS);
		*there = (struct iec104_outstation_point){
		    .ioa = i << IOA_BITS | remote,
		    .read_ms = i == 0 ? (uint32_t)values[POINT_READ].integer : 0};
	}
}

static void check_position(struct config_loader *loader, const struct config_place *place,
			   const struct config_value *values)
{
	const struct config_place count = config_key_of(place, point_rules[POINT_COUNT].name);
	const struct config_place ioa = config_key_of(place, point_rules[POINT_IOA].name);

	if (values[POINT_TYPE].wrong || values[POINT_TYPE].integer != POSITION)
		return;
	if (values[POINT_COUNT].given)
		config_error(&loader->report, &count, "is not for a position, which has four points");
	if (values[POINT_IOA].integer > IOA_MAX - (IEC104_OUTSTATION_POSITION_POINTS - 1))
		config_error(&loader->report, &ioa, "is too high for the four points of a position");
}

static void add_points(struct config_loader *loader, const struct config_place *place,
		       const struct iec104_outstation_set *set, const struct config_value *values)
{
	const char *set_name = loader->config->sets[set->set].name;
	const uint32_t ioa = (uint32_t)values[POINT_IOA].integer;
	const uint32_t remote =
	    values[POINT_REMOTE_IOA].given ? (uint32_t)values[POINT_REMOTE_IOA].integer : ioa;
	const uint32_t command =
	    values[POINT_COMMAND_IOA].given ? (uint32_t)values[POINT_COMMAND_IOA].integer : remote;
	const struct config_commands commands = commands_of(values);

	check_range(loader, place, values, ioa, POINT_IOA);
	check_range(loader, place, values, remote, POINT_REMOTE_IOA);
	check_range(loader, place, values, command, POINT_COMMAND_IOA);
	for (uint32_t i = 0; i < values[POINT_COUNT].integer; i++) {
		struct iec104_outstation_point *there;
		struct map_point *point;
		char name[MAP_NAME_SIZE];

		check_remote_ioa(loader, place, set, remote + i);
		name_point(values, set_name, ioa + i, i + 1, name);
		point =
		    config_add_point(loader, place, name, (enum map_type)values[POINT_TYPE].integer, ioa + i);
		point->group = (uint8_t)values[POINT_GROUP].integer;
		config_set_commands(&commands, point);
		there = map_next_record(loader->config, IEC104_OUTSTATION_POINTS);
		*there = (struct iec104_outstation_point){.ioa = remote + i,
							  .command_ioa = command + i,
							  .read_ms = (uint32_t)values[POINT_READ].integer,
							  .select = values[POINT_SELECT].integer != 0};
	}
}

static void read_point(struct config_loader *loader, const struct config_place *place, const json_t *json,
		       const struct iec104_outstation_set *set)
{
	const struct config_place name = config_key_of(place, point_rules[POINT_NAME].name);
	struct config_value values[POINT_KEYS];
	unsigned errors = loader->report.errors;

	config_read_keys(&loader->report, place, json, point_rules, POINT_KEYS, values);
	if (values[POINT_NAME].given)
		config_check_name(&loader->report, &name, values[POINT_NAME].text);
	check_command(loader, place, values);
	check_position(loader, place, values);
	if (loader->report.errors != errors)
		return;
	if (values[POINT_TYPE].integer == POSITION)
		add_position(loader, place, set, values);
	else
		add_points(loader, place, set, values);
}

/* ---- sets -------------------------------------------------------------------------------- */

static void check_remote_ca(struct config_loader *loader, const struct config_place *place,
			    const struct iec104_outstation *outstation, uint16_t ca)
{
	const struct iec104_outstation_set *sets = iec104_outstation_sets(loader->config);

	for (uint32_t i = 0; i < outstation->set_count; i++)
		if (sets[outstation->first_set + i].ca == ca)
			config_error(&loader->report, place,
				     "%u is the remote_ca of another set of this outstation", ca);
}

static void read_set(struct config_loader *loader, const struct config_place *place, const json_t *json,
		     struct iec104_outstation *outstation)
{
	const struct config_place ca = config_key_of(place, set_rules[SET_CA].name);
	const struct config_place points = config_key_of(place, set_rules[SET_POINTS].name);
	struct iec104_outstation_set *set;
	struct config_value values[SET_KEYS];
	char name[MAP_NAME_SIZE];
	const json_t *point;
	size_t i;

	config_read_keys(&loader->report, place, json, set_rules, SET_KEYS, values);
	if (values[SET_CA].wrong || values[SET_REMOTE_CA].wrong || !values[SET_POINTS].given)
		return;
	if (!values[SET_REMOTE_CA].given)
		values[SET_REMOTE_CA].integer = values[SET_CA].integer;
	check_remote_ca(loader, place, outstation, (uint16_t)values[SET_REMOTE_CA].integer);
	set = map_next_record(loader->config, IEC104_OUTSTATION_SETS);
	*set = (struct iec104_outstation_set){
	    .set = (uint16_t)loader->config->set_count,
	    .ca = (uint16_t)values[SET_REMOTE_CA].integer,
	    .first_point = map_record_count(loader->config, IEC104_OUTSTATION_POINTS),
	};
	outstation->set_count++;
	snprintf(name, sizeof(name), "%s-%u", outstation->name, (unsigned)values[SET_CA].integer);
	config_add_set(loader, &ca, (uint16_t)values[SET_CA].integer, name);
	json_array_foreach(values[SET_POINTS].json, i, point)
	{
		const struct config_place here = config_element_of(&points, i);

		read_point(loader, &here, point, set);
	}
}

/* ---- outstations ------------------------------------------------------------------------- */

static void check_order(struct config_loader *loader, const struct config_place *place,
			const struct config_value *values, int low, int high, bool may_be_same)
{
	const struct config_place here = config_key_of(place, outstation_rules[low].name);

	if (values[low].wrong || values[high].wrong || values[low].integer < values[high].integer ||
	    (may_be_same && values[low].integer == values[high].integer))
		return;
	config_error(&loader->report, &here, "%lld is too much, expected %s %s (%lld)",
		     (long long)values[low].integer, may_be_same ? "at most" : "less than",
		     outstation_rules[high].name, (long long)values[high].integer);
}

static void read_times(const struct config_value *values, struct iec104_outstation *outstation)
{
	outstation->k = (uint16_t)values[OUTSTATION_K].integer;
	outstation->w = (uint16_t)values[OUTSTATION_W].integer;
	outstation->t1_s = (uint16_t)values[OUTSTATION_T1].integer;
	outstation->t2_s = (uint16_t)values[OUTSTATION_T2].integer;
	outstation->t3_s = (uint32_t)values[OUTSTATION_T3].integer;
	outstation->confirmation_ms = (uint32_t)values[OUTSTATION_CONFIRMATION].integer;
	outstation->termination_ms = (uint32_t)values[OUTSTATION_TERMINATION].integer;
	outstation->interrogation_ms = (uint32_t)values[OUTSTATION_INTERROGATION_TIME].integer;
	outstation->retry_ms = (uint32_t)values[OUTSTATION_RETRY].integer;
	outstation->retry_max_ms = (uint32_t)values[OUTSTATION_RETRY_MAX].integer;
	outstation->interrogation_s = (uint32_t)values[OUTSTATION_INTERROGATION].integer;
	outstation->counters_s = (uint32_t)values[OUTSTATION_COUNTERS].integer;
	outstation->clock_s = (uint32_t)values[OUTSTATION_CLOCK].integer;
	outstation->position_type = (uint8_t)values[OUTSTATION_POSITION_TYPE].integer;
}

static void read_security(struct config_loader *loader, const struct config_place *place,
			  const struct config_value *values, struct iec104_outstation *outstation)
{
	const struct config_place secure = config_key_of(place, outstation_rules[OUTSTATION_SECURE].name);
	const struct config_place certificate =
	    config_key_of(place, outstation_rules[OUTSTATION_CERTIFICATE].name);

	outstation->secure = values[OUTSTATION_SECURE].integer != 0;
	if (outstation->secure && iec104_outstation_tls(loader->config) == NULL)
		config_error(&loader->report, &secure,
			     "needs the certificate of this gateway, expected an object %s in the file",
			     file_rules[FILE_TLS].name);
	if (outstation->secure && !values[OUTSTATION_PORT].given)
		outstation->port = PORT_TLS;
	if (!values[OUTSTATION_CERTIFICATE].given)
		return;
	if (!channel_names_certificate(values[OUTSTATION_CERTIFICATE].text))
		config_error(&loader->report, &certificate,
			     "is neither a common name nor a SHA-256 fingerprint as AB:CD:...");
	if (!outstation->secure)
		config_error(&loader->report, &certificate,
			     "is of an outstation with TLS, expected \"secure\": true beside it");
	snprintf(outstation->certificate, sizeof(outstation->certificate), "%s",
		 values[OUTSTATION_CERTIFICATE].text);
}

static void read_link(struct config_loader *loader, const struct config_place *place,
		      const struct config_value *values, struct iec104_outstation *outstation)
{
	const struct config_place addresses =
	    config_key_of(place, outstation_rules[OUTSTATION_ADDRESSES].name);
	const struct config_place zone = config_key_of(place, outstation_rules[OUTSTATION_TIMEZONE].name);

	outstation->port = (uint16_t)values[OUTSTATION_PORT].integer;
	outstation->originator = (uint8_t)values[OUTSTATION_ORIGINATOR].integer;
	outstation->terminates = values[OUTSTATION_TERMINATES].integer != 0;
	outstation->interrogates = values[OUTSTATION_INTERROGATES].integer != 0;
	outstation->zone = loader->config->settings.zone;
	if (values[OUTSTATION_ADDRESSES].given)
		outstation->address_count = (uint8_t)config_read_addresses(
		    &loader->report, &addresses, values[OUTSTATION_ADDRESSES].json, outstation->addresses);
	if (values[OUTSTATION_ADDRESSES].given && outstation->address_count == 0)
		config_error(&loader->report, &addresses,
			     "is empty, expected one address, or two of redundant "
			     "links");
	if (values[OUTSTATION_TIMEZONE].given &&
	    !config_read_zone(values[OUTSTATION_TIMEZONE].text, &outstation->zone))
		config_error(&loader->report, &zone,
			     "is not a time zone, expected one like UTC0 or CET-1CEST,M3.5.0,M10.5.0/3");
}

static void read_name(struct config_loader *loader, const struct config_place *place,
		      const struct config_value *value, struct iec104_outstation *outstation)
{
	const struct config_place here = config_key_of(place, outstation_rules[OUTSTATION_NAME].name);
	const struct iec104_outstation *others = iec104_outstations(loader->config);

	if (!value->given)
		return;
	config_check_name(&loader->report, &here, value->text);
	for (const struct iec104_outstation *other = others; other < outstation; other++)
		if (strcmp(other->name, value->text) == 0)
			config_error(&loader->report, &here, "\"%s\" is the name of another outstation",
				     value->text);
	snprintf(outstation->name, sizeof(outstation->name), "%s", value->text);
}

static void read_outstation(struct config_loader *loader, const struct config_place *place,
			    const json_t *json)
{
	const struct config_place sets = config_key_of(place, outstation_rules[OUTSTATION_SETS].name);
	struct iec104_outstation *outstation = map_next_record(loader->config, IEC104_OUTSTATIONS);
	struct config_value values[OUTSTATION_KEYS];
	const json_t *set;
	size_t i;

	config_read_keys(&loader->report, place, json, outstation_rules, OUTSTATION_KEYS, values);
	read_name(loader, place, &values[OUTSTATION_NAME], outstation);
	check_order(loader, place, values, OUTSTATION_W, OUTSTATION_K, true);
	check_order(loader, place, values, OUTSTATION_T2, OUTSTATION_T1, false);
	check_order(loader, place, values, OUTSTATION_RETRY, OUTSTATION_RETRY_MAX, true);
	read_times(values, outstation);
	read_link(loader, place, values, outstation);
	read_security(loader, place, values, outstation);
	outstation->first_set = map_record_count(loader->config, IEC104_OUTSTATION_SETS);
	if (!values[OUTSTATION_SETS].given)
		return;
	if (json_array_size(values[OUTSTATION_SETS].json) == 0)
		config_error(&loader->report, &sets, "is empty, expected at least one set");
	json_array_foreach(values[OUTSTATION_SETS].json, i, set)
	{
		const struct config_place here = config_element_of(&sets, i);

		read_set(loader, &here, set, outstation);
	}
}

/* ---- the part ---------------------------------------------------------------------------- */

/* The elements of an array of the file, if it is none of too many. */
static const json_t *elements(const json_t *object, const struct config_rule *rule)
{
	const json_t *array = json_object_get(object, rule->name);

	return json_array_size(array) > (size_t)rule->high ? NULL : array;
}

/* What this part keeps from step to step. */
struct own {
	const json_t *outstations, *tls;
	uint64_t points;
};

static uint64_t count_points(const json_t *set)
{
	const json_t *point;
	uint64_t count = 0;
	size_t i;

	json_array_foreach(elements(set, &set_rules[SET_POINTS]), i, point)
	{
		json_int_t objects =
		    json_integer_value(json_object_get(point, point_rules[POINT_COUNT].name));
		const char *type = json_string_value(json_object_get(point, point_rules[POINT_TYPE].name));

		if (type != NULL && strcmp(type, POSITION_TYPE) == 0)
			objects = IEC104_OUTSTATION_POSITION_POINTS;
		count += objects > 1 && objects <= COUNT_MAX ? (uint64_t)objects : 1;
	}
	return count;
}

static uint32_t count_sets(const json_t *outstations, struct own *own)
{
	const json_t *outstation, *set;
	uint32_t sets = 0;
	size_t i, j;

	json_array_foreach(outstations, i, outstation)
	{
		const json_t *of_it = elements(outstation, &outstation_rules[OUTSTATION_SETS]);

		sets += (uint32_t)json_array_size(of_it);
		json_array_foreach(of_it, j, set)
		{
			own->points += count_points(set);
		}
	}
	return sets;
}

/* One record. False: no memory. */
static bool add_tls(struct config_loader *loader, const json_t *root)
{
	void *tls;

	if (json_object_get(root, file_rules[FILE_TLS].name) == NULL)
		return true;
	tls = config_allocate(1, sizeof(struct channel_tls));
	map_add_section(loader->config, IEC104_OUTSTATION_TLS, sizeof(struct channel_tls), 1, tls);
	return tls != NULL;
}

static bool begin(struct config_loader *loader, void *own_part, const json_t *root)
{
	const json_t *array = elements(root, &file_rules[FILE_OUTSTATIONS]);
	const uint32_t count = (uint32_t)json_array_size(array);
	struct own *own = own_part;
	const uint32_t sets = count_sets(array, own);
	const uint32_t points = (uint32_t)own->points;
	void *outstations, *all_sets, *all_points;

	if (!add_tls(loader, root))
		return false;
	if (count == 0 || own->points > IEC104_OUTSTATION_POINTS_MAX)
		return true;
	outstations = config_allocate(count, sizeof(struct iec104_outstation));
	all_sets = config_allocate(sets, sizeof(struct iec104_outstation_set));
	all_points = config_allocate(points, sizeof(struct iec104_outstation_point));
	map_add_section(loader->config, IEC104_OUTSTATIONS, sizeof(struct iec104_outstation), 0, outstations);
	map_add_section(loader->config, IEC104_OUTSTATION_SETS, sizeof(struct iec104_outstation_set), 0,
			all_sets);
	map_add_section(loader->config, IEC104_OUTSTATION_POINTS, sizeof(struct iec104_outstation_point), 0,
			all_points);
	loader->sets_max += sets;
	loader->points_max += points;
	return outstations != NULL && all_sets != NULL && all_points != NULL;
}

static void read_part(struct config_loader *loader, void *own_part, const struct config_value *values)
{
	struct own *own = own_part;

	own->outstations = values[FILE_OUTSTATIONS].given ? values[FILE_OUTSTATIONS].json : NULL;
	own->tls = values[FILE_TLS].given ? values[FILE_TLS].json : NULL;
	(void)loader;
}

static bool finish(struct config_loader *loader, void *own_part)
{
	const struct config_place file = {.in = NULL};
	const struct config_place array = config_key_of(&file, file_rules[FILE_OUTSTATIONS].name);
	const struct config_place tls = config_key_of(&file, file_rules[FILE_TLS].name);
	const struct own *own = own_part;
	const json_t *outstation;
	size_t i;

	if (own->points > IEC104_OUTSTATION_POINTS_MAX) {
		config_error(&loader->report, &array, "has %llu points, expected at most %d",
			     (unsigned long long)own->points, IEC104_OUTSTATION_POINTS_MAX);
		return true;
	}
	if (own->tls != NULL)
		channel_read_tls(&loader->report, &tls, own->tls, NULL,
				 iec104_outstation_tls(loader->config));
	json_array_foreach(own->outstations, i, outstation)
	{
		const struct config_place place = config_element_of(&array, i);

		read_outstation(loader, &place, outstation);
	}
	return true;
}

const struct config_part iec104_outstations_part = {
    .keys = file_rules,
    .key_count = FILE_KEYS,
    .own_size = sizeof(struct own),
    .begin = begin,
    .read = read_part,
    .finish = finish,
};
