/* SPDX-License-Identifier: GPL-3.0-or-later */
/*
 * CP56Time2a, the seven octets of IEC 60870-5-101, 7.2.6.18, in UTC. Two-digit years are 2000..2099.
 */
#ifndef OPENRTU_IEC104_TIME56_H
#define OPENRTU_IEC104_TIME56_H

#include <stdbool.h>
#include <stdint.h>

#define IEC104_TIME56_SIZE 7

/*
 * Encodes a wall time in nanoseconds since 1970, cut to the millisecond. invalid sets the IV bit; so does a
 * time outside 2000..2099, which the format cannot hold (it is sent as the nearest one it can).
 */
void iec104_time56_encode(uint8_t octets[IEC104_TIME56_SIZE], int64_t wall_ns, bool invalid);

/*
 * Decodes to nanoseconds since 1970. False: the IV bit is set, or there is no such time. The SU bit and the
 * day of the week carry nothing for a time in UTC.
 */
bool iec104_time56_decode(const uint8_t octets[IEC104_TIME56_SIZE], int64_t *wall_ns);

#endif
