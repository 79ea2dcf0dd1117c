/* SPDX-License-Identifier: GPL-3.0-or-later */
/*
 * Lines of NMEA 0183 out of octets: "$" address "," fields "*" checksum, CR LF. The checksum is asked for: a line that was
 * cut has none.
 */
#ifndef OPENRTU_GPS_LINE_H
#define OPENRTU_GPS_LINE_H

#include <stdbool.h>
#include <stddef.h>
#include <stdint.h>

#define NMEA_LINE_MAX   128 /* the standard has 82 octets; receivers have longer lines of their own */
#define NMEA_FIELDS_MAX 40

/* What is taken from a line, what is not, and why. */
enum nmea_counter {
	NMEA_TAKEN,   /* sentences that we read */
	NMEA_DAMAGED, /* no or a wrong checksum, cut, too long, a field that cannot be */
	NMEA_UNKNOWN, /* sound, but of a kind that we do not read */
	NMEA_STRAY,   /* octets outside a line */
	NMEA_COUNTERS
};

struct nmea_text {
	const char *at;
	size_t size;
};

/* A line whose checksum is right. fields[0] is the address, as GPGGA. It lies in the line's buffer until the next octet. */
struct nmea_sentence {
	struct nmea_text fields[NMEA_FIELDS_MAX];
	unsigned count;
};

enum nmea_state {
	NMEA_OUTSIDE,
	NMEA_AMONG_STRAY,
	NMEA_INSIDE,
	NMEA_DROPPED, /* the rest of a damaged line */
};

/* All 0 to begin with. */
struct nmea_line {
	uint32_t counters[NMEA_COUNTERS];
	enum nmea_state state;
	uint8_t size;
	char text[NMEA_LINE_MAX];
};

/* Takes an octet. True: it ended a sound line, and *out is that. */
bool nmea_line_take(struct nmea_line *line, uint8_t octet, struct nmea_sentence *out);

#endif
