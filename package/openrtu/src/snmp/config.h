/* SPDX-License-Identifier: GPL-3.0-or-later */
/* What only SNMP knows of the configuration: its section of it. */
#ifndef OPENRTU_SNMP_CONFIG_H
#define OPENRTU_SNMP_CONFIG_H

#include "map/config.h"

#define SNMP_KIND     "snmp"
#define SNMP_SETTINGS MAP_SECTION_ID('S', 'N', 'M', 'P')

#define SNMP_NAME_SIZE    33 /* of a user or a sink, SnmpAdminString (SIZE (1..32)) */
#define SNMP_TEXT_SIZE    128
#define SNMP_USERS_MAX    16
#define SNMP_SINKS_MAX    8
#define SNMP_MANAGERS_MAX 16
#define SNMP_BASE_MAX     16 /* arcs of the place of OPENRTU-MIB */
#define SNMP_WINDOW_MAX   16

/* What a user may do; each may what the one before may. */
enum snmp_role { SNMP_VIEWER, SNMP_OPERATOR, SNMP_ENGINEER };

struct snmp_user {
	char name[SNMP_NAME_SIZE];
	uint8_t role; /* enum snmp_role */
};

/* Who is notified. */
struct snmp_sink {
	char name[SNMP_NAME_SIZE];
	char address[MAP_ADDRESS_SIZE];
	uint16_t port;
	uint16_t timeout_ms; /* before an inform is sent again; doubles each time */
	uint8_t user;        /* its place among the users */
	uint8_t window;      /* informs without an answer */
	uint8_t retries;
	bool inform; /* else traps */
};

struct snmp_settings {
	char address[MAP_ADDRESS_SIZE];
	char managers[SNMP_MANAGERS_MAX][MAP_ADDRESS_SIZE];      /* who is answered; none: everybody */
	char clock_masters[SNMP_MANAGERS_MAX][MAP_ADDRESS_SIZE]; /* who may set the clock; none: everybody */
	char station[MAP_NAME_SIZE];
	char contact[SNMP_TEXT_SIZE], location[SNMP_TEXT_SIZE]; /* sysContact, sysLocation */
	char keys[MAP_FILE_SIZE];                               /* localized keys */
	char state[MAP_FILE_SIZE];                              /* folder of the number of boots */
	uint32_t base[SNMP_BASE_MAX];
	uint32_t base_length;
	uint32_t manager_count, clock_master_count, user_count, sink_count;
	uint32_t max_message; /* octets */
	uint32_t rate;        /* messages a second from one address */
	uint32_t release_s;   /* after which a command's last state becomes inactive */
	uint16_t port;
	struct snmp_user users[SNMP_USERS_MAX];
	struct snmp_sink sinks[SNMP_SINKS_MAX];
};

/* NULL: SNMP is not configured. */
static inline struct snmp_settings *snmp_settings(const struct map_config *config)
{
	return map_records(config, SNMP_SETTINGS, sizeof(struct snmp_settings));
}

#endif
