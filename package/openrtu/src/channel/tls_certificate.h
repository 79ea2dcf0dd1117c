/* SPDX-License-Identifier: GPL-3.0-or-later */
/* Whose certificate a master shows, whether it is good, and what it is refused for. */
#ifndef OPENRTU_CHANNEL_TLS_CERTIFICATE_H
#define OPENRTU_CHANNEL_TLS_CERTIFICATE_H

#include <openssl/ssl.h>

#include "iec104/config.h"

#define TLS_NAME_SIZE 65 /* X.520, ub-common-name */
#define TLS_DATE_SIZE 32
#define TLS_WHY_SIZE  160

/* settings: the masters that may come; they outlive all certificates. */
void tls_certificate_start(const struct iec104_tls *settings);

/* The subject's common name in UTF-8, cut; empty: it has none, or there is no certificate. */
void tls_common_name(const X509 *certificate, char name[TLS_NAME_SIZE]);
/* A date as 2026-01-31; empty: it is none. */
void tls_date(const ASN1_TIME *time, char text[TLS_DATE_SIZE]);

/* OpenSSL's callback in a handshake, for each certificate from the CA's down to the master's, at depth 0. */
int tls_verify(int good, X509_STORE_CTX *store);
/* True: the master's certificate is over, or there is none. */
bool tls_has_expired(const SSL *tls);
/*
 * Looks at the certificate of a connection's master once more, by the files of this context. What a missing or outdated
 * list or a clock that was set back says about it is no reason: IEC 62351-3 lets these end no connection.
 */
bool tls_still_good(SSL *tls, SSL_CTX *context);

/* What the certificate in hand was refused for: one at a time, since a handshake is one call that OpenSSL goes on with. */
void tls_refusal_clear(void);
void tls_refuse(int error, const X509 *certificate);
/* False: no certificate was. */
bool tls_refusal(char why[TLS_WHY_SIZE]);

#endif
