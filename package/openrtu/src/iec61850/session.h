/* SPDX-License-Identifier: GPL-3.0-or-later */
/* The session layer (ISO/IEC 8327-1), as far as a server of MMS meets it. */
#ifndef OPENRTU_IEC61850_SESSION_H
#define OPENRTU_IEC61850_SESSION_H

#include "ber/ber.h"

enum iec61850_spdu {
	IEC61850_SPDU_DATA = 1, /* GIVE TOKENS and DATA TRANSFER, which has the same number */
	IEC61850_SPDU_FINISH = 9,
	IEC61850_SPDU_DISCONNECT = 10,
	IEC61850_SPDU_REFUSE = 12,
	IEC61850_SPDU_CONNECT = 13,
	IEC61850_SPDU_ACCEPT = 14,
	IEC61850_SPDU_ABORT = 25,
};

#define IEC61850_SESSION_SELECTOR_MAX 16

struct iec61850_session {
	uint8_t kind; /* enum iec61850_spdu */
	struct ber_element user_data;
	struct ber_element called; /* selector of a CONNECT; size 0: it names none */
};

/* False: it is none of these, or its lengths are wrong. */
bool iec61850_session_read(const uint8_t *octets, size_t size, struct iec61850_session *out);
/*
 * Puts the SPDU before the user data that writer holds since end; a REFUSE takes 512 octets of them. called: of the CONNECT that an
 * ACCEPT answers, else NULL.
 */
void iec61850_session_write(struct ber_writer *writer, enum iec61850_spdu kind, size_t end,
			    const struct ber_element *called);

#endif
