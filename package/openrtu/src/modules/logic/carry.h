/* SPDX-License-Identifier: GPL-3.0-or-later */
#ifndef OPENRTU_MODULES_LOGIC_CARRY_H
#define OPENRTU_MODULES_LOGIC_CARRY_H

#include "logic/config.h"

/* From the section of the process that ran an instance to that of the one that will run what it is in another configuration. */
void logic_carry_kept(const struct map_config *before, const struct logic_instance *was, const void *from,
		      const struct map_config *now, const struct logic_instance *is, void *to);

#endif
