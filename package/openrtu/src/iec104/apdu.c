/* SPDX-License-Identifier: GPL-3.0-or-later */
#include "iec104/apdu.h"

#define START_OCTET    0x68
#define LENGTH_MIN     4 /* the control field alone */
#define LENGTH_MAX     253
#define LENGTH_OUTSIDE 2 /* start and length octet are not counted in the length */

int iec104_apdu_size(const uint8_t *bytes, size_t size)
{
	if (size >= 1 && bytes[0] != START_OCTET)
		return -1;
	if (size < LENGTH_OUTSIDE)
		return 0;
	if (bytes[1] < LENGTH_MIN || bytes[1] > LENGTH_MAX)
		return -1;
	return bytes[1] + LENGTH_OUTSIDE;
}

static uint16_t sequence_number(const uint8_t *octets)
{
	return (uint16_t)((octets[0] | octets[1] << 8) >> 1);
}

static void put_sequence_number(uint8_t *octets, uint16_t number)
{
	octets[0] = (uint8_t)(number << 1);
	octets[1] = (uint8_t)(number >> 7);
}

static bool is_function(uint8_t octet)
{
	switch (octet) {
	case IEC104_STARTDT_ACT:
	case IEC104_STARTDT_CON:
	case IEC104_STOPDT_ACT:
	case IEC104_STOPDT_CON:
	case IEC104_TESTFR_ACT:
	case IEC104_TESTFR_CON:
		return true;
	default:
		return false;
	}
}

static bool decode_i(const uint8_t *bytes, size_t size, struct iec104_apdu *out)
{
	*out = (struct iec104_apdu){
	    .format = IEC104_I_FRAME,
	    .ns = sequence_number(bytes + 2),
	    .nr = sequence_number(bytes + 4),
	    .asdu = bytes + IEC104_APCI_SIZE,
	    .asdu_size = size - IEC104_APCI_SIZE,
	};
	return size > IEC104_APCI_SIZE && (bytes[4] & 1) == 0;
}

static bool decode_s(const uint8_t *bytes, size_t size, struct iec104_apdu *out)
{
	*out = (struct iec104_apdu){.format = IEC104_S_FRAME, .nr = sequence_number(bytes + 4)};
	return size == IEC104_APCI_SIZE && bytes[2] == 0x01 && bytes[3] == 0 && (bytes[4] & 1) == 0;
}

static bool decode_u(const uint8_t *bytes, size_t size, struct iec104_apdu *out)
{
	*out = (struct iec104_apdu){.format = IEC104_U_FRAME, .function = (enum iec104_function)bytes[2]};
	return size == IEC104_APCI_SIZE && is_function(bytes[2]) && bytes[3] == 0 && bytes[4] == 0 &&
	       bytes[5] == 0;
}

bool iec104_apdu_decode(const uint8_t *bytes, size_t size, struct iec104_apdu *out)
{
	if (size < IEC104_APCI_SIZE || iec104_apdu_size(bytes, size) != (int)size)
		return false;
	if ((bytes[2] & 1) == 0)
		return decode_i(bytes, size, out);
	if ((bytes[2] & 3) == 1)
		return decode_s(bytes, size, out);
	return decode_u(bytes, size, out);
}

void iec104_apdu_encode(uint8_t bytes[IEC104_APCI_SIZE], const struct iec104_apdu *apdu)
{
	bytes[0] = START_OCTET;
	bytes[1] = (uint8_t)(LENGTH_MIN + apdu->asdu_size);
	put_sequence_number(bytes + 2, 0);
	put_sequence_number(bytes + 4, 0);
	switch (apdu->format) {
	case IEC104_I_FRAME:
		put_sequence_number(bytes + 2, apdu->ns);
		put_sequence_number(bytes + 4, apdu->nr);
		break;
	case IEC104_S_FRAME:
		bytes[2] = 0x01;
		put_sequence_number(bytes + 4, apdu->nr);
		break;
	case IEC104_U_FRAME:
		bytes[2] = (uint8_t)apdu->function;
		break;
	}
}
