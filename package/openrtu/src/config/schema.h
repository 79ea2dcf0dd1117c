/* SPDX-License-Identifier: GPL-3.0-or-later */
/* The JSON Schema of a file, from the rules that read it: in a build with the option schema. */
#ifndef OPENRTU_CONFIG_SCHEMA_H
#define OPENRTU_CONFIG_SCHEMA_H

#include "config/keys.h"

/* Prints the schema of a file whose outermost object has the rules of the table. False: it could not. */
bool config_print_schema(const struct config_table *file, FILE *out);

#endif
