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
	memcpy(place->hash, user->hash, sizeof(place->hash));
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

void web_sessions_review(struct web_sessions *sessions, FILE *file)
{
	struct web_user user;
	unsigned wrong;

	for (unsigned i = 0; i < WEB_SESSIONS_MAX; i++) {
		struct web_session *session = &sessions->places[i];

		if (session->token[0] == '\0')
			continue;
		if (file != NULL)
			rewind(file);
		if (file == NULL || !web_user_find(file, session->name, &user, &wrong) ||
		    user.role != session->role || memcmp(user.hash, session->hash, sizeof(user.hash)) != 0)
			web_session_end(session);
	}
}
