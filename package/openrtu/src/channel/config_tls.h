/* SPDX-License-Identifier: GPL-3.0-or-later */
/* The reader of what the configuration file says of TLS. */
#ifndef OPENRTU_CHANNEL_CONFIG_TLS_H
#define OPENRTU_CHANNEL_CONFIG_TLS_H

#include "channel/config.h"
#include "config/files.h"

/* json: the object of the file. peers: the key of the list of who may come; NULL: of one who connects to others. */
void channel_read_tls(struct config_report *report, const struct config_place *place, const json_t *json,
		      const char *peers, struct channel_tls *tls);
/* A common name, or a SHA-256 fingerprint. */
bool channel_names_certificate(const char *text);

#endif
