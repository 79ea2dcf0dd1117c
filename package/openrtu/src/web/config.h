/* SPDX-License-Identifier: GPL-3.0-or-later */
/* What only the page knows of the configuration: its section of it. */
#ifndef OPENRTU_WEB_CONFIG_H
#define OPENRTU_WEB_CONFIG_H

#include "map/config.h"

#define WEB_KIND        "web"
#define WEB_SETTINGS    MAP_SECTION_ID('W', 'E', 'B', 'S')
#define WEB_CLIENTS_MAX 16

struct web_settings {
	char address[MAP_ADDRESS_SIZE];
	char clients[WEB_CLIENTS_MAX][MAP_ADDRESS_SIZE]; /* who may connect; none: everybody */
	char station[MAP_NAME_SIZE];
	char users[MAP_FILE_SIZE];       /* their password hashes */
	char certificate[MAP_FILE_SIZE]; /* empty: without TLS */
	char key[MAP_FILE_SIZE];
	uint32_t client_count;
	uint32_t session_s;
	uint16_t port;
	bool commands; /* operators may command */
	bool setup;    /* installers may change lines, devices and points */
};

/* NULL: there is no page. */
static inline struct web_settings *web_settings(const struct map_config *config)
{
	return map_records(config, WEB_SETTINGS, sizeof(struct web_settings));
}

#endif
