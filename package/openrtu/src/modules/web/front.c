/* SPDX-License-Identifier: GPL-3.0-or-later */
#include "modules/web/front.h"

#include <errno.h>
#include <netinet/tcp.h>
#include <openssl/err.h>
#include <string.h>
#include <sys/socket.h>
#include <unistd.h>

#include "channel/tls_context.h"
#include "channel/tls_files.h"
#include "map/address.h"

#define PIPE_SIZE          4096
#define ROUNDS             8 /* of one connection before the others have their turn */
#define CONNECTIONS_A_TURN 8
#define RESUMPTION_S       3600
#define FILES_NS           (5 * NS_PER_S) /* between two looks at the certificate */

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
	bool answering;   /* a request's answer is on its way */
	struct octets in, out;
	struct in6_addr peer;
	int64_t deadline_ns;
};

static struct front fronts[FRONTS_MAX];
static struct map *map;
static const struct web_settings *settings;
static struct web_stats *stats;
static front_taker *taker;
static struct channel_tls tls = {.versions = CHANNEL_TLS_1_2 | CHANNEL_TLS_1_3, .resumption_s = RESUMPTION_S};
static SSL_CTX *context;
static int64_t next_files_ns;
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

/*
 * libmicrohttpd 0.9.75 writes the head of its own refusal twice when it is a header that it does not like. Nothing else follows
 * a head that says close but its body, which is never a head.
 */
static void leave_second_head(struct octets *octets)
{
	static const char close_[] = "\r\nConnection: close\r\n", version[] = "HTTP/1.1 ";
	const uint8_t *head = octets->octets + octets->begin;
	const size_t size = octets->end - octets->begin;
	const uint8_t *end = memmem(head, size, "\r\n\r\n", 4);
	size_t length;

	if (end == NULL)
		return;
	length = (size_t)(end - head) + 4;
	if (size - length >= sizeof(version) - 1 && memcmp(head, version, sizeof(version) - 1) == 0 &&
	    memcmp(head + length, version, sizeof(version) - 1) == 0 &&
	    memmem(head, length, close_, sizeof(close_) - 1) != NULL)
		octets->begin += length;
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
		leave_second_head(&front->out);
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

static void late(struct front *front)
{
	count(WEB_COUNT_LATE);
	end(front);
}

static bool shake_hands(struct front *front, int64_t now_ns)
{
	const ssize_t result = of_tls(front, SSL_accept(front->tls));

	front->ready = result > 0;
	if (front->ready)
		front->deadline_ns = now_ns + FRONT_LATE_S * NS_PER_S;
	if (result < 0) {
		count(WEB_COUNT_DAMAGED);
		end(front);
	}
	return front->ready;
}

static void carry(struct front *front, int64_t now_ns)
{
	bool more = true;

	if (!front->ready && !shake_hands(front, now_ns))
		return;
	for (unsigned i = 0; i < ROUNDS && more; i++) {
		more = carry_in(front);
		more |= carry_out(front);
	}
	if (front->told && is_empty(&front->out))
		end(front);
}

/* ---- who comes --------------------------------------------------------------------------- */

static bool is_of(const struct front *front, const struct in6_addr *peer)
{
	return front->outer >= 0 && memcmp(&front->peer, peer, sizeof(*peer)) == 0;
}

static unsigned count_of(const struct in6_addr *peer)
{
	unsigned count = 0;

	for (unsigned i = 0; i < FRONTS_MAX; i++)
		count += is_of(&fronts[i], peer);
	return count;
}

/* Who waits for no answer, of the address that has most; of these the one without a handshake, or silent, for longest. */
static bool gives_way_before(const struct front *a, const struct front *b)
{
	const unsigned of_a = count_of(&a->peer), of_b = count_of(&b->peer);

	if (of_a != of_b)
		return of_a > of_b;
	if (a->ready != b->ready)
		return !a->ready;
	return a->deadline_ns < b->deadline_ns;
}

/* Of an address; NULL: of any. False: all wait for their answers. */
static bool give_way(const struct in6_addr *peer)
{
	struct front *least = NULL;

	for (unsigned i = 0; i < FRONTS_MAX; i++) {
		struct front *front = &fronts[i];

		if (front->outer >= 0 && !front->answering && (peer == NULL || is_of(front, peer)) &&
		    (least == NULL || gives_way_before(front, least)))
			least = front;
	}
	if (least != NULL)
		late(least);
	return least != NULL;
}

static struct front *free_place(void)
{
	for (unsigned i = 0; i < FRONTS_MAX; i++)
		if (fronts[i].outer < 0)
			return &fronts[i];
	return NULL;
}

/* The newest comes before those that are silent: of its own address, if that has all it may have. */
static struct front *place_for(const struct in6_addr *peer)
{
	struct front *place;

	if (settings->client_count > 0 &&
	    map_address_place(settings->clients, settings->client_count, peer) == settings->client_count)
		return NULL;
	if (count_of(peer) >= FRONTS_OF_ADDRESS)
		return give_way(peer) ? free_place() : NULL;
	place = free_place();
	return place == NULL && give_way(NULL) ? free_place() : place;
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
	front->deadline_ns = now_ns + (context != NULL ? FRONT_HANDSHAKE_S : FRONT_LATE_S) * NS_PER_S;
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

/* The files of the settings; a browser shows no certificate. Those of before stay in force if one of them does not do. */
static bool read_files(void)
{
	char error[TLS_ERROR_SIZE];
	SSL_CTX *fresh = tls_context_create(&tls, false, NULL, error);

	if (fresh == NULL) {
		map_log(map, MAP_LOG_ERROR, "%s%s", context != NULL ? "not in force: " : "", error);
		return false;
	}
	SSL_CTX_free(context); /* connections that began with it keep it, until they end */
	context = fresh;
	return true;
}

static void watch_files(int64_t now_ns)
{
	if (context == NULL || now_ns < next_files_ns)
		return;
	next_files_ns = now_ns + FILES_NS;
	if (tls_files_changed(&tls) && read_files())
		map_log(map, MAP_LOG_INFO, "the page's certificate has changed and is in force");
}

void front_serve(const struct pollfd waits[FRONT_POLLS], int64_t now_ns)
{
	watch_files(now_ns);
	for (unsigned i = 0; i < FRONTS_MAX; i++) {
		struct front *front = &fronts[i];

		if (front->outer < 0)
			continue;
		carry(front, now_ns);
		if (front->outer >= 0 && now_ns >= front->deadline_ns)
			late(front);
	}
	for (int i = 0; (waits[0].revents & POLLIN) && i < CONNECTIONS_A_TURN; i++)
		if (!accept_one(now_ns))
			break;
}

void front_renew(const struct web_settings *of_file)
{
	settings = of_file;
}

void front_answering(unsigned number)
{
	if (number < FRONTS_MAX)
		fronts[number].answering = true;
}

void front_answered(unsigned number, int64_t now_ns)
{
	if (number >= FRONTS_MAX)
		return;
	fronts[number].answering = false;
	fronts[number].deadline_ns = now_ns + FRONT_LATE_S * NS_PER_S;
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
	snprintf(tls.certificate, sizeof(tls.certificate), "%s", settings->certificate);
	snprintf(tls.key, sizeof(tls.key), "%s", settings->key);
	tls_files_changed(&tls); /* before they are read: what changes meanwhile is seen later */
	return read_files();
}
