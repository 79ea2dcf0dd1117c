/* SPDX-License-Identifier: GPL-3.0-or-later */
/* What a line and its devices have counted, in the map for whoever watches. */
#ifndef OPENRTU_MODULES_MODBUS_LINE_COUNTERS_H
#define OPENRTU_MODULES_MODBUS_LINE_COUNTERS_H

#include "modules/modbus/port.h"

/* Goes on counting where a former process has ended: what it showed. */
void line_counters_take(struct port *port);
/* Shows the counters as they are now, and of each device what has been learned of it since the last time. */
void line_counters_show(struct port *port);

#endif
