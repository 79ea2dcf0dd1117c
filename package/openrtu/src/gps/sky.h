/* SPDX-License-Identifier: GPL-3.0-or-later */
/* The satellites in view, from GSV and GSA. A view comes in parts and not with each fix. */
#ifndef OPENRTU_GPS_SKY_H
#define OPENRTU_GPS_SKY_H

#include "gps/sentence.h"

/* A GSV: its first part of a constellation replaces what was known of it. A satellite heard on two signals is one. */
void gps_sky_see(struct gps_sky *sky, const struct nmea_report *report);
/* A GSA: these are used. */
void gps_sky_use(struct gps_sky *sky, const struct nmea_report *report);
void gps_sky_forget_used(struct gps_sky *sky);
/* One more, or another signal of one. */
void gps_sky_add(struct gps_sky *sky, const struct gps_satellite *seen);

#endif
