/* SPDX-License-Identifier: GPL-3.0-or-later */
/* Elements at the limits of their tags and lengths, whole and cut. */
#include <setjmp.h>
#include <stdarg.h>
#include <stddef.h>
#include <stdint.h>
#include <string.h>

#include <cmocka.h>

#include "ber/ber.h"

#define SIZE 70000

static uint8_t octets[SIZE], value[SIZE];

static struct ber_writer begin_at(size_t room)
{
	return (struct ber_writer){.octets = octets, .floor = SIZE - room, .at = SIZE};
}

static struct ber_reader written(const struct ber_writer *writer)
{
	return (struct ber_reader){octets + writer->at, octets + SIZE};
}

/* Each tag and size comes back, and one octet less of it does not. */
static void test_what_is_written_is_read(void **state)
{
	static const uint32_t tags[] = {BER_INTEGER, 0x80, 0xbe, 0x1f1f, 0xbf4d, 0xbf7f};
	static const size_t sizes[] = {0, 1, 0x7f, 0x80, 0xff, 0x100, 0xffff, 0x10000};

	(void)state;
	for (size_t i = 0; i < sizeof(sizes) / sizeof(sizes[0]); i++)
		for (size_t j = 0; j < sizeof(tags) / sizeof(tags[0]); j++) {
			struct ber_writer writer = begin_at(SIZE);
			struct ber_element element;
			struct ber_reader reader;

			memset(value, (int)(i + 1), sizes[i]);
			ber_put(&writer, tags[j], value, sizes[i]);
			assert_false(writer.full);
			reader = written(&writer);
			assert_true(ber_next(&reader, &element));
			assert_int_equal(element.tag, tags[j]);
			assert_true(ber_is(&element, value, sizes[i]));
			assert_ptr_equal(reader.at, reader.end);
			assert_false(ber_next(&reader, &element));
			reader = written(&writer);
			reader.end--;
			assert_false(ber_next(&reader, &element));
		}
}

static void test_integers_have_as_few_octets_as_they_need(void **state)
{
	static const struct {
		int64_t number;
		size_t size;
	} numbers[] = {{0, 1},      {1, 1},         {-1, 1},        {127, 1},       {128, 2},
		       {-128, 1},   {-129, 2},      {32767, 2},     {32768, 3},     {-32768, 2},
		       {-32769, 3}, {INT32_MAX, 4}, {INT32_MIN, 4}, {UINT32_MAX, 5}};

	(void)state;
	for (size_t i = 0; i < sizeof(numbers) / sizeof(numbers[0]); i++) {
		struct ber_writer writer = begin_at(SIZE);
		struct ber_element element;
		struct ber_reader reader;
		int64_t number;

		ber_put_integer(&writer, BER_INTEGER, numbers[i].number);
		reader = written(&writer);
		assert_true(ber_expect(&reader, BER_INTEGER, &element));
		assert_int_equal(element.size, numbers[i].size);
		assert_true(ber_integer(&element, &number));
		assert_true(number == numbers[i].number);
	}
}

static void test_an_integer_of_no_octet_or_of_six_is_none(void **state)
{
	const uint8_t six[6] = {0, 0, 0, 0, 0, 1};
	int64_t number;

	(void)state;
	assert_false(ber_integer(&(struct ber_element){BER_INTEGER, six, 0}, &number));
	assert_false(ber_integer(&(struct ber_element){BER_INTEGER, six, 6}, &number));
	assert_true(ber_integer(&(struct ber_element){BER_INTEGER, six + 1, 5}, &number));
	assert_int_equal(number, 1);
}

/* Of forms that MMS does not use, or cut within its head. */
static void test_what_is_no_element_is_refused(void **state)
{
	static const struct {
		uint8_t octets[8];
		size_t size;
	} wrong[] = {
	    {{0x30}, 1},                               /* no length */
	    {{0x1f}, 1},                               /* half a tag */
	    {{0x1f, 0x81, 0x01, 0x00}, 4},             /* a tag of three octets */
	    {{0x30, 0x80, 0x00, 0x00}, 4},             /* the indefinite form */
	    {{0x30, 0x81}, 2},                         /* half a length */
	    {{0x30, 0x82, 0x00}, 3},                   /* the same */
	    {{0x30, 0x85, 0, 0, 0, 0, 0}, 7},          /* a length of five octets */
	    {{0x30, 0x84, 0xff, 0xff, 0xff, 0xff}, 6}, /* more than there is */
	    {{0x30, 0x02, 0x00}, 3},
	};

	(void)state;
	for (size_t i = 0; i < sizeof(wrong) / sizeof(wrong[0]); i++) {
		struct ber_reader reader = {wrong[i].octets, wrong[i].octets + wrong[i].size};
		struct ber_element element;

		assert_false(ber_next(&reader, &element));
	}
}

static void test_an_element_is_found_by_its_path(void **state)
{
	static const uint32_t path[] = {0xa1, 0x81}, nowhere[] = {0xa1, 0x82}, none[] = {0xa3, 0x81};
	struct ber_writer writer = begin_at(SIZE);
	struct ber_reader reader;
	struct ber_element all, found;

	(void)state;
	ber_put_text(&writer, 0x81, "in");
	ber_close(&writer, 0xa1, SIZE);
	ber_put_text(&writer, 0x81, "beside");
	ber_close(&writer, BER_SEQUENCE, SIZE);
	reader = written(&writer);
	assert_false(ber_expect(&reader, BER_OBJECT_IDENTIFIER, &all));
	reader = written(&writer);
	assert_true(ber_expect(&reader, BER_SEQUENCE, &all));
	assert_true(ber_follow(&all, path, 2, &found));
	assert_true(ber_is(&found, "in", 2));
	assert_false(ber_is(&found, "i", 1));
	assert_false(ber_is(&found, "on", 2));
	assert_true(ber_find(&all, 0x81, &found));
	assert_true(ber_is(&found, "beside", 6));
	assert_false(ber_follow(&all, nowhere, 2, &found));
	assert_false(ber_follow(&all, none, 2, &found));
}

/* Exactly what there is room for; behind what does not fit nothing is written. */
static void test_what_does_not_fit_is_not_written(void **state)
{
	struct ber_writer writer = begin_at(6);

	(void)state;
	ber_put(&writer, 0x81, "four", 4);
	assert_false(writer.full);
	assert_int_equal(SIZE - writer.at, 6);
	writer = begin_at(5);
	ber_put(&writer, 0x81, "four", 4);
	assert_true(writer.full);
	ber_put_octets(&writer, "", 0);
	assert_true(writer.full && writer.at >= writer.floor);
}

int main(void)
{
	const struct CMUnitTest tests[] = {
	    cmocka_unit_test(test_what_is_written_is_read),
	    cmocka_unit_test(test_integers_have_as_few_octets_as_they_need),
	    cmocka_unit_test(test_an_integer_of_no_octet_or_of_six_is_none),
	    cmocka_unit_test(test_what_is_no_element_is_refused),
	    cmocka_unit_test(test_an_element_is_found_by_its_path),
	    cmocka_unit_test(test_what_does_not_fit_is_not_written),
	};
	return cmocka_run_group_tests_name("ber", tests, NULL, NULL);
}
