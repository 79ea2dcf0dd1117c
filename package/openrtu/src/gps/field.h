/* SPDX-License-Identifier: GPL-3.0-or-later */
/* Fields of a sentence. A field that cannot be makes the whole sentence bad; an empty one is none. */
#ifndef OPENRTU_GPS_FIELD_H
#define OPENRTU_GPS_FIELD_H

#include "gps/sentence.h"

struct nmea_fields {
	const struct nmea_sentence *sentence;
	bool bad;
};

/* 0: the sentence has no such field, or it is empty. */
size_t nmea_size(const struct nmea_fields *fields, unsigned place);
bool nmea_is(const struct nmea_fields *fields, unsigned place, const char *text);
/* The field's only character; 0 for an empty field. */
char nmea_letter(struct nmea_fields *fields, unsigned place);
/* A number times 10^decimals, within [low, high]. False: empty or bad. */
bool nmea_number(struct nmea_fields *fields, unsigned place, unsigned decimals, int64_t low, int64_t high,
		 int64_t *out);
/* hhmmss and its fraction, in ms; 60 s in a leap second. -1: empty or bad. */
int32_t nmea_time(struct nmea_fields *fields, unsigned place);
/* ddmmyy, in days since 1970; yy of 80 and above is of the last century. 0: empty or bad. */
int32_t nmea_date(struct nmea_fields *fields, unsigned place);
/* The four fields of latitude and longitude: all there, or all empty. */
void nmea_position(struct nmea_fields *fields, unsigned place, struct nmea_report *out);
/* Speed in a unit of mm_s_milli/1000 mm/s. */
void nmea_speed(struct nmea_fields *fields, unsigned place, int64_t mm_s_milli, struct nmea_report *out);
void nmea_course(struct nmea_fields *fields, unsigned place, struct nmea_report *out);
/* The mode that RMC, GLL and VTG end with since NMEA 0183 2.3, and that of GNS: a letter, or one for each constellation. */
void nmea_mode(struct nmea_fields *fields, unsigned place, struct nmea_report *out);
/* A dilution of precision, in 0.01; 0: not known. */
uint16_t nmea_dilution(struct nmea_fields *fields, unsigned place);

#define NMEA_KNOT_MM_S_MILLI 514444 /* 1 852 m an hour */
#define NMEA_KMH_MM_S_MILLI  277778

#endif
