/* SPDX-License-Identifier: GPL-3.0-or-later */
/* What measured wake-ups are worth. */
#ifndef OPENRTU_RTUCTL_REALTIME_H
#define OPENRTU_RTUCTL_REALTIME_H

#include <stdbool.h>
#include <stdint.h>

#define REALTIME_LIMIT_US   500 /* docs/realtime.md: what a UART's FIFO leaves at 115200 bit/s */
#define REALTIME_WORDS_SIZE 64

/* What the kernel has given a process, whatever the configuration wants; all 0: it is not there. */
struct realtime_grant {
	bool running;
	bool fifo;           /* SCHED_FIFO */
	uint32_t priority;   /* 1..99, 0: ordinary scheduling */
	uint32_t locked_kib; /* memory that is never paged out, 0: none */
};

/*
 * True on a PREEMPT_RT kernel: it says 1 in the file ("/sys/kernel/realtime"; the patch has it), or PREEMPT_RT in its
 * version, as uname -v prints it.
 */
bool realtime_kernel(const char *file, const char *version);

/* Asks the kernel about a process; anybody may. proc: "/proc". */
struct realtime_grant realtime_granted(const char *proc, int32_t pid);

/* "SCHED_FIFO 45, 5120 KiB locked" */
void realtime_words(const struct realtime_grant *grant, char out[REALTIME_WORDS_SIZE]);

/* Whether what was measured of the process promises anything. */
bool realtime_is(bool is_realtime_kernel, const struct realtime_grant *grant);

/* A sentence on a line's longest wake-up. priority: what the configuration wants for its process, 0: none. */
const char *realtime_verdict(bool is_realtime_kernel, const struct realtime_grant *grant, uint8_t priority,
			     uint32_t longest_us);

#endif
