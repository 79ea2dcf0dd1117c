/* SPDX-License-Identifier: GPL-3.0-or-later */
/*
 * A module that changes "changed" each scan, and says when: "BENCH change 17 123456", the value and the time of day in nanoseconds right
 * before it is published.
 */
#include <openrtu.h>
#include <stdint.h>
#include <stdio.h>
#include <time.h>

static int64_t now_ns(void)
{
	struct timespec now;

	clock_gettime(CLOCK_REALTIME, &now);
	return (int64_t)now.tv_sec * 1000000000 + now.tv_nsec;
}

int main(int argc, char **argv)
{
	struct openrtu *rtu = openrtu_attach(argc, argv);
	int point;

	if (rtu == NULL || (point = openrtu_point(rtu, "changed")) < 0)
		return 1;
	for (int value = 1; openrtu_wait(rtu); value++) {
		int64_t begun_ns;

		openrtu_scan_begin(rtu);
		openrtu_write(rtu, point, value);
		begun_ns = now_ns();
		openrtu_scan_end(rtu);
		fprintf(stderr, "BENCH change %d %lld\n", value, (long long)begun_ns);
	}
	openrtu_detach(rtu);
	return 0;
}
