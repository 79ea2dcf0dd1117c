/* SPDX-License-Identifier: GPL-3.0-or-later */
/*
 * Modbus frames of the controlling station: building requests, judging answers. MODBUS Application
 * Protocol V1.1b3 (functions, exceptions) and MODBUS over Serial Line V1.02 (RTU frame, CRC); mbap.h has what is
 * different on TCP. A frame's body is unit and PDU, which both have.
 */
#ifndef OPENRTU_MODBUS_FRAME_H
#define OPENRTU_MODBUS_FRAME_H

#include <stdbool.h>
#include <stddef.h>
#include <stdint.h>

#define MODBUS_FRAME_MAX     256 /* RTU frame: unit, PDU of 253, CRC */
#define MODBUS_BODY_MAX      254 /* unit, PDU */
#define MODBUS_CRC_LENGTH    2
#define MODBUS_BITS_MAX      2000
#define MODBUS_REGISTERS_MAX 125
#define MODBUS_WRITE_MAX     4 /* an object has at most two bits or four registers */
#define MODBUS_BROADCAST     0
#define MODBUS_EXCEPTION_BIT 0x80

/* MODBUS Application Protocol V1.1b3, 7: those that say nothing against what was asked. */
enum modbus_exception_of_the_moment {
	MODBUS_ACKNOWLEDGE = 5, /* it takes the device longer */
	MODBUS_BUSY = 6,
	MODBUS_NO_PATH = 10,   /* a gateway's: to the device */
	MODBUS_NO_TARGET = 11, /* a gateway's: the device did not answer it */
};

enum modbus_function {
	MODBUS_READ_COILS = 1,
	MODBUS_READ_DISCRETE_INPUTS = 2,
	MODBUS_READ_HOLDING_REGISTERS = 3,
	MODBUS_READ_INPUT_REGISTERS = 4,
	MODBUS_WRITE_COIL = 5,
	MODBUS_WRITE_REGISTER = 6,
	MODBUS_READ_EXCEPTION_STATUS = 7,
	MODBUS_READ_EVENT_COUNTER = 11,
	MODBUS_READ_EVENT_LOG = 12,
	MODBUS_WRITE_COILS = 15,
	MODBUS_WRITE_REGISTERS = 16,
	MODBUS_REPORT_SERVER = 17,
	MODBUS_READ_FILE = 20,
	MODBUS_WRITE_FILE = 21,
	MODBUS_MASK_WRITE_REGISTER = 22,
	MODBUS_READ_AND_WRITE = 23,
	MODBUS_READ_FIFO = 24,
	MODBUS_ENCAPSULATED = 43, /* of what it may carry, device identification alone */
};

/* Device identification: what function 43 carries here, and where the body of an answer has what (6.21). */
enum {
	MODBUS_IDENTIFICATION = 14,
	MODBUS_IDENTIFIED_MORE = 5,
	MODBUS_IDENTIFIED_NEXT = 6,
	MODBUS_IDENTIFIED_COUNT = 7,
	MODBUS_IDENTIFIED_OBJECTS = 8, /* each: its number, its length, its text */
	MODBUS_OBJECT_HEAD = 2,
};

/* How a body becomes a frame. */
enum modbus_framing {
	MODBUS_FRAMING_RTU,   /* with a CRC behind it */
	MODBUS_FRAMING_TCP,   /* with the MBAP header before it */
	MODBUS_FRAMING_ASCII, /* as text (ascii.h) */
};

struct modbus_request {
	uint8_t unit;
	uint8_t function; /* enum modbus_function */
	uint16_t address; /* function 43: the kind of access and the first object, an octet each */
	uint16_t count;   /* bits or registers; 1 for functions 5, 6, 22 and 43 */
	/* Writes: registers, or a bit (0, 1) each; function 22: the bits that stay, the bits that are set. */
	uint16_t values[MODBUS_WRITE_MAX];
};

/* What the bytes received so far are, taken as the answer to a request. */
enum modbus_verdict {
	MODBUS_INCOMPLETE,  /* the beginning of its answer */
	MODBUS_ANSWER,      /* its answer */
	MODBUS_EXCEPTION,   /* the device's refusal; byte 2 is the exception code */
	MODBUS_GARBLED,     /* begins like its answer, but the CRC is wrong */
	MODBUS_NOT_ITS_OWN, /* of another unit, function, length or, for writes, with another echo */
};

/* CRC-16 of MODBUS over Serial Line, 6.2.2; sent low byte first. */
uint16_t modbus_crc(const uint8_t *bytes, size_t length);

/* True for a frame of at least four bytes that ends in its own CRC. */
bool modbus_crc_valid(const uint8_t *frame, size_t length);

bool modbus_is_bit_function(uint8_t function);
bool modbus_is_read(uint8_t function);

/*
 * What was asked cannot be had now. All other exceptions are about what was asked, for which one object may be to blame:
 * 8 is a parity error of its memory; 7 and 9 are not in the standard, and what they mean is the device's own.
 */
bool modbus_is_of_the_moment(uint8_t exception);

/*
 * Writes the request's body, or its RTU frame, and returns its length. The request must be within the protocol's limits:
 * count 1..MODBUS_BITS_MAX or MODBUS_REGISTERS_MAX, for writes 1..MODBUS_WRITE_MAX.
 */
size_t modbus_request_body(const struct modbus_request *request, uint8_t *body);
/* Puts the CRC behind a body that stands in the frame. Returns the frame's length. */
size_t modbus_seal(uint8_t *frame, size_t body);
size_t modbus_request_frame(const struct modbus_request *request, uint8_t frame[MODBUS_FRAME_MAX]);

/* Data bytes of the answer to a read of count bits or registers. */
uint16_t modbus_read_bytes(uint8_t function, uint16_t count);

/* Length of the positive answer's whole RTU frame; of function 43, the longest that it may have. */
size_t modbus_answer_length(const struct modbus_request *request);
/* Length of that which begins with these bytes; one of function 43 that has not shown it yet is at least so long. */
size_t modbus_begun_length(const struct modbus_request *request, const uint8_t *bytes, size_t length);

/*
 * Judges the first bytes received. A complete answer is recognised at its last byte, since its length follows
 * from the request; what comes behind that is not looked at.
 */
enum modbus_verdict modbus_answer_judge(const struct modbus_request *request, const uint8_t *bytes,
					size_t length);

/* Judges a whole body: its answer, its exception, or not its own. */
enum modbus_verdict modbus_body_judge(const struct modbus_request *request, const uint8_t *body,
				      size_t length);

/*
 * How many bytes an answer lacks that began with these, which were judged incomplete. That it is an exception shows in the
 * second one; exception_expected holds until that is there.
 */
size_t modbus_answer_missing(const struct modbus_request *request, const uint8_t *bytes, size_t length,
			     bool exception_expected);

/* Bit or register number index of an answer's data bytes. */
bool modbus_bit(const uint8_t *data, uint16_t index);
uint16_t modbus_register(const uint8_t *data, uint16_t index);

#endif
