/* SPDX-License-Identifier: GPL-3.0-or-later */
/*
 * CP56Time2a, the seven octets of IEC 60870-5-101, 7.2.6.18, in a time zone. Two-digit years are 2000..2099.
 */
#ifndef OPENRTU_IEC104_TIME56_H
#define OPENRTU_IEC104_TIME56_H

#include <stdbool.h>
#include <stdint.h>

#include "map/config.h"

#define IEC104_TIME56_SIZE 7

/*
 * Encodes a wall time in nanoseconds since 1970, UTC, cut to the millisecond, with the SU bit in summer time. invalid
 * sets the IV bit; so does a time outside 2000..2099 of the zone, which the format cannot hold (it is sent as the
 * nearest one it can).
 */
void iec104_time56_encode(uint8_t octets[IEC104_TIME56_SIZE], int64_t wall_ns, bool invalid,
			  const struct map_zone *zone);

/*
 * Decodes to nanoseconds since 1970, UTC. False: the IV bit is set, there is no such time, or the SU bit is not that
 * of the time; it tells the two hours apart that have the same time when summer ends. The day of the week and reserved
 * bits carry nothing.
 */
bool iec104_time56_decode(const uint8_t octets[IEC104_TIME56_SIZE], const struct map_zone *zone,
			  int64_t *wall_ns);
/*
 * The same without its SU bit, which some never set: by the zone, and where that knows two such times the one that is
 * nearer to near_ns. False: the IV bit is set, or there is no such time.
 */
bool iec104_time56_decode_nearest(const uint8_t octets[IEC104_TIME56_SIZE], const struct map_zone *zone,
				  int64_t near_ns, int64_t *wall_ns);
/* What was not decoded would be, with the other SU bit: its sender does not set it, or has another zone. */
bool iec104_time56_lacks_season(const uint8_t octets[IEC104_TIME56_SIZE], const struct map_zone *zone);

#endif
