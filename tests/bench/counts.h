/* SPDX-License-Identifier: GPL-3.0-or-later */
/* What count_memory.c has counted so far, for the program that it counts: built with -DCOUNTS="FILE", which is its file. */
#ifndef COUNTS_H
#define COUNTS_H

#include <fcntl.h>
#include <stdint.h>
#include <stdio.h>
#include <unistd.h>

#ifndef COUNTS
#define COUNTS "" /* nobody counts */
#endif

struct counts {
	uint64_t instructions, calls, octets;
};

static inline struct counts counts_now(void)
{
	struct counts counts = {0};
	int fd = open(COUNTS, O_RDONLY);

	if (fd < 0)
		return counts;
	if (read(fd, &counts, sizeof(counts)) != sizeof(counts))
		counts = (struct counts){0};
	close(fd);
	return counts;
}

/* Of each of so many scans since then. */
static inline void counts_say(struct counts since, unsigned scans)
{
	const struct counts now = counts_now();

	if (now.instructions == 0)
		return;
	fprintf(stderr, "COUNT instructions %.0f\nCOUNT calls %.0f\nCOUNT octets %.0f\n",
		(double)(now.instructions - since.instructions) / scans,
		(double)(now.calls - since.calls) / scans, (double)(now.octets - since.octets) / scans);
}

#endif
