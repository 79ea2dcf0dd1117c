/* SPDX-License-Identifier: GPL-3.0-or-later */
/* Who is logged in. Time and random octets are arguments; all times are the map's. */
#ifndef OPENRTU_WEB_SESSIONS_H
#define OPENRTU_WEB_SESSIONS_H

#include "web/users.h"

#define WEB_SESSIONS_MAX  16
#define WEB_SECRET_OCTETS 32
#define WEB_SECRET_SIZE   (2 * WEB_SECRET_OCTETS + 1)
#define WEB_IDLE_S        600 /* without a request, and a session ends: the page asks while it is open */

struct web_session {
	char token[WEB_SECRET_SIZE]; /* the cookie's; empty: the place is free */
	char csrf[WEB_SECRET_SIZE];  /* what a request that changes something has to bring beside it */
	char name[WEB_USER_SIZE];
	uint8_t role;
	uint8_t hash[WEB_HASH_SIZE]; /* as the user had it in the file */
	uint32_t number;             /* of no other session of this process */
	int64_t used_ns, until_ns;
};

struct web_sessions {
	struct web_session places[WEB_SESSIONS_MAX];
	uint32_t count; /* that there were */
};

/* Begins a session of a user, in the place of the one that was used longest ago if all are taken. */
struct web_session *web_session_begin(struct web_sessions *sessions, const struct web_user *user,
				      const uint8_t random[2 * WEB_SECRET_OCTETS], int64_t now_ns,
				      uint32_t seconds);
/* The session of a cookie, which is used now; token: NULL is none. NULL: there is none, or it is over. */
struct web_session *web_session_find(struct web_sessions *sessions, const char *token, int64_t now_ns);
void web_session_end(struct web_session *session);
/* Ends the sessions of users who are not in the file any more, or have another role or password there. NULL: nobody is. */
void web_sessions_review(struct web_sessions *sessions, FILE *file);
/* In a time that does not tell how much is the same. */
bool web_same_secret(const char *known, const char *given);

#endif
