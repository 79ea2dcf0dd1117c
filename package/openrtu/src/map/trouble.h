/* SPDX-License-Identifier: GPL-3.0-or-later */
/*
 * What the log says of something that fails and is well again: a connection, a device.
 *
 * The first failure is said at once, and so is the end of the first trouble. While it goes on to fail, failures are counted, and
 * said with the count when map/repeats.h has it, and once meanwhile if there is another reason. What was said to be well again
 * and failed once more comes and goes: it is said to be well when it has been so as long as the pause between the lines. So the
 * last line of the log is true of it, however often it comes and goes. After an hour without a failure it begins anew.
 */
#ifndef OPENRTU_MAP_TROUBLE_H
#define OPENRTU_MAP_TROUBLE_H

#include "map/repeats.h"

#define MAP_TROUBLE_SIZE 64

/* Begins with zeros. */
struct map_trouble {
	struct map_repeats repeats; /* lines about failures */
	int64_t since_ns;
	int64_t well_ns;   /* since then it is well; 0: it is not */
	uint32_t failures; /* since it began */
	uint32_t reason;   /* of the last line, a hash */
	bool another_said; /* since then, a line for another reason */
	bool is;
	bool said;  /* the last line says so */
	bool ended; /* one ended less than an hour ago */
};

/* It fails. True: the log is to say so, with map_trouble_times. */
bool map_trouble_failed(struct map_trouble *trouble, const char *reason, int64_t now_ns);
/*
 * It is well, now and since the last call. True: the log is to say so, with map_trouble_ended. Where there was no trouble, that
 * is its owner's to say.
 */
bool map_trouble_well(struct map_trouble *trouble, int64_t now_ns);

/* "; 7 times in 30 s", or nothing of the first. Returns text. */
const char *map_trouble_times(const struct map_trouble *trouble, int64_t now_ns, char text[MAP_TROUBLE_SIZE]);
/* ", again after 7 failures in 30 s". Returns text. */
const char *map_trouble_ended(const struct map_trouble *trouble, int64_t now_ns, char text[MAP_TROUBLE_SIZE]);

#define MAP_DURATION_SIZE 24

/* "500 ms", "30 s", "7 min", "9 h". Returns text. */
const char *map_duration(int64_t ns, char text[MAP_DURATION_SIZE]);

#endif
