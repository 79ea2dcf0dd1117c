/* SPDX-License-Identifier: GPL-3.0-or-later */
/* Verifies a program: what run.c does with it then stays within its memory and ends. */
#include <string.h>

#include "logic/logic.h"
#include "logic/real.h"

_Static_assert(__BYTE_ORDER__ == __ORDER_LITTLE_ENDIAN__, "the file is little-endian");

static const struct shape {
	char type, a, b, c;
} shapes[] = {
#define LOGIC_SHAPE(name, type, operands) {type[0], operands[0], operands[1], operands[2]},
    LOGIC_OPERATIONS(LOGIC_SHAPE)
#undef LOGIC_SHAPE
};

static uint32_t crc32(const uint8_t *octets, size_t size)
{
	uint32_t crc = UINT32_MAX;

	for (size_t i = 0; i < size; i++) {
		crc ^= octets[i];
		for (int bit = 0; bit < 8; bit++)
			crc = crc >> 1 ^ (crc & 1 ? 0xedb88320 : 0);
	}
	return ~crc;
}

static size_t filled(size_t size)
{
	return (size + 3) & ~(size_t)3;
}

/* The octets of all sections behind the head. */
static size_t sections_size(const struct logic_head *head)
{
	return filled(head->slots) + head->initial * sizeof(struct logic_initial) +
	       head->arrays * sizeof(struct logic_array) + head->routines * sizeof(struct logic_routine) +
	       head->points * sizeof(struct logic_point) + head->commands * sizeof(struct logic_command) +
	       head->requests * sizeof(struct logic_request) +
	       head->retained * sizeof(struct logic_retained) + head->strings * sizeof(struct logic_string) +
	       head->code * sizeof(struct logic_instruction) + filled(head->code * sizeof(uint16_t)) +
	       head->names;
}

size_t logic_memory(const void *file, size_t size)
{
	struct logic_head head;

	if (size < sizeof(head))
		return 0;
	memcpy(&head, file, sizeof(head));
	if (memcmp(head.magic, LOGIC_MAGIC, sizeof(head.magic)) != 0 || head.version != LOGIC_VERSION ||
	    head.size != size || sizeof(head) + sections_size(&head) != size)
		return 0;
	return logic_quality_place(&head) + head.slots;
}

static bool is_float(uint8_t type)
{
	return type == LOGIC_REAL || type == LOGIC_LREAL;
}

static bool is_bits(uint8_t type)
{
	return type >= LOGIC_BYTE && type <= LOGIC_DWORD;
}

static bool type_fits(char class, uint8_t type)
{
	switch (class) {
	case '-':
		return type == 0;
	case 'n':
		return type < LOGIC_TYPES && type != LOGIC_BOOL && !is_bits(type) && !is_float(type);
	case 'o':
		return type < LOGIC_TYPES && !is_float(type);
	case 'w':
		return type == LOGIC_BOOL || is_bits(type);
	case 's':
		return is_bits(type);
	default:
		return type < LOGIC_TYPES;
	}
}

static bool slot_is(const struct logic *logic, uint16_t slot, uint8_t type)
{
	return slot < logic->head->slots && logic->types[slot] == type;
}

static bool variable_is(const struct logic *logic, uint16_t slot, uint8_t type)
{
	return slot >= logic->head->constants && slot_is(logic, slot, type);
}

static bool array_fits(const struct logic *logic, uint16_t array, uint8_t type, bool written)
{
	return array < logic->head->arrays && logic->arrays[array].type == type &&
	       !(written && logic->arrays[array].first < logic->head->constants);
}

/* A jump stays in its routine; a call goes to a routine before it. */
static bool operand_fits(const struct logic *logic, uint16_t routine, uint8_t type, char kind, uint16_t value)
{
	const struct logic_routine *here = &logic->routines[routine];

	switch (kind) {
	case 't':
		return slot_is(logic, value, type);
	case 'T':
		return variable_is(logic, value, type);
	case 'b':
		return slot_is(logic, value, LOGIC_BOOL);
	case 'B':
		return variable_is(logic, value, LOGIC_BOOL);
	case 'i':
		return value < logic->head->slots && !is_float(logic->types[value]);
	case 'Q':
		return variable_is(logic, value, LOGIC_BYTE);
	case 'f':
		return slot_is(logic, value, LOGIC_REAL);
	case 'F':
		return variable_is(logic, value, LOGIC_REAL);
	case 'd':
		return slot_is(logic, value, LOGIC_LREAL);
	case 'D':
		return variable_is(logic, value, LOGIC_LREAL);
	case '*':
		return value < logic->head->slots;
	case '+':
		return value >= logic->head->constants && value < logic->head->slots;
	case 'x':
		return array_fits(logic, value, type, false);
	case 'X':
		return array_fits(logic, value, type, true);
	case 'j':
		return value >= here->first && value - here->first < here->instructions;
	case 'k':
		return value < routine;
	case 'm':
		return value < LOGIC_FUNCTIONS;
	case 'n':
		return value > 0;
	case 'v':
		return value <= LOGIC_MESSAGE_SLOTS;
	case 'N':
		return variable_is(logic, value, LOGIC_INT);
	case 'r':
		return value < logic->head->strings;
	case 'S':
		return value < logic->head->strings && logic->strings[value].first >= logic->head->constants;
	case 'l':
		return value < logic->head->names;
	default:
		return value == 0;
	}
}

/* Of BLOCK, SPREAD and MESSAGE: c slots, of pairwise the same types for BLOCK. */
static bool ranges_fit(const struct logic *logic, const struct logic_instruction *at)
{
	if (at->operation == LOGIC_MESSAGE)
		return at->c <= logic->head->slots - at->b;
	if (at->operation != LOGIC_BLOCK && at->operation != LOGIC_SPREAD)
		return true;
	if (at->c > logic->head->slots - at->a)
		return false;
	return at->operation == LOGIC_SPREAD ||
	       (at->c <= logic->head->slots - at->b &&
		memcmp(logic->types + at->a, logic->types + at->b, at->c) == 0);
}

static bool instruction_fits(const struct logic *logic, uint16_t routine, const struct logic_instruction *at)
{
	const struct shape *shape;

	if (at->operation >= LOGIC_OPERATION_COUNT)
		return false;
	shape = &shapes[at->operation];
	return type_fits(shape->type, at->type) && operand_fits(logic, routine, at->type, shape->a, at->a) &&
	       operand_fits(logic, routine, at->type, shape->b, at->b) &&
	       operand_fits(logic, routine, at->type, shape->c, at->c) && ranges_fit(logic, at);
}

/* Instructions are within routines only, one routine behind the other; each ends with RETURN or JUMP. */
static const char *check_code(const struct logic *logic)
{
	uint8_t depth[LOGIC_ROUTINES];
	uint32_t next = 0;

	if (logic->head->routines == 0 || logic->head->routines > LOGIC_ROUTINES)
		return "the program has no routine, or too many";
	for (uint16_t r = 0; r < logic->head->routines; r++) {
		const struct logic_routine *routine = &logic->routines[r];
		const struct logic_instruction *at = &logic->code[next], *end;

		if (routine->first != next || routine->instructions == 0 ||
		    (next += routine->instructions) > logic->head->code)
			return "the routines are not in order";
		end = at + routine->instructions;
		depth[r] = 1;
		for (; at < end; at++) {
			if (!instruction_fits(logic, r, at))
				return "an instruction does not fit its operands";
			if (at->operation == LOGIC_CALL && depth[at->a] >= depth[r])
				depth[r] = (uint8_t)(depth[at->a] + 1);
		}
		if (depth[r] > LOGIC_DEPTH)
			return "calls are nested too deep";
		if (end[-1].operation != LOGIC_RETURN && end[-1].operation != LOGIC_JUMP)
			return "a routine has no end";
	}
	return next == logic->head->code ? NULL : "instructions are in no routine";
}

static bool name_fits(const struct logic *logic, uint16_t name)
{
	return name < logic->head->names;
}

static bool place_fits(const struct logic *logic, uint16_t slot, uint8_t type)
{
	return slot == LOGIC_NO_SLOT || variable_is(logic, slot, type);
}

static bool string_fits(const struct logic *logic, const struct logic_string *string)
{
	uint32_t end = string->first + logic_string_slots(string->octets);

	if (string->octets == 0 || string->octets > LOGIC_STRING_MAX || end > logic->head->slots)
		return false;
	for (uint32_t slot = string->first; slot < end; slot++)
		if (logic->types[slot] != LOGIC_LINT)
			return false;
	return true;
}

static const char *check_arrays(const struct logic *logic)
{
	const struct logic_head *head = logic->head;

	for (uint16_t i = 0; i < head->arrays; i++) {
		const struct logic_array *array = &logic->arrays[i];
		uint32_t last = array->first + (uint32_t)array->stride * (array->elements - 1U);

		if (array->elements == 0 || array->stride == 0 || last >= head->slots || last < array->first)
			return "an array is too long";
		for (uint32_t slot = array->first; slot <= last; slot += array->stride)
			if (logic->types[slot] != array->type)
				return "an array has elements of several types";
	}
	return NULL;
}

static const char *check_retained(const struct logic *logic)
{
	const struct logic_head *head = logic->head;

	for (uint16_t i = 0; i < head->retained; i++) {
		const struct logic_retained *kept = &logic->retained[i];

		if (kept->first < head->constants || kept->slots > head->slots - kept->first ||
		    !name_fits(logic, kept->name))
			return "a retained variable has no memory";
		if (kept->ends_with_power > 1 || (i > 0 && kept->ends_with_power < kept[-1].ends_with_power))
			return "what is retained is not in its order";
		for (uint16_t j = 0; j < kept->slots; j++)
			if (logic->types[kept->first + j] != kept->type)
				return "a retained variable has several types";
	}
	return NULL;
}

static const char *check_tables(const struct logic *logic)
{
	const struct logic_head *head = logic->head;
	const char *why;

	if (head->constants > head->slots || head->slots == LOGIC_NO_SLOT || head->code > INT16_MAX)
		return "the program is too large";
	if (head->names == 0 || logic->names[head->names - 1] != '\0' || !name_fits(logic, head->name))
		return "the names have no end";
	for (uint16_t i = 0; i < head->slots; i++)
		if (logic->types[i] >= LOGIC_TYPES)
			return "a variable has an unknown type";
	for (uint16_t i = 0; i < head->strings; i++)
		if (!string_fits(logic, &logic->strings[i]))
			return "a string has no memory";
	for (uint16_t i = 0; i < head->points; i++)
		if (!variable_is(logic, logic->points[i].slot, logic->points[i].type) ||
		    !place_fits(logic, logic->points[i].time, LOGIC_DT) ||
		    !name_fits(logic, logic->points[i].name))
			return "a point has no variable";
	for (uint16_t i = 0; i < head->commands; i++) {
		const struct logic_command *command = &logic->commands[i];

		if (!variable_is(logic, command->execute, LOGIC_BOOL) ||
		    !variable_is(logic, command->value, LOGIC_LREAL) ||
		    !variable_is(logic, command->select, LOGIC_BOOL) ||
		    !variable_is(logic, command->state, LOGIC_USINT) ||
		    !variable_is(logic, command->result, LOGIC_USINT) || !name_fits(logic, command->name))
			return "a command has no variables";
	}
	for (uint16_t i = 0; i < head->requests; i++) {
		const struct logic_request *request = &logic->requests[i];

		if (!variable_is(logic, request->active, LOGIC_BOOL) ||
		    !variable_is(logic, request->value, LOGIC_LREAL) ||
		    !variable_is(logic, request->refuse, LOGIC_BOOL) ||
		    !variable_is(logic, request->state, LOGIC_USINT) ||
		    !variable_is(logic, request->result, LOGIC_USINT) || !name_fits(logic, request->name))
			return "a request has no variables";
	}
	why = check_arrays(logic);
	if (why == NULL)
		why = check_retained(logic);
	if (why != NULL)
		return why;
	if (!place_fits(logic, head->uptime, LOGIC_TIME) || !place_fits(logic, head->elapsed, LOGIC_TIME) ||
	    !place_fits(logic, head->now, LOGIC_DT))
		return "the time has no variable";
	return NULL;
}

bool logic_holds(enum logic_type type, union logic_cell value)
{
	if (type == LOGIC_REAL)
		return value.bits >> 32 == 0 && logic_finite((double)value.r);
	if (type == LOGIC_LREAL)
		return logic_finite(value.d);
	return value.i >= logic_ranges[type].low && value.i <= logic_ranges[type].high;
}

static const char *take_initial(struct logic *logic, const uint8_t *section)
{
	for (uint16_t i = 0; i < logic->head->initial; i++) {
		struct logic_initial initial;
		union logic_cell value;

		memcpy(&initial, section + i * sizeof(initial), sizeof(initial));
		value.bits = (uint64_t)initial.high << 32 | initial.low;
		if (initial.slot >= logic->head->slots ||
		    !logic_holds((enum logic_type)logic->types[initial.slot], value))
			return "an initial value does not fit its variable";
		logic->cells[initial.slot] = value;
	}
	return NULL;
}

/* The cells first, since they want the widest alignment; then the file, whose sections begin at multiples of 4. */
const char *logic_load(struct logic *logic, void *memory, const void *file, size_t size)
{
	struct logic_head head;
	const uint8_t *at, *initial;
	const char *refusal;

	memset(logic, 0, sizeof(*logic));
	if (logic_memory(file, size) == 0)
		return "this is not a program, or it is from another version";
	memcpy(&head, file, sizeof(head));
	if (crc32((const uint8_t *)file + 16, size - 16) != head.crc)
		return "the program is damaged: its CRC does not match";
	logic->cells = memory;
	at = memcpy((uint8_t *)memory + head.slots * sizeof(union logic_cell), file, size);
	logic->quality = (uint8_t *)memory + logic_quality_place(&head);
	memset(logic->cells, 0, head.slots * sizeof(union logic_cell));
	memset(logic->quality, 0, head.slots);
#define SECTION(octets) (at += (octets), at - (octets))
	logic->head = (const void *)SECTION(sizeof(struct logic_head));
	logic->types = SECTION(filled(logic->head->slots));
	initial = SECTION(logic->head->initial * sizeof(struct logic_initial));
	logic->arrays = (const void *)SECTION(logic->head->arrays * sizeof(struct logic_array));
	logic->routines = (const void *)SECTION(logic->head->routines * sizeof(struct logic_routine));
	logic->points = (const void *)SECTION(logic->head->points * sizeof(struct logic_point));
	logic->commands = (const void *)SECTION(logic->head->commands * sizeof(struct logic_command));
	logic->requests = (const void *)SECTION(logic->head->requests * sizeof(struct logic_request));
	logic->retained = (const void *)SECTION(logic->head->retained * sizeof(struct logic_retained));
	logic->strings = (const void *)SECTION(logic->head->strings * sizeof(struct logic_string));
	logic->code = (const void *)SECTION(logic->head->code * sizeof(struct logic_instruction));
	logic->lines = (const void *)SECTION(filled(logic->head->code * sizeof(uint16_t)));
	logic->names = (const char *)at;
#undef SECTION
	refusal = check_tables(logic);
	if (!refusal)
		refusal = check_code(logic);
	if (!refusal)
		refusal = take_initial(logic, initial);
	return refusal;
}

const char *logic_name(const struct logic *logic, uint16_t name)
{
	return logic->names + name;
}

bool logic_retains_alike(const struct logic *a, const struct logic_retained *in_a, const struct logic *b,
			 const struct logic_retained *in_b)
{
	return in_a->type == in_b->type && in_a->slots == in_b->slots &&
	       strcmp(logic_name(a, in_a->name), logic_name(b, in_b->name)) == 0;
}

unsigned logic_carry(struct logic *to, const struct logic *from)
{
	unsigned carried = 0;

	for (uint16_t i = 0; i < to->head->retained; i++) {
		const struct logic_retained *new = &to->retained[i];

		for (uint16_t j = 0; j < from->head->retained; j++) {
			const struct logic_retained *old = &from->retained[j];

			if (!logic_retains_alike(to, new, from, old))
				continue;
			memcpy(to->cells + new->first, from->cells + old->first,
			       new->slots * sizeof(union logic_cell));
			memcpy(to->quality + new->first, from->quality + old->first, new->slots);
			carried += !new->ends_with_power;
		}
	}
	return carried;
}
