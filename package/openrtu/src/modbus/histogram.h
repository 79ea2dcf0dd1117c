/* SPDX-License-Identifier: GPL-3.0-or-later */
/* How often durations were how long, in powers of two: what an average hides. */
#ifndef OPENRTU_MODBUS_HISTOGRAM_H
#define OPENRTU_MODBUS_HISTOGRAM_H

#include <stdint.h>

/* The first is below 1 us, number i from 2^(i-1) to below 2^i us, the last whatever is longer: from 524 ms on. */
#define MODBUS_BUCKETS 21

struct modbus_histogram {
	uint32_t counts[MODBUS_BUCKETS];
	uint32_t longest_us;
};

/* A duration below 0 counts as 0. */
void modbus_histogram_add(struct modbus_histogram *histogram, int64_t duration_ns);

#endif
