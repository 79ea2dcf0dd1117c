/* SPDX-License-Identifier: GPL-3.0-or-later */
#include "modules/web/login.h"

#include <errno.h>
#include <fcntl.h>
#include <openssl/crypto.h>
#include <openssl/evp.h>
#include <openssl/hmac.h>
#include <openssl/rand.h>
#include <string.h>
#include <sys/stat.h>
#include <unistd.h>

#include "map/address.h"
#include "modules/web/lists.h"
#include "rows/rows.h"
#include "rows/words.h"
#include "web/mix.h"

#define HASH_OVERHEAD (1u << 20) /* what OpenSSL adds to 128 N r */
#define COOKIE_MAX    192
#define REVIEW_NS     (5 * NS_PER_S) /* between two looks at the file */
#define AROUND        1              /* steps that a telephone's clock may be off */

/* ---- the file ---------------------------------------------------------------------------- */

/* NULL with errno: it cannot be read; EPERM: others can read it, too. */
static FILE *open_users(const struct http_site *site)
{
	const int fd = open(site->settings->users, O_RDONLY | O_NOFOLLOW | O_NONBLOCK | O_CLOEXEC);
	struct stat status;
	FILE *file;

	if (fd < 0)
		return NULL;
	if (fstat(fd, &status) == 0 && S_ISREG(status.st_mode) && (status.st_mode & 077) == 0) {
		file = fdopen(fd, "r");
		if (file != NULL)
			return file;
	} else {
		errno = EPERM;
	}
	close(fd);
	return NULL;
}

void login_look(struct http_site *site)
{
	FILE *file = open_users(site);
	struct web_user user;
	unsigned wrong;

	if (file == NULL) {
		map_log(site->map, MAP_LOG_WARNING, "nobody can log in: %s: %s", site->settings->users,
			errno == EPERM ? "others may read it: chmod 0400" : strerror(errno));
		return;
	}
	web_user_find(file, "", &user, &wrong);
	if (wrong > 0)
		map_log(site->map, MAP_LOG_WARNING,
			"%s: %u lines are no users: make it with openrtu web-users", site->settings->users,
			wrong);
	fclose(file);
}

void login_review(struct http_site *site)
{
	FILE *file;

	if (site->now_ns - site->reviewed_ns < REVIEW_NS)
		return;
	site->reviewed_ns = site->now_ns;
	file = open_users(site);
	if (file != NULL || site->no_users) /* one that is exchanged is not there for a moment */
		web_sessions_review(&site->sessions, file);
	site->no_users = file == NULL;
	if (file != NULL)
		fclose(file);
}

static bool find_user(struct http_site *site, const char *name, struct web_user *out)
{
	FILE *file = open_users(site);
	unsigned wrong;
	bool found;

	memset(out, 0, sizeof(*out));
	if (file == NULL) {
		login_look(site);
		return false;
	}
	found = web_user_find(file, name, out, &wrong);
	fclose(file);
	return found;
}

/* As slow for a name that is not there, by another user of the file: nobody learns names by time. */
static bool fits(const char *password, const struct web_user *user, bool known)
{
	static const struct web_user nobody = {.n = 8192, .r = 8, .p = 1, .salt_size = 16};
	const struct web_user *by = user->n != 0 ? user : &nobody;
	const uint64_t memory = UINT64_C(128) * by->n * by->r + HASH_OVERHEAD;
	uint8_t hash[WEB_HASH_SIZE];
	bool same;

	if (EVP_PBE_scrypt(password, strlen(password), by->salt, by->salt_size, by->n, by->r, by->p, memory,
			   hash, sizeof(hash)) != 1)
		return false;
	same = CRYPTO_memcmp(hash, by->hash, sizeof(hash)) == 0;
	explicit_bzero(hash, sizeof(hash));
	return same && known;
}

/* ---- the second factor ------------------------------------------------------------------- */

static bool is_code_of(const struct web_user *user, uint64_t step, const char *code)
{
	uint8_t counter[8], mac[EVP_MAX_MD_SIZE];
	char right[WEB_CODE_SIZE];
	unsigned size = 0;

	for (unsigned i = 0; i < sizeof(counter); i++)
		counter[i] = (uint8_t)(step >> 8 * (sizeof(counter) - 1 - i));
	if (HMAC(EVP_sha1(), user->secret, user->secret_size, counter, sizeof(counter), mac, &size) == NULL ||
	    size != WEB_MAC_SIZE)
		return false;
	web_code_of(mac, right);
	return strlen(code) == WEB_CODE_SIZE - 1 && CRYPTO_memcmp(right, code, WEB_CODE_SIZE - 1) == 0;
}

/* Each code is good once. */
static bool is_code(struct http_site *site, const struct web_user *user, const char *code)
{
	const struct map_clock clock = map_clock_read(site->map);
	const uint64_t now = (uint64_t)(map_wall_ns(clock, site->now_ns) / NS_PER_S) / WEB_STEP_S;
	const uint64_t whose = web_mix(WEB_MIX_BEGIN, user->name, strlen(user->name));

	for (uint64_t step = now - AROUND; step <= now + AROUND; step++)
		if (is_code_of(user, step, code))
			return web_step_use(site->used, whose, step);
	return false;
}

/* ---- coming in --------------------------------------------------------------------------- */

void login_cookie_name(const struct http_site *site, char *out, size_t size)
{
	snprintf(out, size, "openrtu_%u", site->settings->port);
}

static struct http_answer set_cookie(const struct http_site *site, struct http_answer answer,
				     const char *token)
{
	const bool secure = site->settings->certificate[0] != '\0';
	char name[32], cookie[COOKIE_MAX];

	login_cookie_name(site, name, sizeof(name));
	snprintf(cookie, sizeof(cookie), "%s=%s; Path=/; HttpOnly; SameSite=Strict%s%s", name, token,
		 secure ? "; Secure" : "", token[0] == '\0' ? "; Max-Age=0" : "");
	if (answer.response != NULL)
		MHD_add_response_header(answer.response, MHD_HTTP_HEADER_SET_COOKIE, cookie);
	return answer;
}

static json_t *who(const struct web_session *session)
{
	return json_pack("{s:s, s:s, s:s}", "name", session->name, "role", web_role_name(session->role),
			 "csrf", session->csrf);
}

static struct http_answer let_in(struct http_site *site, struct http_request *request,
				 const struct web_user *user)
{
	uint8_t random[2 * WEB_SECRET_OCTETS];
	char peer[MAP_ADDRESS_SIZE];

	if (RAND_bytes(random, sizeof(random)) != 1)
		return answer_refusal(MHD_HTTP_INTERNAL_SERVER_ERROR, "random",
				      "there are no random numbers");
	request->session =
	    web_session_begin(&site->sessions, user, random, site->now_ns, site->settings->session_s);
	explicit_bzero(random, sizeof(random));
	map_count(&site->stats->counters[WEB_COUNT_LOGINS], 1);
	map_address_text(&request->peer, peer);
	map_log(site->map, MAP_LOG_INFO, "%s (%s) logged in from %s", user->name, web_role_name(user->role),
		peer);
	return set_cookie(site, answer_json(MHD_HTTP_OK, who(request->session)), request->session->token);
}

static void count_failed(struct http_site *site, const struct http_request *request)
{
	char peer[MAP_ADDRESS_SIZE];

	map_count(&site->stats->counters[WEB_COUNT_LOGINS_FAILED], 1);
	map_address_text(&request->peer, peer);
	map_log(site->map, MAP_LOG_WARNING, "a login from %s failed", peer);
}

static struct http_answer put_off(struct http_site *site, unsigned wait_s)
{
	struct http_answer answer;
	char text[64], seconds[16];

	map_count(&site->stats->counters[WEB_COUNT_LOGINS_LIMITED], 1);
	snprintf(text, sizeof(text), "too many tries: try again in %u s", wait_s);
	snprintf(seconds, sizeof(seconds), "%u", wait_s);
	answer = answer_refusal(MHD_HTTP_TOO_MANY_REQUESTS, "tries", text);
	if (answer.response != NULL)
		MHD_add_response_header(answer.response, MHD_HTTP_HEADER_RETRY_AFTER, seconds);
	return answer;
}

/* The password was right. */
static struct http_answer ask_code(struct http_site *site, struct http_request *request,
				   const struct web_user *user, const char *code)
{
	unsigned wait_s;

	if (code[0] == '\0')
		return answer_refusal(MHD_HTTP_UNAUTHORIZED, "code", "say a code of your second factor, too");
	if (!web_code_begin(&site->tries, user->name, site->now_ns, &wait_s))
		return put_off(site, wait_s);
	if (!is_code(site, user, code)) {
		count_failed(site, request);
		return answer_refusal(
		    MHD_HTTP_UNAUTHORIZED, "wrong_code",
		    map_clock_read(site->map).set
			? "the code is wrong, or was used already"
			: "the code is wrong, was used already, or the gateway's clock is wrong");
	}
	web_code_right(&site->tries, user->name);
	return let_in(site, request, user);
}

static struct http_answer try(struct http_site *site, struct http_request *request, const char *name,
			      const char *password, const char *code)
{
	struct web_user user;
	unsigned wait_s;
	bool known;

	if (!web_try_begin(&site->tries, name, &request->peer, site->now_ns, &wait_s))
		return put_off(site, wait_s);
	known = find_user(site, name, &user);
	if (!fits(password, &user, known)) {
		count_failed(site, request);
		return answer_refusal(MHD_HTTP_UNAUTHORIZED, "wrong", "wrong name or password");
	}
	web_try_right(&site->tries, name, &request->peer);
	return user.secret_size > 0 ? ask_code(site, request, &user, code) : let_in(site, request, &user);
}

struct http_answer login_begin(struct http_site *site, struct http_request *request)
{
	json_t *row = json_loadb(request->body, request->size, 0, NULL);
	const char *name, *password, *code = "";
	struct http_answer answer;

	if (json_unpack(row, "{s:s, s:s, s?s}", "name", &name, "password", &password, "code", &code) == 0)
		answer = try(site, request, name, password, code);
	else
		answer = answer_refusal(MHD_HTTP_BAD_REQUEST, "form", "expected name and password");
	json_decref(row);
	return answer;
}

struct http_answer login_end(struct http_site *site, struct http_request *request)
{
	web_session_end(request->session);
	return set_cookie(site, answer_json(MHD_HTTP_OK, json_object()), "");
}

/* ---- what the page's head shows ---------------------------------------------------------- */

static uint32_t bad_points(const struct map *map)
{
	uint32_t bad = 0;

	for (uint32_t i = 0; i < map_config(map)->point_count; i++)
		bad += list_is_bad(map, i);
	return bad;
}

struct http_answer login_state(struct http_site *site, struct http_request *request)
{
	const struct map_clock clock = map_clock_read(site->map);
	json_t *row = who(request->session);
	char time[WORDS_SIZE];

	words_time(map_wall_ns(clock, site->now_ns), time);
	json_object_set_new(row, "station", json_string(site->settings->station));
	json_object_set_new(row, "version", json_string(OPENRTU_VERSION));
	json_object_set_new(row, "time", json_string(time));
	json_object_set_new(row, "clock_set", json_boolean(clock.set));
	json_object_set_new(row, "clock", json_string(words_clock_source(clock.source)));
	json_object_set_new(
	    row, "commands",
	    json_boolean(site->settings->commands && web_role_may(request->session->role, WEB_COMMANDS)));
	json_object_set_new(
	    row, "setup",
	    json_boolean(site->settings->setup && web_role_may(request->session->role, WEB_SETS_UP)));
	json_object_set_new(row, "points", json_integer(map_config(site->map)->point_count));
	json_object_set_new(row, "bad", json_integer(bad_points(site->map)));
	return answer_json(MHD_HTTP_OK, row);
}
