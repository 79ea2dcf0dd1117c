/* SPDX-License-Identifier: GPL-3.0-or-later */
/*
 * TLS after IEC 62351-3: both sides show a certificate. OpenSSL allocates memory for each record and each handshake,
 * which nothing here can change: a station that shall never do so in its data path is built without TLS, or runs plain.
 *
 * A handshake is one call that OpenSSL goes on with: what a certificate was refused for is known in the same call.
 */
#include "channel/channel.h"

#include <errno.h>
#include <netinet/in.h>
#include <netinet/tcp.h>
#include <openssl/err.h>
#include <signal.h>
#include <stdarg.h>
#include <stdio.h>
#include <string.h>
#include <sys/epoll.h>
#include <sys/socket.h>
#include <time.h>
#include <unistd.h>

#include "channel/bare.h"
#include "channel/tls_certificate.h"
#include "channel/tls_context.h"
#include "channel/tls_dates.h"
#include "channel/tls_files.h"
#include "map/time_ns.h"

#define FILES_NS (5 * NS_PER_S) /* how often the files are looked at */
#define LOOK_NS  NS_PER_S       /* how often a connection is */

static const struct channel_owner *owner;
static const struct channel_tls *settings;
static SSL_CTX *context;
static uint32_t readings; /* of the files; each makes a context */
static int64_t next_files_ns;

/* ---- log --------------------------------------------------------------------------------- */

static void say(enum map_log_level level, const char *peer, const char *format, ...)
    __attribute__((format(printf, 3, 4)));

static void say(enum map_log_level level, const char *peer, const char *format, ...)
{
	char text[MAP_LOG_TEXT_SIZE];
	va_list arguments;

	va_start(arguments, format);
	vsnprintf(text, sizeof(text), format, arguments);
	va_end(arguments);
	owner->say(level, peer, text);
}

static const char *handshake_refusal(unsigned long error)
{
	if (error == 0)
		return "closed the connection during the handshake";
	if (ERR_SYSTEM_ERROR(error))
		return strerror(ERR_GET_REASON(error));
	switch (ERR_GET_LIB(error) == ERR_LIB_SSL ? ERR_GET_REASON(error) : 0) {
	case SSL_R_PEER_DID_NOT_RETURN_A_CERTIFICATE:
		return "shows no certificate";
	case SSL_R_WRONG_VERSION_NUMBER:
	case SSL_R_HTTP_REQUEST:
		return "does not speak TLS";
	case SSL_R_UNSUPPORTED_PROTOCOL:
	case SSL_R_VERSION_TOO_LOW:
	case SSL_R_TLSV1_ALERT_PROTOCOL_VERSION:
		return "version of TLS is not allowed";
	case SSL_R_NO_SHARED_CIPHER:
		return "no cipher suite is allowed";
	case SSL_R_TLSV1_ALERT_UNKNOWN_CA:
		return "does not know the CA of our certificate";
	case SSL_R_SSLV3_ALERT_CERTIFICATE_EXPIRED:
		return "considers our certificate expired";
	default: /* an alert of the peer is one of these */
		return ERR_reason_error_string(error);
	}
}

static void log_refusal(const struct channel *channel)
{
	const char *alert = handshake_refusal(ERR_peek_last_error());
	char why[TLS_WHY_SIZE];

	channel_count_refused(owner);
	if (tls_refusal(why))
		say(MAP_LOG_WARNING, channel->peer, "refused, %s", why);
	else
		say(MAP_LOG_WARNING, channel->peer, "refused, %s", alert ? alert : "no TLS");
}

/* A peer's wish to begin anew on its own connection was turned down; the connection goes on. */
static void log_renegotiation(const SSL *tls, int where, int what)
{
	const struct channel *channel = SSL_get_app_data(tls);

	if ((where & SSL_CB_WRITE_ALERT) == SSL_CB_WRITE_ALERT && channel != NULL &&
	    (what & 0xff) == SSL_AD_NO_RENEGOTIATION)
		say(MAP_LOG_WARNING, channel->peer, "renegotiation is refused");
}

static void log_handshake(const struct channel *channel)
{
	char name[CHANNEL_NAME_SIZE];

	channel_name(channel, name);
	say(MAP_LOG_INFO, channel->peer, "%s%s, \"%s\"", SSL_get_version(channel->tls),
	    SSL_session_reused(channel->tls) ? " resumed" : "", name);
}

/* ---- sessions of a controlling station ----------------------------------------------------- */

void channel_forget(struct channel_station *station)
{
	SSL_SESSION_free(station->session);
	station->session = NULL;
}

/* OpenSSL's callback for each that may be resumed. 1: it is ours now. */
static int keep_session(SSL *tls, SSL_SESSION *session)
{
	struct channel *channel = SSL_get_app_data(tls);

	if (channel == NULL || channel->station == NULL)
		return 0;
	channel_forget(channel->station);
	channel->station->session = session;
	channel->station->reading = channel->reading;
	return 1;
}

/* When it began. OpenSSL 3.3 brings the one that knows times after 2038, 3.4 deprecates the other. */
static time_t begin_of(const SSL_SESSION *session)
{
#if OPENSSL_VERSION_NUMBER >= 0x30300000L
	return SSL_SESSION_get_time_ex(session);
#else
	return SSL_SESSION_get_time(session);
#endif
}

/* With other files the certificate is looked at anew; and so it is after resumption_s. */
static void resume(const struct channel *channel)
{
	struct channel_station *station = channel->station;

	if (station->session == NULL)
		return;
	if (station->reading != readings || !SSL_SESSION_is_resumable(station->session) ||
	    time(NULL) - begin_of(station->session) > settings->resumption_s)
		channel_forget(station);
	else
		SSL_set_session(channel->tls, station->session);
}

/* ---- start ------------------------------------------------------------------------------- */

/* The files are read; those of before stay in force if one of them does not do. */
static bool read_files(void)
{
	char error[TLS_ERROR_SIZE];
	SSL_CTX *fresh = tls_context_create(settings, owner->controlling, tls_verify, error);

	if (fresh == NULL) {
		say(MAP_LOG_ERROR, NULL, "%s%s", context != NULL ? "not in force: " : "", error);
		if (context == NULL) /* later, stderr may be a file, and none can be written */
			fprintf(stderr, "%s: %s\n", program_invocation_short_name, error);
		return false;
	}
	SSL_CTX_set_info_callback(fresh, log_renegotiation);
	SSL_CTX_sess_set_new_cb(fresh, keep_session);
	SSL_CTX_free(context); /* connections that began with it keep it, until they end */
	context = fresh;
	readings++;
	tls_dates_forget();
	return true;
}

void channel_renew(void)
{
	settings = owner->tls;
	tls_certificate_start(settings, owner->controlling, owner->peers);
}

bool channel_start(const struct channel_owner *of_channels)
{
	owner = of_channels;
	settings = owner->tls;
	signal(SIGPIPE, SIG_IGN); /* OpenSSL writes without MSG_NOSIGNAL */
	tls_certificate_start(settings, owner->controlling, owner->peers);
	tls_files_changed(settings); /* before they are read: what changes meanwhile is seen later */
	if (!read_files())
		return false;
	tls_dates_watch(owner->say, context, map_now_ns());
	return true;
}

void channel_watch(int64_t now_ns)
{
	if (context == NULL || now_ns < next_files_ns)
		return;
	next_files_ns = now_ns + FILES_NS;
	if (tls_files_changed(settings) && read_files())
		say(MAP_LOG_INFO, NULL, "TLS, its files have changed and are in force");
	tls_dates_watch(owner->say, context, now_ns);
}

/* ---- the handshake ----------------------------------------------------------------------- */

enum channel_progress channel_open(struct channel *channel, int fd, const char *peer)
{
	SSL *tls = SSL_new(context);

	*channel = (struct channel){.fd = fd, .wants = EPOLLIN, .tls = tls, .reading = readings};
	snprintf(channel->peer, sizeof(channel->peer), "%s", peer);
	ERR_clear_error();
	tls_refusal_clear();
	if (tls != NULL && SSL_set_fd(tls, fd) == 1) {
		SSL_set_accept_state(tls);
		return CHANNEL_WAITS;
	}
	log_refusal(channel);
	return CHANNEL_REFUSED;
}

/* The program may have no TLS in force, if none of its stations has. */
static bool set_up_client(struct channel *channel, int fd)
{
	channel->tls = context != NULL ? SSL_new(context) : NULL;
	if (channel->tls == NULL || SSL_set_fd(channel->tls, fd) != 1)
		return false;
	SSL_set_app_data(channel->tls, channel);
	SSL_set_connect_state(channel->tls);
	resume(channel);
	return true;
}

enum channel_progress channel_connect(struct channel *channel, int fd, const char *peer, bool secure,
				      struct channel_station *station)
{
	*channel = (struct channel){
	    .fd = fd, .wants = secure ? EPOLLOUT : 0, .reading = readings, .station = station};
	snprintf(channel->peer, sizeof(channel->peer), "%s", peer);
	if (!secure)
		return CHANNEL_READY;
	ERR_clear_error();
	tls_refusal_clear();
	if (set_up_client(channel, fd))
		return CHANNEL_WAITS;
	log_refusal(channel);
	return CHANNEL_REFUSED;
}

static const char *expected_of(const struct channel *channel)
{
	return channel->station != NULL ? channel->station->certificate : NULL;
}

static void renew_next_time(struct channel *channel)
{
	channel->renew_ns = map_now_ns() + settings->renewal_s * NS_PER_S;
}

/* A session is resumed without a look at the certificate it began with. */
static enum channel_progress finish_handshake(struct channel *channel)
{
	channel->wants = 0;
	renew_next_time(channel);
	if (tls_has_expired(channel->tls)) {
		SSL_CTX_remove_session(SSL_get_SSL_CTX(channel->tls), SSL_get_session(channel->tls));
		if (channel->station != NULL)
			channel_forget(channel->station);
		tls_refuse(X509_V_ERR_CERT_HAS_EXPIRED, SSL_get0_peer_certificate(channel->tls));
		log_refusal(channel);
		return CHANNEL_REFUSED;
	}
	log_handshake(channel);
	return CHANNEL_READY;
}

enum channel_progress channel_handshake(struct channel *channel)
{
	int result;

	ERR_clear_error();
	tls_refusal_clear();
	tls_expect(expected_of(channel));
	result = SSL_do_handshake(channel->tls);
	if (result == 1)
		return finish_handshake(channel);
	switch (SSL_get_error(channel->tls, result)) {
	case SSL_ERROR_WANT_READ:
		channel->wants = EPOLLIN;
		return CHANNEL_WAITS;
	case SSL_ERROR_WANT_WRITE:
		channel->wants = EPOLLOUT;
		return CHANNEL_WAITS;
	default:
		log_refusal(channel);
		return CHANNEL_REFUSED;
	}
}

/* ---- octets ------------------------------------------------------------------------------ */

/* Of a record that cannot be what the peer sent, or of what it may not ask for. */
static void log_fault(const struct channel *channel)
{
	const char *reason = ERR_reason_error_string(ERR_peek_last_error());

	if (reason != NULL)
		say(MAP_LOG_WARNING, channel->peer, "TLS fails: %s", reason);
}

/* What an operation that did not succeed means, and what it waits for: EPOLLIN or EPOLLOUT. */
static ssize_t outcome(const struct channel *channel, int result, uint32_t *waits_for)
{
	switch (SSL_get_error(channel->tls, result)) {
	case SSL_ERROR_WANT_READ:
		*waits_for = EPOLLIN;
		return 0;
	case SSL_ERROR_WANT_WRITE:
		*waits_for = EPOLLOUT;
		return 0;
	default:
		log_fault(channel);
		return -1;
	}
}

ssize_t channel_receive(struct channel *channel, uint8_t *place, size_t size)
{
	uint32_t waits_for = 0;
	ssize_t count;

	if (channel->tls == NULL)
		return bare_receive(channel->fd, place, size);
	ERR_clear_error();
	SSL_set_app_data(channel->tls, channel);
	count = SSL_read(channel->tls, place, (int)size);
	if (count <= 0)
		count = outcome(channel, (int)count, &waits_for);
	channel->wants =
	    waits_for == EPOLLOUT ? EPOLLOUT : 0; /* the peer asked for new keys, and takes no answer */
	return count;
}

bool channel_pending(const struct channel *channel)
{
	return channel->tls != NULL && SSL_pending(channel->tls) > 0;
}

/*
 * A peer that waits for its socket, and reads one message each time, would leave the rest of a longer record in its TLS:
 * lib60870 in C does so.
 */
static size_t record_size(const uint8_t *bytes, size_t size)
{
	if (owner->message != NULL)
		return (size_t)owner->message(bytes, size);
	return size < CHANNEL_RECORD_SIZE ? size : CHANNEL_RECORD_SIZE;
}

static ssize_t transmit_record(const struct channel *channel, const uint8_t *bytes, size_t size)
{
	uint32_t waits_for = 0;
	int count = SSL_write(channel->tls, bytes, (int)record_size(bytes, size));

	return count > 0 ? count : outcome(channel, count, &waits_for);
}

/* What is written meanwhile shares segments: a quarter of the processor's time when much is sent. */
static void hold_segments(const struct channel *channel, int hold)
{
	setsockopt(channel->fd, IPPROTO_TCP, TCP_CORK, &hold, sizeof(hold));
}

ssize_t channel_transmit(struct channel *channel, const uint8_t *bytes, size_t size)
{
	bool several;
	size_t sent = 0;
	ssize_t count = 1;

	if (channel->tls == NULL)
		return bare_transmit(channel->fd, bytes, size);
	ERR_clear_error();
	several = record_size(bytes, size) < size;
	if (several)
		hold_segments(channel, true);
	while (sent < size && count > 0) {
		count = transmit_record(channel, bytes + sent, size - sent);
		if (count > 0)
			sent += (size_t)count;
	}
	if (several)
		hold_segments(channel, false);
	channel->stuck = sent < size;
	return sent > 0 ? (ssize_t)sent : count;
}

/* ---- a connection that lasts ------------------------------------------------------------- */

/* False: logged; the certificate would not be let in any more. */
static bool is_still_good(struct channel *channel)
{
	char why[TLS_WHY_SIZE];

	channel->reading = readings;
	tls_expect(expected_of(channel));
	if (tls_still_good(channel->tls, context))
		return true;
	tls_refusal(why);
	say(MAP_LOG_WARNING, channel->peer, "no longer admitted: %s", why);
	return false;
}

/*
 * TLS 1.3: the station's keys are others from here on, and the peer is asked for the same; no octet waits for it.
 * TLS 1.2 would have to renegotiate. A client may ignore that (RFC 5246, 7.4.1.1) and most are built to, it would be a
 * second way through the handshake for a peer that is let in already, and what it ends in is a new connection all the
 * same: so it is ended, in order, and the peer comes back, by resumption with one round trip.
 */
static bool renew_keys(struct channel *channel)
{
	uint32_t waits_for = 0;
	int result;

	if (SSL_version(channel->tls) < TLS1_3_VERSION) {
		say(MAP_LOG_INFO, channel->peer, "its keys are as old as renewal_s");
		return false;
	}
	if (channel->stuck || channel->wants != 0) /* what is half written goes first */
		return true;
	ERR_clear_error();
	if (SSL_key_update(channel->tls, SSL_KEY_UPDATE_REQUESTED) != 1) {
		log_fault(channel);
		return false;
	}
	result = SSL_do_handshake(channel->tls);
	if (result <= 0 && outcome(channel, result, &waits_for) < 0)
		return false;
	channel->wants = waits_for == EPOLLOUT ? EPOLLOUT : 0;
	renew_next_time(channel);
	say(MAP_LOG_INFO, channel->peer, "its keys are renewed");
	return true;
}

void channel_name(const struct channel *channel, char name[CHANNEL_NAME_SIZE])
{
	tls_common_name(SSL_get0_peer_certificate(channel->tls), name);
}

bool channel_keep(struct channel *channel, int64_t now_ns)
{
	bool renews = now_ns >= channel->renew_ns;

	if (channel->tls == NULL)
		return true;
	if (now_ns < channel->look_ns && channel->reading == readings)
		return true;
	channel->look_ns = now_ns + LOOK_NS;
	if ((renews || channel->reading != readings || tls_has_expired(channel->tls)) &&
	    !is_still_good(channel))
		return false;
	return !renews || renew_keys(channel);
}

void channel_close(struct channel *channel)
{
	if (channel->tls != NULL && SSL_is_init_finished(channel->tls))
		SSL_shutdown(channel->tls);
	SSL_free(channel->tls);
	close(channel->fd);
}
