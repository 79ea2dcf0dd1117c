/* SPDX-License-Identifier: GPL-3.0-or-later */
/* A receiver's time for chrony, which weighs it and sets the system's clock: its reference clock of type SOCK. */
#ifndef OPENRTU_MODULES_GPS_CLOCK_H
#define OPENRTU_MODULES_GPS_CLOCK_H

#include "gps/config.h"
#include "gps/fix.h"

/* The socket by which samples go; before the process is confined. -1: there is none. */
int clock_socket(void);

/* Tells the time of a fix, if its receiver names a socket and the time is its satellites'. Nobody is waited for. */
void clock_tell(int fd, const struct gps_settings *settings, const struct gps_fix *fix);

#endif
