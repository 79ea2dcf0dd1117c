/* SPDX-License-Identifier: GPL-3.0-or-later */
/* Where the device keeps /data: the start scripts leave it in the map's folder, as "flash" or "memory: WHY". */
#ifndef OPENRTU_RTUCTL_DATA_H
#define OPENRTU_RTUCTL_DATA_H

#include <stdbool.h>

#define DATA_LINE_SIZE 160

/* What a person reads of it, terminator included; folder is where the data is. False when dir says nothing. */
bool data_line(const char *dir, const char *folder, char line[DATA_LINE_SIZE]);

#endif
