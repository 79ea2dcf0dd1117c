/* SPDX-License-Identifier: GPL-3.0-or-later */
/*
 * STRING: an octet count and the octets behind it, in slots of LINT. The count is clipped where it is read, so that whatever
 * a file does with these slots stays within the string. The quality is that of the first slot.
 */
#include <string.h>

#include "logic/logic.h"

struct part {
	const char *octets;
	unsigned length;
};

static const struct logic_string *string_of(const struct logic *logic, uint16_t string)
{
	return &logic->strings[string];
}

static struct part read_text(const struct logic *logic, uint16_t string)
{
	const struct logic_string *of = string_of(logic, string);
	int64_t length = logic->cells[of->first].i;

	return (struct part){(const char *)&logic->cells[of->first + 1], length < 0 ? 0
									 : length > of->octets
									     ? of->octets
									     : (unsigned)length};
}

static unsigned quality_of(const struct logic *logic, uint16_t string)
{
	return logic->quality[string_of(logic, string)->first];
}

/* What is too long is cut, with the flag overflow. The octets behind the text are 0: the same text is the same memory. */
static void write_text(struct logic *logic, uint16_t string, struct part text, unsigned quality)
{
	const struct logic_string *to = string_of(logic, string);
	char *octets = (char *)&logic->cells[to->first + 1];
	unsigned length = text.length > to->octets ? to->octets : text.length;

	memmove(octets, text.octets, length);
	memset(octets + length, 0,
	       logic_string_slots(to->octets) * sizeof(union logic_cell) - sizeof(union logic_cell) - length);
	logic->cells[to->first].i = length;
	logic->quality[to->first] = (uint8_t)(quality | (length < text.length ? LOGIC_OVERFLOW : 0));
}

static void join(struct logic *logic, const struct logic_instruction *at)
{
	char made[2 * LOGIC_STRING_MAX];
	struct part first = read_text(logic, at->b), second = read_text(logic, at->c);

	memcpy(made, first.octets, first.length);
	memcpy(made + first.length, second.octets, second.length);
	write_text(logic, at->a, (struct part){made, first.length + second.length},
		   quality_of(logic, at->b) | quality_of(logic, at->c));
}

/* The first octets, those behind them, or the last ones. False: a negative number of them. */
static bool cut(struct logic *logic, const struct logic_instruction *at)
{
	struct part text = read_text(logic, at->b);
	int64_t wanted = logic->cells[at->c].i;
	unsigned count = wanted > text.length ? text.length : (unsigned)wanted;
	unsigned quality = quality_of(logic, at->b) | logic->quality[at->c];

	if (wanted < 0) {
		write_text(logic, at->a, (struct part){"", 0}, quality | LOGIC_INVALID);
		return false;
	}
	if (at->operation == LOGIC_HEAD)
		text.length = count;
	else if (at->operation == LOGIC_LAST)
		text = (struct part){text.octets + (text.length - count), count};
	else
		text = (struct part){text.octets + count, text.length - count};
	write_text(logic, at->a, text, quality);
	return true;
}

/* Where the second one begins in the first one, counted from 1; 0: nowhere. */
static unsigned find(struct part text, struct part wanted)
{
	if (wanted.length == 0)
		return 0;
	for (unsigned i = 0; i + wanted.length <= text.length; i++)
		if (memcmp(text.octets + i, wanted.octets, wanted.length) == 0)
			return i + 1;
	return 0;
}

static int compare(struct part first, struct part second)
{
	unsigned shorter = first.length < second.length ? first.length : second.length;
	int order = memcmp(first.octets, second.octets, shorter);

	if (order == 0)
		order = (int)first.length - (int)second.length;
	return (order > 0) - (order < 0);
}

static void put_number(struct logic *logic, const struct logic_instruction *at, int64_t number)
{
	logic->cells[at->a].i = number;
	logic->quality[at->a] = (uint8_t)quality_of(logic, at->b);
	if (at->operation != LOGIC_LENGTH)
		logic->quality[at->a] |= (uint8_t)quality_of(logic, at->c);
}

static void format(struct logic *logic, const struct logic_instruction *at)
{
	char made[LOGIC_STRING_MAX + 1];

	logic_format(logic, at->b, at->c, made, sizeof(made));
	write_text(logic, at->a, (struct part){made, (unsigned)strlen(made)}, logic->quality[at->c]);
}

uint32_t logic_text_cost(const struct logic *logic, const struct logic_instruction *at)
{
	switch (at->operation) {
	case LOGIC_FIND:
		return 1 + (uint32_t)string_of(logic, at->b)->octets * string_of(logic, at->c)->octets / 64;
	case LOGIC_COMPARE:
	case LOGIC_LENGTH:
		return 1 + string_of(logic, at->b)->octets / 8;
	default:
		return 4 + string_of(logic, at->a)->octets / 8;
	}
}

bool logic_text(struct logic *logic, const struct logic_instruction *at)
{
	switch (at->operation) {
	case LOGIC_TEXT:
		write_text(logic, at->a, read_text(logic, at->b), quality_of(logic, at->b));
		break;
	case LOGIC_JOIN:
		join(logic, at);
		break;
	case LOGIC_HEAD:
	case LOGIC_TAIL:
	case LOGIC_LAST:
		return cut(logic, at);
	case LOGIC_LENGTH:
		put_number(logic, at, read_text(logic, at->b).length);
		break;
	case LOGIC_FIND:
		put_number(logic, at, find(read_text(logic, at->b), read_text(logic, at->c)));
		break;
	case LOGIC_COMPARE:
		put_number(logic, at, compare(read_text(logic, at->b), read_text(logic, at->c)));
		break;
	default:
		format(logic, at);
	}
	return true;
}
