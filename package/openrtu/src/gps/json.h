/* SPDX-License-Identifier: GPL-3.0-or-later */
/*
 * A reader of one JSON value (RFC 8259) in octets, without memory of its own: it tells each name and value on the way. It is
 * strict, and bounded in depth.
 */
#ifndef OPENRTU_GPS_JSON_H
#define OPENRTU_GPS_JSON_H

#include <stdbool.h>
#include <stddef.h>
#include <stdint.h>

#define GPS_JSON_DEPTH 8

enum gps_json_kind { GPS_JSON_STRING, GPS_JSON_NUMBER, GPS_JSON_WORD, GPS_JSON_OBJECT, GPS_JSON_END };

/* What was met. Texts are as they stand in the octets, between the quotes, escapes untouched. */
struct gps_json_item {
	enum gps_json_kind kind; /* GPS_JSON_END: of the object that OBJECT began */
	unsigned depth;          /* of objects and arrays around it */
	const char *name;        /* in an object; in an array that of the array */
	size_t name_size;
	const char *text; /* a string, a number; a word: true, false, null */
	size_t size;
};

typedef void gps_json_told(void *context, const struct gps_json_item *item);

/* False: this is not one whole object, or too deep. What was told before counts for nothing then. */
bool gps_json_read(const char *text, size_t size, gps_json_told *told, void *context);

/*
 * A number times 10^decimals, rounded half away from zero. False: its magnitude is 10^9 or more, or it has an exponent, as
 * gpsd writes none.
 */
bool gps_json_number(const struct gps_json_item *item, unsigned decimals, int64_t *out);
bool gps_json_is(const struct gps_json_item *item, const char *name);

#endif
