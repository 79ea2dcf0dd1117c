/* SPDX-License-Identifier: GPL-3.0-or-later */
/*
 * Reports (IEC 61850-7-2, clause 17; 8-1, clause 17). What the client of an unbuffered block has not taken when a point changes again
 * is told by its newest value; a buffered block tells each change.
 */
#ifndef OPENRTU_IEC61850_REPORT_H
#define OPENRTU_IEC61850_REPORT_H

#include "iec61850/mms.h"

/* Puts the next report that is due for server->client. False: there is none. */
bool iec61850_report_put(struct iec61850_server *server, struct ber_writer *writer);
/* When the next one will be due; INT64_MAX: never, as it looks now. */
int64_t iec61850_report_due_ns(const struct iec61850_server *server);

#endif
