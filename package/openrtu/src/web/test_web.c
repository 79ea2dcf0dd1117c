/* SPDX-License-Identifier: GPL-3.0-or-later */
#include <setjmp.h>
#include <stdarg.h>
#include <stddef.h>
#include <string.h>

#include <cmocka.h>

#include "map/time_ns.h"
#include "web/sessions.h"
#include "web/users.h"

#define SALT "00112233445566778899aabbccddeeff"
#define HASH "000102030405060708090a0b0c0d0e0f101112131415161718191a1b1c1d1e1f"

static struct web_sessions sessions;
static const struct web_user anna = {.name = "anna", .role = WEB_OPERATOR};

static bool reads(const char *text, struct web_user *out)
{
	char line[WEB_LINE_SIZE];

	snprintf(line, sizeof(line), "%s", text);
	return web_user_read(line, out);
}

static void test_a_line_is_a_user(void **state)
{
	struct web_user user;

	(void)state;
	assert_true(reads("anna operator scrypt 8192 8 1 " SALT " " HASH "\n", &user));
	assert_string_equal(user.name, "anna");
	assert_int_equal(user.role, WEB_OPERATOR);
	assert_int_equal(user.n, 8192);
	assert_int_equal(user.salt_size, 16);
	assert_int_equal(user.hash[31], 0x1f);
}

static void test_a_damaged_line_is_none(void **state)
{
	static const char *const lines[] = {
	    "",
	    "anna",
	    "anna operator scrypt 8192 8 1 " SALT,
	    "anna operator scrypt 8192 8 1 " SALT " " HASH " more",
	    "anna root scrypt 8192 8 1 " SALT " " HASH,
	    "anna operator sha256 8192 8 1 " SALT " " HASH,
	    "anna operator scrypt 8191 8 1 " SALT " " HASH,
	    "anna operator scrypt 1 8 1 " SALT " " HASH,
	    "anna operator scrypt -2 8 1 " SALT " " HASH,
	    "anna operator scrypt 32768 8 1 " SALT " " HASH, /* 32 MiB */
	    "anna operator scrypt 16384 8 5 " SALT " " HASH, /* too long */
	    "anna operator scrypt 8192 8 1 001122 " HASH,
	    "anna operator scrypt 8192 8 1 " SALT " 0001",
	    "anna operator scrypt 8192 8 1 " SALT " zz" HASH,
	    "a-name-that-is-longer-than-a-name-may-be operator scrypt 8192 8 1 " SALT " " HASH,
	};
	struct web_user user;

	(void)state;
	for (unsigned i = 0; i < sizeof(lines) / sizeof(lines[0]); i++)
		assert_false(reads(lines[i], &user));
}

static void test_a_file_is_looked_through(void **state)
{
	static char text[] = "# users\n\nbad line\nbert viewer scrypt 8192 8 1 " SALT " " HASH
			     "\nanna operator scrypt 8192 8 1 " SALT " " HASH "\n";
	FILE *file = fmemopen(text, sizeof(text) - 1, "r");
	struct web_user user;
	unsigned wrong;

	(void)state;
	assert_true(web_user_find(file, "anna", &user, &wrong));
	assert_int_equal(wrong, 1);
	rewind(file);
	assert_false(web_user_find(file, "carl", &user, &wrong));
	fclose(file);
}

static struct web_session *begin(uint8_t seed, int64_t now_ns)
{
	uint8_t random[2 * WEB_SECRET_OCTETS];

	memset(random, seed, sizeof(random));
	random[0] = 0;
	return web_session_begin(&sessions, &anna, random, now_ns, 3600);
}

static void test_a_session_is_found_until_it_is_over(void **state)
{
	struct web_session *session = begin(7, NS_PER_S);
	char token[WEB_SECRET_SIZE];

	(void)state;
	memcpy(token, session->token, sizeof(token));
	assert_string_not_equal(session->token, session->csrf);
	for (int64_t s = 1; s < 3601; s += WEB_IDLE_S - 1)
		assert_ptr_equal(web_session_find(&sessions, token, s * NS_PER_S), session);
	assert_null(web_session_find(&sessions, token, 3601 * NS_PER_S));
	assert_null(web_session_find(&sessions, NULL, NS_PER_S));
	assert_null(web_session_find(&sessions, "", NS_PER_S));
}

static void test_a_session_nobody_uses_ends(void **state)
{
	struct web_session *session = begin(8, NS_PER_S);

	(void)state;
	assert_null(web_session_find(&sessions, session->token, (1 + WEB_IDLE_S) * NS_PER_S));
}

static void test_who_was_away_longest_gives_its_place(void **state)
{
	char first[WEB_SECRET_SIZE], second[WEB_SECRET_SIZE];

	(void)state;
	memset(&sessions, 0, sizeof(sessions));
	memcpy(first, begin(1, NS_PER_S)->token, sizeof(first));
	memcpy(second, begin(2, NS_PER_S)->token, sizeof(second));
	for (uint8_t i = 3; i <= WEB_SESSIONS_MAX; i++)
		begin(i, NS_PER_S);
	assert_non_null(web_session_find(&sessions, first, 2 * NS_PER_S));
	begin(99, 3 * NS_PER_S);
	assert_non_null(web_session_find(&sessions, first, 4 * NS_PER_S));
	assert_null(web_session_find(&sessions, second, 4 * NS_PER_S));
}

static void test_tries_are_limited_by_address(void **state)
{
	struct web_tries tries = {.all = {.full_ns = 0}};
	const struct in6_addr one = {.s6_addr[15] = 1}, other = {.s6_addr[15] = 2};
	unsigned wait_s;

	(void)state;
	for (unsigned i = 0; i < WEB_TRIES; i++)
		assert_true(web_may_try(&tries, &one, NS_PER_S, &wait_s));
	assert_false(web_may_try(&tries, &one, NS_PER_S, &wait_s));
	assert_int_equal(wait_s, WEB_TRY_S);
	assert_true(web_may_try(&tries, &other, NS_PER_S, &wait_s));
	assert_true(web_may_try(&tries, &one, (1 + WEB_TRY_S) * NS_PER_S, &wait_s));
	assert_false(web_may_try(&tries, &one, (1 + WEB_TRY_S) * NS_PER_S, &wait_s));
}

static void test_many_addresses_are_limited_together(void **state)
{
	struct web_tries tries = {.all = {.full_ns = 0}};
	unsigned wait_s, tried = 0;

	(void)state;
	for (uint16_t i = 0; i < 1000; i++) {
		struct in6_addr address = {.s6_addr[15] = (uint8_t)i, .s6_addr[14] = (uint8_t)(i >> 8)};

		tried += web_may_try(&tries, &address, NS_PER_S, &wait_s);
	}
	assert_int_equal(tried, WEB_TRIES_OF_ALL);
}

int main(void)
{
	const struct CMUnitTest tests[] = {
	    cmocka_unit_test(test_a_line_is_a_user),
	    cmocka_unit_test(test_a_damaged_line_is_none),
	    cmocka_unit_test(test_a_file_is_looked_through),
	    cmocka_unit_test(test_a_session_is_found_until_it_is_over),
	    cmocka_unit_test(test_a_session_nobody_uses_ends),
	    cmocka_unit_test(test_who_was_away_longest_gives_its_place),
	    cmocka_unit_test(test_tries_are_limited_by_address),
	    cmocka_unit_test(test_many_addresses_are_limited_together),
	};

	return cmocka_run_group_tests(tests, NULL, NULL);
}
