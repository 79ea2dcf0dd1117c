/* SPDX-License-Identifier: GPL-3.0-or-later */
/* What only IEC 60870-5-104 knows of the configuration: its section of it. */
#ifndef OPENRTU_IEC104_CONFIG_H
#define OPENRTU_IEC104_CONFIG_H

#include "channel/config.h"
#include "map/config.h"

#define IEC104_SETTINGS MAP_SECTION_ID('I', '1', '0', '4')

#define IEC104_CLOCK_MASTERS_MAX 8  /* addresses in "clock_masters" */
#define IEC104_MASTERS_MAX       32 /* addresses in "masters" */
#define IEC104_GROUP_MASTERS_MAX 8  /* addresses of a redundancy group */

/*
 * A redundancy group: controlling stations, or connections of one, of which one at a time is sent the events. Its queue is
 * the one of the same number among the named ones of the map's settings.
 */
struct iec104_group {
	uint32_t master_count;
	char masters[IEC104_GROUP_MASTERS_MAX][MAP_ADDRESS_SIZE];
};

/* Times of IEC 60870-5-104, 9.6. */
struct iec104_settings {
	char address[MAP_ADDRESS_SIZE]; /* where rtu-iec104 listens */
	uint16_t port;
	uint16_t k, w; /* 1..32767, w <= k */
	uint16_t t1_s, t2_s;
	uint32_t t3_s; /* up to 48 h */
	uint16_t max_connections;
	uint16_t connections_per_address;
	uint16_t own_ca;            /* common address of the gateway's own station, 0: there is none */
	uint16_t own_set;           /* its place among the sets */
	uint8_t clock_master_count; /* 0: every master may set the clock */
	bool command_without_clock; /* takes a time tag whose age nobody knows */
	bool ignore_summer_bit;     /* of times that a controlling station sends */
	uint8_t position_type;      /* the private type of positions */
	char clock_masters[IEC104_CLOCK_MASTERS_MAX][MAP_ADDRESS_SIZE];
	uint32_t master_count; /* 0: everybody may connect */
	uint32_t lone_masters; /* of them, those in no group */
	char masters[IEC104_MASTERS_MAX][MAP_ADDRESS_SIZE];
	struct iec104_group groups[MAP_NAMED_QUEUES_MAX];
	uint32_t originators_refused[8]; /* a bit for each originator address that may not command */
	struct channel_tls tls;
};

static inline struct iec104_settings *iec104_settings(const struct map_config *config)
{
	return map_records(config, IEC104_SETTINGS, sizeof(struct iec104_settings));
}

/* rtu-iec104-tls is the module's program. */
static inline bool iec104_tls_used(const struct iec104_settings *settings)
{
	return channel_tls_used(&settings->tls);
}

#endif
