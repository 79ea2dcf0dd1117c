/* SPDX-License-Identifier: GPL-3.0-or-later */
/*
 * The APDU of IEC 60870-5-104, clause 5: start octet, length, four control octets, and in an I frame the ASDU.
 */
#ifndef OPENRTU_IEC104_APDU_H
#define OPENRTU_IEC104_APDU_H

#include <stdbool.h>
#include <stddef.h>
#include <stdint.h>

#define IEC104_APCI_SIZE       6
#define IEC104_ASDU_MAX        249
#define IEC104_APDU_MAX        (IEC104_APCI_SIZE + IEC104_ASDU_MAX)
#define IEC104_SEQUENCE_MODULO 32768u /* N(S), N(R): 15 bits */

enum iec104_format {
	IEC104_I_FRAME, /* numbered information transfer */
	IEC104_S_FRAME, /* numbered supervisory function */
	IEC104_U_FRAME, /* unnumbered control function */
};

/* The first control octet of a U frame (figure 8); exactly one of the six functions. */
enum iec104_function {
	IEC104_STARTDT_ACT = 0x07,
	IEC104_STARTDT_CON = 0x0b,
	IEC104_STOPDT_ACT = 0x13,
	IEC104_STOPDT_CON = 0x23,
	IEC104_TESTFR_ACT = 0x43,
	IEC104_TESTFR_CON = 0x83,
};

struct iec104_apdu {
	enum iec104_format format;
	enum iec104_function function; /* U frames */
	uint16_t ns;                   /* I frames */
	uint16_t nr;                   /* I and S frames */
	const uint8_t *asdu;           /* I frames: inside the decoded frame */
	size_t asdu_size;
};

/*
 * The size in octets of the APDU that begins at bytes, or 0 when size octets are too few to tell, or -1 when
 * no APDU begins so (start octet other than 0x68, length outside 4..253). All of the APDU may not be there yet.
 */
int iec104_apdu_size(const uint8_t *bytes, size_t size);

/*
 * Decodes one whole APDU (iec104_apdu_size octets). False: the control field or the length is none of the
 * standard's.
 */
bool iec104_apdu_decode(const uint8_t *bytes, size_t size, struct iec104_apdu *out);

/* Writes the first six octets of an APDU; asdu_size is 0 unless it is an I frame. */
void iec104_apdu_encode(uint8_t bytes[IEC104_APCI_SIZE], const struct iec104_apdu *apdu);

#endif
