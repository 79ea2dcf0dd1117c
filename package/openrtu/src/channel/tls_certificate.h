/* SPDX-License-Identifier: GPL-3.0-or-later */
/* Whose certificate a peer shows, whether it is good, and what it is refused for. */
#ifndef OPENRTU_CHANNEL_TLS_CERTIFICATE_H
#define OPENRTU_CHANNEL_TLS_CERTIFICATE_H

#include <openssl/ssl.h>

#include "channel/config.h"

#define TLS_DATE_SIZE 32
#define TLS_WHY_SIZE  160

/* settings: who may come, controlling: to others; peers: how those are called. All outlive all certificates. */
void tls_certificate_start(const struct channel_tls *settings, bool controlling, const char *peers);
/* The common name or the fingerprint of the peer whose certificate is looked at from now on. NULL: as the settings say. */
void tls_expect(const char *name);

/* The subject's common name in UTF-8, cut; empty: it has none, or there is no certificate. */
void tls_common_name(const X509 *certificate, char name[CHANNEL_NAME_SIZE]);
/* A date as 2026-01-31; empty: it is none. */
void tls_date(const ASN1_TIME *time, char text[TLS_DATE_SIZE]);

/* OpenSSL's callback in a handshake, for each certificate from the CA's down to the peer's, at depth 0. */
int tls_verify(int good, X509_STORE_CTX *store);
/* True: the peer's certificate is over, or there is none. */
bool tls_has_expired(const SSL *tls);
/*
 * Looks at the certificate of a connection's peer once more, by the files of this context. What a missing or outdated
 * list or a clock that was set back says about it is no reason: IEC 62351-3 lets these end no connection.
 */
bool tls_still_good(SSL *tls, SSL_CTX *context);

/* What the certificate in hand was refused for: one at a time, since a handshake is one call that OpenSSL goes on with. */
void tls_refusal_clear(void);
void tls_refuse(int error, const X509 *certificate);
/* False: no certificate was. */
bool tls_refusal(char why[TLS_WHY_SIZE]);

#endif
