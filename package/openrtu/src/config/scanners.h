/* SPDX-License-Identifier: GPL-3.0-or-later */
/* What scans, and so may wait for others or be waited for: the parts name it, and the net of synch/ refers to it. */
#ifndef OPENRTU_CONFIG_SCANNERS_H
#define OPENRTU_CONFIG_SCANNERS_H

#include "config/files.h"

/*
 * waits: its scans can begin when others have ended theirs. priority: SCHED_FIFO, 0: none. Of a name that something else has, the
 * net can use neither.
 */
void config_add_scanner(struct config_loader *loader, const char *name, bool waits, int priority);
/* NULL: there is none of this name, or there are many. */
const struct config_scanner *config_find_scanner(const struct config_loader *loader, const char *name,
						 bool *many);

#endif
