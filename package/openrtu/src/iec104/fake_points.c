/* SPDX-License-Identifier: GPL-3.0-or-later */
/* The points of the map that tests hold in their hand. */
#include "iec104/fake_map.h"

#define COMMAND MAP_POINT_COMMAND

struct map_point points[ALL] = {
    /* CA 3067: the project report, figure 5.3 */
    {.set = 0, .type = MAP_SINGLE, .flags = COMMAND, .ioa = 1},
    {.set = 0, .type = MAP_SINGLE, .flags = COMMAND, .ioa = 2},
    {.set = 0, .type = MAP_SINGLE, .flags = COMMAND, .ioa = 3},
    {.set = 0, .type = MAP_SINGLE, .flags = COMMAND, .ioa = 4, .short_pulse_ms = 500},
    {.set = 0, .type = MAP_SINGLE, .ioa = 10001},
    {.set = 0, .type = MAP_SINGLE, .ioa = 10002},
    {.set = 0, .type = MAP_SINGLE, .ioa = 10003},
    {.set = 0, .type = MAP_SCALED, .ioa = 30001},
    {.set = 0, .type = MAP_SCALED, .ioa = 30002},
    {.set = 0, .type = MAP_SCALED, .ioa = 30003},
    {.set = 0, .type = MAP_SCALED, .flags = COMMAND, .ioa = 40001},
    {.set = 0, .type = MAP_SCALED, .flags = COMMAND, .ioa = 40002},
    {.set = 0, .type = MAP_SCALED, .flags = COMMAND, .ioa = 40003, .step = 5, .max = 300},
    /* CA 4001: the other types */
    {.set = 1, .type = MAP_DOUBLE, .flags = COMMAND, .ioa = 1, .group = 2, .long_pulse_ms = 2000},
    {.set = 1, .type = MAP_STEP, .ioa = 5, .group = 16},
    {.set = 1, .type = MAP_BITSTRING, .flags = COMMAND, .ioa = 7},
    {.set = 1, .type = MAP_NORMALIZED, .flags = COMMAND, .ioa = 9, .group = 2, .send_period_ms = 1000},
    {.set = 1, .type = MAP_FLOAT, .flags = COMMAND, .ioa = 11},
    {.set = 1, .type = MAP_COUNTER, .ioa = 15, .group = 2},
    {.set = 1, .type = MAP_DOUBLE, .ioa = 3, .send_period_ms = 5000},
    /* CA 900: this process's own */
    {.set = 2, .type = MAP_SINGLE, .ioa = 1},
    {.set = 2, .type = MAP_SINGLE, .ioa = 9},
    {.set = 2, .type = MAP_BITSTRING, .ioa = 101},
    {.set = 2, .type = MAP_BITSTRING, .ioa = 109},
    /* CA 7001: a receiver of positions */
    {.set = 3, .type = MAP_BITSTRING, .flags = MAP_POINT_POSITION, .ioa = 200, .group = 3},
    {.set = 3, .type = MAP_ANGLE, .ioa = 1},
    {.set = 3, .type = MAP_ANGLE, .ioa = 2},
    {.set = 3, .type = MAP_FLOAT, .ioa = 3},
};

struct map_set devices[DEVICES + 2] = {
    {.module = 1, .ca = 3067, .first_point = 0, .point_count = 13},
    {.module = 2, .ca = 4001, .first_point = 13, .point_count = 7},
    {.module = 0, .ca = 900, .first_point = 20, .point_count = OWN},
    {.module = 2, .ca = 7001, .first_point = POSITION, .point_count = PLACE},
};
