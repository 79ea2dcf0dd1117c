/* SPDX-License-Identifier: GPL-3.0-or-later */
/* Receivers of positions: where they are, how well they hear, the sky above them. */
#include <math.h>
#include <stdio.h>
#include <string.h>

#include "gps/config.h"
#include "gps/stats.h"
#include "map/time_ns.h"
#include "rtuctl/listing.h"
#include "rtuctl/rtuctl.h"

#define COUNT(array) (sizeof(array) / sizeof((array)[0]))
#define ZENITH       90
#define SKY_ROWS     15 /* odd, so that there is a middle */
#define SKY_COLUMNS  (2 * SKY_ROWS + 1)
#define LABEL_SIZE   16

static const char *const methods[GPS_METHODS] = {"none",      "autonomous", "differential", "precise",  "rtk",
						 "rtk float", "estimated",  "manual",       "simulated"};

static const struct listing_column columns[] = {
    {"name", "NAME", LISTING_TEXT},          {"source", "SOURCE", LISTING_TEXT},
    {"open", "OPEN", LISTING_TEXT},          {"fix", "FIX", LISTING_TEXT},
    {"latitude", "LATITUDE", LISTING_RIGHT}, {"longitude", "LONGITUDE", LISTING_RIGHT},
    {"satellites", "SATS", LISTING_RIGHT},   {"age_s", "AGE", LISTING_AGE},
    {"fixes", "FIXES", LISTING_RIGHT},       {"events", "EVENTS", LISTING_RIGHT},
    {"damaged", "DAMAGED", LISTING_RIGHT},   {"stray", "STRAY", LISTING_RIGHT},
    {"failures", "FAILURES", LISTING_RIGHT},
};

static const struct {
	enum gps_mark mark;
	const char *name;
} marks[] = {
    {GPS_CONTRADICTS, "contradicts"}, {GPS_DATUM, "datum"},           {GPS_JUMP, "jump"},
    {GPS_TOO_FAST, "too fast"},       {GPS_CLOCK_STEP, "clock step"},
};

static json_t *degrees(const struct gps_fix *fix, int32_t value)
{
	return fix->known & GPS_POSITION ? json_real((double)value / MAP_ANGLE_PER_DEGREE) : json_null();
}

static json_t *marks_of(const struct gps_fix *fix)
{
	json_t *names = json_array();

	for (size_t i = 0; i < COUNT(marks); i++)
		if (fix->marks & marks[i].mark)
			json_array_append_new(names, json_string(marks[i].name));
	return names;
}

static json_t *sky_of(const struct gps_fix *fix)
{
	json_t *sky = json_array();

	for (uint32_t i = 0; i < fix->sky.count && i < GPS_SKY_MAX; i++) {
		const struct gps_satellite *satellite = &fix->sky.satellites[i];
		json_t *row = json_object();

		json_object_set_new(row, "constellation", json_stringn(&satellite->constellation, 1));
		json_object_set_new(row, "number", json_integer(satellite->number));
		json_object_set_new(row, "elevation", json_integer(satellite->elevation));
		json_object_set_new(row, "azimuth", json_integer(satellite->azimuth));
		json_object_set_new(row, "snr", json_integer(satellite->snr));
		json_object_set_new(row, "used", json_boolean(satellite->used));
		json_array_append_new(sky, row);
	}
	return sky;
}

/* False: rtu-gps has not had a burst yet, or overtook every try. */
static bool last_fix(struct gps_stats *stats, struct gps_fix *fix)
{
	return stats->fixes != 0 && latch_load(&stats->latch, stats->copies, fix, sizeof(*fix));
}

static void add_fix(json_t *row, const struct gps_fix *fix)
{
	const bool found = fix->known & GPS_POSITION;

	json_object_set_new(row, "fix",
			    json_string(methods[found && fix->method < GPS_METHODS ? fix->method : 0]));
	json_object_set_new(row, "latitude", degrees(fix, fix->latitude));
	json_object_set_new(row, "longitude", degrees(fix, fix->longitude));
	json_object_set_new(row, "satellites", json_integer(fix->satellites));
	json_object_set_new(row, "age_s", json_real((double)(map_now_ns() - fix->arrival_ns) / NS_PER_S));
	json_object_set_new(row, "marks", marks_of(fix));
	json_object_set_new(row, "sky", sky_of(fix));
}

static json_t *receiver_row(const struct gps_settings *settings, struct gps_stats *stats, bool alive)
{
	const struct {
		const char *name;
		uint32_t value;
	} counters[] = {
	    {"octets", stats->octets},
	    {"sentences", stats->sentences},
	    {"damaged", stats->damaged},
	    {"unknown", stats->unknown},
	    {"stray", stats->stray},
	    {"fixes", stats->fixes},
	    {"events", stats->events},
	    {"era_corrected", stats->era_corrected},
	    {"dates_refused", stats->dates_refused},
	    {"jumps", stats->jumps},
	    {"too_fast", stats->too_fast},
	    {"clock_steps", stats->clock_steps},
	    {"failures", stats->failures},
	};
	json_t *row = json_object();
	struct gps_fix fix;

	json_object_set_new(row, "name", json_string(settings->name));
	json_object_set_new(row, "source",
			    settings->device[0] != '\0'
				? json_string(settings->device)
				: json_sprintf("gpsd %s:%u", settings->gpsd, settings->gpsd_port));
	json_object_set_new(row, "open", json_boolean(alive && stats->open != 0));
	if (last_fix(stats, &fix))
		add_fix(row, &fix);
	for (size_t i = 0; i < COUNT(counters); i++)
		json_object_set_new(row, counters[i].name, json_integer(counters[i].value));
	return row;
}

/* ---- the sky ----------------------------------------------------------------------------- */

/* A label at its place; the half of the picture that lacks room takes it to the left. */
static void put_label(char sky[SKY_ROWS][SKY_COLUMNS + 1], int row, int column, const char *label)
{
	const int size = (int)strlen(label);

	if (column + size > SKY_COLUMNS)
		column = SKY_COLUMNS - size;
	memcpy(&sky[row][column], label, (size_t)size);
}

static void put_satellite(char sky[SKY_ROWS][SKY_COLUMNS + 1], const struct gps_satellite *satellite)
{
	const double middle = SKY_ROWS / 2, angle = satellite->azimuth * acos(-1) / 180;
	const double from_zenith = middle * (ZENITH - satellite->elevation) / ZENITH;
	char label[LABEL_SIZE];

	if (satellite->elevation < 0 || satellite->elevation > ZENITH || satellite->azimuth >= 360)
		return;
	snprintf(label, sizeof(label), "%c%u%s", satellite->constellation, satellite->number,
		 satellite->used ? "*" : "");
	put_label(sky, (int)lround(middle - from_zenith * cos(angle)),
		  (int)lround(2 * (middle + from_zenith * sin(angle))), label);
}

static void put_rim(char sky[SKY_ROWS][SKY_COLUMNS + 1])
{
	const double middle = SKY_ROWS / 2;

	for (int degree = 0; degree < 360; degree += 5) {
		const double angle = degree * acos(-1) / 180;

		sky[lround(middle - middle * cos(angle))][lround(2 * (middle + middle * sin(angle)))] = '.';
	}
	put_label(sky, 0, SKY_ROWS - 1, "N");
	put_label(sky, SKY_ROWS / 2, SKY_COLUMNS - 1, "E");
	put_label(sky, SKY_ROWS - 1, SKY_ROWS - 1, "S");
	put_label(sky, SKY_ROWS / 2, 0, "W");
}

static void print_sky(const struct gps_fix *fix)
{
	char sky[SKY_ROWS][SKY_COLUMNS + 1];

	for (int row = 0; row < SKY_ROWS; row++) {
		memset(sky[row], ' ', SKY_COLUMNS);
		sky[row][SKY_COLUMNS] = '\0';
	}
	put_rim(sky);
	for (uint32_t i = 0; i < fix->sky.count && i < GPS_SKY_MAX; i++)
		put_satellite(sky, &fix->sky.satellites[i]);
	putchar('\n');
	for (int row = 0; row < SKY_ROWS; row++)
		puts(sky[row]);
}

int rtuctl_gps(struct map *map, const struct rtuctl_request *request)
{
	const struct gps_settings *settings = gps_receivers(map_config(map));
	const uint32_t count = map_record_count(map_config(map), GPS_RECEIVERS);
	struct gps_stats *stats = gps_stats_of(map), *chosen = NULL;
	struct listing listing;
	struct gps_fix fix;

	listing_begin(&listing, columns, COUNT(columns), request->json);
	for (uint32_t i = 0; stats != NULL && i < count; i++) {
		if (request->arguments[0] != NULL && strcmp(request->arguments[0], settings[i].name) != 0)
			continue;
		chosen = &stats[i];
		listing_add(&listing, receiver_row(&settings[i], &stats[i], map_kind_alive(map, GPS_KIND)));
	}
	listing_end_found(&listing, chosen != NULL);
	if (chosen == NULL) {
		fputs("rtuctl: there is no such receiver: \"gps\" in the configuration names them\n", stderr);
		return RTUCTL_FAILED;
	}
	if (request->arguments[0] != NULL && !request->json && last_fix(chosen, &fix))
		print_sky(&fix);
	return RTUCTL_DONE;
}
