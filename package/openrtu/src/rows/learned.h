/* SPDX-License-Identifier: GPL-3.0-or-later */
/* What a line's process has learned of its devices, for people and for scripts. */
#ifndef OPENRTU_ROWS_LEARNED_H
#define OPENRTU_ROWS_LEARNED_H

#include <stdbool.h>
#include <stdint.h>

#include <jansson.h>

#include "map/map.h"
#include "modbus/stats.h"

#define LEARNED_WORDS_SIZE 64

/* Objects of the table that a function reads: "holding registers 5 to 7", "coil 12". */
void learned_objects(uint32_t function, uint32_t address, uint32_t count, char out[LEARNED_WORDS_SIZE]);
/* Whether a function reads bits; else, registers. */
static inline bool learned_is_of_bits(uint32_t function)
{
	return function <= 2;
}

/* A new reference. */
json_t *learned_json(const struct modbus_learned_stats *learned);

#endif
