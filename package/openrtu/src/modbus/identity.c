/* SPDX-License-Identifier: GPL-3.0-or-later */
#include "modbus/identity.h"

#include <string.h>

#include "modbus/plan.h"

/* Read device ID codes of streams. */
#define BASIC   1
#define REGULAR 2

#define MORE 0xFF /* objects follow */

#define NAME(name, says) name,
const char *const modbus_identity_names[MODBUS_IDENTITY_OBJECTS] = {MODBUS_IDENTITY_NAMES(NAME)};

void modbus_identity_begin(struct modbus_identity *identity)
{
	identity->state =
	    identity->silences >= MODBUS_IDENTITY_SILENCES ? MODBUS_IDENTITY_SILENT : MODBUS_IDENTITY_UNASKED;
	identity->access = REGULAR;
	identity->next = identity->requests = identity->size = 0;
}

bool modbus_identity_is_wanted(const struct modbus_identity *identity)
{
	return identity->state == MODBUS_IDENTITY_UNASKED;
}

struct modbus_request modbus_identity_request(const struct modbus_identity *identity, uint8_t unit)
{
	return (struct modbus_request){.unit = unit,
				       .function = MODBUS_ENCAPSULATED,
				       .address = (uint16_t)(identity->access << 8 | identity->next),
				       .count = 1};
}

static bool is_shown(uint8_t octet)
{
	return octet >= ' ' && octet != 0x7F && !(octet >= 0x80 && octet < 0xA0);
}

/* Without what no list could show, and the blanks behind it; as far as there is room. */
static void keep(struct modbus_identity *identity, uint8_t object, const uint8_t *text, uint8_t length)
{
	uint8_t *to = identity->texts + identity->size + MODBUS_OBJECT_HEAD;
	size_t room = MODBUS_IDENTITY_SIZE - identity->size;
	uint8_t kept = 0, shown = 0;

	if (object >= MODBUS_IDENTITY_OBJECTS || room < MODBUS_OBJECT_HEAD)
		return;
	room -= MODBUS_OBJECT_HEAD;
	for (uint8_t i = 0; i < length && kept < MODBUS_IDENTITY_TEXT && kept < room; i++) {
		if (!is_shown(text[i]))
			continue;
		to[kept++] = text[i];
		if (text[i] != ' ')
			shown = kept;
	}
	if (shown == 0)
		return;
	to[-2] = object;
	to[-1] = shown;
	identity->size = (uint8_t)(identity->size + MODBUS_OBJECT_HEAD + shown);
}

static void end(struct modbus_identity *identity, enum modbus_identity_state state)
{
	identity->state = (uint8_t)state;
	identity->news = true;
}

void modbus_identity_answered(struct modbus_identity *identity, const uint8_t *body)
{
	const uint8_t *object = body + MODBUS_IDENTIFIED_OBJECTS;

	identity->requests++;
	identity->silences = 0;
	for (uint8_t i = 0; i < body[MODBUS_IDENTIFIED_COUNT]; i++, object += MODBUS_OBJECT_HEAD + object[1])
		keep(identity, object[0], object + MODBUS_OBJECT_HEAD, object[1]);
	if (body[MODBUS_IDENTIFIED_MORE] == MORE && body[MODBUS_IDENTIFIED_NEXT] > identity->next &&
	    body[MODBUS_IDENTIFIED_NEXT] < MODBUS_IDENTITY_OBJECTS &&
	    identity->requests < MODBUS_IDENTITY_REQUESTS)
		identity->next = body[MODBUS_IDENTIFIED_NEXT];
	else
		end(identity, MODBUS_IDENTITY_KNOWN);
}

/* Some have the basic objects alone, and say so by an exception. */
void modbus_identity_refused(struct modbus_identity *identity, uint8_t exception)
{
	identity->silences = 0;
	if (identity->access == REGULAR && identity->requests == 0 && exception == MODBUS_ILLEGAL_VALUE)
		identity->access = BASIC;
	else
		end(identity, identity->requests > 0 ? MODBUS_IDENTITY_KNOWN : MODBUS_IDENTITY_REFUSED);
}

void modbus_identity_unanswered(struct modbus_identity *identity)
{
	identity->silences++;
	end(identity, MODBUS_IDENTITY_SILENT);
}

/* Latin-1 becomes UTF-8. */
static void put_text(const uint8_t *text, size_t length, char *out)
{
	for (size_t i = 0; i < length; i++) {
		if (text[i] >= 0x80)
			*out++ = (char)(0xC0 | text[i] >> 6);
		*out++ = (char)(text[i] >= 0x80 ? 0x80 | (text[i] & 0x3F) : text[i]);
	}
	*out = '\0';
}

void modbus_identity_text(const uint8_t *texts, size_t size, uint8_t object, char out[MODBUS_IDENTITY_WORDS])
{
	size_t at = 0;

	out[0] = '\0';
	while (at + MODBUS_OBJECT_HEAD <= size && at + MODBUS_OBJECT_HEAD + texts[at + 1] <= size) {
		if (texts[at] == object && texts[at + 1] <= MODBUS_IDENTITY_TEXT) {
			put_text(texts + at + MODBUS_OBJECT_HEAD, texts[at + 1], out);
			return;
		}
		at += MODBUS_OBJECT_HEAD + texts[at + 1];
	}
}

bool modbus_identity_is(const uint8_t *texts, size_t size, uint8_t object, const char *latin)
{
	char is[MODBUS_IDENTITY_WORDS], shall[MODBUS_IDENTITY_WORDS];

	modbus_identity_text(texts, size, object, is);
	put_text((const uint8_t *)latin, strnlen(latin, MODBUS_IDENTITY_TEXT), shall);
	return strcmp(is, shall) == 0;
}
