/* SPDX-License-Identifier: GPL-3.0-or-later */
/*
 * The transport of an association: TPKT (RFC 1006) and class 0 of the connection-oriented transport protocol (ISO/IEC 8073).
 * Octets come and go in pieces of any size; what is handed on are whole messages.
 */
#ifndef OPENRTU_IEC61850_TRANSPORT_H
#define OPENRTU_IEC61850_TRANSPORT_H

#include <stdbool.h>
#include <stddef.h>
#include <stdint.h>

#define IEC61850_TPDU_EXPONENT_MAX 13 /* 8192 octets, the most of ISO/IEC 8073 */
#define IEC61850_TPDU_EXPONENT_MIN 7
#define IEC61850_INPUT_SIZE        (4 + (1 << IEC61850_TPDU_EXPONENT_MAX))
#define IEC61850_DATA_HEADER       7 /* TPKT, and DT of class 0 */

/* What the layers above add to an MMS PDU at most. */
#define IEC61850_ENVELOPE              64
#define IEC61850_MESSAGE_SIZE(max_pdu) ((size_t)(max_pdu) + IEC61850_ENVELOPE)
/* A message in the smallest TPDUs. */
#define IEC61850_OUTPUT_SIZE(max_pdu)                                                                        \
	(IEC61850_MESSAGE_SIZE(max_pdu) +                                                                    \
	 (IEC61850_MESSAGE_SIZE(max_pdu) / ((1 << IEC61850_TPDU_EXPONENT_MIN) - 3) + 1) *                    \
	     IEC61850_DATA_HEADER)

struct iec61850_transport {
	uint8_t *input, *message, *output; /* INPUT_SIZE, message_size and output_size octets */
	size_t message_size, output_size;
	size_t input_begin, input_end, message_end, output_begin, output_end;
	unsigned tpdu_size;
	bool connected;
	bool handed_on; /* the message was; the next one begins anew */
};

enum iec61850_incoming {
	IEC61850_NOTHING, /* more octets are needed, or the output has to go first */
	IEC61850_MESSAGE, /* one is whole: message, message_end octets */
	IEC61850_WRONG,   /* these are not the protocol's, or too long: the connection shall end */
	IEC61850_ENDED,   /* the peer has disconnected */
};

/* A new connection; the memory stays. */
void iec61850_transport_open(struct iec61850_transport *transport);
/* Where octets that come shall go; size 0: there is no room now. */
uint8_t *iec61850_transport_space(struct iec61850_transport *transport, size_t *size);
void iec61850_transport_received(struct iec61850_transport *transport, size_t size);
/* The next message. It stays until the next call. A request for a connection is answered here. */
enum iec61850_incoming iec61850_transport_next(struct iec61850_transport *transport);
/* Whether a message of any size may be sent now. */
static inline bool iec61850_transport_is_free(const struct iec61850_transport *transport)
{
	return transport->output_begin == transport->output_end;
}
/* Sends a message of message_size octets at most. Only while the transport is free. */
void iec61850_transport_send(struct iec61850_transport *transport, const uint8_t *octets, size_t size);
const uint8_t *iec61850_transport_output(const struct iec61850_transport *transport, size_t *size);
void iec61850_transport_written(struct iec61850_transport *transport, size_t size);

#endif
