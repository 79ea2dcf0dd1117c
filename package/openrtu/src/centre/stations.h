/* SPDX-License-Identifier: GPL-3.0-or-later */
/* All stations of the file together. */
#ifndef OPENRTU_CENTRE_STATIONS_H
#define OPENRTU_CENTRE_STATIONS_H

#include "centre/station.h"

/* Everything that will ever be allocated. False: no memory. */
bool centre_stations_init(struct centre *centre, const struct centre_config *config);
void centre_stations_free(struct centre *centre);
/* The octets of memory that a station has, and the process for all of them. */
size_t centre_octets_of_station(const struct centre_config *config);

/* There is a consumer: all stations are tried. There is none: all connections end. */
void centre_stations_begin(struct centre *centre);
void centre_stations_end(struct centre *centre);

/* Tells the consumer the next station of the configuration. False: all are told. Needs centre_has_room. */
bool centre_tell_next(struct centre *centre);

#endif
