/* SPDX-License-Identifier: GPL-3.0-or-later */
#include "histogram.h"

#include "map/map.h"
#include "map/time_ns.h"

void modbus_histogram_add(struct modbus_histogram *histogram, int64_t duration_ns)
{
	int64_t us = duration_ns > 0 ? duration_ns / NS_PER_US : 0;

	histogram->counts[map_bucket_of(us)]++;
	if (us > histogram->longest_us)
		histogram->longest_us = us < UINT32_MAX ? (uint32_t)us : UINT32_MAX;
}
