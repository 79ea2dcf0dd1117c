/* SPDX-License-Identifier: GPL-3.0-or-later */
/* Where the programs of the modules are. */
#ifndef OPENRTU_RTUD_PROGRAMS_H
#define OPENRTU_RTUD_PROGRAMS_H

#include <stdbool.h>

/*
 * Whether the folder has the program, and it may be executed. When not, says so on stderr, and names --modules with the
 * folder that has it if that lies where a build or a moved installation has it, as seen from rtud's own program.
 */
bool programs_look_for(const char *folder, const char *program);

/* It is there, or where a build or a moved installation has it. */
bool programs_are_known(const char *folder, const char *program);

#endif
