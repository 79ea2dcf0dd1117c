/* SPDX-License-Identifier: GPL-3.0-or-later */
/*
 * A module of 100 inputs and 20 outputs on libopenrtu, which measures itself: "in-0" .. "in-99" and "out-0" .. "out-19".
 *
 * Prints a line for each reading, "BENCH attach 123456" in nanoseconds: the time to attach, the processor time of a scan with the wake-up
 * before it and of one in a row of them, and, where the file has the synchronisation point "fire", the round trip of a firing. Where
 * it is counted, "COUNT instructions 1234" and so on are of a scan with the wake-up. Then it goes on scanning.
 */
#include <openrtu.h>
#include <stdint.h>
#include <stdio.h>
#include <time.h>

#include "counts.h"

enum { INPUTS = 100, OUTPUTS = 20, BATCHES = 9, SCANS = 200, FIRINGS = 200 };

static int inputs[INPUTS], outputs[OUTPUTS];

static int64_t now_ns(clockid_t clock)
{
	struct timespec now;

	clock_gettime(clock, &now);
	return (int64_t)now.tv_sec * 1000000000 + now.tv_nsec;
}

static void say(const char *what, int64_t ns)
{
	fprintf(stderr, "BENCH %s %lld\n", what, (long long)ns);
}

static bool find_points(struct openrtu *rtu)
{
	char name[16];

	for (int i = 0; i < INPUTS; i++) {
		snprintf(name, sizeof(name), "in-%d", i);
		inputs[i] = openrtu_point(rtu, name);
		if (inputs[i] < 0)
			return false;
	}
	for (int i = 0; i < OUTPUTS; i++) {
		snprintf(name, sizeof(name), "out-%d", i);
		outputs[i] = openrtu_point(rtu, name);
		if (outputs[i] < 0)
			return false;
	}
	return true;
}

static void compute(struct openrtu *rtu)
{
	struct openrtu_sample sample;
	double sum = 0;

	for (int i = 0; i < INPUTS; i++) {
		openrtu_read(rtu, inputs[i], &sample);
		sum += sample.value;
	}
	for (int i = 0; i < OUTPUTS; i++)
		openrtu_write(rtu, outputs[i], sum + i);
}

static void scan_now(struct openrtu *rtu)
{
	openrtu_scan_begin(rtu);
	compute(rtu);
	openrtu_scan_end(rtu);
}

static bool scan(struct openrtu *rtu)
{
	if (!openrtu_wait(rtu))
		return false;
	scan_now(rtu);
	return true;
}

/* One behind the other, without a wake-up. */
static void measure_row(struct openrtu *rtu)
{
	const int64_t begun_ns = now_ns(CLOCK_PROCESS_CPUTIME_ID);

	for (int i = 0; i < SCANS; i++)
		scan_now(rtu);
	say("row", (now_ns(CLOCK_PROCESS_CPUTIME_ID) - begun_ns) / SCANS);
}

/* A scan is open, so that its module may fire. */
static void measure_firing(struct openrtu *rtu)
{
	int64_t begun_ns;

	if (!openrtu_wait(rtu))
		return;
	openrtu_scan_begin(rtu);
	begun_ns = now_ns(CLOCK_MONOTONIC);
	for (int i = 0; i < FIRINGS; i++)
		if (openrtu_synch(rtu, "fire", true) < 0)
			return;
	say("firing", (now_ns(CLOCK_MONOTONIC) - begun_ns) / FIRINGS);
	openrtu_scan_end(rtu);
}

int main(int argc, char **argv)
{
	int64_t begun_ns = now_ns(CLOCK_MONOTONIC);
	struct openrtu *rtu = openrtu_attach(argc, argv);

	if (rtu == NULL || !find_points(rtu))
		return 1;
	say("attach", now_ns(CLOCK_MONOTONIC) - begun_ns);
	for (int batch = 0; batch < BATCHES; batch++) {
		const struct counts since = counts_now();

		begun_ns = now_ns(CLOCK_PROCESS_CPUTIME_ID);
		for (int i = 0; i < SCANS && scan(rtu);)
			i++;
		say("scan", (now_ns(CLOCK_PROCESS_CPUTIME_ID) - begun_ns) / SCANS);
		counts_say(since, SCANS);
		measure_row(rtu);
		measure_firing(rtu);
	}
	say("end", 0);
	while (scan(rtu))
		;
	openrtu_detach(rtu);
	return 0;
}
