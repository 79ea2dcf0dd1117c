/* SPDX-License-Identifier: GPL-3.0-or-later */
/* The modules' log lines, on rtud's standard error. */
#ifndef OPENRTU_RTUD_PRINT_H
#define OPENRTU_RTUD_PRINT_H

#include "rtud/supervisor.h"

/* At each tick; a module gone wild loses lines, which is said. */
void print_logs(struct supervisor *supervisor);
/* All that is left, and lost. */
void print_last_lines(struct supervisor *supervisor);

#endif
