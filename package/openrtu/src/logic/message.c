/* SPDX-License-Identifier: GPL-3.0-or-later */
/*
 * What a program says: its text, with a value in place of each {}, of each "\x01NUMBER=NAME,NUMBER=NAME\x02" the value's
 * name, and of each "\x03OCTETS\x02" the STRING of so many. The text is the file's, so nothing is known of it.
 */
#include <inttypes.h>
#include <stdarg.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

#include "logic/logic.h"

struct text {
	char *at;
	size_t left; /* with the octet for the end */
};

#define NAMES  "\x01"
#define END    "\x02"
#define STRING "\x03"

/* A line of a log has no control characters. */
static void put_octet(struct text *text, char octet)
{
	if (text->left < 2)
		return;
	*text->at++ = (unsigned char)octet < ' ' || octet == 0x7f ? '?' : octet;
	*text->at = '\0';
	text->left--;
}

static void put(struct text *text, const char *format, ...) __attribute__((format(printf, 2, 3)));

static void put(struct text *text, const char *format, ...)
{
	va_list arguments;
	int octets;

	va_start(arguments, format);
	octets = vsnprintf(text->at, text->left, format, arguments);
	va_end(arguments);
	if (octets < 0)
		return;
	if ((size_t)octets >= text->left)
		octets = (int)text->left - 1;
	text->at += octets;
	text->left -= (size_t)octets;
}

static void put_value(struct text *text, enum logic_type type, union logic_cell cell, uint8_t quality)
{
	switch (type) {
	case LOGIC_BOOL:
		put(text, "%s", cell.i ? "TRUE" : "FALSE");
		break;
	case LOGIC_BYTE:
	case LOGIC_WORD:
	case LOGIC_DWORD:
		put(text, "16#%" PRIX64, cell.bits);
		break;
	case LOGIC_REAL:
		put(text, "%.7g", (double)cell.r);
		break;
	case LOGIC_LREAL:
		put(text, "%.15g", cell.d);
		break;
	case LOGIC_TIME:
		put(text, "%.15g s", (double)cell.i / 1e6);
		break;
	default:
		put(text, "%" PRId64, cell.i);
	}
	if (quality & LOGIC_NOT_GOOD)
		put_octet(text, '!');
}

/* The name of the value, or the value; returns what is behind the names. */
static const char *put_name(struct text *text, const char *names, union logic_cell cell, uint8_t quality)
{
	const char *end = names + strcspn(names, END);
	bool found = false;

	while (names < end && !found) {
		size_t length = strcspn(names, "," END);
		char *equals;

		if (strtoll(names, &equals, 10) == cell.i && *equals == '=') {
			for (found = true; equals + 1 < names + length; equals++)
				put_octet(text, equals[1]);
			break;
		}
		names += length + (names + length < end);
	}
	if (!found)
		put(text, "%" PRId64, cell.i);
	if (quality & LOGIC_NOT_GOOD)
		put_octet(text, '!');
	return end + (*end != '\0');
}

/* The octets of a STRING, whose slots begin here; the text of the file is hostile, so that all of them are checked. */
static const char *put_string(struct text *text, const char *octets, const struct logic *logic, uint16_t slot,
			      uint16_t slots, uint32_t *taken)
{
	char *end;
	unsigned long room = strtoul(octets, &end, 10);
	const char *from = (const char *)&logic->cells[slot + 1];
	int64_t length = logic->cells[slot].i;

	*taken = 1;
	if (room > 0 && room <= LOGIC_STRING_MAX && logic_string_slots((uint32_t)room) <= slots) {
		*taken = logic_string_slots((uint32_t)room);
		for (int64_t i = 0; i < length && i < (int64_t)room; i++)
			put_octet(text, from[i]);
		if (logic->quality[slot] & LOGIC_NOT_GOOD)
			put_octet(text, '!');
	}
	return end + (*end == *END);
}

/* The text with so many slots from this one on. */
static void fill(struct text *text, const struct logic *logic, const char *from, uint16_t slot,
		 uint16_t slots, bool marks)
{
	*text->at = '\0';
	while (*from != '\0') {
		uint8_t quality = slots > 0 && marks ? logic->quality[slot] : 0;
		uint32_t taken = 1;

		if (slots > 0 && *from == *NAMES) {
			from = put_name(text, from + 1, logic->cells[slot], quality);
		} else if (slots > 0 && *from == *STRING) {
			from = put_string(text, from + 1, logic, slot, slots, &taken);
		} else if (slots > 0 && from[0] == '{' && from[1] == '}') {
			put_value(text, (enum logic_type)logic->types[slot], logic->cells[slot], quality);
			from += 2;
		} else {
			put_octet(text, *from++);
			continue;
		}
		slot = (uint16_t)(slot + taken);
		slots = (uint16_t)(slots - taken);
	}
}

void logic_message(const struct logic *logic, unsigned message, char *out, size_t size)
{
	const struct logic_instruction *at = &logic->code[logic->message_at[message]];
	struct text text = {out, size};

	fill(&text, logic, logic_name(logic, at->a), at->b, at->c, true);
}

void logic_format(const struct logic *logic, uint16_t text, uint16_t slot, char *out, size_t size)
{
	struct text made = {out, size};

	fill(&made, logic, logic_name(logic, text), slot, 1, false);
}
