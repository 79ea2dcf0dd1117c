/* SPDX-License-Identifier: GPL-3.0-or-later */
#include "modbus/describe.h"

#include <stdarg.h>
#include <stdio.h>
#include <string.h>

#include "modbus/ascii.h"
#include "modbus/mbap.h"
#include "modbus/plan.h"

#define COIL_ON    0xFF00
#define HEAD       2 /* unit, function */
#define COUNT_NOTE 3 /* behind unit, function and the number of octets */

struct words {
	char *out;
	size_t length;
};

__attribute__((format(printf, 2, 3))) static void say(struct words *words, const char *format, ...)
{
	va_list arguments;
	int wanted;

	va_start(arguments, format);
	wanted = vsnprintf(words->out + words->length, MODBUS_WORDS_SIZE - words->length, format, arguments);
	va_end(arguments);
	if (wanted > 0)
		words->length += (size_t)wanted;
	if (words->length >= MODBUS_WORDS_SIZE)
		words->length = MODBUS_WORDS_SIZE - 1;
}

static const char *plural(size_t count)
{
	return count == 1 ? "" : "s";
}

static const char *objects_of(uint8_t function, uint16_t count)
{
	static const char *const names[][2] = {
	    [MODBUS_READ_COILS] = {"coil", "coils"},
	    [MODBUS_READ_DISCRETE_INPUTS] = {"discrete input", "discrete inputs"},
	    [MODBUS_READ_HOLDING_REGISTERS] = {"holding register", "holding registers"},
	    [MODBUS_READ_INPUT_REGISTERS] = {"input register", "input registers"},
	    [MODBUS_WRITE_COIL] = {"coil", "coils"},
	    [MODBUS_WRITE_REGISTER] = {"register", "registers"},
	    [MODBUS_WRITE_COILS] = {"coil", "coils"},
	    [MODBUS_WRITE_REGISTERS] = {"register", "registers"},
	    [MODBUS_MASK_WRITE_REGISTER] = {"register", "registers"},
	};

	return names[function][count != 1];
}

/* MODBUS Application Protocol V1.1b3, 7. */
static const char *exception_name(uint8_t exception)
{
	static const char *const names[] = {
	    [MODBUS_ILLEGAL_FUNCTION] = ", illegal function",
	    [MODBUS_ILLEGAL_ADDRESS] = ", illegal data address",
	    [MODBUS_ILLEGAL_VALUE] = ", illegal data value",
	    [4] = ", device failure",
	    [MODBUS_ACKNOWLEDGE] = ", acknowledge",
	    [MODBUS_BUSY] = ", device busy",
	    [8] = ", memory parity error",
	    [MODBUS_NO_PATH] = ", gateway path unavailable",
	    [MODBUS_NO_TARGET] = ", gateway target does not respond",
	};
	const size_t known = sizeof(names) / sizeof(names[0]);

	return exception < known && names[exception] != NULL ? names[exception] : "";
}

static bool is_known(uint8_t function)
{
	return modbus_is_read(function) || function == MODBUS_WRITE_COIL ||
	       function == MODBUS_WRITE_REGISTER || function == MODBUS_WRITE_COILS ||
	       function == MODBUS_WRITE_REGISTERS || function == MODBUS_MASK_WRITE_REGISTER;
}

/* Address and one value, or two masks: what request and answer of functions 5, 6 and 22 have. */
static void say_single(struct words *words, const uint8_t *body)
{
	const uint16_t address = modbus_register(body + HEAD, 0), value = modbus_register(body + HEAD, 1);

	say(words, "%s %u", objects_of(body[1], 1), address);
	if (body[1] == MODBUS_WRITE_COIL)
		say(words, value == COIL_ON ? " on" : value == 0 ? " off" : " neither on nor off");
	else if (body[1] == MODBUS_WRITE_REGISTER)
		say(words, " = %u", value);
	else
		say(words, ", keep 0x%04x, set 0x%04x", value, modbus_register(body + HEAD, 2));
}

static void say_range(struct words *words, const uint8_t *body)
{
	const uint16_t address = modbus_register(body + HEAD, 0), count = modbus_register(body + HEAD, 1);

	say(words, "%u %s from %u", count, objects_of(body[1], count), address);
}

static void say_registers(struct words *words, const uint8_t *octets, size_t count)
{
	for (size_t i = 0; i + 1 < count; i += 2)
		say(words, " %u", modbus_register(octets + i, 0));
}

static bool is_single(uint8_t function)
{
	return function == MODBUS_WRITE_COIL || function == MODBUS_WRITE_REGISTER ||
	       function == MODBUS_MASK_WRITE_REGISTER;
}

static void say_objects(struct words *words, const uint8_t *body)
{
	if (is_single(body[1]))
		say_single(words, body);
	else
		say_range(words, body);
}

/* Of unit, function and what say_objects says, in octets. */
static size_t fixed_length(uint8_t function)
{
	return HEAD + (function == MODBUS_MASK_WRITE_REGISTER ? 6u : 4u);
}

/* Its maker, product, version. */
static void say_identification(struct words *words, const uint8_t *body, size_t length)
{
	size_t at = MODBUS_IDENTIFIED_OBJECTS;

	say(words, "identification:");
	for (uint8_t i = 0; i < body[MODBUS_IDENTIFIED_COUNT] && at + MODBUS_OBJECT_HEAD <= length; i++) {
		const uint8_t *text = body + at + MODBUS_OBJECT_HEAD;

		at += MODBUS_OBJECT_HEAD + body[at + 1];
		say(words, "%s ", i > 0 ? "," : "");
		for (; text < body + at && text < body + length; text++)
			say(words, "%c", *text >= ' ' && *text < 0x7F ? *text : '?');
	}
}

static bool is_identification(const uint8_t *body, size_t length)
{
	return body[1] == MODBUS_ENCAPSULATED && length > HEAD && body[2] == MODBUS_IDENTIFICATION;
}

static void say_request(struct words *words, const uint8_t *body, size_t length)
{
	const size_t fixed = fixed_length(body[1]);

	if (is_identification(body, length) && length == HEAD + 3) {
		say(words, "read identification from object %u", body[4]);
		return;
	}
	if (!is_known(body[1]) || length < fixed) {
		say(words, "function %u, %zu octet%s", body[1], length - HEAD, plural(length - HEAD));
		return;
	}
	say(words, modbus_is_read(body[1]) ? "read " : "write ");
	say_objects(words, body);
	if (body[1] == MODBUS_WRITE_REGISTERS && length > fixed) {
		say(words, ":");
		say_registers(words, body + fixed + 1, length - fixed - 1);
	}
}

static void say_values(struct words *words, const uint8_t *body, size_t length)
{
	const size_t octets = length - COUNT_NOTE;

	if (modbus_is_bit_function(body[1])) {
		say(words, "%s in octets", objects_of(body[1], 2));
		for (size_t i = 0; i < octets; i++)
			say(words, " %02x", body[COUNT_NOTE + i]);
		return;
	}
	say(words, "%s", objects_of(body[1], (uint16_t)(octets / 2)));
	say_registers(words, body + COUNT_NOTE, octets);
}

static void say_answer(struct words *words, const uint8_t *body, size_t length)
{
	const size_t fixed = fixed_length(body[1]);

	if (is_identification(body, length) && length >= MODBUS_IDENTIFIED_OBJECTS) {
		say_identification(words, body, length);
		return;
	}
	if ((body[1] & MODBUS_EXCEPTION_BIT) && length == COUNT_NOTE)
		say(words, "exception %u%s, to function %u", body[2], exception_name(body[2]),
		    body[1] & (unsigned)~MODBUS_EXCEPTION_BIT);
	else if (modbus_is_read(body[1]) && length >= COUNT_NOTE && body[2] == length - COUNT_NOTE)
		say_values(words, body, length);
	else if (is_known(body[1]) && !modbus_is_read(body[1]) && length == fixed) {
		say(words, "has written ");
		say_objects(words, body);
	} else {
		say(words, "function %u, %zu octet%s", body[1], length - HEAD, plural(length - HEAD));
	}
}

/* The text is one frame, from its beginning to its end. */
static const uint8_t *find_body_in_text(struct modbus_ascii *ascii, const uint8_t *text, size_t *length)
{
	enum modbus_ascii_state state = MODBUS_ASCII_NOISE;

	for (size_t i = 0; i < *length; i++) {
		state = modbus_ascii_take(ascii, text[i]);
		if (state != MODBUS_ASCII_BEGUN && i + 1 < *length)
			return NULL;
	}
	*length = ascii->length;
	return state == MODBUS_ASCII_SOUND ? ascii->body : NULL;
}

/* Where unit, function and data are; NULL: nowhere. */
static const uint8_t *find_body(enum modbus_framing framing, struct modbus_ascii *ascii,
				const uint8_t *octets, size_t *length)
{
	if (framing == MODBUS_FRAMING_ASCII)
		return find_body_in_text(ascii, octets, length);
	if (framing == MODBUS_FRAMING_RTU) {
		if (!modbus_crc_valid(octets, *length))
			return NULL;
		*length -= MODBUS_CRC_LENGTH;
		return octets;
	}
	if (*length < MODBUS_MBAP_PREFIX + HEAD || modbus_mbap_length(octets, *length) != *length)
		return NULL;
	*length -= MODBUS_MBAP_PREFIX;
	return octets + MODBUS_MBAP_PREFIX;
}

bool modbus_describe(enum modbus_framing framing, enum modbus_direction direction, const uint8_t *octets,
		     size_t length, char *out)
{
	struct words words = {.out = out};
	size_t whole = length;
	struct modbus_ascii ascii = {.begun = false};
	const uint8_t *body = find_body(framing, &ascii, octets, &whole);

	out[0] = '\0';
	if (body == NULL) {
		say(&words, "%zu octet%s, no sound frame", length, plural(length));
		return false;
	}
	if (framing == MODBUS_FRAMING_TCP)
		say(&words, "transaction %u, ", modbus_register(octets, 0));
	say(&words, "unit %u: ", body[0]);
	if (direction == MODBUS_SENT)
		say_request(&words, body, whole);
	else
		say_answer(&words, body, whole);
	return true;
}
