/* SPDX-License-Identifier: GPL-3.0-or-later */
#include "modules/web/front.h"

#include <errno.h>
#include <netinet/tcp.h>
#include <openssl/err.h>
#include <string.h>
#include <sys/socket.h>
#include <unistd.h>

#include "channel/tls_context.h"
#include "map/address.h"

#define PIPE_SIZE          4096
#define ROUNDS             8 /* of one connection before the others have their turn */
#define CONNECTIONS_A_TURN 8
#define RESUMPTION_S       3600

struct octets {
	uint8_t octets[PIPE_SIZE];
	size_t begin, end;
};

struct front {
	int outer, inner; /* -1: it is free */
	SSL *tls;         /* NULL: without */
	bool ready;       /* the handshake is over */
	bool wants_write; /* TLS cannot go on before that */
	bool asked, told; /* one side, or the library, has said its last */
	struct octets in, out;
	struct in6_addr peer;
	int64_t deadline_ns;
};

static struct front fronts[FRONTS_MAX];
static struct map *map;
static const struct web_settings *settings;
static struct web_stats *stats;
static front_taker *taker;
static SSL_CTX *context;
static int listener;

static void count(enum web_counter counter)
{
	map_count(&stats->counters[counter], 1);
}

static void end(struct front *front)
{
	if (front->tls != NULL && front->ready)
		SSL_shutdown(front->tls);
	SSL_free(front->tls);
	ERR_clear_error();
	close(front->inner);
	close(front->outer);
	front->tls = NULL;
	front->outer = front->inner = -1;
}

/* ---- octets ------------------------------------------------------------------------------ */

/* -1: the connection is over; 0: none now. */
static ssize_t of_tls(struct front *front, int result)
{
	const int error = SSL_get_error(front->tls, result);

	ERR_clear_error();
	front->wants_write = error == SSL_ERROR_WANT_WRITE;
	if (result > 0)
		return result;
	return error == SSL_ERROR_WANT_READ || error == SSL_ERROR_WANT_WRITE ? 0 : -1;
}

static ssize_t of_socket(ssize_t result)
{
	if (result > 0)
		return result;
	return result < 0 && (errno == EAGAIN || errno == EINTR) ? 0 : -1;
}

static ssize_t receive(struct front *front)
{
	ssize_t result;

	if (front->tls != NULL)
		result = of_tls(front, SSL_read(front->tls, front->in.octets, PIPE_SIZE));
	else
		result = of_socket(recv(front->outer, front->in.octets, PIPE_SIZE, 0));
	return result;
}

static ssize_t transmit(struct front *front)
{
	const uint8_t *octets = front->out.octets + front->out.begin;
	const size_t size = front->out.end - front->out.begin;

	if (front->tls != NULL)
		return of_tls(front, SSL_write(front->tls, octets, (int)size));
	return of_socket(send(front->outer, octets, size, MSG_NOSIGNAL));
}

static bool is_empty(const struct octets *octets)
{
	return octets->begin == octets->end;
}

static void filled(struct octets *octets, ssize_t size)
{
	octets->begin = 0;
	octets->end = (size_t)size;
}

/* Towards the library. True: something went on. */
static bool carry_in(struct front *front)
{
	ssize_t went;

	if (is_empty(&front->in)) {
		went = front->asked ? 0 : receive(front);
		if (went < 0) {
			front->asked = true;
			shutdown(front->inner, SHUT_WR);
		}
		if (went <= 0)
			return false;
		filled(&front->in, went);
	}
	went = of_socket(send(front->inner, front->in.octets + front->in.begin,
			      front->in.end - front->in.begin, MSG_NOSIGNAL));
	if (went < 0)
		filled(&front->in, 0); /* the library takes no more: what it has said still goes out */
	else
		front->in.begin += (size_t)went;
	return went > 0;
}

/* Towards the browser. True: something went on. False with told: all is said. */
static bool carry_out(struct front *front)
{
	ssize_t went;

	if (is_empty(&front->out)) {
		went = front->told ? 0 : of_socket(recv(front->inner, front->out.octets, PIPE_SIZE, 0));
		front->told |= went < 0;
		if (went <= 0)
			return false;
		filled(&front->out, went);
	}
	went = transmit(front);
	if (went < 0) {
		filled(&front->out, 0);
		front->told = true;
		return false;
	}
	front->out.begin += (size_t)went;
	return went > 0;
}

static bool shake_hands(struct front *front)
{
	const ssize_t result = of_tls(front, SSL_accept(front->tls));

	front->ready = result > 0;
	if (result < 0) {
		count(WEB_COUNT_DAMAGED);
		end(front);
	}
	return front->ready;
}

static void carry(struct front *front)
{
	bool more = true;

	if (!front->ready && !shake_hands(front))
		return;
	for (unsigned i = 0; i < ROUNDS && more; i++) {
		more = carry_in(front);
		more |= carry_out(front);
	}
	if (front->told && is_empty(&front->out))
		end(front);
}

/* ---- who comes --------------------------------------------------------------------------- */

static struct front *place_for(const struct in6_addr *peer)
{
	struct front *place = NULL;
	unsigned of_peer = 0;

	if (settings->client_count > 0 &&
	    map_address_place(settings->clients, settings->client_count, peer) == settings->client_count)
		return NULL;
	for (unsigned i = 0; i < FRONTS_MAX; i++) {
		if (fronts[i].outer < 0)
			place = &fronts[i];
		else if (memcmp(&fronts[i].peer, peer, sizeof(*peer)) == 0)
			of_peer++;
	}
	return of_peer < FRONTS_OF_ADDRESS ? place : NULL;
}

static bool begin_tls(struct front *front)
{
	front->ready = context == NULL;
	if (context == NULL)
		return true;
	front->tls = SSL_new(context);
	return front->tls != NULL && SSL_set_fd(front->tls, front->outer) == 1 &&
	       (SSL_set_accept_state(front->tls), true);
}

static void open_front(struct front *front, int fd, const struct in6_addr *peer, int64_t now_ns)
{
	const int on = 1;
	int pair[2];

	setsockopt(fd, IPPROTO_TCP, TCP_NODELAY, &on, sizeof(on));
	if (socketpair(AF_UNIX, SOCK_STREAM | SOCK_NONBLOCK | SOCK_CLOEXEC, 0, pair) < 0) {
		close(fd);
		return;
	}
	*front = (struct front){.outer = fd, .inner = pair[0], .peer = *peer};
	front->deadline_ns = now_ns + FRONT_LATE_S * NS_PER_S;
	if (!taker(pair[1], (unsigned)(front - fronts), peer) || !begin_tls(front))
		end(front);
}

/* False: none is waiting. */
static bool accept_one(int64_t now_ns)
{
	struct sockaddr_storage from;
	socklen_t size = sizeof(from);
	const int fd = accept4(listener, (struct sockaddr *)&from, &size, SOCK_NONBLOCK | SOCK_CLOEXEC);
	struct front *place;
	struct in6_addr peer;

	if (fd < 0)
		return errno == ECONNABORTED;
	peer = map_address_of(&from);
	place = place_for(&peer);
	count(place == NULL ? WEB_COUNT_REFUSED : WEB_COUNT_CONNECTIONS);
	if (place == NULL)
		close(fd);
	else
		open_front(place, fd, &peer, now_ns);
	return true;
}

/* ---- the loop's -------------------------------------------------------------------------- */

static void wait_of(const struct front *front, struct pollfd waits[2])
{
	short outer = 0, inner = 0;

	if (!front->ready) {
		outer = front->wants_write ? POLLOUT : POLLIN;
	} else {
		outer |= is_empty(&front->in) && !front->asked ? POLLIN : 0;
		outer |= !is_empty(&front->out) || front->wants_write ? POLLOUT : 0;
		inner |= is_empty(&front->out) ? POLLIN : 0;
		inner |= !is_empty(&front->in) ? POLLOUT : 0;
	}
	/* A socket that nothing is wanted of tells of its end all the same. */
	waits[0] = (struct pollfd){.fd = outer != 0 ? front->outer : -1, .events = outer};
	waits[1] = (struct pollfd){.fd = inner != 0 ? front->inner : -1, .events = inner};
}

bool front_wait(struct pollfd waits[FRONT_POLLS])
{
	bool pending = false;

	waits[0] = (struct pollfd){.fd = listener, .events = POLLIN};
	for (unsigned i = 0; i < FRONTS_MAX; i++) {
		const struct front *front = &fronts[i];

		wait_of(front, &waits[1 + 2 * i]);
		if (front->outer >= 0 && front->ready && front->tls != NULL && is_empty(&front->in))
			pending |= !front->asked && SSL_pending(front->tls) > 0;
	}
	return pending;
}

void front_serve(const struct pollfd waits[FRONT_POLLS], int64_t now_ns)
{
	for (unsigned i = 0; i < FRONTS_MAX; i++) {
		struct front *front = &fronts[i];

		if (front->outer < 0)
			continue;
		carry(front);
		if (front->outer >= 0 && now_ns >= front->deadline_ns) {
			count(WEB_COUNT_LATE);
			end(front);
		}
	}
	for (int i = 0; (waits[0].revents & POLLIN) && i < CONNECTIONS_A_TURN; i++)
		if (!accept_one(now_ns))
			break;
}

void front_renew(const struct web_settings *of_file)
{
	settings = of_file;
}

void front_answered(unsigned number, int64_t now_ns)
{
	if (number < FRONTS_MAX)
		fronts[number].deadline_ns = now_ns + FRONT_LATE_S * NS_PER_S;
}

/* A browser shows no certificate. */
static SSL_CTX *make_context(void)
{
	struct channel_tls tls = {.versions = CHANNEL_TLS_1_2 | CHANNEL_TLS_1_3,
				  .resumption_s = RESUMPTION_S};
	char error[TLS_ERROR_SIZE];
	SSL_CTX *made;

	snprintf(tls.certificate, sizeof(tls.certificate), "%s", settings->certificate);
	snprintf(tls.key, sizeof(tls.key), "%s", settings->key);
	made = tls_context_create(&tls, false, NULL, error);
	if (made == NULL)
		map_log(map, MAP_LOG_ERROR, "%s", error);
	return made;
}

bool front_begin(struct map *of_map, const struct web_settings *of_file, struct web_stats *counters, int fd,
		 front_taker *take)
{
	map = of_map;
	settings = of_file;
	stats = counters;
	listener = fd;
	taker = take;
	for (unsigned i = 0; i < FRONTS_MAX; i++)
		fronts[i].outer = fronts[i].inner = -1;
	if (settings->certificate[0] == '\0')
		return true;
	context = make_context();
	return context != NULL;
}
