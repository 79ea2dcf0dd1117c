/* SPDX-License-Identifier: GPL-3.0-or-later */
#include "web/sessions.h"

#include <string.h>

#include "map/time_ns.h"
#include "web/hex.h"

static bool is_over(const struct web_session *session, int64_t now_ns)
{
	return session->token[0] == '\0' || now_ns >= session->until_ns ||
	       now_ns - session->used_ns >= WEB_IDLE_S * NS_PER_S;
}

struct web_session *web_session_begin(struct web_sessions *sessions, const struct web_user *user,
				      const uint8_t random[2 * WEB_SECRET_OCTETS], int64_t now_ns,
				      uint32_t seconds)
{
	struct web_session *place = &sessions->places[0];

	for (unsigned i = 0; i < WEB_SESSIONS_MAX && !is_over(place, now_ns); i++)
		if (is_over(&sessions->places[i], now_ns) || sessions->places[i].used_ns < place->used_ns)
			place = &sessions->places[i];
	*place = (struct web_session){.role = user->role,
				      .number = ++sessions->count,
				      .used_ns = now_ns,
				      .until_ns = now_ns + seconds * NS_PER_S};
	memcpy(place->name, user->name, sizeof(place->name));
	web_hex_write(random, WEB_SECRET_OCTETS, place->token);
	web_hex_write(random + WEB_SECRET_OCTETS, WEB_SECRET_OCTETS, place->csrf);
	return place;
}

bool web_same_secret(const char *known, const char *given)
{
	unsigned char difference = 0;

	if (strlen(given) != WEB_SECRET_SIZE - 1)
		return false;
	for (unsigned i = 0; i < WEB_SECRET_SIZE; i++)
		difference |= (unsigned char)(known[i] ^ given[i]);
	return difference == 0;
}

struct web_session *web_session_find(struct web_sessions *sessions, const char *token, int64_t now_ns)
{
	struct web_session *found = NULL;

	for (unsigned i = 0; token != NULL && i < WEB_SESSIONS_MAX; i++)
		if (!is_over(&sessions->places[i], now_ns) &&
		    web_same_secret(sessions->places[i].token, token))
			found = &sessions->places[i];
	if (found != NULL)
		found->used_ns = now_ns;
	return found;
}

void web_session_end(struct web_session *session)
{
	memset(session, 0, sizeof(*session));
}

/* ---- tries to log in --------------------------------------------------------------------- */

/* How long until there is one in it. */
static int64_t wait_for(const struct web_bucket *bucket, int64_t tries, int64_t try_ns, int64_t now_ns)
{
	return bucket->full_ns - (tries - 1) * try_ns - now_ns;
}

static void take(struct web_bucket *bucket, int64_t try_ns, int64_t now_ns)
{
	bucket->full_ns = (bucket->full_ns > now_ns ? bucket->full_ns : now_ns) + try_ns;
}

/* The bucket of an address, or the fullest: who had that is not held up by it any more. */
static struct web_bucket *bucket_of(struct web_tries *tries, const struct in6_addr *address, int64_t now_ns)
{
	struct web_bucket *fullest = &tries->of[0];

	for (unsigned i = 0; i < WEB_ADDRESSES_MAX; i++) {
		struct web_bucket *bucket = &tries->of[i];

		if (bucket->full_ns > now_ns && memcmp(&bucket->address, address, sizeof(*address)) == 0)
			return bucket;
		if (bucket->full_ns < fullest->full_ns)
			fullest = bucket;
	}
	*fullest = (struct web_bucket){.address = *address};
	return fullest;
}

bool web_may_try(struct web_tries *tries, const struct in6_addr *address, int64_t now_ns, unsigned *wait_s)
{
	struct web_bucket *bucket = bucket_of(tries, address, now_ns);
	const int64_t own_ns = wait_for(bucket, WEB_TRIES, WEB_TRY_S * NS_PER_S, now_ns);
	const int64_t all_ns = wait_for(&tries->all, WEB_TRIES_OF_ALL, WEB_TRY_OF_ALL_S * NS_PER_S, now_ns);
	const int64_t wait_ns = own_ns > all_ns ? own_ns : all_ns;

	*wait_s = wait_ns > 0 ? (unsigned)((wait_ns + NS_PER_S - 1) / NS_PER_S) : 0;
	if (wait_ns > 0)
		return false;
	take(bucket, WEB_TRY_S * NS_PER_S, now_ns);
	take(&tries->all, WEB_TRY_OF_ALL_S * NS_PER_S, now_ns);
	return true;
}
