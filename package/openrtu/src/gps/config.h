/* SPDX-License-Identifier: GPL-3.0-or-later */
/* What only receivers of positions know of the configuration: their sections of it. */
#ifndef OPENRTU_GPS_CONFIG_H
#define OPENRTU_GPS_CONFIG_H

#include "gps/fence.h"
#include "gps/track.h"
#include "map/config.h"

#define GPS_RECEIVERS MAP_SECTION_ID('G', 'P', 'S', 'R')
#define GPS_FENCES    MAP_SECTION_ID('G', 'P', 'S', 'F')

#define GPS_NAME_SIZE     21
#define GPS_RECEIVERS_MAX 8
#define GPS_FENCES_MAX    64  /* of a receiver */
#define GPS_SOCKET_SIZE   108 /* as a Unix socket's address has it */

/*
 * The points of a receiver, in the order of its set; those of its fences are behind them. Before them is the position as a whole
 * (MAP_POINT_POSITION), if it is configured.
 */
enum gps_point {
	GPS_POINT_LATITUDE,
	GPS_POINT_LONGITUDE,
	GPS_POINT_ALTITUDE,
	GPS_POINT_SPEED,
	GPS_POINT_COURSE,
	GPS_POINT_HDOP,
	GPS_POINT_ERROR,
	GPS_POINT_FIX,
	GPS_POINT_SATELLITES,
	GPS_POINTS
};

/* Where a receiver is, and what becomes of its fixes. */
struct gps_settings {
	char name[GPS_NAME_SIZE];
	char device[MAP_FILE_SIZE];      /* of a serial port; empty: behind gpsd */
	char gpsd[MAP_ADDRESS_SIZE];     /* its address */
	char gpsd_device[MAP_FILE_SIZE]; /* its name there; empty: the first with a fix */
	char clock[GPS_SOCKET_SIZE];     /* chrony's socket, which is told its time; empty: none is */
	uint16_t gpsd_port;
	uint16_t set;  /* its place among the sets */
	uint8_t whole; /* points before GPS_POINT_LATITUDE: 1 with the position as a whole, else 0 */
	uint32_t baud;
	uint32_t first_fence, fence_count; /* among those of all receivers */
	int64_t silence_ns;                /* that ends a burst */
	int64_t topical_ns;                /* values that are older are not topical */
	struct gps_limits limits;
	struct gps_rule rule;
};

/* NULL: there is no receiver. */
static inline struct gps_settings *gps_receivers(const struct map_config *config)
{
	return map_records(config, GPS_RECEIVERS, sizeof(struct gps_settings));
}

static inline const struct gps_fence *gps_fences(const struct map_config *config)
{
	return map_records(config, GPS_FENCES, sizeof(struct gps_fence));
}

#endif
