/* SPDX-License-Identifier: GPL-3.0-or-later */
/* What rtud --check says of the net. */
#ifndef OPENRTU_SYNCH_CHECK_H
#define OPENRTU_SYNCH_CHECK_H

#include <stdio.h>

#include "synch/net.h"

/* Nothing where there is no net. False: no memory. */
bool synch_print(const struct map_config *config, FILE *out);

#endif
