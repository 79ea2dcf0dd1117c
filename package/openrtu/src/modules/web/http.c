/* SPDX-License-Identifier: GPL-3.0-or-later */
#include "modules/web/http.h"

#include <stdlib.h>
#include <string.h>
#include <strings.h>
#include <unistd.h>

#include "modules/web/commands.h"
#include "modules/web/files.h"
#include "modules/web/lists.h"
#include "modules/web/login.h"
#include "modules/web/proposals.h"

#define REQUEST_MEMORY  8192 /* octets of a request's head and of what of its answer is written at a time */
#define SILENT_S        60   /* the front's limit comes first */
#define STEPS_A_TURN    16
#define COOKIE_SIZE     32
#define CONNECTIONS_MAX (2u * FRONTS_MAX)

struct route {
	const char *path;
	http_route *make;
	bool posted;    /* changes something: wants POST and, of a session, its token */
	bool open;      /* also to who is not logged in */
	bool long_body; /* of a configuration */
	enum web_right right;
};

static const struct route routes[] = {
    {.path = "/api/login", .make = login_begin, .posted = true, .open = true},
    {.path = "/api/logout", .make = login_end, .posted = true},
    {.path = "/api/state", .make = login_state},
    {.path = "/api/points", .make = list_points},
    {.path = "/api/commands", .make = list_commands},
    {.path = "/api/lines", .make = list_lines},
    {.path = "/api/modules", .make = list_modules},
    {.path = "/api/counters", .make = list_counters},
    {.path = "/api/events", .make = list_events},
    {.path = "/api/log", .make = list_log},
    {.path = "/api/frames", .make = list_frames},
    {.path = "/api/command", .make = command_state, .right = WEB_COMMANDS},
    {.path = "/api/order", .make = command_order, .posted = true, .right = WEB_COMMANDS},
    {.path = "/api/setup", .make = setup_state, .right = WEB_SETS_UP},
    {.path = "/api/setup/text", .make = setup_text, .right = WEB_SETS_UP},
    {.path = "/api/setup/show", .make = setup_show, .posted = true, .right = WEB_SETS_UP},
    {.path = "/api/setup/check",
     .make = setup_check,
     .posted = true,
     .long_body = true,
     .right = WEB_SETS_UP},
    {.path = "/api/setup/apply", .make = setup_apply, .posted = true, .right = WEB_SETS_UP},
    {.path = "/api/setup/confirm", .make = setup_confirm, .posted = true, .right = WEB_SETS_UP},
    {.path = "/api/setup/return", .make = setup_return, .posted = true, .right = WEB_SETS_UP},
};

static struct http_site *site;
static struct MHD_Daemon *daemon_of_http;

/* One of the library's, which may outlive its front for a turn. */
static struct connection {
	bool used;
	unsigned front;
	struct in6_addr peer;
	struct http_request request;
} connections[CONNECTIONS_MAX];

/* ---- who may ----------------------------------------------------------------------------- */

static const char *header(const struct http_request *request, const char *name)
{
	return MHD_lookup_connection_value(request->connection, MHD_HEADER_KIND, name);
}

static void find_session(struct http_request *request)
{
	char name[COOKIE_SIZE];

	login_review(site);
	login_cookie_name(site, name, sizeof(name));
	request->session = web_session_find(
	    &site->sessions, MHD_lookup_connection_value(request->connection, MHD_COOKIE_KIND, name),
	    site->now_ns);
}

/* A form of another site cannot say that it is JSON, nor know the token. */
static bool is_of_the_page(const struct http_request *request)
{
	const char *type = header(request, MHD_HTTP_HEADER_CONTENT_TYPE);
	const char *token = header(request, "X-CSRF-Token");

	if (type == NULL || strcmp(type, "application/json") != 0)
		return false;
	return request->session == NULL || (token != NULL && web_same_secret(request->session->csrf, token));
}

/* True: it is said why not. */
static bool refuse(const struct route *route, struct http_request *request, struct http_answer *answer)
{
	find_session(request);
	if (route->open)
		request->session = NULL; /* who logs in is nobody yet */
	if (!route->open && request->session == NULL)
		*answer = answer_refusal(MHD_HTTP_UNAUTHORIZED, "login", "log in first");
	else if (route->posted && !is_of_the_page(request))
		*answer = answer_refusal(MHD_HTTP_FORBIDDEN, "csrf",
					 "this did not come from the page: load it again");
	else if (request->session != NULL && !web_role_may(request->session->role, route->right))
		*answer = answer_refusal(MHD_HTTP_FORBIDDEN, "role", "your role may not do this");
	else if (route->right == WEB_SETS_UP && !site->settings->setup)
		*answer = answer_refusal(
		    MHD_HTTP_FORBIDDEN, "off",
		    "set-up is off: \"setup\": true in \"web\" lets installers change the configuration");
	else
		return false;
	return true;
}

static struct http_answer answer_to(const struct route *route, struct http_request *request)
{
	struct http_answer answer;

	return refuse(route, request, &answer) ? answer : route->make(site, request);
}

/* ---- the library's side ------------------------------------------------------------------ */

static struct connection *connection_of(struct MHD_Connection *connection)
{
	return MHD_get_connection_info(connection, MHD_CONNECTION_INFO_SOCKET_CONTEXT)->socket_context;
}

static enum MHD_Result queue(struct MHD_Connection *connection, struct http_answer answer)
{
	static const char *const headers[][2] = {
	    {"Content-Security-Policy",
	     "default-src 'none'; script-src 'self'; style-src 'self'; img-src 'self'; connect-src 'self'; "
	     "form-action 'none'; base-uri 'none'; frame-ancestors 'none'"},
	    {"X-Content-Type-Options", "nosniff"},
	    {"X-Frame-Options", "DENY"},
	    {"Referrer-Policy", "no-referrer"},
	    {"Cross-Origin-Resource-Policy", "same-origin"},
	    {"Cache-Control", "no-store"},
	};
	enum MHD_Result result;

	if (answer.response == NULL)
		return MHD_NO;
	if (answer.status >= MHD_HTTP_BAD_REQUEST)
		map_count(&site->stats->counters[WEB_COUNT_DENIED], 1);
	for (unsigned i = 0; i < sizeof(headers) / sizeof(headers[0]); i++)
		MHD_add_response_header(answer.response, headers[i][0], headers[i][1]);
	front_answering(connection_of(connection)->front);
	result = MHD_queue_response(connection, answer.status, answer.response);
	MHD_destroy_response(answer.response);
	return result;
}

static const struct route *find_route(const char *path)
{
	for (unsigned i = 0; i < sizeof(routes) / sizeof(routes[0]); i++)
		if (strcmp(routes[i].path, path) == 0)
			return &routes[i];
	return NULL;
}

static struct http_answer answer_with_file(const char *path)
{
	const struct web_file *file = web_file_find(path);
	struct http_answer answer = {.status = MHD_HTTP_OK};

	if (file == NULL)
		return answer_refusal(MHD_HTTP_NOT_FOUND, "unknown", "there is no such page");
	answer.response = MHD_create_response_from_buffer(file->size, (void *)(uintptr_t)file->octets,
							  MHD_RESPMEM_PERSISTENT);
	MHD_add_response_header(answer.response, MHD_HTTP_HEADER_CONTENT_TYPE, file->type);
	if (file->packed != NULL)
		MHD_add_response_header(answer.response, MHD_HTTP_HEADER_CONTENT_ENCODING, file->packed);
	return answer;
}

static bool is_reading(const char *method)
{
	return strcmp(method, MHD_HTTP_METHOD_GET) == 0 || strcmp(method, MHD_HTTP_METHOD_HEAD) == 0;
}

static struct http_answer wrong_method(const char *allowed)
{
	struct http_answer answer =
	    answer_refusal(MHD_HTTP_METHOD_NOT_ALLOWED, "method", "not by this method");

	if (answer.response != NULL)
		MHD_add_response_header(answer.response, MHD_HTTP_HEADER_ALLOW, allowed);
	return answer;
}

static enum MHD_Result count_length(void *count, enum MHD_ValueKind kind, const char *name, const char *value)
{
	(void)kind, (void)value;
	*(unsigned *)count += strcasecmp(name, MHD_HTTP_HEADER_CONTENT_LENGTH) == 0 ||
			      strcasecmp(name, MHD_HTTP_HEADER_TRANSFER_ENCODING) == 0;
	return MHD_YES;
}

/* RFC 9112, 6.3: where its body ends, somebody before us may see otherwise. */
static bool has_two_lengths(const struct http_request *request)
{
	unsigned count = 0;

	MHD_get_connection_values(request->connection, MHD_HEADER_KIND, count_length, &count);
	return count > 1;
}

static struct http_answer refuse_two_lengths(void)
{
	struct http_answer answer = answer_refusal(MHD_HTTP_BAD_REQUEST, "length", "it has two lengths");

	if (answer.response != NULL)
		MHD_add_response_header(answer.response, MHD_HTTP_HEADER_CONNECTION, "close");
	return answer;
}

/* What can be said before its body has come. True: it is said. */
static bool refuse_early(const struct route *route, const char *method, struct http_request *request,
			 struct http_answer *answer)
{
	const char *length = header(request, MHD_HTTP_HEADER_CONTENT_LENGTH);

	if (has_two_lengths(request)) {
		*answer = refuse_two_lengths();
	} else if (route == NULL || !route->posted) {
		if (is_reading(method))
			return false;
		*answer = wrong_method("GET, HEAD");
	} else if (strcmp(method, MHD_HTTP_METHOD_POST) != 0) {
		*answer = wrong_method("POST");
	} else if (length == NULL) {
		*answer = answer_refusal(MHD_HTTP_LENGTH_REQUIRED, "length", "how long is it?");
	} else if (strtoul(length, NULL, 10) > (route->long_body ? SETUP_TEXT_MAX : HTTP_BODY_MAX)) {
		*answer = answer_refusal(MHD_HTTP_CONTENT_TOO_LARGE, "length", "too long");
	} else if (route->long_body) {
		return refuse(route, request, answer); /* of who may not, no long body is taken */
	} else {
		return false;
	}
	return true;
}

static enum MHD_Result handle(void *cls, struct MHD_Connection *connection, const char *path,
			      const char *method, const char *version, const char *upload,
			      size_t *upload_size, void **context)
{
	const struct route *route = find_route(path);
	struct http_request *request = *context;
	struct http_answer answer;

	(void)cls, (void)version;
	if (request == NULL) {
		struct connection *own = connection_of(connection);

		if (own == NULL)
			return MHD_NO;
		*context = request = &own->request;
		*request = (struct http_request){.connection = connection, .peer = own->peer};
		map_count(&site->stats->counters[WEB_COUNT_REQUESTS], 1);
		return refuse_early(route, method, request, &answer) ? queue(connection, answer) : MHD_YES;
	}
	if (*upload_size > 0 && route->long_body) {
		if (!setup_take_piece(site, request, upload, *upload_size))
			return MHD_NO;
		*upload_size = 0;
		return MHD_YES;
	}
	if (*upload_size > 0) {
		if (*upload_size > sizeof(request->body) - request->size)
			return MHD_NO; /* more than it has announced */
		memcpy(request->body + request->size, upload, *upload_size);
		request->size += *upload_size;
		*upload_size = 0;
		return MHD_YES;
	}
	return queue(connection, route == NULL ? answer_with_file(path) : answer_to(route, request));
}

static void completed(void *cls, struct MHD_Connection *connection, void **context,
		      enum MHD_RequestTerminationCode why)
{
	(void)cls;
	if (why == MHD_REQUEST_TERMINATED_COMPLETED_OK)
		front_answered(connection_of(connection)->front, site->now_ns);
	if (*context != NULL)
		setup_forget(*context);
	if (*context != NULL)
		explicit_bzero(*context, sizeof(struct http_request)); /* it may have had a password */
	*context = NULL;
}

static void connected(void *cls, struct MHD_Connection *connection, void **context,
		      enum MHD_ConnectionNotificationCode what)
{
	const struct sockaddr_in6 *from;
	struct connection *own = *context;

	(void)cls;
	if (what == MHD_CONNECTION_NOTIFY_CLOSED) {
		if (own != NULL)
			own->used = false;
		return;
	}
	from = (const void *)MHD_get_connection_info(connection, MHD_CONNECTION_INFO_CLIENT_ADDRESS)
		   ->client_addr;
	for (unsigned i = 0; i < CONNECTIONS_MAX; i++)
		if (!connections[i].used) {
			*context = &connections[i];
			connections[i] = (struct connection){
			    .used = true, .front = from->sin6_port, .peer = from->sin6_addr};
			return;
		}
}

bool http_take(int fd, unsigned number, const struct in6_addr *peer)
{
	/* The library tells of the connection when it likes to; what it keeps of it says which it is. */
	const struct sockaddr_in6 from = {
	    .sin6_family = AF_INET6, .sin6_addr = *peer, .sin6_port = (in_port_t)number};

	return MHD_add_connection(daemon_of_http, fd, (const struct sockaddr *)&from, sizeof(from)) ==
	       MHD_YES;
}

bool http_begin(struct http_site *of)
{
	site = of;
	daemon_of_http =
	    MHD_start_daemon(MHD_USE_EPOLL | MHD_USE_NO_LISTEN_SOCKET, 0, NULL, NULL, handle, NULL,
			     MHD_OPTION_CONNECTION_LIMIT, CONNECTIONS_MAX, MHD_OPTION_CONNECTION_MEMORY_LIMIT,
			     (size_t)REQUEST_MEMORY, MHD_OPTION_CONNECTION_MEMORY_INCREMENT, (size_t)1024,
			     MHD_OPTION_CONNECTION_TIMEOUT, (unsigned)SILENT_S, MHD_OPTION_STRICT_FOR_CLIENT,
			     1, MHD_OPTION_NOTIFY_CONNECTION, connected, NULL, MHD_OPTION_NOTIFY_COMPLETED,
			     completed, NULL, MHD_OPTION_END);
	return daemon_of_http != NULL;
}

int http_fd(void)
{
	return MHD_get_daemon_info(daemon_of_http, MHD_DAEMON_INFO_EPOLL_FD)->epoll_fd;
}

bool http_serve(void)
{
	MHD_UNSIGNED_LONG_LONG wait_ms = 0;

	for (int i = 0; i < STEPS_A_TURN; i++) {
		MHD_run(daemon_of_http);
		if (MHD_get_timeout(daemon_of_http, &wait_ms) != MHD_YES || wait_ms > 0)
			return true;
	}
	return false;
}

void http_end(void)
{
	MHD_stop_daemon(daemon_of_http);
}
