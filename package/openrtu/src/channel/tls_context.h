/* SPDX-License-Identifier: GPL-3.0-or-later */
/* What IEC 62351-3 asks of a station's TLS, of either side, set up in OpenSSL. */
#ifndef OPENRTU_CHANNEL_TLS_CONTEXT_H
#define OPENRTU_CHANNEL_TLS_CONTEXT_H

#include <openssl/ssl.h>
#include <stdbool.h>

#include "channel/config.h"

#define TLS_ERROR_SIZE      256
#define CHANNEL_RECORD_SIZE 4096 /* octets at most; a connection that sends keeps so much memory */

/*
 * Reads the files of the settings. controlling: of the side that connects. verify: OpenSSL's callback for each certificate that
 * the peer shows; NULL: it need not show any, and there is no CA. NULL: a file is
 * missing, unfit, or a key that others may read; error, of TLS_ERROR_SIZE bytes, says which and why.
 */
SSL_CTX *tls_context_create(const struct channel_tls *settings, bool controlling, SSL_verify_cb verify,
			    char *error);

#endif
