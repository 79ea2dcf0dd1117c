/* SPDX-License-Identifier: GPL-3.0-or-later */
/*
 * Commands (IEC 61850-7-2, clause 20; 8-1, clause 20): a service of a client becomes a request to the point's owner, and the map's
 * answers become the service's answer, LastApplError and CommandTermination. The map has the one state machine of all protocols;
 * here is only who waits for what.
 */
#ifndef OPENRTU_IEC61850_CONTROL_H
#define OPENRTU_IEC61850_CONTROL_H

#include "iec61850/mms.h"

/*
 * A Write of a service of a command, by server->client. IEC61850_LATER: iec61850_control_put answers it. Else
 * IEC61850_NO_ERROR, and *error is 0 or a DataAccessError.
 */
enum iec61850_error iec61850_control_write(struct iec61850_server *server,
					   const struct iec61850_object *object,
					   const struct ber_element *data, int *error);
/* A Read of SBO, which selects. As before. */
enum iec61850_error iec61850_control_select(struct iec61850_server *server,
					    const struct iec61850_object *object, int *error);
/* What the map says of a request of this module. */
void iec61850_control_answer(struct iec61850_server *server, const struct map_answer *answer);
/* Each turn: selections whose time is over, owners that are gone. */
void iec61850_controls_tick(struct iec61850_server *server);
/* A client is gone: what it has selected is free. What is under way goes on, and nobody is told. */
void iec61850_controls_release(struct iec61850_server *server, const void *client);
/* Puts the next PDU that server->client waits for; of ends: a CommandTermination too. False: there is none. */
bool iec61850_control_put(struct iec61850_server *server, struct ber_writer *writer, bool ends);

/* ---- for its files ------------------------------------------------------------------------- */

/* Reads the parameters of a service that node describes: 0, or a DataAccessError; what is no value of the point is out_of_range. */
int iec61850_wish_read(const struct map_point *point, const struct iec61850_node *node,
		       const struct ber_element *data, struct iec61850_wish *out);
/* Whether an execution has what its selection had (7-2, 20.2.2). */
bool iec61850_wish_is_same(const struct iec61850_wish *a, const struct iec61850_wish *b);

#endif
