/* SPDX-License-Identifier: GPL-3.0-or-later */
#include "gps/burst.h"

#include <stdlib.h>
#include <string.h>

#include "gps/sky.h"
#include "gps/sphere.h"
#include "map/time_ns.h"

#define BITS_PER_OCTET 10 /* 8 data bits, start, stop */
#define HALF_DAY_MS    43200000
#define MS_PER_DAY     86400000LL
/*
 * Sentences of one moment may still differ: by their digits, and where a receiver computes between two of them. 0.0005 degree
 * is 55 m of latitude.
 */
#define CONTRADICTION_E7 5000
/*
 * The times of one moment's sentences may differ by less: half of the shortest period. Receivers are known whose RMC is of 20 ms
 * after their GGA, or GLL of 5 ms before it.
 */
#define MOMENT_MS 50

void gps_burst_init(struct gps_burst *burst, int32_t built_days)
{
	memset(burst, 0, sizeof(*burst));
	burst->calendar.built_days = built_days;
	burst->fix.day_ms = -1;
}

int64_t gps_burst_time_ns(uint32_t octets, uint32_t baud)
{
	return octets * (BITS_PER_OCTET * NS_PER_S) / baud;
}

/* ---- a sentence's part --------------------------------------------------------------------- */

static bool contradicts(const struct gps_burst *burst, const struct nmea_report *report)
{
	int32_t north = report->latitude - burst->fix.latitude;
	int32_t east = gps_longitude_apart(burst->fix.longitude, report->longitude);

	return north > CONTRADICTION_E7 || north < -CONTRADICTION_E7 || east > CONTRADICTION_E7 ||
	       east < -CONTRADICTION_E7;
}

/* Both or none: the position of one sentence, the one with the most digits. */
static void take_position(struct gps_burst *burst, const struct nmea_report *report)
{
	bool first = (burst->fix.known & GPS_POSITION) == 0;

	if (!first && contradicts(burst, report))
		burst->fix.marks |= GPS_CONTRADICTS;
	if (!first && (report->digits < burst->digits ||
		       (report->digits == burst->digits && report->kind > burst->position_from)))
		return;
	burst->fix.latitude = report->latitude;
	burst->fix.longitude = report->longitude;
	burst->digits = report->digits;
	burst->position_from = report->kind;
	if (report->day_ms >= 0)
		burst->fix.day_ms = report->day_ms;
}

static bool is_made_up(uint8_t method)
{
	return method >= GPS_ESTIMATED;
}

/* Of GGA first; but a position that one sentence calls estimated, typed or simulated is that. */
static void take_method(struct gps_burst *burst, const struct nmea_report *report)
{
	struct gps_fix *fix = &burst->fix;

	if (report->method == GPS_NO_FIX)
		return;
	if (fix->method == GPS_NO_FIX || is_made_up(report->method) ||
	    (!is_made_up(fix->method) && report->kind < burst->method_from)) {
		fix->method = report->method;
		burst->method_from = report->kind;
	}
}

static void take_movement(struct gps_fix *fix, const struct nmea_report *report)
{
	if (report->known & GPS_SPEED)
		fix->speed_mm_s = report->speed_mm_s;
	if (report->known & GPS_COURSE)
		fix->course = report->course;
	if (report->known & GPS_CLIMB)
		fix->climb_mm_s = report->climb_mm_s;
}

static void take_height(struct gps_fix *fix, const struct nmea_report *report)
{
	if (report->known & GPS_ALTITUDE)
		fix->altitude_mm = report->altitude_mm;
	if (report->known & GPS_GEOID)
		fix->geoid_mm = report->geoid_mm;
}

static void take_accuracy(struct gps_fix *fix, const struct nmea_report *report)
{
	if (report->known & GPS_HDOP)
		fix->hdop = report->hdop;
	if (report->known & GPS_PDOP)
		fix->pdop = report->pdop;
	if (report->known & GPS_VDOP)
		fix->vdop = report->vdop;
	if (report->known & GPS_ERROR)
		fix->error_mm = report->error_mm;
	if (report->known & GPS_ERROR_VERTICAL)
		fix->error_vertical_mm = report->error_vertical_mm;
	if (report->satellites > fix->satellites) /* GNS counts those of all constellations */
		fix->satellites = report->satellites;
	if (report->dimensions > fix->dimensions) /* a constellation that is not used has 1 */
		fix->dimensions = report->dimensions;
}

static void take_own(struct gps_burst *burst, const struct nmea_report *report)
{
	switch (report->kind) {
	case NMEA_GSV:
		gps_sky_see(&burst->fix.sky, report);
		break;
	case NMEA_GSA:
		if (burst->used_count < GPS_CONSTELLATIONS)
			burst->used[burst->used_count++] = *report;
		break;
	case NMEA_PGRMM:
		burst->other_datum = report->other_datum;
		break;
	case NMEA_PGRMT:
		burst->faults = report->faults;
		break;
	default:
		break;
	}
}

static void take(struct gps_burst *burst, const struct nmea_report *report)
{
	burst->says_fix |= report->says == NMEA_SAYS_FIX;
	burst->says_no_fix |= report->says == NMEA_SAYS_NO_FIX;
	burst->says_fix_of_nothing |= report->says == NMEA_SAYS_FIX_OF_NOTHING;
	if (report->known & GPS_POSITION)
		take_position(burst, report);
	if (report->has_method)
		take_method(burst, report);
	take_movement(&burst->fix, report);
	take_height(&burst->fix, report);
	take_accuracy(&burst->fix, report);
	take_own(burst, report);
	if (report->date != 0 && report->day_ms >= 0) {
		burst->date = report->date;
		burst->date_ms = report->day_ms;
	}
	burst->fix.known |= report->known;
}

/* ---- the whole ----------------------------------------------------------------------------- */

/* The day that the burst's sentences say is that of the time that they say with it. */
static void keep_date(struct gps_burst *burst)
{
	if (burst->date == 0)
		return;
	burst->last_date = gps_calendar_believe(&burst->calendar, &burst->date) ? burst->date : 0;
	burst->last_day_ms = burst->date_ms;
	burst->date = 0;
}

/*
 * Without a date of its own, a fix is of the day of the one before, or after midnight of the next. Without a fix, a
 * receiver's clock is whatever it was switched on with.
 */
static void finish_time(struct gps_burst *burst)
{
	const bool own_date = burst->date != 0;

	keep_date(burst);
	if (burst->fix.day_ms < 0 || burst->last_date == 0)
		return;
	burst->last_date += burst->fix.day_ms < burst->last_day_ms - HALF_DAY_MS;
	burst->last_date -= own_date && burst->fix.day_ms > burst->last_day_ms + HALF_DAY_MS;
	burst->last_day_ms = burst->fix.day_ms;
	burst->fix.time_ns = (burst->last_date * MS_PER_DAY + burst->fix.day_ms) * NS_PER_MS;
	burst->fix.known |= GPS_TIME;
}

/* Satellites that the GSA of this fix name. */
static unsigned count_used(const struct gps_burst *burst)
{
	unsigned count = 0;

	for (unsigned i = 0; i < burst->used_count; i++)
		count += burst->used[i].dimensions > 0 ? burst->used[i].used_count : 0;
	return count;
}

/* Where GGA counts none or is not said, GSA counts. Nobody: it is not known. */
static void finish_satellites(struct gps_burst *burst)
{
	struct gps_fix *fix = &burst->fix;

	if (fix->satellites == 0)
		fix->satellites = (uint8_t)count_used(burst);
	if (fix->satellites > 0)
		fix->known |= GPS_SATELLITES;
	else
		fix->known &= ~(uint32_t)GPS_SATELLITES;
}

/*
 * One sentence that denies the fix is enough. A GGA that says it out of 0 satellites neither denies nor vouches: many do not
 * count those that are not of GPS. Then GSA decides, if it is said, by whether it names one, unless GNS counts them.
 */
static bool has_fix(const struct gps_burst *burst)
{
	const unsigned used = count_used(burst);
	const bool of_nothing = burst->says_fix_of_nothing && burst->fix.satellites == 0,
		   vouched = burst->says_fix || (of_nothing && used > 0),
		   denied = burst->says_no_fix || (of_nothing && burst->used_count > 0 && used == 0);

	return vouched && !denied && (burst->fix.known & GPS_POSITION) != 0;
}

/* Nothing of a place that the receiver itself does not vouch for. */
static void forget_position(struct gps_fix *fix)
{
	const struct gps_fix kept = {.arrival_ns = fix->arrival_ns,
				     .day_ms = fix->day_ms,
				     .marks = fix->marks & GPS_DATUM,
				     .known = fix->known & GPS_SATELLITES,
				     .satellites = fix->satellites};

	memcpy(fix, &kept, offsetof(struct gps_fix, sky));
}

/* Nothing is known but the sky. */
static void begin(struct gps_burst *burst)
{
	memset(&burst->fix, 0, offsetof(struct gps_fix, sky));
	burst->fix.day_ms = -1;
	burst->open = burst->timed = false;
	burst->kinds = 0;
	burst->says_fix = burst->says_no_fix = burst->says_fix_of_nothing = false;
	burst->date = 0;
	burst->used_count = 0;
}

static void finish(struct gps_burst *burst, struct gps_fix *fix)
{
	if (burst->used_count > 0)
		gps_sky_forget_used(&burst->fix.sky);
	for (unsigned i = 0; i < burst->used_count; i++)
		gps_sky_use(&burst->fix.sky, &burst->used[i]);
	if (burst->other_datum)
		burst->fix.marks |= GPS_DATUM;
	if (has_fix(burst)) {
		finish_satellites(burst);
		finish_time(burst);
		if (burst->fix.method == GPS_NO_FIX)
			burst->fix.method = GPS_AUTONOMOUS;
	} else {
		forget_position(&burst->fix);
	}
	*fix = burst->fix;
	begin(burst);
}

/* ZDA alone says the time of a moment, of another one with some receivers, and nothing of a place. */
static bool says_anything(const struct gps_burst *burst)
{
	return burst->says_fix || burst->says_no_fix || burst->says_fix_of_nothing;
}

bool gps_burst_end(struct gps_burst *burst, struct gps_fix *fix)
{
	if (says_anything(burst)) {
		finish(burst, fix);
		return true;
	}
	keep_date(burst);
	begin(burst);
	return false;
}

static uint32_t bit_of(const struct nmea_report *report)
{
	return 1u << report->kind;
}

/* A sentence of a kind that was said before, with another time, is of the next moment however near it is. */
static bool is_of_another_moment(const struct gps_burst *burst, const struct nmea_report *report)
{
	int32_t apart_ms = report->day_ms - burst->fix.day_ms;

	if (!burst->timed || !report->timed || apart_ms == 0)
		return false;
	if (report->day_ms < 0 || burst->fix.day_ms < 0 || (burst->kinds & bit_of(report)) != 0)
		return true;
	apart_ms = abs(apart_ms);
	return apart_ms >= MOMENT_MS && apart_ms <= MS_PER_DAY - MOMENT_MS;
}

bool gps_burst_take(struct gps_burst *burst, const struct nmea_report *report, int64_t now_ns,
		    struct gps_fix *fix)
{
	bool other = is_of_another_moment(burst, report), next = other && says_anything(burst);

	if (next) {
		finish(burst, fix);
	} else if (other) {
		keep_date(burst);
		burst->timed = false;
		burst->kinds = 0;
	}
	if (!burst->open)
		burst->fix.arrival_ns = now_ns;
	burst->open = true;
	if (report->timed) {
		if (!burst->timed)
			burst->fix.day_ms = report->day_ms;
		burst->timed = true;
		burst->kinds |= bit_of(report);
	}
	take(burst, report);
	return next;
}
