/* SPDX-License-Identifier: GPL-3.0-or-later */
#ifndef OPENRTU_RTUD_SCHEMA_H
#define OPENRTU_RTUD_SCHEMA_H

#include <stdbool.h>
#include <stdio.h>

/* Prints the JSON Schema of the configuration file. False: it could not. */
bool schema_print(FILE *out);

#endif
