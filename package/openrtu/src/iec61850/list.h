/* SPDX-License-Identifier: GPL-3.0-or-later */
/*
 * Data sets that clients make (IEC 61850-7-2, clause 13; 8-1, clause 14): a logical device's, which all see and which end when one
 * deletes them or the module ends, and an association's own. Members are of one logical device, points or attributes of points.
 */
#ifndef OPENRTU_IEC61850_LIST_H
#define OPENRTU_IEC61850_LIST_H

#include "iec61850/mms.h"

/* Whether the client may use the list for a control block of the device. */
static inline bool iec61850_list_is_of(const struct iec61850_list *list, const struct iec61850_device *device,
				       const void *client)
{
	return list->used && list->device == device && (list->client == NULL || list->client == client);
}

#endif
