/* SPDX-License-Identifier: GPL-3.0-or-later */
/*
 * The same inputs give the same outputs, bit for bit, on every machine: programs of random instructions on random values, and a
 * sum of all that they leave. `make unit` has it on this machine, `make cross` on ARMv5 with soft float; the sum is one.
 */
#include <setjmp.h>
#include <stdarg.h>
#include <stddef.h>
#include <stdint.h>
#include <stdlib.h>
#include <string.h>

#include <cmocka.h>

#include "logic/logic.h"
#include "logic/real.h"
#include "logic/test_seal.h"

#define OF_A_TYPE    4 /* slots */
#define SLOTS        (OF_A_TYPE * LOGIC_TYPES)
#define INSTRUCTIONS 500
#define PROGRAMS     40
#define SCANS        25
#define EXPECTED     UINT64_C(0x73b4e4c7d61b5168)

static const struct shape {
	char class, operands[4];
} shapes[] = {
#define SHAPE(name, type, operands) {type[0], operands},
    LOGIC_OPERATIONS(SHAPE)
#undef SHAPE
};

struct program {
	struct logic_head head;
	uint8_t types[SLOTS];
	struct logic_routine routine;
	struct logic_point points[SLOTS];
	struct logic_instruction code[INSTRUCTIONS];
	uint16_t lines[INSTRUCTIONS];
	char names[4];
};
_Static_assert(sizeof(struct program) == 48 + SLOTS + 4 + SLOTS * 8 + INSTRUCTIONS * 10 + 4, "no padding");
_Static_assert(SLOTS % 4 == 0 && INSTRUCTIONS % 2 == 0, "sections begin at multiples of 4");

/* xorshift64*, as rand() is another one on each machine. */
static uint64_t chance;

static uint64_t draw(void)
{
	chance ^= chance >> 12;
	chance ^= chance << 25;
	chance ^= chance >> 27;
	return chance * UINT64_C(2685821657736338717);
}

static unsigned below(unsigned limit)
{
	return (unsigned)((draw() >> 32) % limit);
}

static uint16_t slot_of(unsigned type)
{
	return (uint16_t)(type * OF_A_TYPE + below(OF_A_TYPE));
}

static uint16_t operand(char kind, unsigned type)
{
	switch (kind) {
	case 't':
	case 'T':
		return slot_of(type);
	case 'b':
	case 'B':
		return slot_of(LOGIC_BOOL);
	case 'i':
		return slot_of(below(LOGIC_REAL));
	case 'Q':
		return slot_of(LOGIC_BYTE);
	case 'f':
	case 'F':
		return slot_of(LOGIC_REAL);
	case 'd':
	case 'D':
		return slot_of(LOGIC_LREAL);
	case '*':
	case '+':
		return (uint16_t)below(SLOTS);
	case 'm':
		return (uint16_t)below(LOGIC_FUNCTIONS);
	case 'n':
		return 1;
	default:
		return 0;
	}
}

static unsigned type_for(char class)
{
	static const uint8_t numbers[] = {LOGIC_SINT, LOGIC_INT,   LOGIC_DINT, LOGIC_LINT, LOGIC_USINT,
					  LOGIC_UINT, LOGIC_UDINT, LOGIC_TIME, LOGIC_DT};

	switch (class) {
	case '-':
		return 0;
	case 'n':
		return numbers[below(sizeof(numbers))];
	case 'o':
		return below(LOGIC_REAL);
	case 'w':
		return below(4) == 0 ? LOGIC_BOOL : LOGIC_BYTE + below(3);
	case 's':
		return LOGIC_BYTE + below(3);
	default:
		return below(LOGIC_TYPES);
	}
}

/* One behind the other: what jumps, calls and arrays do has no bits of its own. */
static bool is_straight(unsigned operation)
{
	return strpbrk(shapes[operation].operands, "jkxX") == NULL && operation != LOGIC_RETURN;
}

static struct logic_instruction draw_instruction(void)
{
	struct logic_instruction drawn;

	do
		drawn.operation = (uint8_t)below(LOGIC_MESSAGE); /* the last one, which leaves no bits */
	while (!is_straight(drawn.operation));
	drawn.type = (uint8_t)type_for(shapes[drawn.operation].class);
	drawn.a = operand(shapes[drawn.operation].operands[0], drawn.type);
	drawn.b = operand(shapes[drawn.operation].operands[1], drawn.type);
	drawn.c = operand(shapes[drawn.operation].operands[2], drawn.type);
	return drawn;
}

/* BLOCK needs slots of the same types. */
static void draw_program(struct program *program)
{
	*program = (struct program){.head = {.magic = {'R', 'T', 'U', 'L'},
					     .version = LOGIC_VERSION,
					     .size = sizeof(*program),
					     .slots = SLOTS,
					     .routines = 1,
					     .points = SLOTS,
					     .code = INSTRUCTIONS,
					     .uptime = LOGIC_NO_SLOT,
					     .elapsed = LOGIC_NO_SLOT,
					     .now = LOGIC_NO_SLOT,
					     .names = sizeof(program->names)},
				    .routine = {0, INSTRUCTIONS}};
	for (uint16_t i = 0; i < SLOTS; i++) {
		program->types[i] = (uint8_t)(i / OF_A_TYPE);
		program->points[i] = (struct logic_point){i, LOGIC_NO_SLOT, program->types[i], 0, 0};
	}
	for (unsigned i = 0; i + 1 < INSTRUCTIONS; i++) {
		struct logic_instruction *at = &program->code[i];

		do
			*at = draw_instruction();
		while (at->operation == LOGIC_BLOCK && program->types[at->a] != program->types[at->b]);
	}
	program->code[INSTRUCTIONS - 1] = (struct logic_instruction){.operation = LOGIC_RETURN};
	seal(&program->head, sizeof(*program));
}

/* One draw a statement: C leaves the order within one to the compiler. Numbers of all sizes, and those near to zero and one, for which functions have answers. */
static struct logic_value draw_value(unsigned type)
{
	struct logic_value value = {.quality = below(8) == 0 ? (uint8_t)(draw() & 0xf1) : 0};
	unsigned size = below(64);

	value.value.bits = draw() >> size;
	if (type < LOGIC_REAL && below(2) == 0)
		value.value.i = -value.value.i;
	size = below(20);
	if (type >= LOGIC_REAL && below(3) > 0)
		value.value.d = (double)(int64_t)draw() / 9223372036854775808.0 * (double)(1U << size);
	if (type == LOGIC_REAL && value.value.bits >> 52 != 0)
		value.value = (union logic_cell){.r = (float)(int32_t)draw() / 2147483648.0F};
	return value;
}

static void add(uint64_t *sum, uint64_t bits)
{
	*sum = (*sum ^ bits) * UINT64_C(1099511628211); /* FNV-1a, by words */
}

static void add_all(uint64_t *sum, const struct logic *logic)
{
	for (uint16_t i = 0; i < SLOTS; i++) {
		add(sum,
		    logic->types[i] == LOGIC_REAL ? (uint32_t)logic->cells[i].bits : logic->cells[i].bits);
		add(sum, logic->quality[i]);
	}
	for (unsigned i = 0; i < LOGIC_FAULTS; i++)
		add(sum, logic->faults[i]);
}

static void run_program(uint64_t *sum)
{
	static struct program program;
	struct logic logic;
	size_t size;
	void *memory;

	draw_program(&program);
	size = logic_memory(&program, sizeof(program));
	assert_true(size > 0);
	memory = malloc(size);
	assert_non_null(memory);
	assert_null(logic_load(&logic, memory, &program, sizeof(program)));
	for (unsigned scan = 0; scan < SCANS; scan++) {
		const struct logic_times times = {scan, 1, scan};

		for (uint16_t i = 0; i < SLOTS; i++) {
			struct logic_value value = draw_value(program.types[i]);

			logic_set(&logic, &logic.points[i], &value);
		}
		assert_true(logic_scan(&logic, &times, 10 * INSTRUCTIONS));
		add_all(sum, &logic);
	}
	free(memory);
}

static void test_the_same_inputs_give_the_same_bits(void **state)
{
	uint64_t sum = UINT64_C(14695981039346656037);

	(void)state;
	chance = 1;
	for (unsigned i = 0; i < PROGRAMS; i++)
		run_program(&sum);
	if (sum != EXPECTED)
		fail_msg("the sum is UINT64_C(0x%llx)", (unsigned long long)sum);
}

int main(void)
{
	const struct CMUnitTest tests[] = {
	    cmocka_unit_test(test_the_same_inputs_give_the_same_bits),
	};

	return cmocka_run_group_tests(tests, NULL, NULL);
}
