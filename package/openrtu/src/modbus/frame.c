/* SPDX-License-Identifier: GPL-3.0-or-later */
#include "frame.h"

#define CRC_POLYNOMIAL   0xA001 /* 0x8005, bits reversed */
#define HEAD_LENGTH      2      /* unit, function */
#define EXCEPTION_BODY   3
#define EXCEPTION_LENGTH (EXCEPTION_BODY + MODBUS_CRC_LENGTH)
#define COIL_ON          0xFF00
#define ECHO_MAX         6 /* of function 22; other writes have 4 */

uint16_t modbus_crc(const uint8_t *bytes, size_t length)
{
	uint16_t crc = 0xFFFF;

	for (size_t i = 0; i < length; i++) {
		crc ^= bytes[i];
		for (int bit = 0; bit < 8; bit++)
			crc = (uint16_t)((crc >> 1) ^ ((crc & 1) ? CRC_POLYNOMIAL : 0));
	}
	return crc;
}

bool modbus_crc_valid(const uint8_t *frame, size_t length)
{
	if (length < HEAD_LENGTH + MODBUS_CRC_LENGTH)
		return false;
	uint16_t crc = modbus_crc(frame, length - MODBUS_CRC_LENGTH);
	return frame[length - 2] == (crc & 0xFF) && frame[length - 1] == crc >> 8;
}

bool modbus_is_bit_function(uint8_t function)
{
	return function == MODBUS_READ_COILS || function == MODBUS_READ_DISCRETE_INPUTS ||
	       function == MODBUS_WRITE_COIL || function == MODBUS_WRITE_COILS;
}

bool modbus_is_read(uint8_t function)
{
	return function >= MODBUS_READ_COILS && function <= MODBUS_READ_INPUT_REGISTERS;
}

bool modbus_is_of_the_moment(uint8_t exception)
{
	return exception == MODBUS_ACKNOWLEDGE || exception == MODBUS_BUSY || exception == MODBUS_NO_PATH ||
	       exception == MODBUS_NO_TARGET;
}

static size_t put_word(uint8_t *frame, size_t at, uint16_t word)
{
	frame[at] = (uint8_t)(word >> 8);
	frame[at + 1] = (uint8_t)(word & 0xFF);
	return at + 2;
}

static size_t put_coils(uint8_t *frame, size_t at, const struct modbus_request *request)
{
	uint8_t bits = 0;

	for (uint16_t i = 0; i < request->count && i < MODBUS_WRITE_MAX; i++)
		bits |= (uint8_t)((request->values[i] ? 1u : 0u) << i);
	frame[at++] = 1;
	frame[at++] = bits;
	return at;
}

static size_t put_registers(uint8_t *frame, size_t at, const struct modbus_request *request)
{
	frame[at++] = (uint8_t)(2 * request->count);
	for (uint16_t i = 0; i < request->count && i < MODBUS_WRITE_MAX; i++)
		at = put_word(frame, at, request->values[i]);
	return at;
}

/* The bytes behind unit and function that the answer to a write repeats. */
static size_t put_echoed(uint8_t *frame, size_t at, const struct modbus_request *request)
{
	at = put_word(frame, at, request->address);
	switch (request->function) {
	case MODBUS_WRITE_COIL:
		return put_word(frame, at, request->values[0] ? COIL_ON : 0);
	case MODBUS_WRITE_REGISTER:
		return put_word(frame, at, request->values[0]);
	case MODBUS_MASK_WRITE_REGISTER: /* MODBUS Application Protocol V1.1b3, 6.16 */
		at = put_word(frame, at, request->values[0]);
		return put_word(frame, at, request->values[1]);
	default:
		return put_word(frame, at, request->count);
	}
}

static size_t put_identification(uint8_t *frame, size_t at, const struct modbus_request *request)
{
	frame[at++] = MODBUS_IDENTIFICATION;
	return put_word(frame, at, request->address);
}

size_t modbus_request_body(const struct modbus_request *request, uint8_t *body)
{
	body[0] = request->unit;
	body[1] = request->function;
	if (request->function == MODBUS_ENCAPSULATED)
		return put_identification(body, HEAD_LENGTH, request);
	size_t at = put_echoed(body, HEAD_LENGTH, request);

	if (request->function == MODBUS_WRITE_COILS)
		at = put_coils(body, at, request);
	else if (request->function == MODBUS_WRITE_REGISTERS)
		at = put_registers(body, at, request);
	return at;
}

size_t modbus_seal(uint8_t *frame, size_t body)
{
	uint16_t crc = modbus_crc(frame, body);

	frame[body] = (uint8_t)(crc & 0xFF);
	frame[body + 1] = (uint8_t)(crc >> 8);
	return body + MODBUS_CRC_LENGTH;
}

size_t modbus_request_frame(const struct modbus_request *request, uint8_t frame[MODBUS_FRAME_MAX])
{
	return modbus_seal(frame, modbus_request_body(request, frame));
}

uint16_t modbus_read_bytes(uint8_t function, uint16_t count)
{
	return (uint16_t)(modbus_is_bit_function(function) ? (count + 7u) / 8u : 2u * count);
}

size_t modbus_answer_length(const struct modbus_request *request)
{
	if (modbus_is_read(request->function))
		return HEAD_LENGTH + 1u + modbus_read_bytes(request->function, request->count) +
		       MODBUS_CRC_LENGTH;
	if (request->function == MODBUS_ENCAPSULATED)
		return MODBUS_FRAME_MAX;
	return HEAD_LENGTH + (request->function == MODBUS_MASK_WRITE_REGISTER ? ECHO_MAX : ECHO_MAX - 2) +
	       MODBUS_CRC_LENGTH;
}

/* Of a body that begins so, as far as that has come. */
static size_t identification_length(const uint8_t *bytes, size_t length)
{
	size_t at = MODBUS_IDENTIFIED_OBJECTS;

	if (length < at)
		return at;
	for (uint8_t i = 0; i < bytes[MODBUS_IDENTIFIED_COUNT]; i++) {
		if (length < at + MODBUS_OBJECT_HEAD)
			return at + MODBUS_OBJECT_HEAD;
		at += MODBUS_OBJECT_HEAD + bytes[at + 1];
	}
	return at;
}

size_t modbus_begun_length(const struct modbus_request *request, const uint8_t *bytes, size_t length)
{
	if (request->function == MODBUS_ENCAPSULATED)
		return identification_length(bytes, length) + MODBUS_CRC_LENGTH;
	return modbus_answer_length(request);
}

/* What stands between unit, function and the data or CRC: the byte count of a read, the echo of a write, the kind of identification. */
static size_t expected_fields(const struct modbus_request *request, uint8_t fields[ECHO_MAX])
{
	if (request->function == MODBUS_ENCAPSULATED)
		return put_identification(fields, 0, request) - 1; /* not the object */
	if (!modbus_is_read(request->function))
		return put_echoed(fields, 0, request);
	fields[0] = (uint8_t)modbus_read_bytes(request->function, request->count);
	return 1;
}

/* Judges the first bytes of a body. *whole: how long it is when it is not another's. */
static enum modbus_verdict judge_beginning(const struct modbus_request *request, const uint8_t *bytes,
					   size_t length, size_t *whole)
{
	uint8_t fields[ECHO_MAX];
	size_t field_count = expected_fields(request, fields);

	*whole = EXCEPTION_BODY;
	if (length > 0 && bytes[0] != request->unit)
		return MODBUS_NOT_ITS_OWN;
	if (length > 1 && bytes[1] == (request->function | MODBUS_EXCEPTION_BIT))
		return MODBUS_EXCEPTION;
	if (length > 1 && bytes[1] != request->function)
		return MODBUS_NOT_ITS_OWN;
	for (size_t i = 0; i < field_count && HEAD_LENGTH + i < length; i++)
		if (bytes[HEAD_LENGTH + i] != fields[i])
			return MODBUS_NOT_ITS_OWN;
	*whole = modbus_begun_length(request, bytes, length) - MODBUS_CRC_LENGTH;
	return *whole + MODBUS_CRC_LENGTH > MODBUS_FRAME_MAX ? MODBUS_NOT_ITS_OWN : MODBUS_ANSWER;
}

enum modbus_verdict modbus_answer_judge(const struct modbus_request *request, const uint8_t *bytes,
					size_t length)
{
	size_t whole;
	enum modbus_verdict complete = judge_beginning(request, bytes, length, &whole);

	if (complete == MODBUS_NOT_ITS_OWN)
		return MODBUS_NOT_ITS_OWN;
	if (length < whole + MODBUS_CRC_LENGTH)
		return MODBUS_INCOMPLETE;
	return modbus_crc_valid(bytes, whole + MODBUS_CRC_LENGTH) ? complete : MODBUS_GARBLED;
}

enum modbus_verdict modbus_body_judge(const struct modbus_request *request, const uint8_t *body,
				      size_t length)
{
	size_t whole;
	enum modbus_verdict verdict = judge_beginning(request, body, length, &whole);

	return length == whole ? verdict : MODBUS_NOT_ITS_OWN;
}

size_t modbus_answer_missing(const struct modbus_request *request, const uint8_t *bytes, size_t length,
			     bool exception_expected)
{
	bool is_exception = length > 1 ? bytes[1] != request->function : exception_expected;

	return (is_exception ? EXCEPTION_LENGTH : modbus_begun_length(request, bytes, length)) - length;
}

bool modbus_bit(const uint8_t *data, uint16_t index)
{
	return (data[index / 8] >> (index % 8)) & 1;
}

uint16_t modbus_register(const uint8_t *data, uint16_t index)
{
	return (uint16_t)((data[2u * index] << 8) | data[2u * index + 1]);
}
