/* SPDX-License-Identifier: GPL-3.0-or-later */
/*
 * `scan_cost PROGRAM SCANS`: the machine of rtu-logic by itself, with inputs that change from scan to scan. Prints the
 * nanoseconds of CPU and the octets of its memory, then each output. logic_scans.py compares it with the same program in C.
 */
#include <inttypes.h>
#include <stdio.h>
#include <stdlib.h>
#include <time.h>

#include "logic/logic.h"

#define FILE_MAX  (1 << 20)
#define PERIOD_US 10000

static int64_t cpu_ns(void)
{
	struct timespec now;

	clock_gettime(CLOCK_PROCESS_CPUTIME_ID, &now);
	return now.tv_sec * INT64_C(1000000000) + now.tv_nsec;
}

static void set_inputs(struct logic *logic, int64_t number)
{
	for (uint16_t i = 0; i < logic->head->points; i++) {
		const struct logic_point *point = &logic->points[i];
		struct logic_value value = {.quality = 0};

		if (point->written)
			continue;
		if (point->type == LOGIC_REAL)
			value.value.r = (float)(number * 7 % 100);
		else
			value.value.i = number / (3 + i) % 2;
		logic_set(logic, point, &value);
	}
}

static void print_outputs(const struct logic *logic)
{
	for (uint16_t i = 0; i < logic->head->points; i++) {
		struct logic_value value;

		logic_get(logic, &logic->points[i], &value);
		if (!logic->points[i].written)
			continue;
		if (logic->points[i].type == LOGIC_REAL)
			printf(" %.9g", (double)value.value.r);
		else
			printf(" %" PRId64, value.value.i);
	}
	putchar('\n');
}

int main(int argc, char **argv)
{
	FILE *file = argc == 3 ? fopen(argv[1], "rb") : NULL;
	uint8_t *octets = malloc(FILE_MAX);
	size_t size = file && octets ? fread(octets, 1, FILE_MAX, file) : 0,
	       needed = logic_memory(octets, size);
	void *memory = malloc(needed + 1);
	struct logic logic;
	const char *refusal = needed ? logic_load(&logic, memory, octets, size) : "no program";
	int64_t begun_ns;

	if (refusal) {
		fprintf(stderr, "scan_cost: %s\n", refusal);
		return 1;
	}
	begun_ns = cpu_ns();
	for (int64_t number = 0; number < atol(argv[2]); number++) {
		const struct logic_times times = {number * PERIOD_US, PERIOD_US, number * PERIOD_US};

		set_inputs(&logic, number);
		if (!logic_scan(&logic, &times, LOGIC_BUDGET_DEFAULT))
			return 1;
	}
	printf("%" PRId64 " %zu", cpu_ns() - begun_ns, needed);
	print_outputs(&logic);
	return 0;
}
