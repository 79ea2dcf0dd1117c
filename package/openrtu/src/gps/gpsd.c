/* SPDX-License-Identifier: GPL-3.0-or-later */
#include "gps/gpsd.h"

#include <string.h>

#include "gps/json.h"
#include "gps/number.h"
#include "gps/sky.h"

#define E7           10000000LL
#define ALTITUDE_MAX 2147000 /* what 32 bits hold in mm */
#define SPEED_MAX    10000
#define ERROR_MAX    100000
#define FULL_CIRCLE  36000
#define DILUTION_MAX 65535
#define MS_PER_DAY   86400000LL
#define INSIDE       2 /* the depth of a satellite's object: in an array in the line's object */

/* A line is read whole before any of it counts. */
struct reading {
	bool bad;
	bool tpv, sky;
	char device[GPSD_DEVICE_SIZE];
	int64_t mode, status, used;
	bool has_latitude, has_longitude;
	bool has_used;
	int32_t date;       /* days since 1970, as gpsd says */
	struct gps_fix fix; /* TPV; the sky, dilutions and number of satellites of SKY */
	struct gps_satellite satellite;
};

void gpsd_reader_init(struct gpsd_reader *reader, const char *wanted, int32_t built_days)
{
	memset(reader, 0, offsetof(struct gpsd_reader, line));
	reader->wanted = wanted;
	reader->calendar.built_days = built_days;
}

/* ---- values --------------------------------------------------------------------------------- */

/* False: it is no number in [low, high], times 10^decimals, and the line is bad. */
static bool number(struct reading *reading, const struct gps_json_item *item, unsigned decimals, int64_t low,
		   int64_t high, int64_t *out)
{
	bool good = gps_json_number(item, decimals, out) && *out >= low && *out <= high;

	reading->bad |= !good;
	return good;
}

static bool two_digits(const char *text, int *out)
{
	*out = (text[0] - '0') * 10 + (text[1] - '0');
	return text[0] >= '0' && text[0] <= '9' && text[1] >= '0' && text[1] <= '9';
}

/* 2005-03-16T09:38:03.000Z */
static void read_time(struct reading *reading, const struct gps_json_item *item)
{
	static const char form[] = "dddd-dd-ddTdd:dd:";
	const size_t head = sizeof(form) - 1;
	const char *text = item->text;
	int century, year, month, day, hour, minute;
	int64_t second_ms;

	reading->bad = true;
	if (item->kind != GPS_JSON_STRING || item->size <= head || text[item->size - 1] != 'Z')
		return;
	for (size_t i = 0; i < head; i++)
		if (form[i] != 'd' && text[i] != form[i])
			return;
	if (!two_digits(text, &century) || !two_digits(text + 2, &year) || !two_digits(text + 5, &month) ||
	    !two_digits(text + 8, &day) || !two_digits(text + 11, &hour) || !two_digits(text + 14, &minute) ||
	    !gps_days(century * 100 + year, month, day, &reading->date) || hour > 23 || minute > 59 ||
	    !gps_decimal(text + head, item->size - 1 - head, 3, &second_ms) || second_ms < 0 ||
	    second_ms >= 61000)
		return;
	reading->bad = false;
	reading->fix.day_ms = (hour * 60 + minute) * 60000 + (int32_t)second_ms;
	reading->fix.known |= GPS_TIME;
}

/* A field of the fix in 1/1000 of gpsd's unit, metres or metres a second. */
static void read_milli(struct reading *reading, const struct gps_json_item *item, int64_t limit,
		       int32_t *field, uint32_t known)
{
	int64_t value;

	if (!number(reading, item, 3, -limit * 1000, limit * 1000, &value))
		return;
	*field = (int32_t)value;
	reading->fix.known |= known;
}

static void read_dilution(struct reading *reading, const struct gps_json_item *item, uint16_t *field,
			  uint32_t known)
{
	int64_t value;

	if (!number(reading, item, 2, 0, INT32_MAX, &value))
		return;
	*field = (uint16_t)(value > DILUTION_MAX ? DILUTION_MAX : value);
	reading->fix.known |= known;
}

static void read_course(struct reading *reading, const struct gps_json_item *item)
{
	int64_t value;

	if (!number(reading, item, 2, 0, FULL_CIRCLE, &value))
		return;
	reading->fix.course = (uint16_t)(value % FULL_CIRCLE);
	reading->fix.known |= GPS_COURSE;
}

/* ---- TPV and SKY ---------------------------------------------------------------------------- */

static void read_place(struct reading *reading, const struct gps_json_item *item)
{
	struct gps_fix *fix = &reading->fix;
	int64_t value;

	if (gps_json_is(item, "lat") && number(reading, item, 7, -90 * E7, 90 * E7, &value)) {
		fix->latitude = (int32_t)value;
		reading->has_latitude = true;
	} else if (gps_json_is(item, "lon") && number(reading, item, 7, -180 * E7, 180 * E7, &value)) {
		fix->longitude = (int32_t)value;
		reading->has_longitude = true;
	} else if (gps_json_is(item, "altMSL")) {
		read_milli(reading, item, ALTITUDE_MAX, &fix->altitude_mm, GPS_ALTITUDE);
	} else if (gps_json_is(item, "geoidSep")) {
		read_milli(reading, item, ALTITUDE_MAX, &fix->geoid_mm, GPS_GEOID);
	} else if (gps_json_is(item, "eph")) {
		read_milli(reading, item, ERROR_MAX, &fix->error_mm, GPS_ERROR);
	} else if (gps_json_is(item, "epv")) {
		read_milli(reading, item, ERROR_MAX, &fix->error_vertical_mm, GPS_ERROR_VERTICAL);
	}
}

static void read_motion(struct reading *reading, const struct gps_json_item *item)
{
	if (gps_json_is(item, "speed"))
		read_milli(reading, item, SPEED_MAX, &reading->fix.speed_mm_s, GPS_SPEED);
	else if (gps_json_is(item, "climb"))
		read_milli(reading, item, SPEED_MAX, &reading->fix.climb_mm_s, GPS_CLIMB);
	else if (gps_json_is(item, "track"))
		read_course(reading, item);
}

/* The class comes first; other classes use the same names for other things. */
static void read_kind(struct reading *reading, const struct gps_json_item *item)
{
	if (gps_json_is(item, "class")) {
		reading->bad |= item->kind != GPS_JSON_STRING;
		reading->tpv = item->size == 3 && memcmp(item->text, "TPV", 3) == 0;
		reading->sky = item->size == 3 && memcmp(item->text, "SKY", 3) == 0;
	}
}

/* As the log can say it, too. */
static void read_device(struct reading *reading, const struct gps_json_item *item)
{
	const size_t most = sizeof(reading->device) - 1, size = item->size < most ? item->size : most;

	reading->bad |= item->kind != GPS_JSON_STRING;
	if (reading->bad)
		return;
	for (size_t i = 0; i < size; i++)
		reading->device[i] = item->text[i] >= ' ' && item->text[i] <= '~' ? item->text[i] : '?';
	reading->device[size] = '\0';
}

static void read_report(struct reading *reading, const struct gps_json_item *item)
{
	if (gps_json_is(item, "mode")) {
		number(reading, item, 0, 0, 3, &reading->mode);
	} else if (gps_json_is(item, "status")) {
		number(reading, item, 0, 0, 255, &reading->status);
	} else if (gps_json_is(item, "time")) {
		read_time(reading, item);
	}
}

static void read_view(struct reading *reading, const struct gps_json_item *item)
{
	struct gps_fix *fix = &reading->fix;

	if (gps_json_is(item, "hdop"))
		read_dilution(reading, item, &fix->hdop, GPS_HDOP);
	else if (gps_json_is(item, "pdop"))
		read_dilution(reading, item, &fix->pdop, GPS_PDOP);
	else if (gps_json_is(item, "vdop"))
		read_dilution(reading, item, &fix->vdop, GPS_VDOP);
	else if (gps_json_is(item, "uSat") && number(reading, item, 0, 0, 255, &reading->used))
		reading->has_used = true;
}

/* gnssid of gpsd, which is u-blox's: GPS, SBAS, Galileo, BeiDou, IMES, QZSS, GLONASS, NavIC */
static char constellation(int64_t gnssid)
{
	static const char letters[] = "PPABPQLI";

	return letters[gnssid & 7];
}

static void read_satellite(struct reading *reading, const struct gps_json_item *item)
{
	struct gps_satellite *satellite = &reading->satellite;
	int64_t value;

	if (gps_json_is(item, "PRN") && number(reading, item, 0, 0, UINT16_MAX, &value))
		satellite->number = (uint16_t)value;
	else if (gps_json_is(item, "el") && number(reading, item, 0, -90, 90, &value))
		satellite->elevation = (int8_t)value;
	else if (gps_json_is(item, "az") && number(reading, item, 0, 0, 360, &value))
		satellite->azimuth = (uint16_t)(value % 360);
	else if (gps_json_is(item, "ss") && number(reading, item, 0, -1, UINT8_MAX, &value))
		satellite->snr = (uint8_t)later(value, 0); /* -1: not tracked */
	else if (gps_json_is(item, "gnssid") && number(reading, item, 0, 0, 7, &value))
		satellite->constellation = constellation(value);
	else if (gps_json_is(item, "used"))
		satellite->used = item->size == 4 && memcmp(item->text, "true", 4) == 0;
}

static bool is_satellite(const struct gps_json_item *item)
{
	return item->depth == INSIDE && gps_json_is(item, "satellites");
}

static void on_item(void *context, const struct gps_json_item *item)
{
	struct reading *reading = context;
	struct gps_sky *sky = &reading->fix.sky;

	if (item->kind == GPS_JSON_OBJECT) {
		reading->satellite = (struct gps_satellite){.constellation = 'P'};
	} else if (item->kind == GPS_JSON_END) {
		if (is_satellite(item))
			gps_sky_add(sky, &reading->satellite);
	} else if (item->depth == 1) {
		read_kind(reading, item);
		if ((reading->tpv || reading->sky) && gps_json_is(item, "device"))
			read_device(reading, item);
		if (reading->tpv) {
			read_report(reading, item);
			read_place(reading, item);
			read_motion(reading, item);
		} else if (reading->sky) {
			read_view(reading, item);
		}
	} else if (item->depth == INSIDE + 1 && reading->sky) {
		read_satellite(reading, item);
	}
}

/* ---- a line --------------------------------------------------------------------------------- */

/* gpsd's status: 2 differential, 3 and 4 RTK, 5 and 6 dead reckoning, 7 a surveyed place, 8 simulated, 9 precise */
static uint8_t method_of(int64_t status)
{
	static const uint8_t methods[] = {GPS_AUTONOMOUS, GPS_AUTONOMOUS, GPS_DIFFERENTIAL, GPS_RTK,
					  GPS_RTK_FLOAT,  GPS_ESTIMATED,  GPS_ESTIMATED,    GPS_AUTONOMOUS,
					  GPS_SIMULATED,  GPS_PRECISE};

	return status >= 0 && status < (int64_t)sizeof(methods) ? methods[status] : GPS_AUTONOMOUS;
}

static void finish_time(struct gps_calendar *calendar, int32_t date, struct gps_fix *fix)
{
	if ((fix->known & GPS_TIME) == 0)
		return;
	if (gps_calendar_believe(calendar, &date))
		fix->time_ns = (date * MS_PER_DAY + fix->day_ms) * NS_PER_MS;
	else
		fix->known &= ~(uint32_t)GPS_TIME;
}

static bool has_fix(const struct reading *reading)
{
	return reading->tpv && reading->mode >= 2 && reading->has_latitude && reading->has_longitude &&
	       !gps_is_nowhere(reading->fix.latitude, reading->fix.longitude);
}

static void give_fix(struct gpsd_reader *reader, const struct reading *reading, int64_t now_ns,
		     struct gps_fix *fix)
{
	*fix = (struct gps_fix){.day_ms = reading->fix.day_ms};
	if (has_fix(reading)) {
		*fix = reading->fix;
		finish_time(&reader->calendar, reading->date, fix);
		fix->known |= GPS_POSITION;
		fix->method = method_of(reading->status);
		fix->dimensions = (uint8_t)reading->mode;
		fix->hdop = reader->hdop;
		fix->pdop = reader->pdop;
		fix->vdop = reader->vdop;
		fix->known |= (reader->hdop > 0 ? GPS_HDOP : 0u) | (reader->pdop > 0 ? GPS_PDOP : 0u) |
			      (reader->vdop > 0 ? GPS_VDOP : 0u);
	}
	if (reader->has_sky)
		fix->known |= GPS_SATELLITES;
	fix->satellites = reader->satellites;
	fix->sky = reader->sky;
	fix->arrival_ns = now_ns;
}

static void keep_sky(struct gpsd_reader *reader, const struct reading *reading)
{
	const struct gps_fix *view = &reading->fix;
	uint8_t used = 0;

	reader->hdop = view->hdop;
	reader->pdop = view->pdop;
	reader->vdop = view->vdop;
	if (view->sky.count == 0 && !reading->has_used)
		return; /* dilutions alone */
	for (uint32_t i = 0; i < view->sky.count; i++)
		used += view->sky.satellites[i].used;
	reader->sky = view->sky;
	reader->has_sky = true;
	/* Its own number counts the signals. */
	reader->satellites = view->sky.count > 0 ? used : (uint8_t)reading->used;
}

/* What was known of the sky is another receiver's. */
static void turn_to(struct gpsd_reader *reader, const char *device)
{
	strcpy(reader->device, device);
	reader->heard = true;
	reader->has_sky = false;
	reader->satellites = 0;
	reader->hdop = reader->pdop = reader->vdop = 0;
	reader->sky = (struct gps_sky){0};
}

static bool is_wanted(struct gpsd_reader *reader, const struct reading *reading, int64_t now_ns)
{
	if (reader->wanted[0] != '\0')
		return strcmp(reading->device, reader->wanted) == 0;
	if (!reader->heard)
		turn_to(reader, reading->device);
	if (strcmp(reading->device, reader->device) != 0) {
		if (!has_fix(reading) || (reader->fixed_ns != 0 && now_ns - reader->fixed_ns < GPSD_OTHER_NS))
			return false;
		turn_to(reader, reading->device);
	}
	if (has_fix(reading))
		reader->fixed_ns = now_ns;
	return true;
}

static bool take_line(struct gpsd_reader *reader, int64_t now_ns, struct gps_fix *fix)
{
	struct reading reading = {.fix = {.day_ms = -1}};

	if (reader->too_long || !gps_json_read(reader->line, reader->size, on_item, &reading) ||
	    reading.bad) {
		reader->counters[NMEA_DAMAGED]++;
		return false;
	}
	if ((reading.tpv || reading.sky) && !is_wanted(reader, &reading, now_ns)) {
		strcpy(reader->other, reading.device);
		reading.tpv = reading.sky = false;
	}
	reader->counters[reading.tpv || reading.sky ? NMEA_TAKEN : NMEA_UNKNOWN]++;
	if (reading.sky)
		keep_sky(reader, &reading);
	if (reading.tpv)
		give_fix(reader, &reading, now_ns, fix);
	return reading.tpv;
}

bool gpsd_reader_take(struct gpsd_reader *reader, const uint8_t **bytes, size_t *size, int64_t now_ns,
		      struct gps_fix *fix)
{
	while (*size > 0) {
		char octet = (char)*(*bytes)++;
		bool is_fix;

		(*size)--;
		if (octet != '\n') {
			reader->too_long |= reader->size == GPSD_LINE_MAX;
			if (!reader->too_long)
				reader->line[reader->size++] = octet;
			continue;
		}
		is_fix = reader->size > 0 && take_line(reader, now_ns, fix);
		reader->size = 0;
		reader->too_long = false;
		if (is_fix)
			return true;
	}
	return false;
}
