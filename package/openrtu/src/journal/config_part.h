/* SPDX-License-Identifier: GPL-3.0-or-later */
#ifndef OPENRTU_JOURNAL_CONFIG_PART_H
#define OPENRTU_JOURNAL_CONFIG_PART_H

#include "config/part.h"

/* "journal": without the object there is none. */
extern const struct config_part journal_part;

#endif
