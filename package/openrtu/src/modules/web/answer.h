/* SPDX-License-Identifier: GPL-3.0-or-later */
/* A request that has come, what its answer is made of, and the answer. */
#ifndef OPENRTU_MODULES_WEB_ANSWER_H
#define OPENRTU_MODULES_WEB_ANSWER_H

#include <jansson.h>
#include <microhttpd.h>

#include "map/map.h"
#include "web/config.h"
#include "web/sessions.h"
#include "web/stats.h"
#include "web/tries.h"

#define HTTP_BODY_MAX 512

/* A request that has come wholly. */
struct http_request {
	struct MHD_Connection *connection;
	struct in6_addr peer;
	struct web_session *session; /* NULL: nobody is logged in */
	char body[HTTP_BODY_MAX];
	size_t size;
};

/* What an answer is made of; of the whole process. */
struct http_site {
	struct map *map;
	const char *map_folder;
	const struct web_settings *settings;
	struct web_stats *stats;
	struct web_sessions sessions;
	struct web_tries tries;
	struct web_used used[WEB_STEPS_MAX];
	int64_t reviewed_ns; /* when the file of users was looked at last */
	bool no_users;       /* and could not be read */
	int64_t now_ns;
};

/* An answer that a route makes. */
struct http_answer {
	unsigned status;
	struct MHD_Response *response; /* NULL: there is no memory */
};
typedef struct http_answer http_route(struct http_site *site, struct http_request *request);

/* A row of JSON as an answer, which it takes over. */
struct http_answer answer_json(unsigned status, json_t *row);
/* Why not, for the page: a word, and a sentence. */
struct http_answer answer_refusal(unsigned status, const char *why, const char *text);
/* A number of the request's query; fallback: it has none, or none up to most. */
uint32_t request_number(const struct http_request *request, const char *key, uint32_t most,
			uint32_t fallback);
/* A text of it; empty: there is none. */
const char *request_text(const struct http_request *request, const char *key);

#endif
