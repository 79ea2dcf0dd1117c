/* SPDX-License-Identifier: GPL-3.0-or-later */
#ifndef OPENRTU_GOOSE_CONFIG_PART_H
#define OPENRTU_GOOSE_CONFIG_PART_H

#include "config/part.h"

/* The key "goose". */
extern const struct config_part goose_part;

#endif
