/* SPDX-License-Identifier: GPL-3.0-or-later */
#include "map/type.h"

#include <float.h>

const struct map_type_row map_types[MAP_TYPES] = {
    [MAP_SINGLE] = {"single", MAP_CLASS_STATE, 0, 1},
    [MAP_DOUBLE] = {"double", MAP_CLASS_STATE, 0, 3},
    [MAP_STEP] = {"step", MAP_CLASS_POSITION, -64, 63},
    [MAP_BITSTRING] = {"bitstring", MAP_CLASS_PATTERN, 0, UINT32_MAX},
    [MAP_NORMALIZED] = {"normalized", MAP_CLASS_MEASURED, INT16_MIN, INT16_MAX},
    [MAP_SCALED] = {"scaled", MAP_CLASS_MEASURED, INT16_MIN, INT16_MAX},
    [MAP_FLOAT] = {"float", MAP_CLASS_MEASURED, -FLT_MAX, FLT_MAX},
    [MAP_COUNTER] = {"counter", MAP_CLASS_TOTAL, INT32_MIN, INT32_MAX},
};
