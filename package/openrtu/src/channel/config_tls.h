/* SPDX-License-Identifier: GPL-3.0-or-later */
/* The reader of what the configuration file says of TLS. */
#ifndef OPENRTU_CHANNEL_CONFIG_TLS_H
#define OPENRTU_CHANNEL_CONFIG_TLS_H

#include "channel/config.h"
#include "config/files.h"

/* The keys of all such objects. */
#define CHANNEL_TLS_RULES 7
extern const struct config_rule channel_tls_rules[CHANNEL_TLS_RULES];

#define CHANNEL_TLS_PEERS_JSON                                                                               \
	CONFIG_JSON({                                                                                        \
		"items" : {                                                                                  \
			"type" : "string",                                                                   \
			"anyOf" : [                                                                          \
				{                                                                            \
					"minLength" : 1,                                                     \
					"maxLength" : 64,                                                    \
					"pattern" : "^[^\\u0000-\\u001f\\u007f]*$"                           \
				},                                                                           \
				{"pattern" : "^([0-9A-Fa-f]{2}:){31}[0-9A-Fa-f]{2}$"}                        \
			]                                                                                    \
		}                                                                                            \
	})
/* json: the object of the file. peers: the list of who may come; NULL: of one who connects to others. */
void channel_read_tls(struct config_report *report, const struct config_place *place, const json_t *json,
		      const struct config_rule *peers, struct channel_tls *tls);
/* A common name, or a SHA-256 fingerprint. */
bool channel_names_certificate(const char *text);

#endif
