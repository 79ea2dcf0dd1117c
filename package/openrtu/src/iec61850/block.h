/* SPDX-License-Identifier: GPL-3.0-or-later */
/* Control blocks of reports, as clients write them (IEC 61850-7-2, clause 17). A block belongs to the association that reserved it. */
#ifndef OPENRTU_IEC61850_BLOCK_H
#define OPENRTU_IEC61850_BLOCK_H

#include "iec61850/mms.h"

/* Writes an attribute of a control block for server->client. 0, or a DataAccessError. */
int iec61850_block_write(struct iec61850_server *server, const struct iec61850_object *object,
			 const struct ber_element *data);
void iec61850_block_enable(struct iec61850_model *model, struct iec61850_block *block, bool on,
			   int64_t now_ns);
/* A client is gone: its blocks are free. */
void iec61850_blocks_release(struct iec61850_server *server, const void *client);
/* Ends reservations whose time is over: each second or so. */
void iec61850_blocks_tick(struct iec61850_server *server);
bool iec61850_blocks_owned(const struct iec61850_server *server, const void *client);

#endif
