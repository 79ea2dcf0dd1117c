/* SPDX-License-Identifier: GPL-3.0-or-later */
/* The association control service element (ISO/IEC 8650-1). */
#ifndef OPENRTU_IEC61850_ACSE_H
#define OPENRTU_IEC61850_ACSE_H

#include "ber/ber.h"

/* Reads an AARQ: what it carries for MMS. acse: what presentation carries. */
bool iec61850_acse_request(const struct ber_element *acse, struct ber_element *mms);
/* Puts an AARE before what writer holds since end. context: the number of MMS. accepted: false rejects for ever. */
void iec61850_acse_answer(struct ber_writer *writer, int8_t context, bool accepted, size_t end);
/* Puts an RLRE. */
void iec61850_acse_released(struct ber_writer *writer);

#endif
