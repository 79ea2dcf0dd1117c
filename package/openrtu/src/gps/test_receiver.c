/* SPDX-License-Identifier: GPL-3.0-or-later */
/* Sentences in, fixes out; the checksums are put on here. */
#include <setjmp.h>
#include <stdarg.h>
#include <stddef.h>
#include <stdint.h>
#include <stdio.h>
#include <string.h>

#include <cmocka.h>

#include "gps/receiver.h"
#include "map/time_ns.h"

#define SILENCE_NS (200 * NS_PER_MS)
#define BUILT_DAYS 12784 /* 2005-01-01 */

static struct gps_receiver receiver;
static struct gps_fix fix;
static int64_t now_ns;

static int setup(void **state)
{
	(void)state;
	now_ns = 1000 * NS_PER_S;
	gps_receiver_init(&receiver, SILENCE_NS, BUILT_DAYS);
	return 0;
}

static unsigned take_octets(const char *octets)
{
	const uint8_t *at = (const uint8_t *)octets;
	size_t size = strlen(octets);
	unsigned fixes = 0;

	while (gps_receiver_take(&receiver, &at, &size, now_ns, &fix))
		fixes++;
	return fixes;
}

static unsigned take(const char *body)
{
	char text[160];
	unsigned sum = 0;

	for (const char *c = body; *c != 0; c++)
		sum ^= (uint8_t)*c;
	snprintf(text, sizeof(text), "$%s*%02X\r\n", body, sum);
	return take_octets(text);
}

static bool silence(void)
{
	now_ns += SILENCE_NS;
	return gps_receiver_run(&receiver, now_ns, &fix);
}

/* ---- a burst ------------------------------------------------------------------------------- */

/* The first burst of gpsd's recording garmin17n.log. */
static void take_garmin(const char *seconds)
{
	char text[100];

	snprintf(text, sizeof(text), "GPRMC,%s,A,5213.1439,N,02100.6511,E,010.0,226.0,160305,004.2,E,D",
		 seconds);
	take(text);
	snprintf(text, sizeof(text), "GPGGA,%s,5213.1439,N,02100.6511,E,2,10,0.9,137.2,M,36.2,M,,", seconds);
	take(text);
	take("GPGSA,A,3,03,06,15,16,18,19,21,22,,27,29,,1.6,0.9,1.3");
	take("GPGSV,3,2,12,18,50,135,50,19,15,291,46,21,59,069,51,44,30,169,49");
	take("PGRME,1.7,M,2.4,M,3.0,M");
	take("PGRMV,0.0,0.0,-0.5");
	take("PGRMM,WGS 84");
	take("PGRMC,A,218.8,100,6378137.000,298.257223563,0.0,0.0,0.0,A,3,1,1,4,30");
}

static void check_garmin(void)
{
	assert_int_equal(fix.latitude, 522190650);
	assert_int_equal(fix.longitude, 210108517);
	assert_int_equal(fix.altitude_mm, 137200);
	assert_int_equal(fix.geoid_mm, 36200);
	assert_int_equal(fix.speed_mm_s, 5144);
	assert_int_equal(fix.course, 22600);
	assert_int_equal(fix.climb_mm_s, -500);
	assert_int_equal(fix.hdop, 90);
	assert_int_equal(fix.pdop, 160);
	assert_int_equal(fix.vdop, 130);
	assert_int_equal(fix.error_mm, 1700);
	assert_int_equal(fix.error_vertical_mm, 2400);
	assert_int_equal(fix.method, GPS_DIFFERENTIAL);
	assert_int_equal(fix.dimensions, 3);
	assert_int_equal(fix.satellites, 10);
	assert_int_equal(fix.marks, 0);
	assert_int_equal(fix.time_ns, 1110965882 * NS_PER_S); /* 2005-03-16 09:38:02 */
	assert_int_equal(fix.sky.count, 4);
	assert_int_equal(fix.sky.satellites[0].number, 18);
	assert_int_equal(fix.sky.satellites[0].elevation, 50);
	assert_int_equal(fix.sky.satellites[0].azimuth, 135);
	assert_int_equal(fix.sky.satellites[0].snr, 50);
	assert_true(fix.sky.satellites[0].used);
	assert_false(fix.sky.satellites[3].used);
	assert_int_equal(fix.known, (1u << 13) - 1);
}

static void test_a_change_of_time_ends_a_burst(void **state)
{
	(void)state;
	take_garmin("093802");
	assert_int_equal(take("GPGLL,5213.1439,N,02100.6511,E,093803,A,D"), 1);
	check_garmin();
	assert_int_equal(fix.arrival_ns, 1000 * NS_PER_S);
}

static void test_silence_ends_a_burst(void **state)
{
	(void)state;
	assert_int_equal(gps_receiver_deadline(&receiver), INT64_MAX);
	take_garmin("093802");
	assert_int_equal(gps_receiver_deadline(&receiver), now_ns + SILENCE_NS);
	assert_false(gps_receiver_run(&receiver, now_ns + SILENCE_NS - 1, &fix));
	assert_true(silence());
	check_garmin();
	assert_int_equal(gps_receiver_deadline(&receiver), INT64_MAX);
	assert_false(silence());
}

static void test_nothing_of_a_burst_is_in_the_next(void **state)
{
	(void)state;
	take_garmin("093802");
	silence();
	take("GPGLL,5213.1440,N,02100.6512,E,093803,A,A");
	assert_true(silence());
	assert_int_equal(fix.known, GPS_POSITION | GPS_TIME);
	assert_int_equal(fix.hdop, 0);
	assert_int_equal(fix.method, GPS_AUTONOMOUS);
	assert_int_equal(fix.sky.count, 4); /* a view is older than a fix */
	assert_int_equal(fix.time_ns, 1110965883 * NS_PER_S);
}

static void test_a_status_line_anywhere_costs_nothing(void **state)
{
	(void)state;
	take("PGRMT,GPS 17-HVS VER 3.20,P,F,R,R,P,,23,R");
	take_garmin("093802");
	take("PGRMT,GPS 17-HVS VER 3.20,P,F,R,L,P,,23,R");
	assert_true(silence());
	check_garmin();
	assert_int_equal(receiver.burst.faults, GPS_FAULT_RECEIVER | GPS_FAULT_CLOCK);
	assert_int_equal(receiver.line.counters[NMEA_TAKEN], 10);
}

static void test_the_position_with_the_most_digits(void **state)
{
	(void)state;
	take("GPRMC,120000,A,5213.14,N,02100.65,E,,,160305,,");
	take("GPGGA,120000,5213.14391,N,02100.65112,E,1,05,1.0,,M,,M,,");
	take("GPGLL,5213.143,N,02100.651,E,120000,A");
	assert_true(silence());
	assert_int_equal(fix.latitude, 522190652);
	assert_int_equal(fix.longitude, 210108520);
	assert_int_equal(fix.marks, 0);
}

static void test_two_places_at_one_time(void **state)
{
	(void)state;
	take("GPRMC,120000,A,5213.1439,N,02100.6511,E,,,160305,,");
	take("GPGGA,120000,5213.1839,N,02100.6511,E,1,05,1.0,,M,,M,,");
	assert_true(silence());
	assert_int_equal(fix.marks, GPS_CONTRADICTS);
	take("GPRMC,120001,A,1700.0000,S,17959.9999,E,,,160305,,");
	take("GPGGA,120001,1700.0000,S,17959.9999,W,1,05,1.0,,M,,M,,"); /* 0.35 m on, on Fiji */
	assert_true(silence());
	assert_int_equal(fix.marks, 0);
}

/* ---- one moment ------------------------------------------------------------------------------ */

/* A receiver whose RMC is of 10 to 20 ms behind its GGA; others have GLL as much ahead. */
static void test_sentences_some_milliseconds_apart_are_one_fix(void **state)
{
	(void)state;
	take("GPGLL,5213.1439,N,02100.6511,E,115959.997,A");
	take("GPGGA,120000.00,5213.1439,N,02100.6511,E,1,05,1.0,137.2,M,,M,,");
	assert_int_equal(take("GPRMC,120000.02,A,5213.1439,N,02100.6511,E,010.0,226.0,160305,,,A"), 0);
	assert_true(silence());
	assert_int_equal(fix.altitude_mm, 137200);
	assert_int_equal(fix.speed_mm_s, 5144);
	assert_int_equal(fix.time_ns, 1110974400 * NS_PER_S); /* of the sentence that the place is of */
}

static void test_one_fix_around_midnight(void **state)
{
	(void)state;
	take("GPGGA,235959.99,5213.1439,N,02100.6511,E,1,05,1.0,137.2,M,,M,,");
	assert_int_equal(take("GPRMC,000000.00,A,5213.1439,N,02100.6511,E,,,170305,,,A"), 0);
	assert_true(silence());
	assert_int_equal(fix.time_ns, 1111017600 * NS_PER_S - 10 * NS_PER_MS);
	take("GPRMC,000000.99,A,5213.1439,N,02100.6511,E,,,170305,,,A");
	assert_int_equal(take("GPGGA,000001.00,5213.1439,N,02100.6511,E,1,05,1.0,137.2,M,,M,,"), 0);
	assert_true(silence());
	assert_int_equal(fix.time_ns, 1111017601 * NS_PER_S);
}

static void test_fixes_that_follow_fast(void **state)
{
	static const char *const periods[] = {"040", "100", "200"}; /* 25, 10, 5 Hz */

	(void)state;
	for (size_t i = 0; i < sizeof(periods) / sizeof(periods[0]); i++) {
		char gga[100], rmc[100];

		setup(NULL);
		snprintf(gga, sizeof(gga), "GPGGA,120000.%s,5213.1439,N,02100.6511,E,1,05,1.0,1.0,M,,M,,",
			 periods[i]);
		snprintf(rmc, sizeof(rmc), "GPRMC,120000.%s,A,5213.1439,N,02100.6511,E,,,160305,,,A",
			 periods[i]);
		take("GPGGA,120000.000,5213.1439,N,02100.6511,E,1,05,1.0,1.0,M,,M,,");
		take("GPRMC,120000.000,A,5213.1439,N,02100.6511,E,,,160305,,,A");
		assert_int_equal(take(gga), 1);
		assert_int_equal(take(rmc), 0);
		assert_true(silence());
	}
}

static void test_another_datum(void **state)
{
	(void)state;
	take("PGRMM,TOKYO");
	take("GPGLL,3540.0000,N,13945.0000,E,120000,A");
	assert_true(silence());
	assert_int_equal(fix.marks, GPS_DATUM);
	take("PGRMM,WGS 84");
	take("GPGLL,3540.0000,N,13945.0000,E,120001,A");
	assert_true(silence());
	assert_int_equal(fix.marks, 0);
}

/* ---- no fix -------------------------------------------------------------------------------- */

static void test_no_fix(void **state)
{
	static const char *const sentences[] = {
	    "GPRMC,120000,V,5213.1439,N,02100.6511,E,1.0,2.0,160305,,",
	    "GPGGA,120000,5213.1439,N,02100.6511,E,0,00,1.0,1.0,M,1.0,M,,",
	    "GPGGA,120000,5213.1439,N,02100.6511,E,1,00,1.0,1.0,M,1.0,M,,", /* of no satellite */
	    "GPGGA,120000,5213.1439,N,02100.6511,E,,05,1.0,1.0,M,1.0,M,,",
	    "GPGLL,5213.1439,N,02100.6511,E,120000,V",
	    "GPGLL,5213.1439,N,02100.6511,E,120000,A,N",
	    "GPGLL,,,,,120000,A",
	    "GPRMC,,V,,,,,,,,,,N",
	    "GPRMC,120000,A,0000.0000,N,00000.0000,E,0.0,0.0,160305,,,A", /* nowhere */
	    "GPGGA,120000,0000.0,S,00000.0,W,1,07,1.0,17.0,M,17.0,M,,",
	    "GNGNS,120000,0000.0,S,00000.0,W,AA,07,1.0,17.0,17.0,,",
	    "PGRMF,290,293895,160305,120000,13,0000.0000,N,00000.0000,E,A,2,0,226,2,1",
	    "PGRMF,290,293895,160305,120000,13,5213.1439,N,02100.6511,E,A,0,0,226,2,1",
	};

	(void)state;
	for (size_t i = 0; i < sizeof(sentences) / sizeof(sentences[0]); i++) {
		setup(NULL);
		take(sentences[i]);
		assert_true(silence());
		assert_int_equal(fix.known & ~GPS_SATELLITES, 0);
		assert_int_equal(fix.latitude, 0);
		assert_int_equal(fix.method, GPS_NO_FIX);
		assert_int_equal(fix.time_ns, 0);
	}
}

static void test_a_place_near_0_degrees_is_one(void **state)
{
	(void)state;
	take("GPGLL,0000.0000,N,00000.0001,W,120000,A");
	assert_true(silence());
	assert_int_equal(fix.known & GPS_POSITION, GPS_POSITION);
	take("GPGLL,0000.0000,N,02100.6511,E,120001,A");
	assert_true(silence());
	assert_int_equal(fix.known & GPS_POSITION, GPS_POSITION);
}

static void test_one_sentence_denies_what_others_say(void **state)
{
	(void)state;
	take_garmin("093802");
	take("GPGLL,5213.1439,N,02100.6511,E,093802,V");
	assert_true(silence());
	assert_int_equal(fix.known & GPS_POSITION, 0);
}

/* ---- a fix out of 0 satellites --------------------------------------------------------------- */

/* A receiver of which GGA never counts a satellite; GNS and two GSA do. */
static void test_satellites_that_others_count(void **state)
{
	(void)state;
	take("GNRMC,120200.00,A,5957.0062,N,01100.6429,E,0.00,0.00,310726,,,D,V");
	take("GNGNS,120200.00,5957.0062,N,01100.6429,E,NDD,11,1.3,168.9,39.5,,,V");
	take("GNGGA,120200.00,5957.0062,N,01100.6429,E,2,00,1.3,168.9,M,39.5,M,,");
	take("GNGSA,A,3,68,69,70,78,84,85,,,,,,,1.5,1.3,1.0,2");
	take("GNGSA,A,3,04,05,09,11,36,,,,,,,,1.5,1.3,1.0,3");
	assert_true(silence());
	assert_int_equal(fix.latitude, 599501033);
	assert_int_equal(fix.method, GPS_DIFFERENTIAL);
	assert_int_equal(fix.altitude_mm, 168900);
	assert_int_equal(fix.satellites, 11);
	assert_true(fix.known & GPS_SATELLITES);
}

static void test_gsa_vouches_for_a_gga_without_satellites(void **state)
{
	(void)state;
	take("GPGGA,120326,4221.3871,N,01322.0800,E,1,00,3.1,746.1,M,44.2,M,,");
	take("GPGSA,A,2,01,03,,14,,,,,,,,,3.1,3.1,");
	assert_true(silence());
	assert_true(fix.known & GPS_POSITION);
	assert_int_equal(fix.satellites, 3);
}

/* A converter writes 00 where it does not know the number. */
static void test_nobody_counts_satellites(void **state)
{
	(void)state;
	take("GPGGA,120000,5213.1439,N,02100.6511,E,1,00,1.0,1.0,M,1.0,M,,");
	take("GPRMC,120000,A,5213.1439,N,02100.6511,E,1.0,2.0,160305,,,A");
	assert_true(silence());
	assert_true(fix.known & GPS_POSITION);
	assert_false(fix.known & GPS_SATELLITES);
}

/* Indoors, a receiver goes on with the last place for a while. */
static void test_gsa_names_none_of_the_0_satellites(void **state)
{
	(void)state;
	take("GPRMC,200010,A,5504.4344,N,01025.5385,E,0.0,0.0,260810,1.0,E,D");
	take("GPGGA,200010,5504.4344,N,01025.5385,E,2,00,2.5,-9.1,M,43.9,M,,");
	take("GPGSA,A,2,,,,,,,,,,,,,2.7,2.5,1.0");
	take("GPGLL,5504.4344,N,01025.5385,E,200010,A,D");
	assert_true(silence());
	assert_int_equal(fix.known, GPS_SATELLITES);
	assert_int_equal(fix.satellites, 0);
}

static void test_gns(void **state)
{
	static const struct {
		const char *modes;
		uint8_t method;
	} cases[] = {{"A", GPS_AUTONOMOUS}, {"NAD", GPS_DIFFERENTIAL}, {"RRN", GPS_RTK},
		     {"RF", GPS_RTK_FLOAT}, {"AE", GPS_ESTIMATED},     {"NN", GPS_NO_FIX}};

	(void)state;
	for (size_t i = 0; i < sizeof(cases) / sizeof(cases[0]); i++) {
		char text[100];

		snprintf(text, sizeof(text), "GNGNS,120000,5213.1439,N,02100.6511,E,%s,13,0.9,25.6,11.2,,",
			 cases[i].modes);
		take(text);
		take("GPGNS,120000,,,,,,08,,,,1.0,23"); /* of one constellation: says nothing of the fix */
		take("GLGNS,120000,,,,,,05,,,,1.0,23");
		assert_true(silence());
		assert_int_equal(fix.method, cases[i].method);
		assert_int_equal(fix.satellites, 13);
		assert_int_equal((fix.known & GPS_ALTITUDE) != 0, cases[i].method != GPS_NO_FIX);
	}
}

static void test_a_fix_lost_is_not_the_one_before(void **state)
{
	(void)state;
	take_garmin("093802");
	assert_int_equal(take("GPRMC,,V,,,,,,,,,,N"), 1);
	check_garmin();
	assert_true(silence());
	assert_int_equal(fix.known, 0);
	assert_int_equal(fix.day_ms, -1);
}

static void test_dead_reckoning(void **state)
{
	(void)state;
	take("GPGGA,120000,5213.1439,N,02100.6511,E,1,05,1.0,1.0,M,1.0,M,,");
	take("GPRMC,120000,A,5213.1439,N,02100.6511,E,1.0,2.0,160305,,,E");
	assert_true(silence());
	assert_int_equal(fix.method, GPS_ESTIMATED);
}

static void test_a_time_alone_is_no_fix(void **state)
{
	(void)state;
	take("GPGGA,235959,5213.1439,N,02100.6511,E,1,05,1.0,1.0,M,1.0,M,,");
	assert_int_equal(take("GPZDA,000001,17,03,2005,00,00"), 1); /* a second ahead, as of one receiver */
	assert_int_equal(fix.known & GPS_TIME, 0);
	assert_int_equal(take("GPGGA,000000,5213.1439,N,02100.6511,E,1,05,1.0,1.0,M,1.0,M,,"), 0);
	assert_true(silence());
	assert_int_equal(fix.time_ns, 1111017600 * NS_PER_S); /* 2005-03-17 00:00:00 */
}

static void test_silence_after_a_time_alone(void **state)
{
	(void)state;
	take("GPZDA,120000,16,03,2005,00,00");
	assert_false(silence());
	assert_int_equal(gps_receiver_deadline(&receiver), INT64_MAX);
	take("GPGLL,5213.1439,N,02100.6511,E,120001,A");
	assert_true(silence());
	assert_int_equal(fix.time_ns, 1110974401 * NS_PER_S); /* its date counts */
}

/* ---- dates --------------------------------------------------------------------------------- */

static void test_midnight_without_a_date(void **state)
{
	(void)state;
	take("GPRMC,235959,A,5213.1439,N,02100.6511,E,,,160305,,");
	take("GPGLL,5213.1439,N,02100.6511,E,000000,A");
	assert_true(silence());
	assert_int_equal(fix.time_ns, 1111017600 * NS_PER_S);
}

static void test_a_week_that_rolled_over(void **state)
{
	(void)state;
	take("GPRMC,120000,A,5213.1439,N,02100.6511,E,,,310785,,");
	assert_true(silence());
	assert_int_equal(fix.time_ns,
			 1110974400 * NS_PER_S); /* 1985-07-31 is 1 024 weeks before 2005-03-16 */
	assert_int_equal(receiver.burst.calendar.corrected, 1);
	take("GPRMC,120001,A,5213.1439,N,02100.6511,E,,,010105,,");
	assert_true(silence());
	assert_int_equal(receiver.burst.calendar.corrected, 1);
	assert_int_equal(receiver.burst.calendar.refused, 0);
}

static void test_a_date_that_is_not_believed(void **state)
{
	(void)state;
	take("GPRMC,120000,A,5213.1439,N,02100.6511,E,,,160305,,");
	assert_true(silence());
	assert_true(fix.known & GPS_TIME);
	take("GPRMC,000012,A,5213.1439,N,02100.6511,E,,,060180,,"); /* the receiver was switched off and on */
	assert_true(silence());
	assert_int_equal(fix.known, GPS_POSITION);
	assert_int_equal(fix.time_ns, 0);
	take("GPGLL,5213.1439,N,02100.6511,E,000013,A"); /* nor is the day of before */
	assert_true(silence());
	assert_int_equal(fix.known, GPS_POSITION);
	assert_int_equal(receiver.burst.calendar.refused, 1);
	take("GPRMC,120030,A,5213.1439,N,02100.6511,E,,,160305,,");
	assert_true(silence());
	assert_true(fix.known & GPS_TIME);
}

/* ---- what is refused ----------------------------------------------------------------------- */

static void test_impossible_fields(void **state)
{
	static const char *const sentences[] = {
	    "GPGLL,9000.0001,N,02100.6511,E,120000,A",
	    "GPGLL,5260.0000,N,02100.6511,E,120000,A",
	    "GPGLL,5213.1439,X,02100.6511,E,120000,A",
	    "GPGLL,5213.1439,,02100.6511,E,120000,A",
	    "GPGLL,5213.1439,N,18000.0001,E,120000,A",
	    "GPGLL,5213.1439,N,,,120000,A",
	    "GPGLL,5213.14x9,N,02100.6511,E,120000,A",
	    "GPGLL,-213.1439,N,02100.6511,E,120000,A",
	    "GPGLL,52-3.1439,N,02100.6511,E,120000,A",
	    "GPGLL,5213.1439,N,02100.6511,E,240000,A",
	    "GPGLL,5213.1439,N,02100.6511,E,126000,A",
	    "GPGLL,5213.1439,N,02100.6511,E,120061,A",
	    "GPGLL,5213.1439,N,02100.6511,E,1200,A",
	    "GPGLL,5213.1439,N,02100.6511,E,12 000,A",
	    "GPGLL,5213.1439,N,02100.6511,E,120000,AA",
	    "GPGLL,52,N,02100.6511,E,120000,A",
	    "GPGLL,5213.1439,N,1032.5,E,120000,A", /* of 10 degrees, without its 0: not of 103 */
	    "GPGLL,526.5,N,02100.6511,E,120000,A",
	    "GPGLL,05213.1439,N,02100.6511,E,120000,A",
	    "GPGLL,52.2190,N,021.0108,E,120000,A",
	    "GPGLL,526,N,02100.6511,E,120000,A",
	    "GPRMC,120000,A,5213.1439,N,02100.6511,E,,,290205,,",
	    "GPRMC,120000,A,5213.1439,N,02100.6511,E,,,1603,,",
	    "GPRMC,120000,A,5213.1439,N,02100.6511,E,-1,,160305,,",
	    "GPRMC,120000,A,5213.1439,N,02100.6511,E,,361,160305,,",
	    "GPGGA,120000,5213.1439,N,02100.6511,E,9,05,1.0,1.0,M,1.0,M,,",
	    "GPGGA,120000,5213.1439,N,02100.6511,E,1,05,1.0,1.0.0,M,1.0,M,,",
	    "GPZDA,120000,31,02,2005,,",
	    "GPGSV,1,1,01,03,91,100,30",
	    "GPGSA,A,4,03,06,15,16,18,19,21,22,,27,29,,1.6,0.9,1.3",
	};
	const size_t count = sizeof(sentences) / sizeof(sentences[0]);

	(void)state;
	for (size_t i = 0; i < count; i++)
		take(sentences[i]);
	assert_int_equal(receiver.line.counters[NMEA_DAMAGED], count);
	assert_false(silence());
}

static void test_what_we_do_not_read(void **state)
{
	(void)state;
	take("GPRMB,A,,,,,,,,,,,,V");
	take("PUBX,00,1");
	take("PGRMZ,125,f,3");
	take("PGGGA,1");
	take("G");
	assert_int_equal(receiver.line.counters[NMEA_UNKNOWN], 5);
	assert_int_equal(receiver.line.counters[NMEA_DAMAGED], 0);
}

static void test_the_ends_of_the_earth(void **state)
{
	(void)state;
	take("GNGLL,9000.0000,S,18000.0000,W,235960,A");
	assert_true(silence());
	assert_int_equal(fix.latitude, -900000000);
	assert_int_equal(fix.longitude, -1800000000);
	assert_int_equal(fix.day_ms, 86400000); /* a leap second */
}

/* ---- satellites ---------------------------------------------------------------------------- */

static void test_two_constellations(void **state)
{
	(void)state;
	take("GPGSV,2,1,05,01,10,020,30,02,10,020,30,03,10,020,30,04,10,020,30,1");
	take("GPGSV,2,2,05,05,10,020,30,1");
	take("GLGSV,1,1,01,01,10,020,31,1");
	take("GPGSV,1,1,01,01,10,020,40,8"); /* on a second signal, and the only one of its row */
	take("GNGSA,A,3,01,,,,,,,,,,,,1.6,0.9,1.3,2");
	take("GNGLL,5213.1439,N,02100.6511,E,120000,A");
	assert_true(silence());
	assert_int_equal(fix.sky.count, 2);
	assert_int_equal(fix.sky.satellites[0].constellation, 'L');
	assert_true(fix.sky.satellites[0].used);
	assert_int_equal(fix.sky.satellites[1].constellation, 'P');
	assert_int_equal(fix.sky.satellites[1].snr, 40);
	assert_false(fix.sky.satellites[1].used);
}

static void test_more_satellites_than_there_is_room(void **state)
{
	char text[64];

	(void)state;
	for (int i = 1; i < 2 * GPS_SKY_MAX; i++) {
		snprintf(text, sizeof(text), "GPGSV,200,%d,200,%d,10,020,30", i + 1, i);
		take(text);
	}
	take("GPGLL,5213.1439,N,02100.6511,E,120000,A");
	assert_true(silence());
	assert_int_equal(fix.sky.count, GPS_SKY_MAX);
}

/* ---- time on the line ---------------------------------------------------------------------- */

static void test_how_long_a_burst_takes(void **state)
{
	(void)state;
	/* 13 lines of 750 octets, as a burst of 1.56 s at 4 800 bit/s has */
	assert_int_equal(gps_burst_time_ns(750, 4800), 1562500000);
	assert_int_equal(gps_burst_time_ns(750, 9600), 781250000);
	assert_int_equal(gps_burst_time_ns(UINT32_MAX / 16, 115200),
			 (int64_t)(UINT32_MAX / 16) * 10 * NS_PER_S / 115200);
}

int main(void)
{
	const struct CMUnitTest tests[] = {
	    cmocka_unit_test_setup(test_a_change_of_time_ends_a_burst, setup),
	    cmocka_unit_test_setup(test_silence_ends_a_burst, setup),
	    cmocka_unit_test_setup(test_nothing_of_a_burst_is_in_the_next, setup),
	    cmocka_unit_test_setup(test_a_status_line_anywhere_costs_nothing, setup),
	    cmocka_unit_test_setup(test_the_position_with_the_most_digits, setup),
	    cmocka_unit_test_setup(test_two_places_at_one_time, setup),
	    cmocka_unit_test_setup(test_sentences_some_milliseconds_apart_are_one_fix, setup),
	    cmocka_unit_test_setup(test_one_fix_around_midnight, setup),
	    cmocka_unit_test_setup(test_fixes_that_follow_fast, setup),
	    cmocka_unit_test_setup(test_another_datum, setup),
	    cmocka_unit_test_setup(test_no_fix, setup),
	    cmocka_unit_test_setup(test_a_place_near_0_degrees_is_one, setup),
	    cmocka_unit_test_setup(test_one_sentence_denies_what_others_say, setup),
	    cmocka_unit_test_setup(test_satellites_that_others_count, setup),
	    cmocka_unit_test_setup(test_gsa_vouches_for_a_gga_without_satellites, setup),
	    cmocka_unit_test_setup(test_nobody_counts_satellites, setup),
	    cmocka_unit_test_setup(test_gsa_names_none_of_the_0_satellites, setup),
	    cmocka_unit_test_setup(test_gns, setup),
	    cmocka_unit_test_setup(test_a_fix_lost_is_not_the_one_before, setup),
	    cmocka_unit_test_setup(test_dead_reckoning, setup),
	    cmocka_unit_test_setup(test_a_time_alone_is_no_fix, setup),
	    cmocka_unit_test_setup(test_silence_after_a_time_alone, setup),
	    cmocka_unit_test_setup(test_midnight_without_a_date, setup),
	    cmocka_unit_test_setup(test_a_week_that_rolled_over, setup),
	    cmocka_unit_test_setup(test_a_date_that_is_not_believed, setup),
	    cmocka_unit_test_setup(test_impossible_fields, setup),
	    cmocka_unit_test_setup(test_what_we_do_not_read, setup),
	    cmocka_unit_test_setup(test_the_ends_of_the_earth, setup),
	    cmocka_unit_test_setup(test_two_constellations, setup),
	    cmocka_unit_test_setup(test_more_satellites_than_there_is_room, setup),
	    cmocka_unit_test_setup(test_how_long_a_burst_takes, setup),
	};
	return cmocka_run_group_tests_name("gps receiver", tests, NULL, NULL);
}
