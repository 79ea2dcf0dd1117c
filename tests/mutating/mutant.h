/* SPDX-License-Identifier: GPL-3.0-or-later */
/* Before each source of a build with mutants. */
#ifndef MUTANT_H
#define MUTANT_H

extern unsigned mutant_on;             /* the number of the mutant that is on; 0: none */
extern unsigned char *mutants_reached; /* for each number, whether its place was reached */

static inline int mutant(unsigned number) {
    mutants_reached[number] = 1;
    return mutant_on == number;
}

#endif
