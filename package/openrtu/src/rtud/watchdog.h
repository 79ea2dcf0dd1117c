/* SPDX-License-Identifier: GPL-3.0-or-later */
/*
 * The board's watchdog, fed by rtud's own loop. What feeding it says: rtud is scheduled, and its loop turns: it has
 * reaped and restarted modules, looked at every heartbeat and served its requests. Nothing else is asked of the
 * gateway, for nothing else is mended by a reset: a dead Modbus device, a line without its port and a module in its
 * pause before the next start, which rtud itself takes care of, do not reset the board.
 */
#ifndef OPENRTU_RTUD_WATCHDOG_H
#define OPENRTU_RTUD_WATCHDOG_H

#define WATCHDOG_ASKED_S                                                                                     \
	30 /* rtud is started again within a second or two; a hung board is seen to in half a minute */

/*
 * Opens the device, which starts it, and asks for WATCHDOG_ASKED_S; a device that cannot have them keeps its own.
 * Returns a descriptor that is closed on exec, and the time-out that the device has in *timeout_s; or -1 with errno.
 */
int watchdog_open(const char *device, int *timeout_s);
/* As long as this comes within the time-out, the board is not reset. */
void watchdog_feed(int fd);
/* The orderly end: stops the watchdog, unless the kernel has been told that nothing may. */
void watchdog_stop(int fd);

#endif
