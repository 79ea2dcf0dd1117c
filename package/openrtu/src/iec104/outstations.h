/* SPDX-License-Identifier: GPL-3.0-or-later */
/* What only the controlling station of the gateway, rtu-104m, knows of the configuration: its sections of it. */
#ifndef OPENRTU_IEC104_OUTSTATIONS_H
#define OPENRTU_IEC104_OUTSTATIONS_H

#include "iec104/config.h"
#include "map/config.h"

#define IEC104_OUTSTATIONS       MAP_SECTION_ID('1', '0', '4', 'M')
#define IEC104_OUTSTATION_SETS   MAP_SECTION_ID('1', '0', '4', 'S')
#define IEC104_OUTSTATION_POINTS MAP_SECTION_ID('1', '0', '4', 'P')

#define IEC104_OUTSTATION_TLS MAP_SECTION_ID('1', '0', '4', 'T')

#define IEC104_OUTSTATIONS_MAX       32 /* two links each: a module has so many descriptors */
#define IEC104_OUTSTATION_NAME_SIZE  16
#define IEC104_OUTSTATION_LINKS_MAX  2
#define IEC104_OUTSTATION_SETS_MAX   16
#define IEC104_OUTSTATION_POINTS_MAX 4096 /* of all */

/* A controlled station whose points are points of the map. */
struct iec104_outstation {
	char name[IEC104_OUTSTATION_NAME_SIZE];
	char addresses[IEC104_OUTSTATION_LINKS_MAX]
		      [MAP_ADDRESS_SIZE]; /* of redundant links, the preferred first */
	uint16_t port;
	uint16_t k, w, t1_s, t2_s; /* IEC 60870-5-104, 9.6 */
	uint32_t t3_s;
	uint8_t address_count;
	uint8_t originator;
	bool terminates;       /* it sends the termination of a command */
	bool interrogates;     /* it is interrogated when data transfer starts */
	uint8_t position_type; /* the private type of its positions */
	uint32_t confirmation_ms, termination_ms, interrogation_ms;
	uint32_t retry_ms, retry_max_ms; /* the first pause before another attempt, and the longest */
	uint32_t interrogation_s, counters_s, clock_s; /* 0: never again, never, never */
	uint32_t first_set, set_count;                 /* among those of all outstations */
	struct map_zone zone;                          /* of its time tags */
	bool secure;                                   /* with TLS */
	char certificate[CHANNEL_TLS_PEER_SIZE]; /* its common name or fingerprint; empty: any of the CA */
};

/* A common address of an outstation, which is a set of the map. */
struct iec104_outstation_set {
	uint16_t set;         /* its place among the sets */
	uint16_t ca;          /* there */
	uint32_t first_point; /* among those of all outstations; their order is that of the set */
};

/* The points of a position: the whole (MAP_POINT_POSITION), latitude, longitude, altitude. */
#define IEC104_OUTSTATION_POSITION_POINTS 4

/* What a point is there. */
struct iec104_outstation_point {
	/* Of the points behind a position's first: its own, and 1 to 3 above the 24 bits of an address. */
	uint32_t ioa;
	uint32_t command_ioa;
	uint32_t read_ms; /* how often it is read by itself, 0: never */
	bool select;      /* a command of it is selected there before */
};

/* NULL: there is none. */
static inline struct iec104_outstation *iec104_outstations(const struct map_config *config)
{
	return map_records(config, IEC104_OUTSTATIONS, sizeof(struct iec104_outstation));
}

static inline struct iec104_outstation_set *iec104_outstation_sets(const struct map_config *config)
{
	return map_records(config, IEC104_OUTSTATION_SETS, sizeof(struct iec104_outstation_set));
}

static inline const struct iec104_outstation_point *iec104_outstation_points(const struct map_config *config)
{
	return map_records(config, IEC104_OUTSTATION_POINTS, sizeof(struct iec104_outstation_point));
}

/* Who the gateway is for outstations with TLS. NULL: there is none of these. */
static inline struct channel_tls *iec104_outstation_tls(const struct map_config *config)
{
	return map_records(config, IEC104_OUTSTATION_TLS, sizeof(struct channel_tls));
}

#endif
