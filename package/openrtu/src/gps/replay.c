/* SPDX-License-Identifier: GPL-3.0-or-later */
/*
 * For the tests: recordings in, fixes out. A recording is a line with its number of octets, and the octets; each begins with
 * a new receiver. Each fix is a line of JSON, and so is what was counted, after the last.
 *
 *	gps-replay nmea|gpsd BUILT_DAYS < recordings
 *	gps-replay distance 0 < "latitude longitude latitude longitude" in 1e-7 degree; prints mm
 */
#include <inttypes.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

#include "gps/gpsd.h"
#include "gps/receiver.h"
#include "gps/sphere.h"

#define RECORDING_MAX (4 << 20)
#define PER_OCTET_NS  2083333 /* 4800 bit/s */
#define SILENCE_NS    200000000

static void print_fix(const struct gps_fix *fix)
{
	printf("{\"day_ms\": %d, \"known\": %u, \"marks\": %u, \"method\": %u, \"dimensions\": %u, "
	       "\"latitude\": %d, "
	       "\"longitude\": %d, \"altitude_mm\": %d, \"speed_mm_s\": %d, \"course\": %u, \"hdop\": %u, "
	       "\"error_mm\": %d, \"satellites\": %u, \"time_ns\": %" PRId64 ", \"sky\": [",
	       fix->day_ms, fix->known, fix->marks, fix->method, fix->dimensions, fix->latitude,
	       fix->longitude, fix->altitude_mm, fix->speed_mm_s, fix->course, fix->hdop, fix->error_mm,
	       fix->satellites, fix->time_ns);
	for (uint32_t i = 0; i < fix->sky.count; i++) {
		const struct gps_satellite *satellite = &fix->sky.satellites[i];

		printf("%s[\"%c\", %u, %d, %u, %u, %d]", i > 0 ? ", " : "", satellite->constellation,
		       satellite->number, satellite->elevation, satellite->azimuth, satellite->snr,
		       satellite->used);
	}
	printf("]}\n");
}

static void print_counters(const uint32_t *counters, const struct gps_calendar *calendar)
{
	printf("{\"taken\": %u, \"damaged\": %u, \"unknown\": %u, \"stray\": %u, \"corrected\": %u, "
	       "\"refused\": %u}\n",
	       counters[NMEA_TAKEN], counters[NMEA_DAMAGED], counters[NMEA_UNKNOWN], counters[NMEA_STRAY],
	       calendar->corrected, calendar->refused);
}

static void replay_nmea(const uint8_t *bytes, size_t size, int32_t built_days)
{
	static struct gps_receiver receiver;
	struct gps_fix fix;
	int64_t now_ns = 0;

	gps_receiver_init(&receiver, SILENCE_NS, built_days);
	for (const uint8_t *end = bytes + size; bytes < end; now_ns += PER_OCTET_NS) {
		size_t one = 1;

		if (gps_receiver_take(&receiver, &bytes, &one, now_ns, &fix))
			print_fix(&fix);
	}
	if (gps_receiver_run(&receiver, now_ns + SILENCE_NS, &fix))
		print_fix(&fix);
	print_counters(receiver.line.counters, &receiver.burst.calendar);
}

static void replay_gpsd(const uint8_t *bytes, size_t size, int32_t built_days)
{
	static struct gpsd_reader reader;
	struct gps_fix fix;
	int64_t now_ns = 0;

	gpsd_reader_init(&reader, "", built_days);
	while (gpsd_reader_take(&reader, &bytes, &size, now_ns++, &fix))
		print_fix(&fix);
	print_counters(reader.counters, &reader.calendar);
}

static int print_distances(void)
{
	int32_t a, b, c, d;

	while (scanf("%" SCNd32 " %" SCNd32 " %" SCNd32 " %" SCNd32, &a, &b, &c, &d) == 4)
		printf("%" PRId64 "\n", gps_distance_mm(a, b, c, d));
	return 0;
}

int main(int argc, char **argv)
{
	static uint8_t bytes[RECORDING_MAX];
	unsigned long size;
	int32_t built_days;

	if (argc != 3)
		return 2;
	built_days = (int32_t)strtol(argv[2], NULL, 10);
	if (strcmp(argv[1], "distance") == 0)
		return print_distances();
	while (scanf("%lu", &size) == 1) {
		if (getchar() != '\n' || size > sizeof(bytes) || fread(bytes, 1, size, stdin) != size)
			return 2;
		if (strcmp(argv[1], "gpsd") == 0)
			replay_gpsd(bytes, size, built_days);
		else
			replay_nmea(bytes, size, built_days);
	}
	return 0;
}
