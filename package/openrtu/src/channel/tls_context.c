/* SPDX-License-Identifier: GPL-3.0-or-later */
#include "channel/tls_context.h"

#include <errno.h>
#include <fcntl.h>
#include <openssl/err.h>
#include <string.h>
#include <sys/stat.h>
#include <unistd.h>

/* Level 2 of OpenSSL: RSA and DH of 2048 bits, elliptic curves of 224, no SHA-1. */
#define SECURITY_LEVEL 2
#define SESSIONS       16 /* that may be resumed: as many as a module of ours has connections at most */

/* TLS 1.2 of IEC 62351-3:2014 with AMD1 and AMD2: AEAD and forward secrecy; what costs the station least comes first. */
static const char ciphers_1_2[] = "ECDHE-ECDSA-AES128-GCM-SHA256:ECDHE-RSA-AES128-GCM-SHA256:"
				  "ECDHE-ECDSA-AES256-GCM-SHA384:ECDHE-RSA-AES256-GCM-SHA384:"
				  "DHE-RSA-AES128-GCM-SHA256:DHE-RSA-AES256-GCM-SHA384";

static const unsigned char session_context[] = "openrtu";

/* ---- files ------------------------------------------------------------------------------- */

static bool refuse(char *error, const char *what, const char *path, const char *why)
{
	snprintf(error, TLS_ERROR_SIZE, "the %s %s: %s", what, path, why);
	return false;
}

/* OpenSSL's word for what is wrong with a file's content. */
static bool refuse_content(char *error, const char *what, const char *path)
{
	const char *reason = ERR_reason_error_string(ERR_peek_error()); /* the deepest of several */

	return refuse(error, what, path, reason != NULL ? reason : "OpenSSL does not accept it");
}

/* OpenSSL's own words for a file that is not there are many. */
static bool is_readable(char *error, const char *what, const char *path, mode_t *mode)
{
	int fd = open(path, O_RDONLY | O_CLOEXEC);
	struct stat status;

	if (fd < 0 || fstat(fd, &status) < 0) {
		refuse(error, what, path, strerror(errno));
		if (fd >= 0)
			close(fd);
		return false;
	}
	close(fd);
	*mode = status.st_mode;
	return S_ISREG(status.st_mode) || refuse(error, what, path, "is not a file");
}

static bool use_certificate(SSL_CTX *context, const char *path, char *error)
{
	mode_t mode;

	return is_readable(error, "certificate", path, &mode) &&
	       (SSL_CTX_use_certificate_chain_file(context, path) == 1 ||
		refuse_content(error, "certificate", path));
}

/* Nobody is there to type one. */
static int no_passphrase(char *buffer, int size, int writing, void *data)
{
	(void)buffer, (void)size, (void)writing, (void)data;
	return -1;
}

static bool use_key(SSL_CTX *context, const char *path, char *error)
{
	mode_t mode;

	if (!is_readable(error, "key", path, &mode))
		return false;
	if (mode & S_IRWXO)
		return refuse(error, "key", path, "other users may read it: type chmod o= for it");
	SSL_CTX_set_default_passwd_cb(context, no_passphrase);
	if (SSL_CTX_use_PrivateKey_file(context, path, SSL_FILETYPE_PEM) == 1)
		return true;
	if (ERR_GET_LIB(ERR_peek_last_error()) == ERR_LIB_X509)
		return refuse(error, "key", path, "does not belong to the certificate");
	return refuse_content(error, "key", path);
}

/* The CA's name is sent too, so that a peer with several certificates shows the right one. */
static bool use_ca(SSL_CTX *context, const char *path, char *error)
{
	STACK_OF(X509_NAME) * names;
	mode_t mode;

	if (!is_readable(error, "ca", path, &mode))
		return false;
	names = SSL_load_client_CA_file(path);
	if (names == NULL || SSL_CTX_load_verify_file(context, path) != 1)
		return refuse_content(error, "ca", path);
	SSL_CTX_set_client_CA_list(context, names);
	return true;
}

static bool use_crl(SSL_CTX *context, const char *path, char *error)
{
	X509_STORE *store = SSL_CTX_get_cert_store(context);
	X509_LOOKUP *lookup = X509_STORE_add_lookup(store, X509_LOOKUP_file());
	mode_t mode;

	if (!is_readable(error, "crl", path, &mode))
		return false;
	if (lookup == NULL || X509_load_crl_file(lookup, path, X509_FILETYPE_PEM) < 1)
		return refuse_content(error, "crl", path);
	X509_STORE_set_flags(store, X509_V_FLAG_CRL_CHECK | X509_V_FLAG_CRL_CHECK_ALL);
	return true;
}

static bool use_files(SSL_CTX *context, const struct channel_tls *settings, char *error)
{
	return use_certificate(context, settings->certificate, error) &&
	       use_key(context, settings->key, error) &&
	       (settings->ca[0] == '\0' || use_ca(context, settings->ca, error)) &&
	       (settings->crl[0] == '\0' || use_crl(context, settings->crl, error));
}

/* ---- rules ------------------------------------------------------------------------------- */

static bool use_versions(SSL_CTX *context, uint8_t versions)
{
	int least = versions & CHANNEL_TLS_1_2 ? TLS1_2_VERSION : TLS1_3_VERSION;
	int most = versions & CHANNEL_TLS_1_3 ? TLS1_3_VERSION : TLS1_2_VERSION;

	return SSL_CTX_set_min_proto_version(context, least) == 1 &&
	       SSL_CTX_set_max_proto_version(context, most) == 1;
}

/*
 * Sessions lie in this process, and not in tickets: a key of tickets would have to be changed in time, and with the
 * process goes all that could be resumed.
 */
static void use_sessions(SSL_CTX *context, uint32_t resumption_s)
{
	SSL_CTX_set_session_id_context(context, session_context, sizeof(session_context) - 1);
	SSL_CTX_set_timeout(context, (long)resumption_s);
	SSL_CTX_sess_set_cache_size(context, SESSIONS);
	SSL_CTX_set_session_cache_mode(context,
				       resumption_s > 0 ? SSL_SESS_CACHE_SERVER : SSL_SESS_CACHE_OFF);
	SSL_CTX_set_num_tickets(context, resumption_s > 0 ? 1 : 0); /* of TLS 1.3: names of such sessions */
}

/* The owner keeps them, one for each station that it connects to: a ticket of another's is as good as a session here. */
static void use_client_sessions(SSL_CTX *context, uint32_t resumption_s)
{
	SSL_CTX_set_timeout(context, (long)resumption_s);
	SSL_CTX_set_session_cache_mode(context, resumption_s > 0
						    ? SSL_SESS_CACHE_CLIENT | SSL_SESS_CACHE_NO_INTERNAL
						    : SSL_SESS_CACHE_OFF);
	SSL_CTX_clear_options(context, SSL_OP_NO_TICKET);
}

static bool use_rules(SSL_CTX *context, const struct channel_tls *settings, bool controlling,
		      SSL_verify_cb verify)
{
	SSL_CTX_set_security_level(context, SECURITY_LEVEL);
	/* Who closes TCP without saying so in TLS is as gone as anybody: a message of our protocols says its length itself. */
	SSL_CTX_set_options(context, SSL_OP_NO_RENEGOTIATION | SSL_OP_NO_COMPRESSION | SSL_OP_NO_TICKET |
					 SSL_OP_CIPHER_SERVER_PREFERENCE | SSL_OP_IGNORE_UNEXPECTED_EOF);
	/*
	 * What is written may have moved and grown when it is offered again; an idle connection keeps no buffers; the
	 * peers' CA is not added to the certificates that are sent.
	 */
	SSL_CTX_set_mode(context, SSL_MODE_ACCEPT_MOVING_WRITE_BUFFER | SSL_MODE_RELEASE_BUFFERS |
				      SSL_MODE_NO_AUTO_CHAIN);
	/* A record without data, of which a peer may send many, does not keep a call from returning. */
	SSL_CTX_clear_mode(context, SSL_MODE_AUTO_RETRY);
	SSL_CTX_set_max_send_fragment(context, CHANNEL_RECORD_SIZE);
	SSL_CTX_set_dh_auto(context, 1);
	if (verify != NULL)
		SSL_CTX_set_verify(context, SSL_VERIFY_PEER | SSL_VERIFY_FAIL_IF_NO_PEER_CERT, verify);
	if (controlling)
		use_client_sessions(context, settings->resumption_s);
	else
		use_sessions(context, settings->resumption_s);
	return use_versions(context, settings->versions) &&
	       SSL_CTX_set_cipher_list(context, ciphers_1_2) == 1;
}

SSL_CTX *tls_context_create(const struct channel_tls *settings, bool controlling, SSL_verify_cb verify,
			    char *error)
{
	SSL_CTX *context;

	OPENSSL_init_ssl(OPENSSL_INIT_NO_LOAD_CONFIG,
			 NULL); /* the rules are here, not in the system's file */
	context = SSL_CTX_new(controlling ? TLS_client_method() : TLS_server_method());
	snprintf(error, TLS_ERROR_SIZE, "OpenSSL cannot be set up");
	if (context != NULL && use_rules(context, settings, controlling, verify) &&
	    use_files(context, settings, error))
		return context;
	SSL_CTX_free(context);
	return NULL;
}
