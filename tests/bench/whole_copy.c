/* SPDX-License-Identifier: GPL-3.0-or-later */
/*
 * A module's scan after MatPLC's method: one semaphore of System V around one map, of which each scan takes a whole copy.
 *
 *     whole_copy POINTS PERIOD_MS
 *
 * A point is what it is in our map: value, quality, time. Nobody else wants the semaphore, which is the best case of the method.
 * Prints what scan_module.c does of a scan, and what the wake-up alone takes.
 */
#include <stdint.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <sys/ipc.h>
#include <sys/mman.h>
#include <sys/sem.h>
#include <time.h>

#include "counts.h"

enum { INPUTS = 100, OUTPUTS = 20, BATCHES = 9, SCANS = 200 };

struct point {
	float value;
	uint8_t quality, detail;
	uint16_t reserved;
	int64_t time_ns;
};

static struct point *global_map, *private_map;
static size_t points;
static int semaphore;

static int64_t now_ns(clockid_t clock)
{
	struct timespec now;

	clock_gettime(clock, &now);
	return (int64_t)now.tv_sec * 1000000000 + now.tv_nsec;
}

static void take(short by)
{
	struct sembuf operation = {.sem_op = by, .sem_flg = SEM_UNDO};

	if (semop(semaphore, &operation, 1) < 0)
		exit(1);
}

/* Own points out, all others in. */
static void update(void)
{
	take(-1);
	memcpy(global_map + INPUTS, private_map + INPUTS, OUTPUTS * sizeof(*global_map));
	memcpy(private_map, global_map, points * sizeof(*global_map));
	take(1);
}

static void compute(void)
{
	const int64_t time_ns = now_ns(CLOCK_MONOTONIC);
	double sum = 0;

	for (int i = 0; i < INPUTS; i++)
		sum += (double)private_map[i].value;
	for (int i = 0; i < OUTPUTS; i++)
		private_map[INPUTS + i] = (struct point){.value = (float)(sum + i), .time_ns = time_ns};
}

static void say(const char *what, int64_t begun_ns)
{
	printf("BENCH %s %lld\n", what, (long long)((now_ns(CLOCK_PROCESS_CPUTIME_ID) - begun_ns) / SCANS));
}

static void sleep_until(int64_t at_ns)
{
	const struct timespec at = {at_ns / 1000000000, at_ns % 1000000000};

	clock_nanosleep(CLOCK_MONOTONIC, TIMER_ABSTIME, &at, NULL);
}

int main(int argc, char **argv)
{
	const int64_t period_ns = argc == 3 ? atoll(argv[2]) * 1000000 : 0;
	int64_t next_ns = now_ns(CLOCK_MONOTONIC);

	points = argc == 3 ? strtoul(argv[1], NULL, 10) : 0;
	if (points < INPUTS + OUTPUTS || period_ns <= 0) {
		fputs("usage: whole_copy POINTS PERIOD_MS\n", stderr);
		return 2;
	}
	global_map = mmap(NULL, points * sizeof(*global_map), PROT_READ | PROT_WRITE,
			  MAP_SHARED | MAP_ANONYMOUS, -1, 0);
	private_map = calloc(points, sizeof(*private_map));
	semaphore = semget(IPC_PRIVATE, 1, 0600);
	if (global_map == MAP_FAILED || private_map == NULL || semaphore < 0)
		return 1;
	memset(global_map, 1, points * sizeof(*global_map)); /* or all of it were one page of zeros */
	take(1);
	for (int batch = 0; batch < BATCHES; batch++) {
		const struct counts since = counts_now();
		int64_t begun_ns = now_ns(CLOCK_PROCESS_CPUTIME_ID);

		for (int i = 0; i < SCANS; i++) {
			next_ns += period_ns;
			sleep_until(next_ns);
			update();
			compute();
		}
		say("scan", begun_ns);
		counts_say(since, SCANS);
		begun_ns = now_ns(CLOCK_PROCESS_CPUTIME_ID);
		for (int i = 0; i < SCANS; i++) {
			update();
			compute();
		}
		say("row", begun_ns);
		begun_ns = now_ns(CLOCK_PROCESS_CPUTIME_ID);
		next_ns = now_ns(CLOCK_MONOTONIC);
		for (int i = 0; i < SCANS; i++) {
			next_ns += period_ns;
			sleep_until(next_ns);
		}
		say("wake", begun_ns);
	}
	semctl(semaphore, 0, IPC_RMID);
	return 0;
}
