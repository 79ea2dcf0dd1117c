/* SPDX-License-Identifier: GPL-3.0-or-later */
/* A point of the map as data of IEC 61850 (7-3), and back. */
#ifndef OPENRTU_GOOSE_VALUE_H
#define OPENRTU_GOOSE_VALUE_H

#include "goose/message.h"
#include "map/map.h"

/*
 * single: BOOLEAN; double: CODED ENUM of 2 bits; float and normalized: FLOAT32 (normalized from -1 to 1); bitstring: INT32U; any other:
 * INT32, an angle in 1e-7 degree.
 */
struct goose_item goose_value_out(enum map_type type, union map_value value);
/* False: the item is none of this type, or beyond what the point holds. */
bool goose_value_in(enum map_type type, const struct goose_item *item, union map_value *out);

/* Quality (IEC 61850-7-3, 6.2): not topical is questionable and oldData, overflow questionable and overflow. */
struct goose_item goose_quality_out(uint8_t quality);
/* What is for a test is invalid for the process. False: the item is no quality. */
bool goose_quality_in(const struct goose_item *item, uint8_t *out);

#endif
