/* SPDX-License-Identifier: GPL-3.0-or-later */
/* Garmin's own sentences, PGRM and a letter. */
#ifndef OPENRTU_GPS_GARMIN_H
#define OPENRTU_GPS_GARMIN_H

#include "gps/field.h"

/* Reads the fields of a PGRM sentence, by the letter behind. False: of another kind. */
bool nmea_garmin(char letter, struct nmea_fields *fields, struct nmea_report *out);

#endif
