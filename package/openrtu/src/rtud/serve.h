/* SPDX-License-Identifier: GPL-3.0-or-later */
/* Requests to rtud: of the clock, of modules, of the configuration, of forces. */
#ifndef OPENRTU_RTUD_SERVE_H
#define OPENRTU_RTUD_SERVE_H

#include "rtud/supervisor.h"

/* All that wait. A reset happens later, at supervisor->reset_at_ns. */
void serve_requests(struct supervisor *supervisor);

#endif
