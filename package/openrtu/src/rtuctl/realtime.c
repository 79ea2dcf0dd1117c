/* SPDX-License-Identifier: GPL-3.0-or-later */
#include "rtuctl/realtime.h"

#include <limits.h>
#include <sched.h>
#include <stdio.h>
#include <string.h>

#define STAT_SIZE 1024

bool realtime_kernel(const char *file, const char *version)
{
	FILE *stream = fopen(file, "re");
	bool is_one = stream != NULL && fgetc(stream) == '1';

	if (stream != NULL)
		fclose(stream);
	return is_one || strstr(version, "PREEMPT_RT") != NULL;
}

static FILE *open_of(const char *proc, int32_t pid, const char *name)
{
	char path[PATH_MAX];

	snprintf(path, sizeof(path), "%s/%d/%s", proc, pid, name);
	return fopen(path, "re");
}

/* proc(5): fields 40 and 41 of stat. The second, the name in brackets, may hold anything; the third is behind them. */
static bool read_scheduling(const char *proc, int32_t pid, struct realtime_grant *grant)
{
	enum { FIRST = 3, PRIORITY = 40 };
	char line[STAT_SIZE] = "";
	FILE *file = open_of(proc, pid, "stat");
	const char *at;
	unsigned priority, policy;

	if (file == NULL)
		return false;
	line[fread(line, 1, sizeof(line) - 1, file)] = '\0';
	fclose(file);
	at = strrchr(line, ')');
	for (int field = FIRST; at != NULL && field <= PRIORITY; field++)
		at = strchr(at + 1, ' ');
	if (at == NULL || sscanf(at, "%u %u", &priority, &policy) != 2)
		return false;
	grant->fifo = policy == SCHED_FIFO;
	grant->priority = priority;
	return true;
}

static bool read_locked(const char *proc, int32_t pid, struct realtime_grant *grant)
{
	char line[STAT_SIZE];
	FILE *file = open_of(proc, pid, "status");
	bool found = false;

	if (file == NULL)
		return false;
	while (!found && fgets(line, sizeof(line), file) != NULL)
		found = sscanf(line, "VmLck: %u kB", &grant->locked_kib) == 1;
	fclose(file);
	return found;
}

struct realtime_grant realtime_granted(const char *proc, int32_t pid)
{
	struct realtime_grant grant = {.running = true};

	if (!read_scheduling(proc, pid, &grant) || !read_locked(proc, pid, &grant))
		return (struct realtime_grant){.running = false};
	return grant;
}

void realtime_words(const struct realtime_grant *grant, char out[REALTIME_WORDS_SIZE])
{
	char scheduling[REALTIME_WORDS_SIZE / 2] = "ordinary scheduling";

	if (grant->priority > 0)
		snprintf(scheduling, sizeof(scheduling), "%s %u", grant->fifo ? "SCHED_FIFO" : "SCHED_RR",
			 grant->priority);
	if (!grant->running)
		snprintf(out, REALTIME_WORDS_SIZE, "does not run");
	else if (grant->locked_kib > 0)
		snprintf(out, REALTIME_WORDS_SIZE, "%s, %u KiB locked", scheduling, grant->locked_kib);
	else
		snprintf(out, REALTIME_WORDS_SIZE, "%s, memory not locked", scheduling);
}

bool realtime_is(bool is_realtime_kernel, const struct realtime_grant *grant)
{
	return is_realtime_kernel && grant->running && grant->fifo && grant->locked_kib > 0;
}

const char *realtime_verdict(bool is_realtime_kernel, const struct realtime_grant *grant, uint8_t priority,
			     uint32_t longest_us)
{
	if (!is_realtime_kernel)
		return "none: this kernel is not PREEMPT_RT, so the measurement guarantees nothing";
	if (!grant->running)
		return "none: the line's process does not run";
	if (!grant->fifo && priority == 0)
		return "none: the lines have no real-time priority, so the measurement guarantees nothing";
	if (!grant->fifo)
		return "none: the line's process was not given its real-time priority, so the measurement "
		       "guarantees nothing";
	if (grant->locked_kib == 0)
		return "none: the memory of the line's process is not locked, so the measurement guarantees "
		       "nothing";
	if (longest_us > REALTIME_LIMIT_US)
		return "bad: a wake-up was more than 500 us late";
	return "good: no wake-up was more than 500 us late";
}
