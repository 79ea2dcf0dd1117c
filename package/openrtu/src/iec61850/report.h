/* SPDX-License-Identifier: GPL-3.0-or-later */
/*
 * Reports of unbuffered report control blocks (IEC 61850-7-2, clause 17; 8-1, clause 17). A block belongs to the association that
 * reserved it. What a client has not taken when a point changes again is told by its newest value.
 */
#ifndef OPENRTU_IEC61850_REPORT_H
#define OPENRTU_IEC61850_REPORT_H

#include "iec61850/mms.h"

/* Writes an attribute of a control block for server->client. 0, or a DataAccessError. */
int iec61850_block_write(struct iec61850_server *server, const struct iec61850_object *object,
			 const struct ber_element *data);
/* A client is gone: its blocks are free. */
void iec61850_blocks_release(struct iec61850_server *server, const void *client);
bool iec61850_blocks_owned(const struct iec61850_server *server, const void *client);
/* Takes the image of all points; what differs from the former one is pending. At the start, and when events were lost. */
void iec61850_report_all(struct iec61850_server *server, int64_t now_ns);
/* What has happened. */
void iec61850_report_event(struct iec61850_server *server, const struct map_event *event, int64_t now_ns);
/* Puts the next report that is due for server->client. False: there is none. */
bool iec61850_report_put(struct iec61850_server *server, struct ber_writer *writer);
/* When the next one will be due; INT64_MAX: never, as it looks now. */
int64_t iec61850_report_due_ns(const struct iec61850_server *server);

#endif
