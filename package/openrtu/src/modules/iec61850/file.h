/* SPDX-License-Identifier: GPL-3.0-or-later */
/* The one file that clients may read: the SCL file of this server. */
#ifndef OPENRTU_MODULES_IEC61850_FILE_H
#define OPENRTU_MODULES_IEC61850_FILE_H

#include "iec61850/mms.h"

/*
 * Takes the file that rtud has written, from its descriptor: memory of the kernel, of which the process maps no more than is
 * read. Without it, which is logged, there is no file.
 */
void file_take(struct iec61850_server *server, struct map *map, int fd);

#endif
