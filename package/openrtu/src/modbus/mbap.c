/* SPDX-License-Identifier: GPL-3.0-or-later */
#include "mbap.h"

#define TRANSACTION_AT 0
#define PROTOCOL_AT    2
#define LENGTH_AT      4
#define BODY_LEAST     2 /* unit, function */
#define BODY_MOST      (MODBUS_MBAP_FRAME_MAX - MODBUS_MBAP_PREFIX)

static void put_word(uint8_t *at, size_t word)
{
	at[0] = (uint8_t)(word >> 8);
	at[1] = (uint8_t)(word & 0xFF);
}

static size_t word(const uint8_t *at)
{
	return (size_t)at[0] << 8 | at[1];
}

size_t modbus_mbap_seal(uint8_t *frame, uint16_t transaction, size_t body)
{
	put_word(frame + TRANSACTION_AT, transaction);
	put_word(frame + PROTOCOL_AT, 0);
	put_word(frame + LENGTH_AT, body);
	return MODBUS_MBAP_PREFIX + body;
}

size_t modbus_mbap_length(const uint8_t *bytes, size_t length)
{
	if (length < MODBUS_MBAP_PREFIX)
		return MODBUS_MBAP_PREFIX;
	if (word(bytes + PROTOCOL_AT) != 0 || word(bytes + LENGTH_AT) < BODY_LEAST ||
	    word(bytes + LENGTH_AT) > BODY_MOST)
		return 0;
	return MODBUS_MBAP_PREFIX + word(bytes + LENGTH_AT);
}
