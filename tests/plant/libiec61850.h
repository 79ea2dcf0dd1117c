/* SPDX-License-Identifier: GPL-3.0-or-later */
/* What both programs on libiec61850 use of it: the package pyiec61850-ng has the library without its headers. */
#ifndef PLANT_LIBIEC61850_H
#define PLANT_LIBIEC61850_H

#include <stdbool.h>
#include <stdint.h>
#include <time.h>

#define NS_PER_S 1000000000LL

enum { ARRAY, STRUCTURE, BOOLEAN, BITS, INTEGER, UNSIGNED, FLOATING, UTC_TIME = 14 }; /* MmsType */

int MmsValue_getType(void *value);
int MmsValue_getArraySize(void *value);
void *MmsValue_getElement(void *value, int place);
bool MmsValue_getBoolean(void *value);
int64_t MmsValue_toInt64(void *value);
uint32_t MmsValue_getBitStringAsInteger(void *value);

/* Plant time. */
static inline long long now_ns(void)
{
	struct timespec now;

	clock_gettime(CLOCK_MONOTONIC, &now);
	return now.tv_sec * NS_PER_S + now.tv_nsec;
}

#endif
