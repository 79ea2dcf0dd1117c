/* SPDX-License-Identifier: GPL-3.0-or-later */
/* The array "gps": receivers of positions, their sets of points, their geofences. */
#include "gps/config_part.h"

#include <stdlib.h>
#include <string.h>

#include "config/address.h"
#include "config/names.h"
#include "config/sets.h"
#include "gps/burst.h"
#include "gps/config.h"
#include "map/map.h"

#define GPSD_PORT        2947 /* IANA: gpsd */
#define FIRST_FENCE      100  /* IOA of a receiver's first fence, from its first point on */
#define SILENCE_LEAST_NS (50 * NS_PER_MS)
#define SILENCE_MOST_NS  (500 * NS_PER_MS)
#define BELIEVED         5              /* fixes after a jump */
#define CLOCK_NS         (2 * NS_PER_S) /* steps of the receiver's time that are its own affair */
#define TURN_SPEED_MM_S  2000           /* the course of what is slower is noise */
#define MM_S_PER_KM_H    (1e6 / 3600)
#define TURN_PER_DEGREE  100
#define MM_PER_M         1000

enum { FENCE_NAME, FENCE_CENTRE, FENCE_RADIUS, FENCE_CORNERS, FENCE_KEYS };
static const struct config_rule fence_rules[FENCE_KEYS] = {
    [FENCE_NAME] = {CONFIG_KEY_NAME, CONFIG_TEXT, .required = true, .low = 1, .high = 15,
		    CONFIG_SAYS("Name, once in the receiver: its point is NAME.in-FENCE.",
				.pattern = "^[^ *?\\[\\]\\\\\\u0000-\\u001f\\u007f]*$")},
    [FENCE_CENTRE] = {"centre", CONFIG_ARRAY, .high = 2,
		      CONFIG_SAYS("Centre of a circle: [latitude, longitude] in degrees.",
				  .json = CONFIG_JSON({
					  "minItems" : 2,
					  "items" : {"type" : "number", "minimum" : -180, "maximum" : 180}
				  }))},
    [FENCE_RADIUS] = {"radius_m", CONFIG_INTEGER, .low = 1, .high = GPS_FENCE_RADIUS_MAX_M,
		      CONFIG_SAYS("Radius of the circle in metres.")},
    [FENCE_CORNERS] = {"corners", CONFIG_ARRAY, .high = GPS_FENCE_CORNERS_MAX,
		       CONFIG_SAYS(
			   "Corners of a polygon, in order, each [latitude, longitude] in degrees.",
			   .json = CONFIG_JSON({
				   "minItems" : 3,
				   "items" : {
					   "type" : "array",
					   "minItems" : 2,
					   "maxItems" : 2,
					   "items" : {"type" : "number", "minimum" : -180, "maximum" : 180}
				   }
			   }))},
};
CONFIG_TABLE(
    geofence_table, .name = "geofence", .rules = fence_rules, .count = FENCE_KEYS,
    .json = CONFIG_JSON({"oneOf" : [ {"required" : [ "centre", "radius_m" ]}, {"required" : ["corners"]} ]}));

enum {
	GPS_NAME,
	GPS_DEVICE,
	GPS_GPSD,
	GPS_GPSD_PORT,
	GPS_GPSD_DEVICE,
	GPS_BAUD_RATE,
	GPS_BURST_OCTETS,
	GPS_PERIOD,
	GPS_CA,
	GPS_IOA,
	GPS_POSITION_IOA,
	GPS_CLOCK_SOCKET,
	GPS_TOPICAL,
	GPS_MAX_SPEED,
	GPS_SLACK,
	GPS_DISTANCE,
	GPS_TURN,
	GPS_INTERVAL,
	GPS_FENCE_LIST,
	GPS_KEYS
};
static const struct config_rule receiver_rules[GPS_KEYS] = {
    [GPS_NAME] = {CONFIG_KEY_NAME, CONFIG_TEXT, .required = true, .low = 1, .high = GPS_NAME_SIZE - 1,
		  CONFIG_SAYS("Name, once in the file: that of its points begins with it.",
			      .pattern = "^[^ *?\\[\\]\\\\\\u0000-\\u001f\\u007f]*$")},
    [GPS_DEVICE] = {"device", CONFIG_TEXT, .low = 1, .high = MAP_FILE_SIZE - 1,
		    CONFIG_SAYS("Serial port of a receiver with NMEA 0183: a path, or a name in /dev.")},
    [GPS_GPSD] = {"gpsd", CONFIG_TEXT, .low = 1, .high = MAP_ADDRESS_SIZE - 1,
		  CONFIG_SAYS("IP address of a gpsd, instead of device.",
			      .json = CONFIG_JSON({"$ref" : "#/$defs/ip_address"}))},
    [GPS_GPSD_PORT] = {"gpsd_port", CONFIG_INTEGER, .low = 1, .high = 65535, .fallback = GPSD_PORT,
		       CONFIG_SAYS("TCP port of gpsd.")},
    [GPS_GPSD_DEVICE] = {"gpsd_device", CONFIG_TEXT, .low = 1, .high = MAP_FILE_SIZE - 1,
			 CONFIG_SAYS("Which of gpsd's receivers, by the path that gpsd has for it; without "
				     "it, the first that has a fix.")},
    [GPS_BAUD_RATE] = {"baud_rate", CONFIG_INTEGER, .low = 4800, .high = 115200, .fallback = 9600,
		       CONFIG_SAYS("Bit/s of the serial port, with 8 data bits, no parity and one stop bit.",
				   .unit = "bit/s")},
    /* The longest burst in the positioning paper: 13 lines. */
    [GPS_BURST_OCTETS] = {"burst_octets", CONFIG_INTEGER, .low = 40, .high = 8192, .fallback = 750,
			  CONFIG_SAYS("Octets that the receiver says of one moment, at most.")},
    [GPS_PERIOD] = {"period_ms", CONFIG_INTEGER, .low = 100, .high = 60000, .fallback = 1000,
		    CONFIG_SAYS("Milliseconds between two moments. A burst that takes longer is an error.")},
    [GPS_CA] = {"ca", CONFIG_INTEGER, .required = true, .low = 1, .high = 65534,
		CONFIG_SAYS("Common address of its points, which no device has.")},
    [GPS_IOA] = {"ioa", CONFIG_INTEGER, .low = 1, .high = 16777000, .fallback = 1,
		 CONFIG_SAYS("Information object address of its first point, the latitude.")},
    [GPS_POSITION_IOA] =
	{"position_ioa", CONFIG_INTEGER, .low = 1, .high = 16777215,
	 CONFIG_SAYS("Information object address of the position as a whole, which IEC 60870-5-104 sends "
		     "beside the points, as one object of a private type; without it, there is none.")},
    [GPS_CLOCK_SOCKET] =
	{"clock_socket", CONFIG_TEXT, .low = 1, .high = GPS_SOCKET_SIZE - 1,
	 CONFIG_SAYS(
	     "Socket of chronyd (refclock SOCK) that is told the receiver's time; without it, none is.")},
    [GPS_TOPICAL] = {"topical_s", CONFIG_INTEGER, .low = 1, .high = 3600, .fallback = 5,
		     CONFIG_SAYS("Seconds after which a position without a successor is not topical.")},
    [GPS_MAX_SPEED] =
	{"max_speed_km_h", CONFIG_INTEGER, .low = 1, .high = 3600, .fallback = 400,
	 CONFIG_SAYS("The greatest speed that can be: a fix that is faster, or farther away, is invalid.")},
    [GPS_SLACK] = {"slack_m", CONFIG_INTEGER, .low = 0, .high = 10000, .fallback = 50,
		   CONFIG_SAYS("Metres by which the positions of a receiver that stands may differ.")},
    [GPS_DISTANCE] = {"distance_m", CONFIG_INTEGER, .low = 0, .high = 100000, .fallback = 50,
		      CONFIG_SAYS("A fix so far from the last event is an event; 0: not for this reason.")},
    [GPS_TURN] = {"turn_degrees", CONFIG_INTEGER, .low = 0, .high = 180, .fallback = 30,
		  CONFIG_SAYS("So is one with another course, from 2 m/s on; 0: not for this reason.")},
    [GPS_INTERVAL] = {"interval_s", CONFIG_INTEGER, .low = 0, .high = 86400, .fallback = 60,
		      CONFIG_SAYS("So is one so many seconds after it; 0: not for this reason.")},
    [GPS_FENCE_LIST] = {"fences", CONFIG_ARRAY, .high = GPS_FENCES_MAX,
			CONFIG_SAYS("Geofences: each is a point that says whether the receiver is inside.",
				    .table = &geofence_table)},
};
CONFIG_TABLE(gps_receiver_table, .name = "gps_receiver", .rules = receiver_rules, .count = GPS_KEYS,
	     .json = CONFIG_JSON({"oneOf" : [ {"required" : ["device"]}, {"required" : ["gpsd"]} ]}));

static const struct config_rule file_rule = {
    "gps", CONFIG_ARRAY, .high = GPS_RECEIVERS_MAX,
    CONFIG_SAYS("Receivers of positions: rtu-gps.", .table = &gps_receiver_table)};

static const struct {
	const char *name;
	enum map_type type;
} points[GPS_POINTS] = {
    [GPS_POINT_LATITUDE] = {"latitude", MAP_ANGLE},
    [GPS_POINT_LONGITUDE] = {"longitude", MAP_ANGLE},
    [GPS_POINT_ALTITUDE] = {"altitude", MAP_FLOAT},
    [GPS_POINT_SPEED] = {"speed", MAP_FLOAT},
    [GPS_POINT_COURSE] = {"course", MAP_FLOAT},
    [GPS_POINT_HDOP] = {"hdop", MAP_FLOAT},
    [GPS_POINT_ERROR] = {"error", MAP_FLOAT},
    [GPS_POINT_FIX] = {"fix", MAP_SCALED},
    [GPS_POINT_SATELLITES] = {"satellites", MAP_SCALED},
};

/* ---- geofences --------------------------------------------------------------------------- */

/* An array [latitude, longitude] in degrees. */
static bool read_place(struct config_loader *loader, const struct config_place *here, const json_t *json,
		       struct gps_place *out)
{
	const json_t *latitude = json_array_get(json, 0), *longitude = json_array_get(json, 1);
	double north = json_number_value(latitude), east = json_number_value(longitude);

	if (json_array_size(json) != 2 || !json_is_number(latitude) || !json_is_number(longitude) ||
	    !(north >= -90 && north <= 90) || !(east >= -180 && east <= 180)) {
		config_error(
		    &loader->report, here,
		    "is not a place, expected [latitude, longitude] in degrees, as [44.8125, 20.4612]");
		return false;
	}
	*out = (struct gps_place){map_round(north * MAP_ANGLE_PER_DEGREE),
				  map_round(east * MAP_ANGLE_PER_DEGREE)};
	return true;
}

static bool read_corners(struct config_loader *loader, const struct config_place *here,
			 const struct config_value *value, struct gps_fence *fence)
{
	bool good = true;

	fence->corner_count = (uint32_t)json_array_size(value->json);
	for (uint32_t i = 0; i < fence->corner_count; i++) {
		const struct config_place corner = config_element_of(here, i);

		good &= read_place(loader, &corner, json_array_get(value->json, i), &fence->corners[i]);
	}
	return good;
}

static void read_fence(struct config_loader *loader, const struct config_place *place, const json_t *json,
		       const struct gps_settings *receiver, uint32_t ioa)
{
	const struct config_place centre = config_key_of(place, fence_rules[FENCE_CENTRE].name);
	const struct config_place corners = config_key_of(place, fence_rules[FENCE_CORNERS].name);
	struct gps_fence *fence = map_next_record(loader->config, GPS_FENCES);
	unsigned errors = loader->report.errors;
	struct config_value values[FENCE_KEYS];
	char name[MAP_NAME_SIZE];
	const char *fault;

	config_read_keys(&loader->report, place, json, fence_rules, FENCE_KEYS, values);
	snprintf(name, sizeof(name), "%s.in-%s", receiver->name,
		 values[FENCE_NAME].given ? values[FENCE_NAME].text : "");
	config_check_name(&loader->report, place, name);
	config_add_point(loader, place, name, MAP_SINGLE, ioa);
	if (values[FENCE_CENTRE].given == values[FENCE_CORNERS].given ||
	    values[FENCE_CENTRE].given != values[FENCE_RADIUS].given)
		config_error(&loader->report, place,
			     "needs one shape, expected centre and radius_m, or corners");
	if (values[FENCE_CENTRE].given)
		read_place(loader, &centre, values[FENCE_CENTRE].json, &fence->centre);
	fence->radius_m = (uint32_t)values[FENCE_RADIUS].integer;
	if (values[FENCE_CORNERS].given)
		read_corners(loader, &corners, &values[FENCE_CORNERS], fence);
	fault = loader->report.errors == errors ? gps_fence_fault(fence) : NULL;
	if (fault != NULL)
		config_error(&loader->report, place, "cannot be used: %s", fault);
}

/* ---- receivers --------------------------------------------------------------------------- */

/* What takes longer to say than the receiver's period is lost in part. */
static void read_times(struct config_loader *loader, const struct config_place *place,
		       const struct config_value *values, struct gps_settings *receiver)
{
	const int64_t period_ns = values[GPS_PERIOD].integer * NS_PER_MS;
	int64_t burst_ns;

	if (values[GPS_BAUD_RATE].wrong || values[GPS_BURST_OCTETS].wrong || values[GPS_PERIOD].wrong)
		return;
	burst_ns = gps_burst_time_ns((uint32_t)values[GPS_BURST_OCTETS].integer, receiver->baud);
	if (values[GPS_DEVICE].given && burst_ns > period_ns)
		config_error(
		    &loader->report, place,
		    "a burst of %lld octets takes %.2f s at %u bit/s, longer than its period of %.2f s: "
		    "expected a "
		    "higher baud_rate, a longer period_ms, or burst_octets as it really is",
		    (long long)values[GPS_BURST_OCTETS].integer, (double)burst_ns / NS_PER_S, receiver->baud,
		    (double)period_ns / NS_PER_S);
	receiver->silence_ns = (period_ns - burst_ns) / 2;
	if (receiver->silence_ns < SILENCE_LEAST_NS)
		receiver->silence_ns = SILENCE_LEAST_NS;
	if (receiver->silence_ns > SILENCE_MOST_NS)
		receiver->silence_ns = SILENCE_MOST_NS;
}

static void read_source(struct config_loader *loader, const struct config_place *place,
			const struct config_value *values, struct gps_settings *receiver)
{
	const struct config_place gpsd = config_key_of(place, receiver_rules[GPS_GPSD].name);

	if (values[GPS_DEVICE].given == values[GPS_GPSD].given && !values[GPS_DEVICE].wrong &&
	    !values[GPS_GPSD].wrong)
		config_error(&loader->report, place,
			     "has %s, expected device of a serial port or gpsd, an IP address",
			     values[GPS_DEVICE].given ? "two sources" : "no source");
	if (values[GPS_DEVICE].given)
		snprintf(receiver->device, sizeof(receiver->device), "%s", values[GPS_DEVICE].text);
	if (values[GPS_CLOCK_SOCKET].given)
		snprintf(receiver->clock, sizeof(receiver->clock), "%s", values[GPS_CLOCK_SOCKET].text);
	if (values[GPS_GPSD].given)
		config_read_address(&loader->report, &gpsd, values[GPS_GPSD].text, receiver->gpsd);
	receiver->gpsd_port = (uint16_t)values[GPS_GPSD_PORT].integer;
	if (values[GPS_GPSD_DEVICE].given)
		snprintf(receiver->gpsd_device, sizeof(receiver->gpsd_device), "%s",
			 values[GPS_GPSD_DEVICE].text);
	receiver->baud = (uint32_t)values[GPS_BAUD_RATE].integer;
}

static void read_fixes(const struct config_value *values, struct gps_settings *receiver)
{
	receiver->topical_ns = values[GPS_TOPICAL].integer * NS_PER_S;
	receiver->limits = (struct gps_limits){
	    .speed_mm_s = (int32_t)((double)values[GPS_MAX_SPEED].integer * MM_S_PER_KM_H),
	    .slack_mm = (int32_t)values[GPS_SLACK].integer * MM_PER_M,
	    .believed = BELIEVED,
	    .clock_ns = CLOCK_NS,
	};
	receiver->rule = (struct gps_rule){
	    .distance_mm = (int32_t)values[GPS_DISTANCE].integer * MM_PER_M,
	    .turn = (uint16_t)(values[GPS_TURN].integer * TURN_PER_DEGREE),
	    .turn_speed_mm_s = TURN_SPEED_MM_S,
	    .time_ns = values[GPS_INTERVAL].integer * NS_PER_S,
	};
}

static void add_points(struct config_loader *loader, const struct config_place *place,
		       const struct config_value *values, const struct gps_settings *receiver)
{
	const struct config_place fences = config_key_of(place, receiver_rules[GPS_FENCE_LIST].name);
	const uint32_t ioa = (uint32_t)values[GPS_IOA].integer;
	char name[MAP_NAME_SIZE];

	if (values[GPS_POSITION_IOA].given) {
		snprintf(name, sizeof(name), "%s.position", receiver->name);
		config_add_point(loader, place, name, MAP_BITSTRING,
				 (uint32_t)values[GPS_POSITION_IOA].integer)
		    ->flags = MAP_POINT_POSITION;
	}
	for (uint32_t i = 0; i < GPS_POINTS; i++) {
		snprintf(name, sizeof(name), "%s.%s", receiver->name, points[i].name);
		config_add_point(loader, place, name, points[i].type, ioa + i);
	}
	for (uint32_t i = 0; i < receiver->fence_count; i++) {
		const struct config_place fence = config_element_of(&fences, i);

		read_fence(loader, &fence, json_array_get(values[GPS_FENCE_LIST].json, i), receiver,
			   ioa + FIRST_FENCE + i);
	}
}

static void read_receiver(struct config_loader *loader, const struct config_place *place, const json_t *json)
{
	const struct config_place ca = config_key_of(place, receiver_rules[GPS_CA].name);
	const struct config_place name = config_key_of(place, receiver_rules[GPS_NAME].name);
	struct gps_settings *receiver = map_next_record(loader->config, GPS_RECEIVERS);
	struct config_value values[GPS_KEYS];

	config_read_keys(&loader->report, place, json, receiver_rules, GPS_KEYS, values);
	if (values[GPS_NAME].given) {
		snprintf(receiver->name, sizeof(receiver->name), "%s", values[GPS_NAME].text);
		config_check_name(&loader->report, &name, receiver->name);
	}
	read_source(loader, place, values, receiver);
	read_times(loader, place, values, receiver);
	read_fixes(values, receiver);
	receiver->set = (uint16_t)loader->config->set_count;
	receiver->whole = values[GPS_POSITION_IOA].given;
	receiver->first_fence = map_record_count(loader->config, GPS_FENCES);
	receiver->fence_count =
	    values[GPS_FENCE_LIST].given ? (uint32_t)json_array_size(values[GPS_FENCE_LIST].json) : 0;
	config_add_set(loader, &ca, (uint16_t)values[GPS_CA].integer, receiver->name);
	add_points(loader, place, values, receiver);
}

/* ---- the part ---------------------------------------------------------------------------- */

static const json_t *receivers_of(const json_t *root)
{
	const json_t *array = json_object_get(root, file_rule.name);

	return json_array_size(array) > GPS_RECEIVERS_MAX ? NULL : array;
}

static uint32_t count_fences(const json_t *receivers)
{
	const json_t *receiver;
	size_t i, count = 0;

	json_array_foreach(receivers, i, receiver)
	{
		size_t fences = json_array_size(json_object_get(receiver, "fences"));

		count += fences > GPS_FENCES_MAX ? 0 : fences;
	}
	return (uint32_t)count;
}

static bool begin(struct config_loader *loader, void *own, const json_t *root)
{
	const json_t *array = receivers_of(root);
	uint32_t receivers = (uint32_t)json_array_size(array), fences = count_fences(array);
	void *settings, *all_fences;

	(void)own;
	if (receivers == 0)
		return true;
	settings = config_allocate(receivers, sizeof(struct gps_settings));
	all_fences = config_allocate(fences, sizeof(struct gps_fence));
	map_add_section(loader->config, GPS_RECEIVERS, sizeof(struct gps_settings), 0, settings);
	map_add_section(loader->config, GPS_FENCES, sizeof(struct gps_fence), 0, all_fences);
	loader->sets_max += receivers;
	loader->points_max += receivers * (1 + GPS_POINTS) + fences;
	return settings != NULL && all_fences != NULL;
}

static void read_part(struct config_loader *loader, void *own, const struct config_value *values)
{
	*(const json_t **)own = values->given ? values->json : NULL;
	(void)loader;
}

static bool finish(struct config_loader *loader, void *own)
{
	const struct config_place file = {.in = NULL};
	const struct config_place array = config_key_of(&file, file_rule.name);
	const json_t *receivers = *(const json_t **)own, *receiver;
	size_t i;

	json_array_foreach(receivers, i, receiver)
	{
		const struct config_place place = config_element_of(&array, i);

		read_receiver(loader, &place, receiver);
	}
	return true;
}

const struct config_part gps_part = {
    .keys = &file_rule,
    .key_count = 1,
    .own_size = sizeof(const json_t *),
    .begin = begin,
    .read = read_part,
    .finish = finish,
};
