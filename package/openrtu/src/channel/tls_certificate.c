/* SPDX-License-Identifier: GPL-3.0-or-later */
#include "channel/tls_certificate.h"

#include <openssl/err.h>
#include <openssl/x509v3.h>
#include <stdio.h>
#include <string.h>
#include <strings.h>
#include <time.h>

static const struct channel_tls *settings;
static bool is_client;
static const char *peers;
static const char *expected;

static struct {
	int error; /* X509_V_... */
	char name[CHANNEL_NAME_SIZE];
} refused;

void tls_certificate_start(const struct channel_tls *of_settings, bool controlling, const char *of_peers)
{
	peers = of_peers;
	settings = of_settings;
	is_client = controlling;
}

void tls_expect(const char *name)
{
	expected = name;
}

/* ---- what is in it ----------------------------------------------------------------------- */

/* A name with a NUL inside is none that anybody typed. */
void tls_common_name(const X509 *certificate, char name[CHANNEL_NAME_SIZE])
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
		snprintf(name, CHANNEL_NAME_SIZE, "%.*s", length, (const char *)utf8);
	OPENSSL_free(utf8);
}

void tls_date(const ASN1_TIME *time, char text[TLS_DATE_SIZE])
{
	struct tm parts;

	text[0] = '\0';
	if (ASN1_TIME_to_tm(time, &parts) == 1)
		strftime(text, TLS_DATE_SIZE, "%Y-%m-%d", &parts);
}

/* As `openssl x509 -fingerprint -sha256` prints it. */
static void fingerprint(const X509 *certificate, char text[CHANNEL_TLS_PEER_SIZE])
{
	unsigned char digest[EVP_MAX_MD_SIZE];
	unsigned size = 0;

	X509_digest(certificate, EVP_sha256(), digest, &size);
	text[0] = '\0';
	for (unsigned i = 0; i < size; i++)
		snprintf(text + 3 * i, CHANNEL_TLS_PEER_SIZE - 3 * i, "%02X%s", digest[i],
			 i + 1 < size ? ":" : "");
}

/* ---- whether it is good ------------------------------------------------------------------ */

static bool is_peer(const X509 *certificate)
{
	char name[CHANNEL_NAME_SIZE], print[CHANNEL_TLS_PEER_SIZE];

	tls_common_name(certificate, name);
	fingerprint(certificate, print);
	if (expected != NULL)
		return strcmp(expected, name) == 0 || strcasecmp(expected, print) == 0;
	for (unsigned i = 0; i < settings->peer_count && i < CHANNEL_TLS_PEERS_MAX; i++)
		if (strcmp(settings->peers[i], name) == 0 || strcasecmp(settings->peers[i], print) == 0)
			return true;
	return settings->peer_count == 0;
}

int tls_verify(int good, X509_STORE_CTX *store)
{
	X509 *peer = X509_STORE_CTX_get0_cert(store);

	if (good && X509_STORE_CTX_get_error_depth(store) == 0 && !is_peer(peer)) {
		X509_STORE_CTX_set_error(store, X509_V_ERR_APPLICATION_VERIFICATION);
		good = 0;
	}
	if (!good)
		tls_refuse(X509_STORE_CTX_get_error(store), peer);
	return good;
}

static int verify_again(int good, X509_STORE_CTX *store)
{
	switch (X509_STORE_CTX_get_error(store)) {
	case X509_V_ERR_CERT_NOT_YET_VALID:
	case X509_V_ERR_CRL_NOT_YET_VALID:
	case X509_V_ERR_CRL_HAS_EXPIRED:
	case X509_V_ERR_UNABLE_TO_GET_CRL:
		return 1;
	default:
		return tls_verify(good, store);
	}
}

bool tls_has_expired(const SSL *tls)
{
	const X509 *certificate = SSL_get0_peer_certificate(tls);

	return certificate == NULL || X509_cmp_current_time(X509_get0_notAfter(certificate)) < 0;
}

bool tls_still_good(SSL *tls, SSL_CTX *context)
{
	X509 *certificate = SSL_get0_peer_certificate(tls);
	X509_STORE_CTX *store = X509_STORE_CTX_new();
	bool good = store != NULL &&
		    X509_STORE_CTX_init(store, SSL_CTX_get_cert_store(context), certificate,
					SSL_get_peer_cert_chain(tls)) == 1 &&
		    X509_STORE_CTX_set_default(store, is_client ? "ssl_server" : "ssl_client") == 1;

	tls_refuse(X509_V_ERR_OUT_OF_MEM, certificate);
	if (good) {
		X509_VERIFY_PARAM_set_auth_level(X509_STORE_CTX_get0_param(store),
						 SSL_CTX_get_security_level(context));
		X509_STORE_CTX_set_verify_cb(store, verify_again);
		good = X509_verify_cert(store) == 1;
	}
	X509_STORE_CTX_free(store);
	ERR_clear_error();
	return good;
}

/* ---- what it is refused for -------------------------------------------------------------- */

void tls_refusal_clear(void)
{
	refused.error = X509_V_OK;
	refused.name[0] = '\0';
}

void tls_refuse(int error, const X509 *certificate)
{
	refused.error = error;
	tls_common_name(certificate, refused.name);
}

/* A board without its time refuses everybody for this; the line tells whose clock is wrong. */
static const char *not_yet_valid(char text[TLS_WHY_SIZE], const char *what)
{
	char today[TLS_DATE_SIZE] = "";
	time_t now = time(NULL);
	struct tm parts;

	if (gmtime_r(&now, &parts) != NULL)
		strftime(today, sizeof(today), "%Y-%m-%d", &parts);
	snprintf(text, TLS_WHY_SIZE, "%s is not yet valid, by our clock it is %s", what, today);
	return text;
}

static const char *not_listed(char text[TLS_WHY_SIZE])
{
	snprintf(text, TLS_WHY_SIZE, "not in the list of %s", peers);
	return text;
}

static const char *reason(char text[TLS_WHY_SIZE])
{
	switch (refused.error) {
	case X509_V_ERR_APPLICATION_VERIFICATION:
		return is_client ? "not the certificate of this station" : not_listed(text);
	case X509_V_ERR_UNABLE_TO_GET_ISSUER_CERT:
	case X509_V_ERR_UNABLE_TO_GET_ISSUER_CERT_LOCALLY:
	case X509_V_ERR_UNABLE_TO_VERIFY_LEAF_SIGNATURE:
	case X509_V_ERR_SELF_SIGNED_CERT_IN_CHAIN:
	case X509_V_ERR_DEPTH_ZERO_SELF_SIGNED_CERT:
		return "certificate is not from a known CA";
	case X509_V_ERR_CERT_NOT_YET_VALID:
		return not_yet_valid(text, "certificate");
	case X509_V_ERR_CRL_NOT_YET_VALID:
		return not_yet_valid(text, "CRL");
	default:
		return X509_verify_cert_error_string(refused.error);
	}
}

bool tls_refusal(char why[TLS_WHY_SIZE])
{
	char text[TLS_WHY_SIZE];

	snprintf(why, TLS_WHY_SIZE, "%.80s: \"%s\"", reason(text), refused.name);
	return refused.error != X509_V_OK;
}
