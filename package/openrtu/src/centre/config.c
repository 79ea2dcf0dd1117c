/* SPDX-License-Identifier: GPL-3.0-or-later */
#include "centre/config.h"

#include <inttypes.h>
#include <stdlib.h>
#include <string.h>

#include "channel/config_tls.h"
#include "config/files.h"
#include "config/zone.h"
#include "map/address.h"
#include "map/time_ns.h"

#define SECONDS_OF_2_DAYS 172800
#define PORT_PLAIN        2404
#define PORT_TLS          19998 /* IANA: iec-104-sec */
#define READS_MAX         64
#define CAS_MAX           16
#define PERIOD_MAX_S      604800 /* a week */
#define IOA_MAX           16777215
#define SINGLE_PLACES     3 /* of polls, of a common address, beside the reads */

enum { READ_CA, READ_IOA, READ_PERIOD, READ_KEYS };
static const struct config_rule read_rules[READ_KEYS] = {
    [READ_CA] = {"common_address", CONFIG_INTEGER, .required = true, .low = 1,
		 .high = IEC104_CA_BROADCAST - 1, CONFIG_SAYS("Common address of the object.")},
    [READ_IOA] = {"ioa", CONFIG_INTEGER, .required = true, .low = 1, .high = IOA_MAX,
		  CONFIG_SAYS("Information object address.")},
    [READ_PERIOD] = {"period_ms", CONFIG_INTEGER, .required = true, .low = 10, .high = PERIOD_MAX_S * 1000.0,
		     CONFIG_SAYS("Between two reads.")},
};
CONFIG_TABLE(read_table, .name = "read", .rules = read_rules, .count = READ_KEYS);

/* A station's keys; those behind its own may be in "defaults", too. */
enum {
	STATION_NAME,
	STATION_ADDRESS,
	STATION_SECOND,
	STATION_CERTIFICATE,
	STATION_PORT,
	STATION_SECURE,
	STATION_CAS,
	STATION_ORIGINATOR,
	STATION_POSITION_TYPE,
	STATION_TERMINATES,
	STATION_INTERROGATE,
	STATION_INTERROGATION,
	STATION_COUNTERS,
	STATION_CLOCK,
	STATION_READS,
	STATION_KEYS,
	STATION_OWN = STATION_PORT
};
static const struct config_rule station_rules[STATION_KEYS] = {
    [STATION_NAME] = {"name", CONFIG_TEXT, .required = true, .low = 1, .high = CENTRE_NAME_SIZE - 1,
		      CONFIG_SAYS("Name, unlike all others.")},
    [STATION_ADDRESS] =
	{"address", CONFIG_TEXT, .required = true, .low = 2, .high = MAP_ADDRESS_SIZE - 1,
	 CONFIG_SAYS("IP address. Names are not resolved: a resolver that waits would let all stations wait.",
		     .json = CONFIG_JSON({"anyOf" : [ {"format" : "ipv4"}, {"format" : "ipv6"} ]}))},
    [STATION_SECOND] = {"second_address", CONFIG_TEXT, .low = 2, .high = MAP_ADDRESS_SIZE - 1,
			CONFIG_SAYS("IP address of a second link.",
				    .json =
					CONFIG_JSON({"anyOf" : [ {"format" : "ipv4"}, {"format" : "ipv6"} ]}),
				    .see = "centre.md#redundant-links")},
    [STATION_CERTIFICATE] = {"certificate", CONFIG_TEXT, .low = 1, .high = CHANNEL_TLS_PEER_SIZE - 1,
			     CONFIG_SAYS("Common name or SHA-256 fingerprint of its certificate; without it "
					 "any certificate of the CA will do, that of another station, too.")},
    [STATION_SECURE] = {"secure", CONFIG_BOOLEAN, CONFIG_SAYS("With TLS.", .see = "centre.md#tls")},
    [STATION_PORT] = {"port", CONFIG_INTEGER, .low = 1, .high = 65535, .fallback = PORT_PLAIN,
		      CONFIG_SAYS("TCP port; with `secure` 19998 unless it is given.")},
    [STATION_CAS] = {"common_addresses", CONFIG_ARRAY, .high = CAS_MAX,
		     CONFIG_SAYS("Common addresses, for interrogations and clock synchronisation.",
				 .json = CONFIG_JSON(
				     {"items" : {"type" : "integer", "minimum" : 1, "maximum" : 65534}}))},
    [STATION_ORIGINATOR] = {"originator", CONFIG_INTEGER, .low = 0, .high = 255,
			    CONFIG_SAYS("Originator address of all requests.")},
    [STATION_POSITION_TYPE] = {"position_type", CONFIG_INTEGER, .low = 0, .high = 255,
			       .fallback = IEC104_GEOPOSITION,
			       CONFIG_SAYS("The private type that carries positions, 0 for none.",
					   .see = "positioning.md")},
    [STATION_TERMINATES] =
	{"terminates", CONFIG_BOOLEAN, .fallback = 1,
	 CONFIG_SAYS("The station ends a command with ACT_TERM; false: its confirmation is the end.")},
    [STATION_INTERROGATE] =
	{"interrogate_at_start", CONFIG_BOOLEAN, .fallback = 1,
	 CONFIG_SAYS("A general interrogation of each common address when data transfer has started; and "
		     "whenever the station says that it was initialised, if it is interrogated at all. 10 s "
		     "after one that the station refused, did not answer or did not end, it is repeated.")},
    [STATION_INTERROGATION] = {"interrogation_s", CONFIG_INTEGER, .low = 0, .high = PERIOD_MAX_S,
			       CONFIG_SAYS("Between general interrogations; 0: none.")},
    [STATION_COUNTERS] = {"counters_s", CONFIG_INTEGER, .low = 0, .high = PERIOD_MAX_S,
			  CONFIG_SAYS("Between counter interrogations; 0: none.")},
    [STATION_CLOCK] = {"clock_s", CONFIG_INTEGER, .low = 0, .high = PERIOD_MAX_S,
		       CONFIG_SAYS("Between clock synchronisations, the first at the start; 0: none.")},
    [STATION_READS] = {"reads", CONFIG_ARRAY, .high = READS_MAX,
		       CONFIG_SAYS("Objects that are read by themselves.", .table = &read_table)},
};
CONFIG_TABLE(station_table, .name = "station", .rules = station_rules, .count = STATION_KEYS);
CONFIG_TABLE(defaults_table, .name = "defaults", .rules = &station_rules[STATION_OWN],
	     .count = STATION_KEYS - STATION_OWN, .like = &station_table);
CONFIG_TABLE(tls_table, .name = "tls", .rules = channel_tls_rules, .count = CHANNEL_TLS_RULES);

enum {
	FILE_SOCKET,
	FILE_K,
	FILE_W,
	FILE_T1,
	FILE_T2,
	FILE_T3,
	FILE_CONFIRMATION,
	FILE_SELECTION,
	FILE_TERMINATION,
	FILE_INTERROGATION,
	FILE_TIMEZONE,
	FILE_CONNECTIONS_AT_ONCE,
	FILE_POLLS_AT_ONCE,
	FILE_CONNECT,
	FILE_SLOW,
	FILE_RETRY,
	FILE_RETRY_MAX,
	FILE_RECEIVE,
	FILE_SEND,
	FILE_BATCHES,
	FILE_BATCH_RECORDS,
	FILE_IN_FLIGHT,
	FILE_SHARDS,
	FILE_TLS,
	FILE_DEFAULTS,
	FILE_STATIONS,
	FILE_KEYS
};
static const struct config_rule file_rules[FILE_KEYS] = {
    [FILE_SOCKET] = {"socket", CONFIG_TEXT, .low = 1, .high = CENTRE_SOCKET_SIZE - 1,
		     CONFIG_SAYS("Where the consumer connects; `--socket` goes before it.")},
    [FILE_K] = {"k", CONFIG_INTEGER, .low = 1, .high = 32767, .fallback = 12,
		CONFIG_SAYS("I frames sent and not yet acknowledged, at most (IEC 60870-5-104, 9.6).")},
    [FILE_W] = {"w", CONFIG_INTEGER, .low = 1, .high = 32767, .fallback = 8,
		CONFIG_SAYS("I frames received before they are acknowledged, at most `k`.")},
    [FILE_T1] = {"t1", CONFIG_INTEGER, .low = 2, .high = 255, .fallback = 15,
		 CONFIG_SAYS("Until a frame that is not acknowledged closes the connection.", .unit = "s")},
    [FILE_T2] = {"t2", CONFIG_INTEGER, .low = 1, .high = 254, .fallback = 10,
		 CONFIG_SAYS("Until received I frames are acknowledged; less than `t1`.", .unit = "s")},
    [FILE_T3] = {"t3", CONFIG_INTEGER, .low = 1, .high = SECONDS_OF_2_DAYS, .fallback = 20,
		 CONFIG_SAYS("Silence until a test frame is sent.", .unit = "s")},
    [FILE_CONFIRMATION] = {"confirmation_ms", CONFIG_INTEGER, .low = 10, .high = 3600000, .fallback = 10000,
			   CONFIG_SAYS("How long is waited for a confirmation.")},
    [FILE_SELECTION] = {"selection_ms", CONFIG_INTEGER, .low = 10, .high = 3600000, .fallback = 60000,
			CONFIG_SAYS("How long is waited for the execution of a selection.")},
    [FILE_TERMINATION] = {"termination_ms", CONFIG_INTEGER, .low = 10, .high = 3600000, .fallback = 60000,
			  CONFIG_SAYS("How long is waited for the end of a command.")},
    [FILE_INTERROGATION] = {"interrogation_ms", CONFIG_INTEGER, .low = 10, .high = 3600000, .fallback = 60000,
			    CONFIG_SAYS("How long is waited for the end of an interrogation.")},
    [FILE_TIMEZONE] =
	{"timezone", CONFIG_TEXT, .low = 4, .high = 63,
	 CONFIG_SAYS("Time zone of the time tags, as UTC0 or CET-1CEST,M3.5.0,M10.5.0/3. Without it, UTC.")},
    [FILE_CONNECTIONS_AT_ONCE] = {"connections_at_once", CONFIG_INTEGER, .low = 1, .high = 65535,
				  .fallback = 64,
				  CONFIG_SAYS("How many connections are being made at once.")},
    [FILE_POLLS_AT_ONCE] = {"polls_at_once", CONFIG_INTEGER, .low = 1, .high = 65535, .fallback = 256,
			    CONFIG_SAYS("How many polls are under way at once.")},
    [FILE_CONNECT] = {"connect_ms", CONFIG_INTEGER, .low = 10, .high = 600000, .fallback = 10000,
		      CONFIG_SAYS("How long a connection may take.")},
    [FILE_SLOW] =
	{"slow_ms", CONFIG_INTEGER, .low = 1, .high = 60000, .fallback = 500,
	 CONFIG_SAYS(
	     "Whoever takes longer gives back its place among those that are connected or polled at once.")},
    [FILE_RETRY] = {"retry_ms", CONFIG_INTEGER, .low = 10, .high = 3600000, .fallback = 1000,
		    CONFIG_SAYS("The pause before the next attempt; it doubles with each one that fails. A "
				"connection that lasted longer than its pause begins anew.")},
    [FILE_RETRY_MAX] = {"retry_max_ms", CONFIG_INTEGER, .low = 10, .high = 3600000, .fallback = 60000,
			CONFIG_SAYS("The longest pause before the next attempt.")},
    [FILE_RECEIVE] = {"receive_octets", CONFIG_INTEGER, .low = IEC104_INPUT_LEAST, .high = 16384,
		      .fallback = 1024, CONFIG_SAYS("The buffer of a connection for what is received.")},
    [FILE_SEND] = {"send_octets", CONFIG_INTEGER, .low = IEC104_OUTPUT_LEAST, .high = 16384, .fallback = 512,
		   CONFIG_SAYS("The buffer of a connection for what is sent.")},
    [FILE_BATCHES] = {"batches", CONFIG_INTEGER, .low = 2, .high = 65536, .fallback = 32,
		      CONFIG_SAYS("Room for so many batches of records.")},
    [FILE_BATCH_RECORDS] = {"batch_records", CONFIG_INTEGER, .low = 1, .high = CENTRE_BATCH_MAX,
			    .fallback = 512, CONFIG_SAYS("Records of a batch, at most.")},
    [FILE_IN_FLIGHT] = {"batches_in_flight", CONFIG_INTEGER, .low = 1, .high = 1024, .fallback = 4,
			CONFIG_SAYS("How many batches may wait for their acknowledgement.")},
    [FILE_SHARDS] = {"shards", CONFIG_INTEGER, .low = 1, .high = CENTRE_SHARDS_MAX, .fallback = 1,
		     CONFIG_SAYS("How many processes share the stations.",
				 .see = "centre.md#a-shard-a-core")},
    [FILE_TLS] = {"tls", CONFIG_OBJECT,
		  CONFIG_SAYS("Who this centre is for stations with TLS.", .table = &tls_table)},
    [FILE_DEFAULTS] = {"defaults", CONFIG_OBJECT,
		       CONFIG_SAYS(
			   "What stations have that do not say it themselves: any key from `port` on.",
			   .table = &defaults_table)},
    [FILE_STATIONS] = {"stations", CONFIG_ARRAY, .required = true, .high = CENTRE_STATIONS_MAX,
		       CONFIG_SAYS("The stations.", .table = &station_table)},
};
CONFIG_SHARED_TABLE(centre_file_table, .name = "file", .rules = file_rules, .count = FILE_KEYS,
		    .json = CONFIG_JSON({"title" : "rtu-centre"}));

/* The station that is read. */
struct reading {
	struct config_report *report;
	struct centre_config *config;
	const struct config_place *place;
	struct centre_plan *station;
};

/* ---- a station --------------------------------------------------------------------------- */

static void add_poll(const struct reading *reading, struct iec104_poll poll)
{
	reading->config->polls[reading->config->poll_count++] = poll;
	reading->station->poll_count++;
}

static void add_periodic(const struct reading *reading, enum iec104_poll_kind kind, uint16_t ca,
			 const struct config_value *period, bool at_start)
{
	if (at_start || period->integer > 0)
		add_poll(reading, (struct iec104_poll){.kind = (uint8_t)kind,
						       .at_start = at_start,
						       .ca = ca,
						       .period_ns = period->integer * NS_PER_S});
}

/* The address of the place, 0 when it is none. */
static uint16_t read_ca(const struct reading *reading, const struct config_place *place, const json_t *json)
{
	json_int_t ca = json_integer_value(json);

	if (json_is_integer(json) && ca >= 1 && ca < IEC104_CA_BROADCAST)
		return (uint16_t)ca;
	config_error(reading->report, place, "is no common address, expected an integer from 1 to %d",
		     IEC104_CA_BROADCAST - 1);
	return 0;
}

static void read_cas(const struct reading *reading, const struct config_value *values)
{
	const struct config_place array = config_key_of(reading->place, station_rules[STATION_CAS].name);
	const json_t *json;
	size_t i;

	json_array_foreach(values[STATION_CAS].given ? values[STATION_CAS].json : NULL, i, json)
	{
		const struct config_place here = config_element_of(&array, i);
		uint16_t ca = read_ca(reading, &here, json);

		if (ca == 0)
			continue;
		add_periodic(reading, IEC104_POLL_CLOCK, ca, &values[STATION_CLOCK],
			     values[STATION_CLOCK].integer > 0);
		add_periodic(reading, IEC104_POLL_INTERROGATION, ca, &values[STATION_INTERROGATION],
			     values[STATION_INTERROGATE].integer != 0);
		add_periodic(reading, IEC104_POLL_COUNTERS, ca, &values[STATION_COUNTERS], false);
	}
}

static void read_reads(const struct reading *reading, const struct config_value *reads)
{
	const struct config_place array = config_key_of(reading->place, station_rules[STATION_READS].name);
	const json_t *json;
	size_t i;

	json_array_foreach(reads->given ? reads->json : NULL, i, json)
	{
		const struct config_place here = config_element_of(&array, i);
		struct config_value values[READ_KEYS];

		config_read_keys(reading->report, &here, json, read_rules, READ_KEYS, values);
		add_poll(reading, (struct iec104_poll){.kind = IEC104_POLL_READ,
						       .at_start = true,
						       .ca = (uint16_t)values[READ_CA].integer,
						       .ioa = (uint32_t)values[READ_IOA].integer,
						       .period_ns = values[READ_PERIOD].integer * NS_PER_MS});
	}
}

static void read_address(const struct reading *reading, const struct config_value *values, unsigned key)
{
	const struct config_place here = config_key_of(reading->place, station_rules[key].name);
	struct centre_plan *station = reading->station;

	if (values[key].given &&
	    !map_address_parse(values[key].text, &station->addresses[station->address_count++]))
		config_error(
		    reading->report, &here,
		    "is not an IP address, expected one like 192.0.2.1 or 2001:db8::1 (names are not "
		    "resolved: that would let all stations wait)");
}

static void read_security(const struct reading *reading, const struct config_value *values)
{
	const struct config_place secure = config_key_of(reading->place, station_rules[STATION_SECURE].name);
	const struct config_place certificate =
	    config_key_of(reading->place, station_rules[STATION_CERTIFICATE].name);
	struct centre_plan *station = reading->station;

	station->secure = values[STATION_SECURE].integer != 0;
	reading->config->secure |= station->secure;
	if (station->secure && reading->config->tls.certificate[0] == '\0')
		config_error(reading->report, &secure,
			     "needs the certificate of this centre, expected an object tls in the file");
	if (station->secure && !values[STATION_PORT].given)
		station->port = PORT_TLS;
	if (!values[STATION_CERTIFICATE].given)
		return;
	if (!channel_names_certificate(values[STATION_CERTIFICATE].text))
		config_error(reading->report, &certificate,
			     "is neither a common name nor a SHA-256 fingerprint as AB:CD:...");
	if (!station->secure)
		config_error(reading->report, &certificate,
			     "is of a station with TLS, expected \"secure\": true beside it");
	station->certificate = strdup(values[STATION_CERTIFICATE].text);
	if (station->certificate == NULL)
		config_out_of_memory(reading->report);
}

static void check_position_type(const struct reading *reading, const struct config_value *value)
{
	const struct config_place here =
	    config_key_of(reading->place, station_rules[STATION_POSITION_TYPE].name);

	if (value->integer != 0 && !iec104_is_private((unsigned)value->integer))
		config_error(reading->report, &here, "%lld is out of range, expected %d to %d, or 0 for none",
			     (long long)value->integer, IEC104_PRIVATE_FIRST, IEC104_PRIVATE_LAST);
}

static void read_station(const struct reading *reading, const json_t *json)
{
	struct centre_plan *station = reading->station;
	struct config_value values[STATION_KEYS];

	config_read_keys(reading->report, reading->place, json, station_rules, STATION_KEYS, values);
	*station = (struct centre_plan){.port = (uint16_t)values[STATION_PORT].integer,
					.originator = (uint8_t)values[STATION_ORIGINATOR].integer,
					.position_type = (uint8_t)values[STATION_POSITION_TYPE].integer,
					.terminates = values[STATION_TERMINATES].integer != 0,
					.first_poll = reading->config->poll_count};
	if (values[STATION_NAME].given)
		snprintf(station->name, sizeof(station->name), "%s", values[STATION_NAME].text);
	read_address(reading, values, STATION_ADDRESS);
	read_address(reading, values, STATION_SECOND);
	read_security(reading, values);
	check_position_type(reading, &values[STATION_POSITION_TYPE]);
	read_cas(reading, values);
	read_reads(reading, &values[STATION_READS]);
}

/* ---- all stations ------------------------------------------------------------------------ */

static int by_name(const void *a, const void *b)
{
	const struct centre_plan *const *left = a, *const *right = b;
	int order = strcmp((*left)->name, (*right)->name);

	return order != 0 ? order : (*left > *right) - (*left < *right);
}

static void report_same_names(struct config_report *report, const struct config_place *array,
			      const struct centre_config *config)
{
	const struct centre_plan **sorted =
	    config_allocate(config->station_count, sizeof(const struct centre_plan *));

	if (sorted == NULL) {
		config_out_of_memory(report);
		return;
	}
	for (uint32_t i = 0; i < config->station_count; i++)
		sorted[i] = &config->stations[i];
	qsort(sorted, config->station_count, sizeof(const struct centre_plan *), by_name);
	for (uint32_t i = 1; i < config->station_count; i++) {
		const struct config_place second =
		    config_element_of(array, (size_t)(sorted[i] - config->stations));

		if (sorted[i]->name[0] != '\0' && strcmp(sorted[i]->name, sorted[i - 1]->name) == 0)
			config_error(report, &second, "has the name \"%s\" of stations[%td]", sorted[i]->name,
				     sorted[i - 1] - config->stations);
	}
	free(sorted);
}

/* A station that says nothing else has what "defaults" says. False: they are wrong, and each station would be so. */
static bool take_defaults(struct config_report *report, const struct config_place *file,
			  const struct config_value *defaults, const json_t *stations)
{
	const struct config_place place = config_key_of(file, file_rules[FILE_DEFAULTS].name);
	struct config_value values[STATION_KEYS];
	unsigned errors = report->errors;
	json_t *station;
	size_t i;

	if (!defaults->given)
		return !defaults->wrong;
	config_read_keys(report, &place, defaults->json, &station_rules[STATION_OWN],
			 STATION_KEYS - STATION_OWN, values);
	json_array_foreach(stations, i, station)
	{
		if (json_is_object(station) &&
		    json_object_update_missing(station, (json_t *)defaults->json) < 0) {
			config_out_of_memory(report);
			return false;
		}
	}
	return errors == report->errors;
}

/* How many polls the stations can have at most. */
static uint32_t polls_of(const json_t *stations)
{
	size_t count = 0, i;
	const json_t *station;

	json_array_foreach(stations, i, station)
	{
		count += json_array_size(json_object_get(station, station_rules[STATION_READS].name)) +
			 SINGLE_PLACES *
			     json_array_size(json_object_get(station, station_rules[STATION_CAS].name));
	}
	return (uint32_t)count;
}

/* The second links are behind the first ones. */
static void number_links(struct centre_config *config)
{
	config->link_count = config->station_count;
	for (uint32_t station = 0; station < config->station_count; station++)
		if (config->stations[station].address_count > 1)
			config->stations[station].second = config->link_count++;
}

static void read_stations(struct config_report *report, const struct config_place *file,
			  const struct config_value *values, struct centre_config *config)
{
	const struct config_place array = config_key_of(file, file_rules[FILE_STATIONS].name);
	const json_t *stations = values[FILE_STATIONS].given ? values[FILE_STATIONS].json : NULL, *json;
	size_t i;

	if (values[FILE_STATIONS].given && json_array_size(stations) == 0)
		config_error(report, &array, "is empty, expected at least one station");
	if (!take_defaults(report, file, &values[FILE_DEFAULTS], stations))
		return;
	config->stations = config_allocate((uint32_t)json_array_size(stations), sizeof(*config->stations));
	config->polls = config_allocate(polls_of(stations), sizeof(*config->polls));
	if (config->stations == NULL || config->polls == NULL) {
		config_out_of_memory(report);
		return;
	}
	json_array_foreach(stations, i, json)
	{
		const struct config_place place = config_element_of(&array, i);
		const struct reading reading = {report, config, &place, &config->stations[i]};

		read_station(&reading, json);
		config->station_count++;
	}
	number_links(config);
	report_same_names(report, &array, config);
}

/* ---- the file ---------------------------------------------------------------------------- */

static void check_order(struct config_report *report, const struct config_place *file,
			const struct config_value *values, int low, int high, bool may_be_same)
{
	const struct config_place here = config_key_of(file, file_rules[low].name);

	if (values[low].wrong || values[high].wrong || values[low].integer < values[high].integer ||
	    (may_be_same && values[low].integer == values[high].integer))
		return;
	config_error(report, &here, "%lld is too much, expected %s %s (%lld)", (long long)values[low].integer,
		     may_be_same ? "at most" : "less than", file_rules[high].name,
		     (long long)values[high].integer);
}

/* A turn of the loop needs room for what one station can say in it: station.h. */
static void check_room(struct config_report *report, const struct config_place *file,
		       const struct centre_config *config)
{
	const struct config_place here = config_key_of(file, file_rules[FILE_BATCHES].name);
	size_t room = (size_t)(config->batches - config->batches_in_flight) * config->batch_records;
	size_t least = 2u * config->receive_octets + 1024u;

	if (room < least)
		config_error(
		    report, &here,
		    "%u of %u records, %u of them in flight, are too few, expected %zu records that are "
		    "not in flight",
		    config->batches, config->batch_records, config->batches_in_flight, least);
}

/* Each shard has a station. */
static void check_shards(struct config_report *report, const struct config_place *file,
			 const struct centre_config *config)
{
	const struct config_place here = config_key_of(file, file_rules[FILE_SHARDS].name);

	if (config->shards > config->station_count)
		config_error(report, &here, "%" PRIu32 " are more than the stations (%" PRIu32 ")",
			     config->shards, config->station_count);
}

static void read_timezone(struct config_report *report, const struct config_place *file,
			  const struct config_value *value, struct map_zone *zone)
{
	const struct config_place here = config_key_of(file, file_rules[FILE_TIMEZONE].name);

	if (value->given && !config_read_zone(value->text, zone))
		config_error(report, &here,
			     "is not a time zone, expected one like UTC0 or CET-1CEST,M3.5.0,M10.5.0/3");
}

static void read_tls(struct config_report *report, const struct config_place *file,
		     const struct config_value *value, struct channel_tls *tls)
{
	const struct config_place here = config_key_of(file, file_rules[FILE_TLS].name);

	if (value->given && !OPENRTU_TLS)
		config_error(report, &here,
			     "this build has no TLS: remove the object, or build with -Dtls=true");
	if (value->given)
		channel_read_tls(report, &here, value->json, NULL, tls);
}

static void take_values(const struct config_value *values, struct centre_config *config)
{
	struct iec104_controlling_settings *common = &config->common;

	if (values[FILE_SOCKET].given)
		snprintf(config->socket, sizeof(config->socket), "%s", values[FILE_SOCKET].text);
	common->times = (struct iec104_times){.k = (uint16_t)values[FILE_K].integer,
					      .w = (uint16_t)values[FILE_W].integer,
					      .t1_ns = values[FILE_T1].integer * NS_PER_S,
					      .t2_ns = values[FILE_T2].integer * NS_PER_S,
					      .t3_ns = values[FILE_T3].integer * NS_PER_S};
	common->requests_max = IEC104_CONTROLLING_REQUESTS_MAX;
	common->confirmation_ns = values[FILE_CONFIRMATION].integer * NS_PER_MS;
	common->selection_ns = values[FILE_SELECTION].integer * NS_PER_MS;
	common->termination_ns = values[FILE_TERMINATION].integer * NS_PER_MS;
	common->interrogation_ns = values[FILE_INTERROGATION].integer * NS_PER_MS;
	config->connections_at_once = (uint32_t)values[FILE_CONNECTIONS_AT_ONCE].integer;
	config->polls_at_once = (uint32_t)values[FILE_POLLS_AT_ONCE].integer;
	config->connect_ns = values[FILE_CONNECT].integer * NS_PER_MS;
	config->slow_ns = values[FILE_SLOW].integer * NS_PER_MS;
	config->retry_ns = values[FILE_RETRY].integer * NS_PER_MS;
	config->retry_max_ns = values[FILE_RETRY_MAX].integer * NS_PER_MS;
	config->receive_octets = (uint16_t)values[FILE_RECEIVE].integer;
	config->send_octets = (uint16_t)values[FILE_SEND].integer;
	config->batches = (uint32_t)values[FILE_BATCHES].integer;
	config->batch_records = (uint32_t)values[FILE_BATCH_RECORDS].integer;
	config->batches_in_flight = (uint32_t)values[FILE_IN_FLIGHT].integer;
	config->shards = (uint32_t)values[FILE_SHARDS].integer;
}

static void read_file(struct config_report *report, const json_t *root, struct centre_config *config)
{
	const struct config_place file = {.in = NULL};
	struct config_value values[FILE_KEYS];

	config_read_keys(report, &file, root, file_rules, FILE_KEYS, values);
	take_values(values, config);
	read_timezone(report, &file, &values[FILE_TIMEZONE], &config->common.zone);
	read_tls(report, &file, &values[FILE_TLS], &config->tls);
	check_order(report, &file, values, FILE_W, FILE_K, true);
	check_order(report, &file, values, FILE_T2, FILE_T1, false);
	check_order(report, &file, values, FILE_RETRY, FILE_RETRY_MAX, true);
	check_order(report, &file, values, FILE_IN_FLIGHT, FILE_BATCHES, false);
	if (report->errors == 0)
		check_room(report, &file, config);
	read_stations(report, &file, values, config);
	if (report->errors == 0)
		check_shards(report, &file, config);
}

enum centre_config_result centre_config_load(const char *path, struct centre_config *config, FILE *messages)
{
	struct config_loader loader = {.report = {.messages = messages}};
	enum centre_config_result result = CENTRE_CONFIG_UNREADABLE;

	memset(config, 0, sizeof(*config));
	if (config_read_files(&loader, path, NULL)) {
		read_file(&loader.report, loader.files[0].root, config);
		config_report_end(&loader.report);
		result = loader.report.errors == 0 ? CENTRE_CONFIG_GOOD : CENTRE_CONFIG_WRONG;
	}
	config_free_files(&loader);
	return result;
}

void centre_config_take_shard(struct centre_config *config, uint32_t shard)
{
	uint32_t count = 0;

	for (uint32_t place = 0; place < config->station_count; place++) {
		if (place % config->shards == shard)
			config->stations[count++] = config->stations[place];
		else
			free(config->stations[place].certificate);
	}
	config->shard = shard;
	config->station_count = count;
	number_links(config);
}

uint32_t centre_config_place(const struct centre_config *config, uint32_t station)
{
	return station * config->shards + config->shard;
}

bool centre_config_station(const struct centre_config *config, uint32_t place, uint32_t *station)
{
	*station = place / config->shards;
	return place % config->shards == config->shard && *station < config->station_count;
}

void centre_config_free(struct centre_config *config)
{
	for (uint32_t i = 0; i < config->station_count; i++)
		free(config->stations[i].certificate);
	free(config->stations);
	free(config->polls);
}
