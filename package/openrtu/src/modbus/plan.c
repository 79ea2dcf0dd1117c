/* SPDX-License-Identifier: GPL-3.0-or-later */
#include "plan.h"

#include <stdlib.h>
#include <string.h>

#include "frame.h"
#include "map/time_ns.h"

#define DEFAULT_BAUD    19200
#define DEFAULT_BITS    11 /* of a character */
#define FAST_BAUD       19200
#define FAST_SILENCE_NS 1750000 /* MODBUS over Serial Line, 2.5.1.1: fixed above 19200 bit/s */
#define TCP_LEAST_NS    (10 * NS_PER_MS)
#define REQUEST_CHARS   8
#define ANSWER_CHARS    5  /* besides the data */
#define WRITE_CHARS     16 /* a write of one register and its confirmation */

struct modbus_wire modbus_wire(uint32_t baud, unsigned bits_per_char)
{
	struct modbus_wire wire = {.char_ns = NS_PER_S * bits_per_char / baud, .gap_ns = MODBUS_GAP_NS};

	wire.silence_ns = baud > FAST_BAUD ? FAST_SILENCE_NS : wire.char_ns * 7 / 2;
	return wire;
}

struct modbus_wire modbus_wire_ascii(uint32_t baud, unsigned bits_per_char)
{
	struct modbus_wire wire = modbus_wire(baud, bits_per_char);

	wire.char_ns *= 2;
	wire.framing = MODBUS_FRAMING_ASCII;
	return wire;
}

struct modbus_wire modbus_wire_tcp(enum modbus_framing framing)
{
	return (struct modbus_wire){.least_ns = TCP_LEAST_NS,
				    .gap_ns = MODBUS_TCP_GAP_NS,
				    .connection = true,
				    .framing = (uint8_t)framing};
}

struct modbus_wire modbus_wire_udp(void)
{
	struct modbus_wire wire = modbus_wire_tcp(MODBUS_FRAMING_TCP);

	wire.connection = false;
	wire.datagrams = true;
	return wire;
}

static int compare_objects(const void *left, const void *right)
{
	const struct modbus_object *a = left, *b = right;

	if (a->period_ms != b->period_ms)
		return a->period_ms < b->period_ms ? -1 : 1;
	if (a->page != b->page)
		return a->page < b->page ? -1 : 1;
	if (a->function != b->function)
		return a->function < b->function ? -1 : 1;
	return (a->address > b->address) - (a->address < b->address);
}

void modbus_objects_sort(struct modbus_object *objects, size_t count)
{
	if (count > 1)
		qsort(objects, count, sizeof(*objects), compare_objects);
}

/* Widens the read so that it covers its last object. */
static void cover_last(struct modbus_read *read, const struct modbus_object *objects)
{
	const struct modbus_object *last = &objects[read->first + read->objects - 1];
	uint32_t count = (uint32_t)last->address + last->width - read->address;

	if (read->count > 0 && last->address > read->address + (uint32_t)read->count)
		read->holed = true;
	if (count > read->count)
		read->count = (uint16_t)count;
}

static struct modbus_read read_of(const struct modbus_object *objects, uint32_t first, uint32_t count)
{
	struct modbus_read read = {
	    .first = first,
	    .address = objects[first].address,
	    .function = objects[first].function,
	    .page = objects[first].page,
	    .period_ns = objects[first].period_ms * NS_PER_MS,
	};

	while (read.objects < count) {
		read.objects++;
		cover_last(&read, objects);
	}
	return read;
}

static bool fits(const struct modbus_limits *limits, const struct modbus_read *read)
{
	bool bits = modbus_is_bit_function(read->function);
	uint16_t limit = bits ? limits->bits : limits->registers;

	if (limit == 0)
		limit = bits ? MODBUS_BITS_MAX : MODBUS_REGISTERS_MAX;
	return read->count <= limit;
}

int64_t modbus_read_ns(const struct modbus_wire *wire, uint8_t function, uint16_t count, int64_t reaction_ns)
{
	int64_t chars = REQUEST_CHARS + ANSWER_CHARS + modbus_read_bytes(function, count);
	int64_t taken_ns = wire->before_ns + chars * wire->char_ns + 2 * wire->silence_ns + reaction_ns;

	return taken_ns > wire->least_ns ? taken_ns : wire->least_ns;
}

int64_t modbus_page_ns(const struct modbus_wire *wire, int64_t reaction_ns)
{
	int64_t taken_ns = wire->before_ns + WRITE_CHARS * wire->char_ns + 2 * wire->silence_ns + reaction_ns;

	return taken_ns > wire->least_ns ? taken_ns : wire->least_ns;
}

int64_t modbus_reaction_ns(const struct modbus_limits *limits)
{
	return limits->reaction_ns > 0 ? limits->reaction_ns : MODBUS_REACTION_NS;
}

/*
 * What a hole costs on a TCP connection nobody can see from here: nothing at the device itself, but much on the serial
 * line behind a gateway. There, what every serial device has by default is taken (MODBUS over Serial Line, 2.5.1, 3.2):
 * so a device itself is asked a little more often, and a line behind is never filled with holes.
 */
static int64_t duration(const struct modbus_wire *wire, const struct modbus_limits *limits,
			const struct modbus_read *read)
{
	const struct modbus_wire behind = modbus_wire(DEFAULT_BAUD, DEFAULT_BITS);
	const struct modbus_wire *taken = wire->connection ? &behind : wire;
	const int64_t reaction_ns = wire->connection ? MODBUS_REACTION_NS : modbus_reaction_ns(limits);

	return modbus_read_ns(taken, read->function, read->count, reaction_ns) +
	       (read->page != 0 ? modbus_page_ns(taken, reaction_ns) : 0);
}

/* Takes the object behind the read into it when that is allowed and not slower than a read of its own. */
static bool merge_next(const struct modbus_wire *wire, const struct modbus_limits *limits,
		       const struct modbus_object *objects, struct modbus_read *read)
{
	uint32_t next = read->first + read->objects;

	if (objects[next].function != read->function || objects[next].page != read->page ||
	    objects[next].period_ms * NS_PER_MS != read->period_ns ||
	    (uint32_t)objects[next].address + objects[next].width - read->address > MODBUS_BITS_MAX)
		return false;
	if (limits->no_holes && objects[next].address > read->address + (uint32_t)read->count)
		return false;

	struct modbus_read alone = read_of(objects, next, 1);
	struct modbus_read merged = *read;

	merged.objects++;
	cover_last(&merged, objects);
	if (!fits(limits, &merged) ||
	    duration(wire, limits, &merged) > duration(wire, limits, read) + duration(wire, limits, &alone))
		return false;
	*read = merged;
	return true;
}

uint32_t modbus_plan(const struct modbus_wire *wire, const struct modbus_limits *limits,
		     const struct modbus_object *objects, uint32_t count, struct modbus_read *reads)
{
	uint32_t made = 0;

	for (uint32_t next = 0; next < count; next = reads[made - 1].first + reads[made - 1].objects) {
		struct modbus_read *read = &reads[made++];

		*read = read_of(objects, next, 1);
		while (read->first + read->objects < count && merge_next(wire, limits, objects, read))
			;
	}
	return made;
}

static uint32_t apart(uint32_t a, uint32_t b)
{
	return a > b ? a - b : b - a;
}

/* How many of its objects lie before the widest hole; of equals, that nearest to the middle. 0: there is none. */
static uint32_t before_widest_hole(const struct modbus_object *objects, const struct modbus_read *read)
{
	uint32_t end = read->address, widest = 0, before = 0;

	for (uint32_t i = 0; i < read->objects; i++) {
		const struct modbus_object *object = &objects[read->first + i];
		uint32_t hole = object->address > end ? object->address - end : 0;

		if (hole > widest || (hole > 0 && hole == widest &&
				      apart(2 * i, read->objects) < apart(2 * before, read->objects))) {
			widest = hole;
			before = i;
		}
		if ((uint32_t)object->address + object->width > end)
			end = (uint32_t)object->address + object->width;
	}
	return before;
}

bool modbus_plan_split(const struct modbus_object *objects, struct modbus_read *reads, uint32_t *count,
		       uint32_t index, uint8_t exception)
{
	struct modbus_read whole = reads[index];
	uint32_t before = 0;

	if (exception == MODBUS_ILLEGAL_ADDRESS && whole.holed)
		before = before_widest_hole(objects, &whole);
	if (before == 0)
		before = whole.objects / 2;
	if (before == 0)
		return false;
	memmove(&reads[index + 2], &reads[index + 1], (*count - index - 1) * sizeof(*reads));
	reads[index] = read_of(objects, whole.first, before);
	reads[index + 1] = read_of(objects, whole.first + before, whole.objects - before);
	reads[index + 1].whole = whole.first + 1;
	reads[index + 1].whole_exception = exception;
	reads[index].urgent = reads[index + 1].urgent = whole.urgent;
	reads[index].due_ns = reads[index + 1].due_ns = whole.due_ns;
	(*count)++;
	return true;
}
