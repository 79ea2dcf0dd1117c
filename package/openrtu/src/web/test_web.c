/* SPDX-License-Identifier: GPL-3.0-or-later */
#include <setjmp.h>
#include <stdarg.h>
#include <stddef.h>
#include <string.h>

#include <cmocka.h>

#include "map/time_ns.h"
#include "web/sessions.h"
#include "web/tries.h"
#include "web/users.h"

#define SALT     "00112233445566778899aabbccddeeff"
#define HASH_END "0102030405060708090a0b0c0d0e0f101112131415161718191a1b1c1d1e1f"
#define HASH     "00" HASH_END

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
	    "anna operator scrypt 8192 8 1 " SALT " " HASH " GEZDGNBVGY3TQOJQ more",
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
	assert_int_equal(user.n, 8192); /* as slow */
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

static void test_a_session_ends_with_its_user(void **state)
{
	static const char *const files[] = {
	    "anna operator scrypt 8192 8 1 " SALT " " HASH "\n",
	    "anna viewer scrypt 8192 8 1 " SALT " " HASH "\n",
	    "anna operator scrypt 8192 8 1 " SALT " ff" HASH_END "\n",
	    "bert operator scrypt 8192 8 1 " SALT " " HASH "\n",
	};

	(void)state;
	for (unsigned i = 0; i < sizeof(files) / sizeof(files[0]); i++) {
		FILE *file = fmemopen((void *)(uintptr_t)files[i], strlen(files[i]), "r");
		struct web_user user;
		unsigned wrong;
		char token[WEB_SECRET_SIZE];
		FILE *first = fmemopen((void *)(uintptr_t)files[0], strlen(files[0]), "r");
		const uint8_t random[2 * WEB_SECRET_OCTETS] = {[0] = 1, [40] = 1};

		assert_true(web_user_find(first, "anna", &user, &wrong));
		memcpy(token, web_session_begin(&sessions, &user, random, NS_PER_S, 3600)->token,
		       sizeof(token));
		web_sessions_review(&sessions, file);
		if (i == 0)
			assert_non_null(web_session_find(&sessions, token, NS_PER_S));
		else
			assert_null(web_session_find(&sessions, token, NS_PER_S));
		web_sessions_review(&sessions, NULL);
		assert_null(web_session_find(&sessions, token, NS_PER_S));
		fclose(first);
		fclose(file);
	}
}

/* ---- tries ------------------------------------------------------------------------------- */

static struct in6_addr ipv4(uint8_t last)
{
	return (struct in6_addr){
	    .s6_addr[10] = 0xff, .s6_addr[11] = 0xff, .s6_addr[12] = 192, .s6_addr[15] = last};
}

static unsigned tried(struct web_tries *tries, const char *name, const struct in6_addr *address,
		      unsigned times, int64_t now_ns)
{
	unsigned count = 0, wait_s;

	for (unsigned i = 0; i < times; i++)
		count += web_try_begin(tries, name, address, now_ns, &wait_s);
	return count;
}

static void test_guesses_wait_longer_and_longer(void **state)
{
	static const unsigned waits[] = {30, 60, 120, 240, 480, 900, 900};
	struct web_tries tries = {.next_known = 0};
	const struct in6_addr one = ipv4(1), other = ipv4(2);
	int64_t now_ns = NS_PER_S;
	unsigned wait_s;

	(void)state;
	assert_int_equal(tried(&tries, "anna", &one, WEB_OF_BOTH + 3, now_ns), WEB_OF_BOTH);
	assert_true(web_try_begin(&tries, "anna", &other, now_ns, &wait_s));
	web_try_right(&tries, "anna", &other);
	for (unsigned i = 0; i < sizeof(waits) / sizeof(waits[0]); i++) {
		assert_false(web_try_begin(&tries, "anna", &one, now_ns, &wait_s));
		assert_int_equal(wait_s, waits[i]);
		now_ns += wait_s * NS_PER_S;
		assert_true(web_try_begin(&tries, "anna", &one, now_ns, &wait_s));
	}
	now_ns += (WEB_WAIT_MAX_S + WEB_FORGET_S + 1) * NS_PER_S;
	assert_int_equal(tried(&tries, "anna", &one, WEB_OF_BOTH + 1, now_ns), WEB_OF_BOTH);
}

static void test_an_address_guesses_no_more_with_other_names(void **state)
{
	struct web_tries tries = {.next_known = 0};
	struct in6_addr one = {.s6_addr = {0x20, 0x01, 0x0d, 0xb8}};
	unsigned count = 0, wait_s;

	(void)state;
	for (uint8_t i = 0; i < 200; i++) {
		const char name[] = {(char)('a' + i % 26), (char)('a' + i / 26), '\0'};

		one.s6_addr[15] = i; /* one host has them all */
		count += web_try_begin(&tries, name, &one, (1 + i * WEB_HASH_S) * NS_PER_S, &wait_s);
	}
	assert_in_range(count, WEB_OF_HOST, WEB_OF_HOST + 4);
}

static void test_strangers_lock_nobody_out_who_came_from_there(void **state)
{
	struct web_tries tries = {.next_known = 0};
	const struct in6_addr home = ipv4(250);
	unsigned count = 0, wait_s;

	(void)state;
	assert_true(web_try_begin(&tries, "anna", &home, NS_PER_S, &wait_s));
	web_try_right(&tries, "anna", &home);
	for (unsigned i = 0; i < 10000; i++) {
		const struct in6_addr address = {
		    .s6_addr[0] = 0x20, .s6_addr[4] = (uint8_t)(i >> 8), .s6_addr[5] = (uint8_t)i};

		count += web_try_begin(&tries, "anna", &address, NS_PER_S, &wait_s);
	}
	assert_int_equal(count, WEB_HASHES - 1);
	assert_true(web_try_begin(&tries, "anna", &home, NS_PER_S, &wait_s));
}

static void test_a_name_is_not_guessed_from_many_addresses(void **state)
{
	struct web_tries tries = {.next_known = 0};
	unsigned count = 0, wait_s;

	(void)state;
	for (unsigned i = 0; i < 200; i++) {
		const struct in6_addr address = {.s6_addr[0] = 0x20, .s6_addr[4] = (uint8_t)i};

		count += web_try_begin(&tries, "anna", &address, (1 + i * WEB_HASH_S) * NS_PER_S, &wait_s);
	}
	assert_in_range(count, WEB_OF_NAME, WEB_OF_NAME + 6);
}

static void test_codes_are_counted_by_name(void **state)
{
	struct web_tries tries = {.next_known = 0};
	unsigned wait_s;

	(void)state;
	for (unsigned i = 0; i < WEB_OF_CODE; i++)
		assert_true(web_code_begin(&tries, "anna", NS_PER_S, &wait_s));
	assert_false(web_code_begin(&tries, "anna", NS_PER_S, &wait_s));
	assert_true(web_code_begin(&tries, "bert", NS_PER_S, &wait_s));
	web_code_right(&tries, "anna");
	assert_true(web_code_begin(&tries, "anna", NS_PER_S, &wait_s));
}

/* ---- codes ------------------------------------------------------------------------------- */

static void test_secrets_are_base32(void **state)
{
	uint8_t secret[WEB_TOTP_MAX];
	struct web_user user;

	(void)state;
	assert_int_equal(web_secret_read("GEZDGNBVGY3TQOJQGEZDGNBVGY3TQOJQ", secret), 20);
	assert_memory_equal(secret, "12345678901234567890", 20);
	assert_int_equal(web_secret_read("GEZDGNBV", secret), 0);         /* too short */
	assert_int_equal(web_secret_read("GEZDGNBVGY3TQOJ1", secret), 0); /* no letter of base32 */
	assert_int_equal(
	    web_secret_read("AAAAAAAAAAAAAAAAAAAAAAAAAAAAAAAAAAAAAAAAAAAAAAAAAAAAAAAAAAAAAAAA", secret),
	    WEB_TOTP_MAX);
	assert_int_equal(
	    web_secret_read("AAAAAAAAAAAAAAAAAAAAAAAAAAAAAAAAAAAAAAAAAAAAAAAAAAAAAAAAAAAAAAAAAA", secret), 0);
	assert_true(reads("anna operator scrypt 8192 8 1 " SALT " " HASH " GEZDGNBVGY3TQOJQ\n", &user));
	assert_int_equal(user.secret_size, 10);
	assert_true(reads("anna operator scrypt 8192 8 1 " SALT " " HASH "\n", &user));
	assert_int_equal(user.secret_size, 0);
}

/* RFC 4226, 5.4. */
static void test_a_code_is_six_digits_of_the_hmac(void **state)
{
	static const uint8_t mac[WEB_MAC_SIZE] = {0x1f, 0x86, 0x98, 0x69, 0x0e, 0x02, 0xca, 0x16, 0x61, 0x85,
						  0x50, 0xef, 0x7f, 0x19, 0xda, 0x8e, 0x94, 0x5b, 0x55, 0x5a};
	char code[WEB_CODE_SIZE];

	(void)state;
	web_code_of(mac, code);
	assert_string_equal(code, "872921");
}

static void test_a_code_is_good_once(void **state)
{
	struct web_used used[WEB_STEPS_MAX] = {{0}};

	(void)state;
	assert_true(web_step_use(used, 7, 100));
	assert_false(web_step_use(used, 7, 100));
	assert_false(web_step_use(used, 7, 99));
	assert_true(web_step_use(used, 8, 100));
	assert_true(web_step_use(used, 7, 101));
	for (uint64_t user = 100; user < 100 + WEB_STEPS_MAX - 2; user++)
		assert_true(web_step_use(used, user, 101));
	assert_false(web_step_use(used, 7, 101));
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
	    cmocka_unit_test(test_a_session_ends_with_its_user),
	    cmocka_unit_test(test_guesses_wait_longer_and_longer),
	    cmocka_unit_test(test_an_address_guesses_no_more_with_other_names),
	    cmocka_unit_test(test_strangers_lock_nobody_out_who_came_from_there),
	    cmocka_unit_test(test_a_name_is_not_guessed_from_many_addresses),
	    cmocka_unit_test(test_codes_are_counted_by_name),
	    cmocka_unit_test(test_secrets_are_base32),
	    cmocka_unit_test(test_a_code_is_six_digits_of_the_hmac),
	    cmocka_unit_test(test_a_code_is_good_once),
	};

	return cmocka_run_group_tests(tests, NULL, NULL);
}
