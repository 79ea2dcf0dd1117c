/* SPDX-License-Identifier: GPL-3.0-or-later */
/* NMEA 0183, 2.0 to 4.11. */
#include "gps/sentence.h"

#include <string.h>

#include "gps/date.h"
#include "gps/field.h"
#include "gps/garmin.h"

#define ADDRESS_SIZE   5
#define ALTITUDE_MM    2147000000LL /* 2 147 km either way: what 32 bits hold */
#define SATELLITES_MAX 255
#define NUMBER_MAX     999
#define GSV_HEAD       4 /* address, messages, message, satellites in view */
#define GSV_FIELDS     4

static void says(struct nmea_report *out, bool fix)
{
	out->says = fix ? NMEA_SAYS_FIX : NMEA_SAYS_NO_FIX;
}

static void read_satellites(struct nmea_fields *fields, unsigned place, struct nmea_report *out)
{
	int64_t satellites;

	if (!nmea_number(fields, place, 0, 0, SATELLITES_MAX, &satellites))
		return;
	out->satellites = (uint8_t)satellites;
	out->known |= GPS_SATELLITES;
}

static void read_height(struct nmea_fields *fields, unsigned altitude_place, unsigned geoid_place,
			struct nmea_report *out)
{
	int64_t altitude, geoid;

	if (nmea_number(fields, altitude_place, 3, -ALTITUDE_MM, ALTITUDE_MM, &altitude)) {
		out->altitude_mm = (int32_t)altitude;
		out->known |= GPS_ALTITUDE;
	}
	if (nmea_number(fields, geoid_place, 3, -ALTITUDE_MM, ALTITUDE_MM, &geoid)) {
		out->geoid_mm = (int32_t)geoid;
		out->known |= GPS_GEOID;
	}
}

/* $GPGGA,093802,5213.1439,N,02100.6511,E,2,10,0.9,137.2,M,36.2,M,,*43 */
static void read_gga(struct nmea_fields *fields, struct nmea_report *out)
{
	int64_t method;

	out->timed = true;
	out->day_ms = nmea_time(fields, 1);
	nmea_position(fields, 2, out);
	if (nmea_number(fields, 6, 0, 0, GPS_METHODS - 1, &method)) {
		out->has_method = true;
		out->method = (uint8_t)method;
		says(out, method != GPS_NO_FIX);
	} else {
		says(out, false);
	}
	read_satellites(fields, 7, out);
	if ((out->known & GPS_SATELLITES) && out->satellites == 0 && out->says == NMEA_SAYS_FIX &&
	    out->method < GPS_ESTIMATED)
		out->says = NMEA_SAYS_FIX_OF_NOTHING;
	out->hdop = nmea_dilution(fields, 8);
	read_height(fields, 9, 11, out);
}

/*
 * $GNGNS,120200.00,5957.0062,N,01100.6429,E,NDD,11,1.3,168.9,39.5,,,V*65: a letter of the mode for each constellation. Behind
 * it some receivers say one of each, with nothing but its satellites.
 */
static void read_gns(struct nmea_fields *fields, struct nmea_report *out)
{
	out->timed = true;
	out->day_ms = nmea_time(fields, 1);
	nmea_position(fields, 2, out);
	nmea_mode(fields, 6, out);
	if (nmea_size(fields, 6) > 0)
		says(out, out->method != GPS_NO_FIX);
	read_satellites(fields, 7, out);
	out->hdop = nmea_dilution(fields, 8);
	read_height(fields, 9, 10, out);
}

/* $GPRMC,093802,A,5213.1439,N,02100.6511,E,000.0,226.0,160305,004.2,E,D*15 */
static void read_rmc(struct nmea_fields *fields, struct nmea_report *out)
{
	out->timed = true;
	out->day_ms = nmea_time(fields, 1);
	says(out, nmea_letter(fields, 2) == 'A');
	nmea_position(fields, 3, out);
	nmea_speed(fields, 7, NMEA_KNOT_MM_S_MILLI, out);
	nmea_course(fields, 8, out);
	out->date = nmea_date(fields, 9);
	nmea_mode(fields, 12, out);
}

/* $GPGLL,5213.1439,N,02100.6511,E,093802,A,D*48 */
static void read_gll(struct nmea_fields *fields, struct nmea_report *out)
{
	out->timed = true;
	nmea_position(fields, 1, out);
	out->day_ms = nmea_time(fields, 5);
	says(out, nmea_letter(fields, 6) == 'A');
	nmea_mode(fields, 7, out);
}

/* $GPVTG,226,T,222,M,000.0,N,0000.0,K,D*12 */
static void read_vtg(struct nmea_fields *fields, struct nmea_report *out)
{
	nmea_course(fields, 1, out);
	if (nmea_size(fields, 7) > 0)
		nmea_speed(fields, 7, NMEA_KMH_MM_S_MILLI, out);
	else
		nmea_speed(fields, 5, NMEA_KNOT_MM_S_MILLI, out);
	/* Its mode is of the speed, and says nothing of the position. */
}

/* $GPZDA,160012.71,11,03,2004,-1,00*7D */
static void read_zda(struct nmea_fields *fields, struct nmea_report *out)
{
	int64_t day, month, year;

	out->timed = true;
	out->day_ms = nmea_time(fields, 1);
	if (nmea_number(fields, 2, 0, 1, 31, &day) && nmea_number(fields, 3, 0, 1, 12, &month) &&
	    nmea_number(fields, 4, 0, 1970, 2199, &year))
		fields->bad |= !gps_days((int)year, (int)month, (int)day, &out->date);
}

/* $GPGSA,A,3,03,06,15,16,18,19,21,22,,27,29,,1.6,0.9,1.3*34; since 4.11 with the number of the constellation behind */
static void read_gsa(struct nmea_fields *fields, struct nmea_report *out)
{
	static const char constellations[] = "\0PLABQI";
	int64_t value;

	if (nmea_number(fields, 2, 0, 1, 3, &value) && value > 1)
		out->dimensions = (uint8_t)value;
	for (unsigned i = 0; i < NMEA_GSA_SATELLITES; i++)
		if (nmea_number(fields, 3 + i, 0, 0, NUMBER_MAX, &value) && value > 0)
			out->used[out->used_count++] = (uint16_t)value;
	out->pdop = nmea_dilution(fields, 15);
	out->hdop = nmea_dilution(fields, 16);
	out->vdop = nmea_dilution(fields, 17);
	if (fields->sentence->count > 18 && nmea_number(fields, 18, 0, 0, NUMBER_MAX, &value))
		out->constellation = value < (int64_t)sizeof(constellations) ? constellations[value] : 0;
	else if (out->constellation == 'N')
		out->constellation = 0;
}

/* $GPGSV,3,2,12,18,50,135,50,19,15,291,46,21,59,069,51,22,30,169,49*75 */
static void read_gsv(struct nmea_fields *fields, struct nmea_report *out)
{
	int64_t message = 0;

	out->first = nmea_number(fields, 2, 0, 1, NUMBER_MAX, &message) && message == 1;
	for (unsigned place = GSV_HEAD;
	     place + GSV_FIELDS <= fields->sentence->count && out->seen_count < NMEA_GSV_SATELLITES;
	     place += GSV_FIELDS) {
		int64_t number, elevation = 0, azimuth = 0, snr = 0;

		if (!nmea_number(fields, place, 0, 0, NUMBER_MAX, &number) || number == 0)
			continue;
		nmea_number(fields, place + 1, 0, -90, 90, &elevation);
		nmea_number(fields, place + 2, 0, 0, 360, &azimuth);
		nmea_number(fields, place + 3, 0, 0, 99, &snr);
		out->seen[out->seen_count++] = (struct gps_satellite){.constellation = out->constellation,
								      .number = (uint16_t)number,
								      .elevation = (int8_t)elevation,
								      .azimuth = (uint16_t)(azimuth % 360),
								      .snr = (uint8_t)snr};
	}
}

struct form {
	char type[4];
	enum nmea_kind kind;
	void (*read)(struct nmea_fields *fields, struct nmea_report *out);
};

static const struct form forms[] = {
    {"GGA", NMEA_GGA, read_gga}, {"GNS", NMEA_GNS, read_gns}, {"RMC", NMEA_RMC, read_rmc},
    {"GLL", NMEA_GLL, read_gll}, {"GSA", NMEA_GSA, read_gsa}, {"GSV", NMEA_GSV, read_gsv},
    {"VTG", NMEA_VTG, read_vtg}, {"ZDA", NMEA_ZDA, read_zda},
};

/* Two letters of a talker, three of a type. */
static bool read_standard(const char *address, struct nmea_fields *fields, struct nmea_report *out)
{
	for (size_t i = 0; i < sizeof(forms) / sizeof(forms[0]); i++) {
		if (memcmp(address + 2, forms[i].type, 3) != 0)
			continue;
		out->kind = forms[i].kind;
		out->constellation = address[0] == 'B' && address[1] == 'D' ? 'B' : address[1];
		forms[i].read(fields, out);
		return true;
	}
	return false;
}

static void note_dilutions(struct nmea_report *out)
{
	out->known |= (out->hdop > 0 ? GPS_HDOP : 0u) | (out->pdop > 0 ? GPS_PDOP : 0u) |
		      (out->vdop > 0 ? GPS_VDOP : 0u);
}

/* Who says such a place denies the fix, whatever the letter beside it. */
static void refuse_nowhere(struct nmea_report *out)
{
	if ((out->known & GPS_POSITION) == 0 || !gps_is_nowhere(out->latitude, out->longitude))
		return;
	out->known &= ~(uint32_t)GPS_POSITION;
	out->says = NMEA_SAYS_NO_FIX;
}

enum nmea_verdict nmea_read(const struct nmea_sentence *sentence, struct nmea_report *out)
{
	struct nmea_fields fields = {.sentence = sentence};
	struct nmea_text address = sentence->fields[0];
	bool known;

	*out = (struct nmea_report){.day_ms = -1};
	if (address.size != ADDRESS_SIZE)
		return NMEA_NOT_READ;
	if (memcmp(address.at, "PGRM", 4) == 0)
		known = nmea_garmin(address.at[4], &fields, out);
	else
		known = address.at[0] != 'P' && read_standard(address.at, &fields, out);
	if (!known)
		return NMEA_NOT_READ;
	note_dilutions(out);
	refuse_nowhere(out);
	return fields.bad ? NMEA_IMPOSSIBLE : NMEA_READ;
}
