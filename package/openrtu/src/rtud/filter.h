/* SPDX-License-Identifier: GPL-3.0-or-later */
/*
 * What a module asks of the kernel once it has started: a filter of system calls (seccomp) with those of its kind (process/calls.h). rtud
 * makes it, since libseccomp and its memory are then needed in no module; the module puts it in force itself, behind its
 * own start (process/confine.h), so that nothing which only a start takes is allowed: no program is executed, no library
 * loaded, and no socket made but by a Modbus TCP line.
 */
#ifndef OPENRTU_RTUD_FILTER_H
#define OPENRTU_RTUD_FILTER_H

#include <sys/types.h>

#include "modules/kind.h"

#define FILTER_NAME_SIZE 32

/* Why this rtud's modules have no filter, for the log; NULL: they have. */
const char *filter_missing(void);

/*
 * The filter of a program, for this process, which is about to execute it. A call that it does not allow
 * raises SIGSYS. Returns a descriptor to read an array of struct sock_filter from, or -1 with errno.
 */
int filter_open(const struct kind_program *program);

/* A system call's name; "?" for a number that is none. */
void filter_name(int call, char name[FILTER_NAME_SIZE]);

#endif
