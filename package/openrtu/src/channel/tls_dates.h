/* SPDX-License-Identifier: GPL-3.0-or-later */
/* The dates that end a station's TLS: of its own certificate, of its lists of revoked ones; and a clock that was never set. */
#ifndef OPENRTU_CHANNEL_TLS_DATES_H
#define OPENRTU_CHANNEL_TLS_DATES_H

#include <openssl/ssl.h>

#include "map/map.h"

/* A line of the log, of no peer (NULL): channel.h. */
typedef void (*tls_dates_say)(enum map_log_level level, const char *peer, const char *text);

/* Logs what is new about them, and once a day what is wrong with them. now_ns: CLOCK_MONOTONIC. */
void tls_dates_watch(tls_dates_say say, const SSL_CTX *context, int64_t now_ns);
/* Forgets what was said: the files are others. */
void tls_dates_forget(void);

#endif
