/* SPDX-License-Identifier: GPL-3.0-or-later */
/*
 * In each program of a build with mutants. MUTANT has the number of the one that is on, MUTANTS_REACHED the file that keeps, over the
 * death of the program and of those that it starts, which places were reached. A module of the gateway has neither in its
 * environment; then they are in MUTANTS_FOLDER.
 */
#include "mutant.h"

#include <fcntl.h>
#include <stdlib.h>
#include <sys/mman.h>
#include <unistd.h>

enum { MUTANTS = 65536 };

static unsigned char nowhere[MUTANTS];
unsigned mutant_on;
unsigned char *mutants_reached = nowhere;

static void read_number(char *number, size_t size) {
    int file = open(MUTANTS_FOLDER "/on", O_RDONLY | O_CLOEXEC);
    ssize_t got = file < 0 ? 0 : read(file, number, size - 1);
    number[got > 0 ? got : 0] = '\0';
    if (file >= 0)
        close(file);
}

__attribute__((constructor(101))) static void mutant_chosen(void) {
    const char *number = getenv("MUTANT"), *path = getenv("MUTANTS_REACHED");
    char text[12];
    if (!number)
        read_number(text, sizeof(text));
    mutant_on = (unsigned)strtoul(number ? number : text, NULL, 10);
    int file = open(path ? path : MUTANTS_FOLDER "/reached.bin", O_RDWR | O_CLOEXEC);
    if (file < 0)
        return;
    void *map = mmap(NULL, MUTANTS, PROT_READ | PROT_WRITE, MAP_SHARED, file, 0);
    close(file);
    if (map != MAP_FAILED)
        mutants_reached = map;
}
