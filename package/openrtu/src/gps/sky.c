/* SPDX-License-Identifier: GPL-3.0-or-later */
#include "gps/sky.h"

static void forget(struct gps_sky *sky, char constellation)
{
	uint32_t kept = 0;

	for (uint32_t i = 0; i < sky->count; i++)
		if (sky->satellites[i].constellation != constellation)
			sky->satellites[kept++] = sky->satellites[i];
	sky->count = kept;
}

static struct gps_satellite *find(struct gps_sky *sky, char constellation, uint16_t number)
{
	for (uint32_t i = 0; i < sky->count; i++)
		if (sky->satellites[i].number == number &&
		    (constellation == 0 || sky->satellites[i].constellation == constellation))
			return &sky->satellites[i];
	return NULL;
}

void gps_sky_add(struct gps_sky *sky, const struct gps_satellite *seen)
{
	struct gps_satellite *known = find(sky, seen->constellation, seen->number);

	if (known == NULL) {
		if (sky->count < GPS_SKY_MAX)
			sky->satellites[sky->count++] = *seen;
		return;
	}
	known->used |= seen->used;
	if (known->snr < seen->snr)
		known->snr = seen->snr;
}

void gps_sky_see(struct gps_sky *sky, const struct nmea_report *report)
{
	if (report->first)
		forget(sky, report->constellation);
	for (unsigned i = 0; i < report->seen_count; i++)
		gps_sky_add(sky, &report->seen[i]);
}

void gps_sky_use(struct gps_sky *sky, const struct nmea_report *report)
{
	for (unsigned i = 0; i < report->used_count; i++) {
		struct gps_satellite *satellite = find(sky, report->constellation, report->used[i]);

		if (satellite != NULL)
			satellite->used = true;
	}
}

void gps_sky_forget_used(struct gps_sky *sky)
{
	for (uint32_t i = 0; i < sky->count; i++)
		sky->satellites[i].used = false;
}
