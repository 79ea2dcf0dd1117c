/* SPDX-License-Identifier: GPL-3.0-or-later */
/* Values, qualities and times as an engineer reads and writes them. */
#ifndef OPENRTU_ROWS_WORDS_H
#define OPENRTU_ROWS_WORDS_H

#include <stdbool.h>
#include <stddef.h>
#include <stdint.h>

#include <jansson.h>

#include "map/map.h"

#define WORDS_SIZE      64  /* of every text made here, terminator included, */
#define WORDS_LONG_SIZE 256 /* but for this one */

const char *words_type(enum map_type type);
const char *words_module_state(enum map_module_state state);
const char *words_log_level(enum map_log_level level);
const char *words_cause(enum map_cause cause);
const char *words_clock_source(enum map_clock_source source);

/* "good", or what is wrong, joined by commas: "invalid,not topical". */
void words_quality(uint8_t quality, char *out);
/* Seconds as "0.3 s", "12 s", "5 min", "3 h", "2 d". */
void words_age(double seconds, char *out);
/* A wall time in nanoseconds since 1970 as "2026-11-20T23:46:01.123Z". */
void words_time(int64_t wall_ns, char *out);
/* The same with microseconds. */
void words_time_us(int64_t wall_ns, char *out);

/*
 * A value: "on" and "off", a double's four states, numbers; a normalized value as a fraction of 1, an angle in degrees. A new reference; null for a
 * float that is not a number.
 */
json_t *words_value(enum map_type type, const union map_value *value);
/* The "value" of a row of "type" angle as text, with all its decimals. False: this value of the row is none. */
bool words_angle(const json_t *row, const json_t *value, char *out);
/* The "value" of a row that has a "meaning", as "heating (3)". False: this value of the row is none. */
bool words_meaning(const json_t *row, const json_t *value, char *out);
/* The value of a point as people give it: as its type has it, or by its name. */
bool words_parse_point(const struct map_config *config, uint32_t point, const char *text,
		       union map_value *out);
/* What that takes; out: WORDS_LONG_SIZE octets. Returns out. */
const char *words_expected_of(const struct map_config *config, uint32_t point, char *out);
/* The reverse, for commands. False when the text is no value of the type. */
bool words_parse_value(enum map_type type, const char *text, union map_value *out);

#endif
