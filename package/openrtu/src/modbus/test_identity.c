/* SPDX-License-Identifier: GPL-3.0-or-later */
#include <setjmp.h>
#include <stdarg.h>
#include <stdbool.h>
#include <stddef.h>
#include <stdint.h>
#include <stdlib.h>
#include <string.h>

#include <cmocka.h>

#include "modbus/identity.h"

static struct modbus_identity identity;

/* An answer with these objects: each its number and its text. */
static void answer(bool more, uint8_t next, unsigned count, const uint8_t *numbers, const char *const *texts)
{
	uint8_t body[1024] = {17, MODBUS_ENCAPSULATED, 14, 2, 0x82, more ? 0xFF : 0, next, (uint8_t)count};
	size_t at = 8;

	for (unsigned i = 0; i < count; i++) {
		body[at++] = numbers[i];
		body[at++] = (uint8_t)strlen(texts[i]);
		memcpy(body + at, texts[i], strlen(texts[i]));
		at += strlen(texts[i]);
	}
	modbus_identity_answered(&identity, body);
}

static const char *text(uint8_t object)
{
	static char out[MODBUS_IDENTITY_WORDS];

	modbus_identity_text(identity.texts, identity.size, object, out);
	return out;
}

static void begin(void)
{
	identity = (struct modbus_identity){.size = 0};
	modbus_identity_begin(&identity);
}

static void test_objects_are_kept(void **state)
{
	(void)state;
	begin();
	answer(false, 0, 3, (const uint8_t[]){0, 1, 4},
	       (const char *const[]){"Maker",
				     "AB\x1b\x07"
				     "12  ",
				     "M\xfcller"});
	assert_int_equal(identity.state, MODBUS_IDENTITY_KNOWN);
	assert_string_equal(text(0), "Maker");
	assert_string_equal(text(1), "AB12");
	assert_string_equal(text(2), "");
	assert_string_equal(text(4), "M\xc3\xbcller");
}

static void test_the_rest_is_asked_for(void **state)
{
	(void)state;
	begin();
	assert_int_equal(modbus_identity_request(&identity, 17).address, 0x0200);
	answer(true, 2, 2, (const uint8_t[]){0, 1}, (const char *const[]){"a", "b"});
	assert_true(modbus_identity_is_wanted(&identity));
	assert_int_equal(modbus_identity_request(&identity, 17).address, 0x0202);
	answer(false, 0, 1, (const uint8_t[]){2}, (const char *const[]){"c"});
	assert_false(modbus_identity_is_wanted(&identity));
	assert_string_equal(text(0), "a");
	assert_string_equal(text(2), "c");
	/* Back again, as another one. */
	modbus_identity_begin(&identity);
	answer(false, 0, 1, (const uint8_t[]){0}, (const char *const[]){"z"});
	assert_string_equal(text(0), "z");
	assert_string_equal(text(1), "");
}

/* It would be asked for ever. */
static void test_a_stream_without_end_ends(void **state)
{
	(void)state;
	begin();
	answer(true, 0, 1, (const uint8_t[]){0}, (const char *const[]){"a"});
	assert_int_equal(identity.state, MODBUS_IDENTITY_KNOWN);
	begin();
	answer(true, 7, 1, (const uint8_t[]){0}, (const char *const[]){"a"});
	assert_int_equal(identity.state, MODBUS_IDENTITY_KNOWN);
}

static void test_more_than_there_is_room_for_is_cut(void **state)
{
	static const char *const texts[] = {"0123456789012345678901234567890123456789xyz",
					    "1123456789012345678901234567890123456789",
					    "2123456789012345678901234567890123456789",
					    "3123456789",
					    "4",
					    "5",
					    "6"};
	static const uint8_t numbers[] = {0, 1, 2, 3, 4, 5, 6};

	(void)state;
	begin();
	answer(false, 0, 7, numbers, texts);
	assert_true(identity.size <= MODBUS_IDENTITY_SIZE);
	assert_string_equal(text(0), "0123456789012345678901234567890123456789");
	assert_string_equal(text(2), texts[2]);
	assert_string_equal(text(3), "");
	assert_string_equal(text(6), "");
}

static void test_any_answer_stays_within_its_room(void **state)
{
	enum { ROUNDS = 2000, HEAD = 4 };
	static uint8_t chance[ROUNDS + 8 + 255 * 257]; /* each round begins an octet further */

	(void)state;
	srand(1);
	for (size_t i = 0; i < sizeof(chance); i++)
		chance[i] = (uint8_t)rand();
	for (unsigned round = 0; round < ROUNDS; round++) {
		uint8_t body[8 + 255 * 257] = {17, MODBUS_ENCAPSULATED, 14, 2};

		memcpy(body + HEAD, chance + round, sizeof(body) - HEAD);
		begin();
		modbus_identity_answered(&identity, body);
		assert_true(identity.size <= MODBUS_IDENTITY_SIZE);
		for (unsigned object = 0; object < 256; object++)
			assert_true(strlen(text((uint8_t)object)) < MODBUS_IDENTITY_WORDS);
	}
}

/* What another process has left may be anything. */
static void test_any_texts_are_read_within_their_room(void **state)
{
	uint8_t texts[MODBUS_IDENTITY_SIZE];
	char out[MODBUS_IDENTITY_WORDS];

	(void)state;
	srand(2);
	for (unsigned round = 0; round < 20000; round++) {
		const size_t size = (size_t)rand() % (sizeof(texts) + 1);

		for (size_t i = 0; i < sizeof(texts); i++)
			texts[i] = (uint8_t)(rand() % (round % 256 + 1));
		modbus_identity_text(texts, size, (uint8_t)(rand() % 8), out);
		assert_true(strlen(out) < sizeof(out));
	}
}

/* Another device may be in its place. */
static void test_what_was_said_before_it_was_away_is_not_said_by_who_refuses(void **state)
{
	(void)state;
	begin();
	answer(false, 0, 1, (const uint8_t[]){0}, (const char *const[]){"Maker"});
	modbus_identity_begin(&identity);
	modbus_identity_refused(&identity, 1);
	assert_int_equal(identity.state, MODBUS_IDENTITY_REFUSED);
	assert_string_equal(text(0), "");
}

static void test_a_refusal_of_the_regular_ones_asks_for_the_basic_ones(void **state)
{
	(void)state;
	begin();
	modbus_identity_refused(&identity, 3);
	assert_true(modbus_identity_is_wanted(&identity));
	assert_int_equal(modbus_identity_request(&identity, 17).address, 0x0100);
	modbus_identity_refused(&identity, 3);
	assert_int_equal(identity.state, MODBUS_IDENTITY_REFUSED);
	begin();
	modbus_identity_refused(&identity, 1);
	assert_int_equal(identity.state, MODBUS_IDENTITY_REFUSED);
}

static void test_a_text_is_one_or_another(void **state)
{
	(void)state;
	begin();
	answer(false, 0, 2, (const uint8_t[]){0, 1}, (const char *const[]){"M\xfcller", "M1"});
	assert_true(modbus_identity_is(identity.texts, identity.size, 0, "M\xfcller"));
	assert_false(modbus_identity_is(identity.texts, identity.size, 0, "Muller"));
	assert_false(modbus_identity_is(identity.texts, identity.size, 1, "M"));
	assert_true(modbus_identity_is(identity.texts, identity.size, 2, ""));
	assert_false(modbus_identity_is(identity.texts, identity.size, 2, "M1"));
}

static void test_silence_is_left_alone(void **state)
{
	(void)state;
	begin();
	modbus_identity_unanswered(&identity);
	assert_false(modbus_identity_is_wanted(&identity));
	modbus_identity_begin(&identity);
	assert_true(modbus_identity_is_wanted(&identity));
	modbus_identity_unanswered(&identity);
	modbus_identity_begin(&identity);
	assert_false(modbus_identity_is_wanted(&identity));
	assert_int_equal(identity.state, MODBUS_IDENTITY_SILENT);
}

int main(void)
{
	const struct CMUnitTest tests[] = {
	    cmocka_unit_test(test_objects_are_kept),
	    cmocka_unit_test(test_the_rest_is_asked_for),
	    cmocka_unit_test(test_a_stream_without_end_ends),
	    cmocka_unit_test(test_more_than_there_is_room_for_is_cut),
	    cmocka_unit_test(test_any_answer_stays_within_its_room),
	    cmocka_unit_test(test_any_texts_are_read_within_their_room),
	    cmocka_unit_test(test_what_was_said_before_it_was_away_is_not_said_by_who_refuses),
	    cmocka_unit_test(test_a_refusal_of_the_regular_ones_asks_for_the_basic_ones),
	    cmocka_unit_test(test_a_text_is_one_or_another),
	    cmocka_unit_test(test_silence_is_left_alone),
	};
	return cmocka_run_group_tests_name("modbus identity", tests, NULL, NULL);
}
