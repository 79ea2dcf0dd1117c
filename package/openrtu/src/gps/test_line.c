/* SPDX-License-Identifier: GPL-3.0-or-later */
#include <setjmp.h>
#include <stdarg.h>
#include <stddef.h>
#include <stdint.h>
#include <string.h>

#include <cmocka.h>

#include "gps/line.h"

static struct nmea_line line;
static struct nmea_sentence sentence;

static unsigned take(const char *octets)
{
	unsigned sound = 0;

	for (; *octets != 0; octets++)
		sound += nmea_line_take(&line, (uint8_t)*octets, &sentence);
	return sound;
}

static int setup(void **state)
{
	(void)state;
	memset(&line, 0, sizeof(line));
	return 0;
}

static void check_counters(uint32_t damaged, uint32_t stray)
{
	assert_int_equal(line.counters[NMEA_DAMAGED], damaged);
	assert_int_equal(line.counters[NMEA_STRAY], stray);
}

static void test_a_line_and_its_fields(void **state)
{
	(void)state;
	assert_int_equal(take("$PGRMM,WGS 84*06\r\n"), 1);
	assert_int_equal(sentence.count, 2);
	assert_int_equal(sentence.fields[1].size, 6);
	assert_memory_equal(sentence.fields[1].at, "WGS 84", 6);
	check_counters(0, 0);
}

static void test_no_checksum_and_a_wrong_one(void **state)
{
	(void)state;
	assert_int_equal(take("$PGRMM,WGS 84\r\n$PGRMM,WGS 84*07\r\n$PGRMM,WGS 84*0\r\n$*\r\n$\r\n"), 0);
	check_counters(5, 0);
}

static void test_what_stands_behind_the_checksum(void **state)
{
	(void)state;
	assert_int_equal(take("$PGRMM,WGS 84*06 \r\n"), 0);
	check_counters(1, 0);
}

static void test_a_line_begins_in_another(void **state)
{
	(void)state;
	assert_int_equal(take("$PGRMM,WG$PGRMM,WGS 84*06\r\n"), 1);
	check_counters(1, 0);
}

static void test_stray_octets_are_one_a_line(void **state)
{
	(void)state;
	assert_int_equal(take("abc\r\n\r\nde\x01"
			      "f$PGRMM,WGS 84*06\n"),
			 1);
	check_counters(0, 2);
}

static void test_an_octet_that_is_no_text(void **state)
{
	(void)state;
	assert_int_equal(take("$PGRMM,WG\xff"
			      "S 84*06\r\n$PGRMM,WGS 84*06\r\n"),
			 1);
	check_counters(1, 0);
}

static void test_the_longest_line(void **state)
{
	char text[NMEA_LINE_MAX + 8] = "$";

	(void)state;
	memset(text + 1, 'A', NMEA_LINE_MAX - 3);
	memcpy(text + NMEA_LINE_MAX - 2, NMEA_LINE_MAX % 2 ? "*00\n" : "*41\n", 5);
	assert_int_equal(take(text), 1);
	memset(text + 1, 'A', NMEA_LINE_MAX - 1);
	memcpy(text + NMEA_LINE_MAX, "*00\n", 5);
	assert_int_equal(take(text), 0);
	check_counters(1, 0);
}

static void test_more_fields_than_any_sentence_has(void **state)
{
	char text[64];

	(void)state;
	text[0] = '$';
	memset(text + 1, ',', NMEA_FIELDS_MAX);
	memcpy(text + 1 + NMEA_FIELDS_MAX, "*00\n", 5);
	assert_int_equal(take(text), 0);
	memcpy(text + NMEA_FIELDS_MAX, "*2C\n", 5);
	assert_int_equal(take(text), 1);
	assert_int_equal(sentence.count, NMEA_FIELDS_MAX);
	check_counters(1, 0);
}

int main(void)
{
	const struct CMUnitTest tests[] = {
	    cmocka_unit_test_setup(test_a_line_and_its_fields, setup),
	    cmocka_unit_test_setup(test_no_checksum_and_a_wrong_one, setup),
	    cmocka_unit_test_setup(test_what_stands_behind_the_checksum, setup),
	    cmocka_unit_test_setup(test_a_line_begins_in_another, setup),
	    cmocka_unit_test_setup(test_stray_octets_are_one_a_line, setup),
	    cmocka_unit_test_setup(test_an_octet_that_is_no_text, setup),
	    cmocka_unit_test_setup(test_the_longest_line, setup),
	    cmocka_unit_test_setup(test_more_fields_than_any_sentence_has, setup),
	};
	return cmocka_run_group_tests_name("gps line", tests, NULL, NULL);
}
