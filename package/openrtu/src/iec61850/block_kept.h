/* SPDX-License-Identifier: GPL-3.0-or-later */
/* What outlives a process of the module: settings of buffered blocks, and where their clients are in the buffer. */
#ifndef OPENRTU_IEC61850_BLOCK_KEPT_H
#define OPENRTU_IEC61850_BLOCK_KEPT_H

#include "iec61850/mms.h"

/*
 * At the start: what a former process of the module has kept in section goes on, from the place in cursor, which is set then. Without
 * one, all begins where cursor is, with start in the EntryIDs.
 */
void iec61850_blocks_begin(struct iec61850_server *server, void *section, struct map_cursor *cursor,
			   uint32_t start);
/* Of a buffered block: as its attributes are now. */
void iec61850_block_save(const struct iec61850_block *block);

#endif
