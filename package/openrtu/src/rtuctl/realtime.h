/* SPDX-License-Identifier: GPL-3.0-or-later */
/* What measured wake-ups are worth. */
#ifndef OPENRTU_RTUCTL_REALTIME_H
#define OPENRTU_RTUCTL_REALTIME_H

#include <stdbool.h>
#include <stdint.h>

#define REALTIME_LIMIT_US 500 /* docs/realtime.md: what a UART's FIFO leaves at 115200 bit/s */

/*
 * True on a PREEMPT_RT kernel: it says 1 in the file ("/sys/kernel/realtime"; the patch has it), or PREEMPT_RT in its
 * version, as uname -v prints it.
 */
bool realtime_kernel(const char *file, const char *version);

/* A sentence on a line's longest wake-up. priority: SCHED_FIFO of its process, 0: none. */
const char *realtime_verdict(bool is_realtime_kernel, uint8_t priority, uint32_t longest_us);

#endif
