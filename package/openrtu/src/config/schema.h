/* SPDX-License-Identifier: GPL-3.0-or-later */
/* The JSON Schema of a file, from the rules that read it. */
#ifndef OPENRTU_CONFIG_SCHEMA_H
#define OPENRTU_CONFIG_SCHEMA_H

#include "config/keys.h"

#if OPENRTU_SCHEMA
/* The schema of a file whose outermost object has the rules of the table, and in $defs those of each table that they lead to. NULL: no memory. */
json_t *config_schema(const struct config_table *file);
#endif

#endif
