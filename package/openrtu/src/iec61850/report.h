/* SPDX-License-Identifier: GPL-3.0-or-later */
/*
 * Reports (IEC 61850-7-2, clause 17; 8-1, clause 17). A block belongs to the association that reserved it. What the client of an
 * unbuffered block has not taken when a point changes again is told by its newest value; a buffered block tells each change.
 */
#ifndef OPENRTU_IEC61850_REPORT_H
#define OPENRTU_IEC61850_REPORT_H

#include "iec61850/mms.h"

/* Writes an attribute of a control block for server->client. 0, or a DataAccessError. */
int iec61850_block_write(struct iec61850_server *server, const struct iec61850_object *object,
			 const struct ber_element *data);
/* A client is gone: its blocks are free. */
void iec61850_blocks_release(struct iec61850_server *server, const void *client);
/* Ends reservations whose time is over: each second or so. */
void iec61850_blocks_tick(struct iec61850_server *server);
bool iec61850_blocks_owned(const struct iec61850_server *server, const void *client);
/*
 * At the start: what a former process of the module has kept in section goes on, from the place in cursor, which is set then. Without
 * one, all begins where cursor is, with start in the EntryIDs.
 */
void iec61850_report_begin(struct iec61850_server *server, void *section, struct map_cursor *cursor,
			   uint32_t start);
/* The events before this place were told to iec61850_report_event. */
/* Tells whether a point is selected, if that has changed: by whom and how ever. */
void iec61850_report_selection(struct iec61850_server *server, uint32_t point, int64_t now_ns);
/* The same of all points: a selection that others make, or that ends by itself, rings no bell. */
void iec61850_report_selections(struct iec61850_server *server, int64_t now_ns);
void iec61850_report_settle(struct iec61850_server *server, const struct map_cursor *cursor);
/* Takes the image of all points; what differs from the former one is pending. When events were lost. */
void iec61850_report_all(struct iec61850_server *server, int64_t now_ns);
/* What has happened. */
void iec61850_report_event(struct iec61850_server *server, const struct map_event *event, int64_t now_ns);
/* Puts the next report that is due for server->client. False: there is none. */
bool iec61850_report_put(struct iec61850_server *server, struct ber_writer *writer);
/* When the next one will be due; INT64_MAX: never, as it looks now. */
int64_t iec61850_report_due_ns(const struct iec61850_server *server);

#endif
