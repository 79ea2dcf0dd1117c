/* SPDX-License-Identifier: GPL-3.0-or-later */
/* The command line that rtud starts every module with. */
#ifndef OPENRTU_PROCESS_OPTIONS_H
#define OPENRTU_PROCESS_OPTIONS_H

#include <stdbool.h>

struct options {
	const char *map;     /* folder of the point map */
	const char *module;  /* name in it */
	const char *devices; /* folder of the serial devices: /dev unless it is given */
	int socket_fd;       /* that its kind has opened; -1: none */
	int file_fd;         /* that its kind has written about the configuration; -1: none */
	int filter_fd;       /* of the filter of its system calls, for confine(); -1: none */
};

/*
 * --map DIR --module NAME [--dev DIR] [--filter FD] [--socket FD] [--file FD]. Prints and exits for --help and --version. False, with the
 * usage of the program on stderr, for anything else.
 */
bool options_parse(int argc, char **argv, struct options *out);

#endif
