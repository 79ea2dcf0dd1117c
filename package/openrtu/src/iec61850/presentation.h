/* SPDX-License-Identifier: GPL-3.0-or-later */
/* The presentation layer (ISO/IEC 8823-1): which numbers the abstract syntaxes have, and whose data it is. */
#ifndef OPENRTU_IEC61850_PRESENTATION_H
#define OPENRTU_IEC61850_PRESENTATION_H

#include "ber/ber.h"

#define IEC61850_CONTEXTS_MAX              8
#define IEC61850_PRESENTATION_SELECTOR_MAX 16

/* What a connection has agreed on. */
struct iec61850_contexts {
	int8_t ids[IEC61850_CONTEXTS_MAX];
	bool known[IEC61850_CONTEXTS_MAX]; /* it is ACSE's or MMS's */
	uint8_t count;
	int8_t acse, mms; /* the numbers of these two */
};

/* Reads a CP-type: its contexts, the selector it calls (size 0: none), what it carries for ACSE. False: it is none, or has not both. */
bool iec61850_presentation_connect(const struct ber_element *octets, struct iec61850_contexts *contexts,
				   struct ber_element *called, struct ber_element *acse);
/* Puts a CPA-type before what writer holds since end. */
void iec61850_presentation_accept(struct ber_writer *writer, const struct iec61850_contexts *contexts,
				  const struct ber_element *called, size_t end);
/* Puts a CPR-type of the called user's there. */
void iec61850_presentation_reject(struct ber_writer *writer, const struct iec61850_contexts *contexts,
				  const struct ber_element *called, size_t end);
/* Reads user data of this context: out is what it contains. */
bool iec61850_presentation_read(const struct ber_element *octets, int8_t context, struct ber_element *out);
/* Puts the header of user data before what writer holds since end. */
void iec61850_presentation_write(struct ber_writer *writer, int8_t context, size_t end);

#endif
