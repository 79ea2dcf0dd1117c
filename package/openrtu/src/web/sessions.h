/* SPDX-License-Identifier: GPL-3.0-or-later */
/* Who is logged in, and how often somebody has tried to. Time and random octets are arguments; all times are the map's. */
#ifndef OPENRTU_WEB_SESSIONS_H
#define OPENRTU_WEB_SESSIONS_H

#include <netinet/in.h>

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
	uint32_t number; /* of no other session of this process */
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
/* In a time that does not tell how much is the same. */
bool web_same_secret(const char *known, const char *given);

/* ---- tries to log in --------------------------------------------------------------------- */

#define WEB_TRIES         5  /* at once from one address */
#define WEB_TRY_S         12 /* another one after so long */
#define WEB_TRIES_OF_ALL  20 /* the same of all addresses together */
#define WEB_TRY_OF_ALL_S  3
#define WEB_ADDRESSES_MAX 32

/* Full while it is as long ago that it was filled as that takes. */
struct web_bucket {
	struct in6_addr address;
	int64_t full_ns; /* when it is full */
};

struct web_tries {
	struct web_bucket of[WEB_ADDRESSES_MAX];
	struct web_bucket all;
};

/* True: this address may try now, which is counted. False: after *wait_s. */
bool web_may_try(struct web_tries *tries, const struct in6_addr *address, int64_t now_ns, unsigned *wait_s);

#endif
