/* SPDX-License-Identifier: GPL-3.0-or-later */
#include <setjmp.h>
#include <stdarg.h>
#include <stddef.h>
#include <stdint.h>
#include <stdio.h>
#include <string.h>

#include <cmocka.h>

#include "gps/gpsd.h"
#include "map/time_ns.h"

#define TPV                                                                                                  \
	"{\"class\":\"TPV\",\"status\":2,\"mode\":3,\"time\":\"2005-03-16T09:38:03.250Z\",\"lat\":-52."      \
	"219065000,"                                                                                         \
	"\"lon\":21.010851667,\"altMSL\":137.2000,\"track\":226.0000,\"speed\":1.234,\"eph\":4.275}\n"
#define SKY                                                                                                  \
	"{\"class\":\"SKY\",\"hdop\":0.90,\"satellites\":[{\"PRN\":18,\"el\":50.0,\"az\":135.0,\"ss\":50.0," \
	"\"used\":true,\"gnssid\":0},{\"PRN\":65,\"el\":-1.4,\"az\":360.0,\"used\":null,\"gnssid\":6}]}\n"

#define BUILT_DAYS 12784 /* 2005-01-01 */

static struct gpsd_reader reader;
static struct gps_fix fix;
static int64_t now_ns;

static int setup(void **state)
{
	(void)state;
	now_ns = 7;
	gpsd_reader_init(&reader, "", BUILT_DAYS);
	return 0;
}

static unsigned take_octets(const char *octets, size_t size)
{
	const uint8_t *at = (const uint8_t *)octets;
	unsigned fixes = 0;

	while (gpsd_reader_take(&reader, &at, &size, now_ns, &fix))
		fixes++;
	return fixes;
}

static unsigned take(const char *text)
{
	return take_octets(text, strlen(text));
}

static void test_a_fix(void **state)
{
	(void)state;
	assert_int_equal(take(SKY TPV), 1);
	assert_int_equal(fix.latitude, -522190650);
	assert_int_equal(fix.longitude, 210108517);
	assert_int_equal(fix.altitude_mm, 137200);
	assert_int_equal(fix.speed_mm_s, 1234);
	assert_int_equal(fix.course, 22600);
	assert_int_equal(fix.error_mm, 4275);
	assert_int_equal(fix.hdop, 90);
	assert_int_equal(fix.method, GPS_DIFFERENTIAL);
	assert_int_equal(fix.dimensions, 3);
	assert_int_equal(fix.satellites, 1);
	assert_int_equal(fix.arrival_ns, 7);
	assert_int_equal(fix.time_ns, 1110965883250 * NS_PER_MS);
	assert_int_equal(fix.known, GPS_POSITION | GPS_TIME | GPS_ALTITUDE | GPS_SPEED | GPS_COURSE |
					GPS_ERROR | GPS_HDOP | GPS_SATELLITES);
	assert_int_equal(fix.sky.count, 2);
	assert_true(fix.sky.satellites[0].used);
	assert_int_equal(fix.sky.satellites[0].snr, 50);
	assert_int_equal(fix.sky.satellites[1].constellation, 'L');
	assert_int_equal(fix.sky.satellites[1].azimuth, 0);
}

/* A receiver of three bands: gpsd says each satellite once for each of its signals, in lines of 12 kB. */
static void test_a_satellite_on_several_signals(void **state)
{
	char line[14000] = "{\"class\":\"SKY\",\"uSat\":200,\"satellites\":[";
	size_t size = strlen(line);

	(void)state;
	for (int i = 0; i < 200; i++)
		size += (size_t)snprintf(line + size, sizeof(line) - size,
					 "%s{\"PRN\":%d,\"gnssid\":0,\"sigid\":%d,\"ss\":%d,\"used\":%s}",
					 i > 0 ? "," : "", i / 10, i % 10, 20 + i % 10,
					 i % 20 == 0 ? "true" : "false");
	snprintf(line + size, sizeof(line) - size, "]}\n");
	assert_in_range(strlen(line), 10241, sizeof(line) - 1);
	take(line);
	assert_int_equal(reader.counters[NMEA_DAMAGED], 0);
	take(TPV);
	assert_int_equal(fix.sky.count, 20);
	assert_int_equal(fix.sky.satellites[0].snr, 29);
	assert_true(fix.sky.satellites[0].used);
	assert_false(fix.sky.satellites[1].used);
	assert_int_equal(fix.satellites, 10);
}

static void test_octet_by_octet(void **state)
{
	static const char text[] = SKY TPV;
	unsigned fixes = 0;

	(void)state;
	for (size_t i = 0; i < sizeof(text) - 1; i++)
		fixes += take_octets(text + i, 1);
	assert_int_equal(fixes, 1);
	assert_int_equal(fix.latitude, -522190650);
}

static void test_no_fix(void **state)
{
	(void)state;
	assert_int_equal(take("{\"class\":\"TPV\",\"mode\":1,\"lat\":1.0,\"lon\":2.0}\n"), 1);
	assert_int_equal(fix.known, 0);
	assert_int_equal(fix.latitude, 0);
	assert_int_equal(take("{\"class\":\"TPV\",\"mode\":3,\"lat\":0.0,\"lon\":-0.0}\n"), 1); /* nowhere */
	assert_int_equal(fix.known & GPS_POSITION, 0);
	assert_int_equal(take("{\"class\":\"TPV\",\"mode\":3,\"lat\":1.0}\n"), 1);
	assert_int_equal(fix.known, 0);
	assert_int_equal(take("{\"class\":\"TPV\"}\n"), 1);
	assert_int_equal(fix.known, 0);
}

static void test_a_date_that_is_not_believed(void **state)
{
	(void)state;
	assert_int_equal(
	    take("{\"class\":\"TPV\",\"mode\":3,\"time\":\"1980-01-06T00:00:12.000Z\",\"lat\":1.0,"
		 "\"lon\":2.0}\n"),
	    1);
	assert_int_equal(fix.known, GPS_POSITION);
	assert_int_equal(fix.time_ns, 0);
	assert_int_equal(reader.calendar.refused, 1);
}

static void test_other_classes(void **state)
{
	(void)state;
	assert_int_equal(
	    take("{\"class\":\"VERSION\",\"release\":\"3.22\",\"proto_major\":3}\r\n"
		 "{\"class\":\"DEVICES\",\"devices\":[{\"path\":\"/dev/ttyS1\",\"a\":[[1],{}]}]}\n{}\n\n"),
	    0);
	assert_int_equal(reader.counters[NMEA_UNKNOWN], 3);
	assert_int_equal(reader.counters[NMEA_DAMAGED], 0);
}

static void test_what_is_no_json(void **state)
{
	static const char *const lines[] = {
	    "{\"class\":\"TPV\",\"mode\":3,\"lat\":1.0,\"lon\":2.0",
	    "{\"class\":\"TPV\",\"mode\":3,\"lat\":1.0,\"lon\":2.0}}",
	    "{\"class\":\"TPV\",\"mode\":3,\"lat\":01.0,\"lon\":2.0}",
	    "{\"class\":\"TPV\",\"mode\":3,\"lat\":1.,\"lon\":2.0}",
	    "{\"class\":\"TPV\",\"mode\":3,\"lat\":.1,\"lon\":2.0}",
	    "{\"class\":\"TPV\",\"mode\":3,\"lat\":+1.0,\"lon\":2.0}",
	    "{\"class\":\"TPV\",\"mode\":3,\"lat\":1.0 \"lon\":2.0}",
	    "{\"class\":\"TPV\",\"mode\":3,\"lat\":1.0,,\"lon\":2.0}",
	    "{\"class\":\"TPV\",\"mode\":3,\"lat\":1.0,\"lon\":2.0,}",
	    "{\"class\":\"TPV\",\"mode\":3,\"lat\":tru,\"lon\":2.0}",
	    "{\"class\":\"TPV\",\"mode\":3,\"lat\",\"lon\":2.0}",
	    "{\"class\":\"TPV\",\"mode\":3,\"x\":\"\\x\"}",
	    "{\"class\":\"TPV\",\"mode\":3,\"x\":\"\\u12g4\"}",
	    "{\"class\":\"TPV\",\"mode\":3,\"x\":[1}}",
	    "{\"class\":\"TPV\",\"mode\":3,\"x\":[1,]}",
	    "{\"class\":\"TPV\",\"mode\":3,\"x\":\"\x01\"}",
	    "[]",
	    "1",
	    "{",
	    "{1:2}",
	    "{\"x\":[[[[[[[[1]]]]]]]]}",
	};
	const size_t count = sizeof(lines) / sizeof(lines[0]);

	(void)state;
	for (size_t i = 0; i < count; i++) {
		assert_int_equal(take(lines[i]) + take("\n"), 0);
		assert_int_equal(reader.counters[NMEA_DAMAGED], i + 1);
	}
	assert_int_equal(take(TPV), 1);
}

static void test_values_that_cannot_be(void **state)
{
	static const char *const lines[] = {
	    "{\"class\":\"TPV\",\"mode\":3,\"lat\":90.0000001,\"lon\":2.0}\n",
	    "{\"class\":\"TPV\",\"mode\":3,\"lat\":1.0,\"lon\":-181}\n",
	    "{\"class\":\"TPV\",\"mode\":3,\"lat\":1e0,\"lon\":2.0}\n", /* gpsd writes no exponents */
	    "{\"class\":\"TPV\",\"mode\":3,\"lat\":\"1\",\"lon\":2.0}\n",
	    "{\"class\":\"TPV\",\"mode\":4,\"lat\":1.0,\"lon\":2.0}\n",
	    "{\"class\":\"TPV\",\"mode\":3,\"time\":\"2005-02-29T09:38:03.250Z\"}\n",
	    "{\"class\":\"TPV\",\"mode\":3,\"time\":\"2005-02-28T09:38:61.250Z\"}\n",
	    "{\"class\":\"TPV\",\"mode\":3,\"time\":\"2005-02-28T09:38:-1Z\"}\n",
	    "{\"class\":\"TPV\",\"mode\":3,\"time\":\"2005-02-28T09:38Z\"}\n",
	    "{\"class\":\"TPV\",\"mode\":3,\"time\":12}\n",
	    "{\"class\":\"TPV\",\"mode\":3,\"lat\":99999999999999999999999,\"lon\":2.0}\n",
	    "{\"class\":7}\n",
	};
	const size_t count = sizeof(lines) / sizeof(lines[0]);

	(void)state;
	for (size_t i = 0; i < count; i++)
		assert_int_equal(take(lines[i]), 0);
	assert_int_equal(reader.counters[NMEA_DAMAGED], count);
}

static void test_a_line_that_does_not_end(void **state)
{
	(void)state;
	for (int i = 0; i < GPSD_LINE_MAX; i++)
		take(" ");
	assert_int_equal(take(TPV), 0);
	assert_int_equal(reader.counters[NMEA_DAMAGED], 1);
	assert_int_equal(take(TPV), 1);
}

/* As gpsd tells of two receivers in turn. */
#define OF(device, mode, latitude)                                                                           \
	"{\"class\":\"TPV\",\"device\":\"" device "\",\"mode\":" mode ",\"lat\":" latitude ",\"lon\":20.5}"  \
	"\n"

static void test_of_several_receivers_one_counts(void **state)
{
	(void)state;
	assert_int_equal(take(OF("/dev/a", "1", "0")), 1);
	assert_int_equal(take(OF("/dev/b", "3", "44.8")), 1); /* the first with a fix */
	assert_int_equal(fix.latitude, 448000000);
	assert_string_equal(reader.other, "");
	for (unsigned i = 0; i < 20; i++) {
		now_ns += NS_PER_S;
		assert_int_equal(take(OF("/dev/a", "3", "45.2")), 0);
		assert_int_equal(take(OF("/dev/b", "3", "44.8")), 1);
		assert_int_equal(fix.latitude, 448000000);
	}
	assert_string_equal(reader.other, "/dev/a");
	assert_int_equal(reader.counters[NMEA_UNKNOWN], 20);
}

static void test_another_receiver_takes_over_from_one_without_a_fix(void **state)
{
	(void)state;
	take(SKY OF("", "3", "44.8"));
	assert_int_equal(take(OF("", "1", "0")), 1);
	assert_int_equal(take(OF("/dev/b", "3", "45.2")), 0);
	now_ns += GPSD_OTHER_NS;
	assert_int_equal(take(OF("/dev/b", "1", "0")), 0);
	assert_int_equal(take(OF("/dev/b", "3", "45.2")), 1);
	assert_int_equal(fix.latitude, 452000000);
	assert_false(fix.known & (GPS_SATELLITES | GPS_HDOP));
	assert_int_equal(take(OF("", "3", "44.8")), 0);
}

static void test_the_wanted_receiver_counts_alone(void **state)
{
	(void)state;
	gpsd_reader_init(&reader, "/dev/b", BUILT_DAYS);
	assert_int_equal(take(OF("/dev/a", "3", "45.2")), 0);
	assert_int_equal(take(OF("/dev/b", "1", "0")), 1);
	now_ns += 2 * GPSD_OTHER_NS;
	assert_int_equal(take(TPV OF("/dev/a", "3", "45.2") OF("/dev/b", "3", "44.8")), 1);
	assert_int_equal(fix.latitude, 448000000);
}

int main(void)
{
	const struct CMUnitTest tests[] = {
	    cmocka_unit_test_setup(test_a_fix, setup),
	    cmocka_unit_test_setup(test_a_satellite_on_several_signals, setup),
	    cmocka_unit_test_setup(test_octet_by_octet, setup),
	    cmocka_unit_test_setup(test_no_fix, setup),
	    cmocka_unit_test_setup(test_a_date_that_is_not_believed, setup),
	    cmocka_unit_test_setup(test_other_classes, setup),
	    cmocka_unit_test_setup(test_what_is_no_json, setup),
	    cmocka_unit_test_setup(test_values_that_cannot_be, setup),
	    cmocka_unit_test_setup(test_a_line_that_does_not_end, setup),
	    cmocka_unit_test_setup(test_of_several_receivers_one_counts, setup),
	    cmocka_unit_test_setup(test_another_receiver_takes_over_from_one_without_a_fix, setup),
	    cmocka_unit_test_setup(test_the_wanted_receiver_counts_alone, setup),
	};
	return cmocka_run_group_tests_name("gps gpsd", tests, NULL, NULL);
}
