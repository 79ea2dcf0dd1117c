/* SPDX-License-Identifier: GPL-3.0-or-later */
/*
 * TLS after IEC 62351-3: both sides show a certificate. OpenSSL allocates memory for each record and each handshake,
 * which nothing here can change: a station that shall never do so in its data path is built without TLS, or runs plain.
 *
 * A handshake is one call that OpenSSL goes on with: what a certificate was refused for is known in the same call.
 */
#include "modules/channel.h"

#include <openssl/err.h>
#include <openssl/x509v3.h>
#include <signal.h>
#include <stdio.h>
#include <string.h>
#include <sys/epoll.h>
#include <unistd.h>

#include "modules/tls_context.h"

#define COMMON_NAME_SIZE 65 /* X.520, ub-common-name */
#define DATE_SIZE        32

static struct iec104_station *station;
static const struct map_tls *settings;
static SSL_CTX *context;

/* What the certificate in hand was refused for. */
static struct {
	int error; /* X509_V_... */
	char name[COMMON_NAME_SIZE];
} refused;

/* ---- certificates ------------------------------------------------------------------------ */

/* The subject's common name in UTF-8, cut; empty: it has none, or there is no certificate. A name with a NUL inside is none that anybody typed. */
static void common_name(const X509 *certificate, char name[COMMON_NAME_SIZE])
{
	const X509_NAME *subject = certificate != NULL ? X509_get_subject_name(certificate) : NULL;
	int place = X509_NAME_get_index_by_NID(subject, NID_commonName, -1);
	unsigned char *utf8 = NULL;
	int length;

	name[0] = '\0';
	if (place < 0)
		return;
	length = ASN1_STRING_to_UTF8(&utf8, X509_NAME_ENTRY_get_data(X509_NAME_get_entry(subject, place)));
	if (length > 0 && memchr(utf8, '\0', (size_t)length) == NULL)
		snprintf(name, COMMON_NAME_SIZE, "%.*s", length, (const char *)utf8);
	OPENSSL_free(utf8);
}

/* As `openssl x509 -fingerprint -sha256` prints it. */
static void fingerprint(const X509 *certificate, char text[MAP_TLS_MASTER_SIZE])
{
	unsigned char digest[EVP_MAX_MD_SIZE];
	unsigned size = 0;

	X509_digest(certificate, EVP_sha256(), digest, &size);
	text[0] = '\0';
	for (unsigned i = 0; i < size; i++)
		snprintf(text + 3 * i, 4, "%02X%s", digest[i], i + 1 < size ? ":" : "");
}

static bool is_master(const X509 *certificate)
{
	char name[COMMON_NAME_SIZE], print[MAP_TLS_MASTER_SIZE];

	common_name(certificate, name);
	fingerprint(certificate, print);
	for (unsigned i = 0; i < settings->master_count && i < MAP_TLS_MASTERS_MAX; i++)
		if (strcmp(settings->masters[i], name) == 0 || strcasecmp(settings->masters[i], print) == 0)
			return true;
	return settings->master_count == 0;
}

/* OpenSSL asks for each certificate from the CA's down to the master's, at depth 0. */
static int verify(int good, X509_STORE_CTX *store)
{
	X509 *master = X509_STORE_CTX_get0_cert(store);

	if (good && X509_STORE_CTX_get_error_depth(store) == 0 && !is_master(master)) {
		X509_STORE_CTX_set_error(store, X509_V_ERR_APPLICATION_VERIFICATION);
		good = 0;
	}
	if (!good) {
		refused.error = X509_STORE_CTX_get_error(store);
		common_name(master, refused.name);
	}
	return good;
}

/* A session is resumed without a look at the certificate it began with. */
static bool has_expired(const SSL *tls)
{
	const X509 *certificate = SSL_get0_peer_certificate(tls);

	return certificate == NULL || X509_cmp_current_time(X509_get0_notAfter(certificate)) < 0;
}

/* ---- log --------------------------------------------------------------------------------- */

static const char *certificate_refusal(void)
{
	switch (refused.error) {
	case X509_V_ERR_APPLICATION_VERIFICATION:
		return "not in the list of masters";
	case X509_V_ERR_UNABLE_TO_GET_ISSUER_CERT:
	case X509_V_ERR_UNABLE_TO_GET_ISSUER_CERT_LOCALLY:
	case X509_V_ERR_UNABLE_TO_VERIFY_LEAF_SIGNATURE:
	case X509_V_ERR_SELF_SIGNED_CERT_IN_CHAIN:
	case X509_V_ERR_DEPTH_ZERO_SELF_SIGNED_CERT:
		return "certificate is of no known CA";
	default:
		return X509_verify_cert_error_string(refused.error);
	}
}

static const char *handshake_refusal(unsigned long error)
{
	if (error == 0)
		return "gone during the handshake";
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
		return "takes our certificate for expired";
	default: /* an alert of the peer is one of these */
		return ERR_reason_error_string(error);
	}
}

static void log_refusal(const struct channel *channel)
{
	const char *why = handshake_refusal(ERR_peek_last_error());

	if (refused.error != X509_V_OK)
		iec104_log(station, MAP_LOG_WARNING, channel->peer, "refused, %s: \"%s\"",
			   certificate_refusal(), refused.name);
	else
		iec104_log(station, MAP_LOG_WARNING, channel->peer, "refused, %s", why ? why : "no TLS");
}

/* A peer's wish to begin anew on its own connection was turned down; the connection goes on. */
static void log_renegotiation(const SSL *tls, int where, int what)
{
	const struct channel *channel = SSL_get_app_data(tls);

	if ((where & SSL_CB_WRITE_ALERT) == SSL_CB_WRITE_ALERT && channel != NULL &&
	    (what & 0xff) == SSL_AD_NO_RENEGOTIATION)
		iec104_log(station, MAP_LOG_WARNING, channel->peer, "renegotiation is refused");
}

static void log_greeting(const struct channel *channel)
{
	char name[COMMON_NAME_SIZE];

	common_name(SSL_get0_peer_certificate(channel->tls), name);
	iec104_log(station, MAP_LOG_INFO, channel->peer, "%s%s, \"%s\"", SSL_get_version(channel->tls),
		   SSL_session_reused(channel->tls) ? " resumed" : "", name);
}

/* ---- start ------------------------------------------------------------------------------- */

/* The masters judge it, by their own clocks: ours may be wrong. */
static void log_own_certificate(void)
{
	const X509 *certificate = SSL_CTX_get0_certificate(context);
	char name[COMMON_NAME_SIZE], until[DATE_SIZE] = "";
	struct tm end;

	common_name(certificate, name);
	if (ASN1_TIME_to_tm(X509_get0_notAfter(certificate), &end) == 1)
		strftime(until, sizeof(until), "%Y-%m-%d", &end);
	if (X509_cmp_current_time(X509_get0_notAfter(certificate)) < 0)
		map_log(station->map, MAP_LOG_WARNING, "own certificate has expired on %s: \"%s\"", until,
			name);
	else if (X509_cmp_current_time(X509_get0_notBefore(certificate)) > 0)
		map_log(station->map, MAP_LOG_WARNING, "own certificate is not yet valid: \"%s\"", name);
	else
		map_log(station->map, MAP_LOG_INFO, "TLS, own certificate until %s: \"%s\"", until, name);
}

bool channel_start(struct iec104_station *of_station)
{
	char error[TLS_ERROR_SIZE];

	station = of_station;
	settings = &of_station->config->settings.tls;
	signal(SIGPIPE, SIG_IGN); /* OpenSSL writes without MSG_NOSIGNAL */
	context = tls_context_create(settings, verify, error);
	if (context == NULL) {
		map_log(station->map, MAP_LOG_ERROR, "%s", error);
		fprintf(stderr, "rtu-iec104-tls: %s\n", error);
		return false;
	}
	SSL_CTX_set_info_callback(context, log_renegotiation);
	log_own_certificate();
	return true;
}

/* ---- the handshake ----------------------------------------------------------------------- */

enum channel_greeting channel_open(struct channel *channel, int fd, const char *peer)
{
	SSL *tls = SSL_new(context);

	*channel = (struct channel){.fd = fd, .wants = EPOLLIN, .tls = tls};
	snprintf(channel->peer, sizeof(channel->peer), "%s", peer);
	ERR_clear_error();
	if (tls != NULL && SSL_set_fd(tls, fd) == 1)
		return CHANNEL_WAITS;
	log_refusal(channel);
	return CHANNEL_REFUSED;
}

static enum channel_greeting finish_greeting(struct channel *channel)
{
	channel->wants = 0;
	if (has_expired(channel->tls)) {
		SSL_CTX_remove_session(context, SSL_get_session(channel->tls));
		refused.error = X509_V_ERR_CERT_HAS_EXPIRED;
		common_name(SSL_get0_peer_certificate(channel->tls), refused.name);
		log_refusal(channel);
		return CHANNEL_REFUSED;
	}
	log_greeting(channel);
	return CHANNEL_GREETED;
}

enum channel_greeting channel_greet(struct channel *channel)
{
	int result;

	ERR_clear_error();
	refused.error = X509_V_OK;
	refused.name[0] = '\0';
	result = SSL_accept(channel->tls);
	if (result == 1)
		return finish_greeting(channel);
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
		iec104_log(station, MAP_LOG_WARNING, channel->peer, "TLS fails: %s", reason);
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
	return SSL_pending(channel->tls) > 0;
}

ssize_t channel_transmit(struct channel *channel, const uint8_t *bytes, size_t size)
{
	uint32_t waits_for;
	int count;

	ERR_clear_error();
	count = SSL_write(channel->tls, bytes, (int)size);
	return count > 0 ? count : outcome(channel, count, &waits_for);
}

void channel_close(struct channel *channel)
{
	if (channel->tls != NULL && SSL_is_init_finished(channel->tls))
		SSL_shutdown(channel->tls);
	SSL_free(channel->tls);
	close(channel->fd);
}
