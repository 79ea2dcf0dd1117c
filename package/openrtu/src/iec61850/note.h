/* SPDX-License-Identifier: GPL-3.0-or-later */
/* What has happened, for reports: pending in unbuffered blocks, an entry of the buffer for buffered ones. */
#ifndef OPENRTU_IEC61850_NOTE_H
#define OPENRTU_IEC61850_NOTE_H

#include "iec61850/mms.h"

/* Those of a point's reasons for which an attribute of it, or all (NULL), is told. */
unsigned iec61850_reasons_for(const struct iec61850_node *node, unsigned reason);
/* All of a block's data set is told now, for a reason that is none of the points'. */
void iec61850_note_asked(const struct iec61850_model *model, struct iec61850_block *block, unsigned reason,
			 int64_t now_ns);
/* Tells whether a point is selected, if that has changed: by whom and how ever. */
void iec61850_note_selection(struct iec61850_server *server, uint32_t point, int64_t now_ns);
/* The same of all points: a selection that others make, or that ends by itself, rings no bell. */
void iec61850_note_selections(struct iec61850_server *server, int64_t now_ns);
/* Takes the image of all points; what differs from the former one is pending. When events were lost. */
void iec61850_note_all(struct iec61850_server *server, int64_t now_ns);
void iec61850_note_event(struct iec61850_server *server, const struct map_event *event, int64_t now_ns);
/* The events before this place were noted. */
void iec61850_note_settle(struct iec61850_server *server, const struct map_cursor *cursor);

#endif
