/* SPDX-License-Identifier: GPL-3.0-or-later */
#include "gps/field.h"

#include <string.h>

#include "gps/date.h"
#include "gps/number.h"

#define MS_PER_MINUTE   60000
#define FULL_CIRCLE     36000 /* 0.01 degree */
#define DILUTION_MAX    65535
#define MINUTE_DECIMALS 9
#define MINUTE          1000000000LL
#define E7_PER_DEGREE   10000000LL
#define SPEED_MAX       10000 /* in any unit: more is no speed */

static struct nmea_text field(const struct nmea_fields *fields, unsigned place)
{
	return place < fields->sentence->count ? fields->sentence->fields[place] : (struct nmea_text){"", 0};
}

size_t nmea_size(const struct nmea_fields *fields, unsigned place)
{
	return field(fields, place).size;
}

bool nmea_is(const struct nmea_fields *fields, unsigned place, const char *text)
{
	struct nmea_text found = field(fields, place);

	return found.size == strlen(text) && memcmp(found.at, text, found.size) == 0;
}

char nmea_letter(struct nmea_fields *fields, unsigned place)
{
	struct nmea_text text = field(fields, place);

	fields->bad |= text.size > 1;
	return text.size == 1 ? text.at[0] : 0;
}

bool nmea_number(struct nmea_fields *fields, unsigned place, unsigned decimals, int64_t low, int64_t high,
		 int64_t *out)
{
	struct nmea_text text = field(fields, place);

	if (text.size == 0)
		return false;
	if (gps_decimal(text.at, text.size, decimals, out) && *out >= low && *out <= high)
		return true;
	fields->bad = true;
	return false;
}

/* Two digits of a field; -1, and the sentence is bad: they are none. */
static int two_digits(struct nmea_fields *fields, unsigned place, unsigned at)
{
	struct nmea_text text = field(fields, place);
	int64_t value;

	if (text.size >= at + 2 && text.at[at] >= '0' && text.at[at] <= '9' &&
	    gps_decimal(text.at + at, 2, 0, &value))
		return (int)value;
	fields->bad = true;
	return -1;
}

int32_t nmea_time(struct nmea_fields *fields, unsigned place)
{
	struct nmea_text text = field(fields, place);
	int hour, minute;
	int64_t second_ms;

	if (text.size == 0)
		return -1;
	hour = two_digits(fields, place, 0);
	minute = two_digits(fields, place, 2);
	two_digits(fields, place, 4);
	if (fields->bad || !gps_decimal(text.at + 4, text.size - 4, 3, &second_ms) || hour > 23 ||
	    minute > 59 || second_ms >= MS_PER_MINUTE + 1000) {
		fields->bad = true;
		return -1;
	}
	return (hour * 60 + minute) * MS_PER_MINUTE + (int32_t)second_ms;
}

int32_t nmea_date(struct nmea_fields *fields, unsigned place)
{
	int day, month, year;
	int32_t days = 0;

	if (nmea_size(fields, place) == 0)
		return 0;
	day = two_digits(fields, place, 0);
	month = two_digits(fields, place, 2);
	year = two_digits(fields, place, 4);
	if (fields->bad || nmea_size(fields, place) != 6 ||
	    !gps_days(year + (year < 80 ? 2000 : 1900), month, day, &days))
		fields->bad = true;
	return days;
}

static size_t digits_before_point(struct nmea_text text)
{
	const char *point = memchr(text.at, '.', text.size);

	return point == NULL ? text.size : (size_t)(point - text.at);
}

/*
 * "5213.1439" with degree_digits 2, and a hemisphere beside it, in 1e-7 degree. Who leaves out zeros, or says degrees with a fraction, is
 * not understood: his digits would be of another place.
 */
static int32_t angle(struct nmea_fields *fields, unsigned place, unsigned degree_digits,
		     const char *hemispheres)
{
	struct nmea_text text = field(fields, place);
	char hemisphere = nmea_letter(fields, place + 1);
	int64_t degrees, minutes, value, limit = degree_digits == 2 ? 90 : 180;

	if (digits_before_point(text) != degree_digits + 2 || hemisphere == 0 ||
	    strchr(hemispheres, hemisphere) == NULL || text.at[0] < '0' || text.at[degree_digits] < '0' ||
	    !gps_decimal(text.at, degree_digits, 0, &degrees) ||
	    !gps_decimal(text.at + degree_digits, text.size - degree_digits, MINUTE_DECIMALS, &minutes) ||
	    minutes >= 60 * MINUTE) {
		fields->bad = true;
		return 0;
	}
	value = degrees * E7_PER_DEGREE + gps_divide(minutes, 60 * MINUTE / E7_PER_DEGREE);
	fields->bad |= value > limit * E7_PER_DEGREE;
	return (int32_t)(hemisphere == hemispheres[1] ? -value : value);
}

void nmea_position(struct nmea_fields *fields, unsigned place, struct nmea_report *out)
{
	struct nmea_text latitude = field(fields, place), longitude = field(fields, place + 2);
	unsigned digits = gps_decimals_of(latitude.at, latitude.size),
		 digits_longitude = gps_decimals_of(longitude.at, longitude.size);

	if (latitude.size + longitude.size == 0)
		return;
	out->latitude = angle(fields, place, 2, "NS");
	out->longitude = angle(fields, place + 2, 3, "EW");
	out->digits = (uint8_t)(digits < digits_longitude ? digits : digits_longitude);
	out->known |= GPS_POSITION;
}

void nmea_speed(struct nmea_fields *fields, unsigned place, int64_t mm_s_milli, struct nmea_report *out)
{
	int64_t speed;

	if (!nmea_number(fields, place, 3, 0, SPEED_MAX * 1000, &speed))
		return;
	out->speed_mm_s = (int32_t)gps_divide(speed * mm_s_milli, 1000000);
	out->known |= GPS_SPEED;
}

void nmea_course(struct nmea_fields *fields, unsigned place, struct nmea_report *out)
{
	int64_t course;

	if (!nmea_number(fields, place, 2, 0, FULL_CIRCLE, &course))
		return;
	out->course = (uint16_t)(course % FULL_CIRCLE);
	out->known |= GPS_COURSE;
}

void nmea_mode(struct nmea_fields *fields, unsigned place, struct nmea_report *out)
{
	static const char letters[] = "NADPRFEMS"; /* by enum gps_method */
	struct nmea_text text = field(fields, place);
	long method = GPS_NO_FIX;

	for (size_t i = 0; i < text.size; i++) {
		const char *found = memchr(letters, text.at[i], GPS_METHODS);

		if (found == NULL)
			return; /* of a later standard */
		if (found - letters > method)
			method = found - letters;
	}
	if (text.size == 0)
		return;
	out->has_method = true;
	out->method = (uint8_t)method;
	if (out->method == GPS_NO_FIX)
		out->says = NMEA_SAYS_NO_FIX;
}

uint16_t nmea_dilution(struct nmea_fields *fields, unsigned place)
{
	int64_t value;

	if (!nmea_number(fields, place, 2, 0, INT32_MAX, &value))
		return 0;
	return (uint16_t)(value > DILUTION_MAX ? DILUTION_MAX : value);
}
