/* SPDX-License-Identifier: GPL-3.0-or-later */
/* The interpreter of verified programs. It checks only what load.c cannot know: values, bounds of an index, the budget. */
#include <string.h>

#include "logic/logic.h"
#include "logic/real.h"

static void count_fault(struct logic *logic, const struct logic_instruction *at, enum logic_fault fault)
{
	if (logic->faults[fault] < UINT32_MAX)
		logic->faults[fault]++;
	logic->last_fault = (uint8_t)fault;
	logic->last_line = logic->lines[at - logic->code];
}

static bool in_range(uint8_t type, int64_t value)
{
	return value >= logic_ranges[type].low && value <= logic_ranges[type].high;
}

/* An integer result: 0, invalid and counted where its type does not have it. */
static void put(struct logic *logic, const struct logic_instruction *at, bool fits, int64_t value,
		unsigned quality)
{
	if (fits && in_range(at->type, value)) {
		logic->cells[at->a].i = value;
		logic->quality[at->a] = (uint8_t)quality;
		return;
	}
	count_fault(logic, at, LOGIC_RANGE);
	logic->cells[at->a].i = 0;
	logic->quality[at->a] = (uint8_t)(quality | LOGIC_INVALID | LOGIC_OVERFLOW);
}

static void put_nothing(struct logic *logic, const struct logic_instruction *at, enum logic_fault fault,
			unsigned quality)
{
	count_fault(logic, at, fault);
	logic->cells[at->a].bits = 0;
	logic->quality[at->a] = (uint8_t)(quality | LOGIC_INVALID);
}

static void put_double(struct logic *logic, const struct logic_instruction *at, enum logic_fault fault,
		       double value, unsigned quality)
{
	if (!logic_finite(value)) {
		put_nothing(logic, at, fault, quality | (fault == LOGIC_RANGE ? LOGIC_OVERFLOW : 0U));
		return;
	}
	logic->cells[at->a].d = value;
	logic->quality[at->a] = (uint8_t)quality;
}

static void put_real(struct logic *logic, const struct logic_instruction *at, enum logic_fault fault,
		     float value, unsigned quality)
{
	if (!logic_finite((double)value)) {
		put_nothing(logic, at, fault, quality | (fault == LOGIC_RANGE ? LOGIC_OVERFLOW : 0U));
		return;
	}
	logic->cells[at->a].r = value;
	logic->quality[at->a] = (uint8_t)quality;
}

static void put_whole(struct logic *logic, const struct logic_instruction *at, double value, unsigned quality)
{
	const double limit = 9223372036854775808.0; /* 2^63 */

	if (value >= -limit && value < limit)
		put(logic, at, true, (int64_t)value, quality);
	else
		put(logic, at, false, 0, quality);
}

static void divide(struct logic *logic, const struct logic_instruction *at, int64_t by, unsigned quality)
{
	int64_t value = logic->cells[at->b].i;

	if (by == 0)
		put_nothing(logic, at, LOGIC_DIVISION, quality);
	else if (by == -1) /* INT64_MIN / -1 traps */
		put(logic, at, at->operation == LOGIC_MOD || value != INT64_MIN,
		    at->operation == LOGIC_MOD || value == INT64_MIN ? 0 : -value, quality);
	else
		put(logic, at, true, at->operation == LOGIC_MOD ? value % by : value / by, quality);
}

/* By none or more than the width SHL and SHR give 0, ROL and ROR turn round; a negative number of bits is a fault. */
static void shift(struct logic *logic, const struct logic_instruction *at, int64_t by, unsigned quality)
{
	uint64_t value = logic->cells[at->b].bits, mask = (uint64_t)logic_ranges[at->type].high;
	unsigned width = at->type == LOGIC_BYTE ? 8 : at->type == LOGIC_WORD ? 16 : 32;
	unsigned turn;

	if (by < 0) {
		put_nothing(logic, at, LOGIC_DOMAIN, quality);
		return;
	}
	turn = (unsigned)(by % width);
	if (at->operation == LOGIC_ROR)
		turn = (width - turn) % width;
	if (at->operation == LOGIC_ROL || at->operation == LOGIC_ROR)
		value = value << turn | value >> (width - turn);
	else if (by >= width)
		value = 0;
	else
		value = at->operation == LOGIC_SHL ? value << by : value >> by;
	logic->cells[at->a].bits = value & mask;
	logic->quality[at->a] = (uint8_t)quality;
}

/* The element's slot, or -1: a fault. */
static int32_t element(struct logic *logic, const struct logic_instruction *at, int64_t index)
{
	const struct logic_array *array = &logic->arrays[at->b];

	if (index >= array->low && index < (int64_t)array->low + array->elements)
		return (int32_t)(array->first + (index - array->low) * array->stride);
	count_fault(logic, at, LOGIC_BOUNDS);
	return -1;
}

static void load(struct logic *logic, const struct logic_instruction *at)
{
	int32_t slot = element(logic, at, logic->cells[at->c].i);
	unsigned quality = logic->quality[at->c];

	if (slot < 0) {
		logic->cells[at->a].bits = 0;
		logic->quality[at->a] = (uint8_t)(quality | LOGIC_INVALID);
		return;
	}
	logic->cells[at->a] = logic->cells[slot];
	logic->quality[at->a] = (uint8_t)(quality | logic->quality[slot]);
}

/* Where the index is wrong or doubtful, each element is: it may be the one that should have changed. */
static void store(struct logic *logic, const struct logic_instruction *at)
{
	const struct logic_array *array = &logic->arrays[at->b];
	int32_t slot = element(logic, at, logic->cells[at->c].i);
	unsigned doubt = logic->quality[at->c];

	if (slot >= 0) {
		logic->cells[slot] = logic->cells[at->a];
		logic->quality[slot] = logic->quality[at->a];
	} else {
		doubt |= LOGIC_INVALID;
	}
	for (uint32_t i = 0; doubt && i < array->elements; i++)
		logic->quality[array->first + i * array->stride] |= (uint8_t)doubt;
}

static void spread(struct logic *logic, const struct logic_instruction *at)
{
	for (uint32_t i = 0; i < at->c; i++)
		logic->quality[at->a + i] |= logic->quality[at->b];
}

/* Said once in a scan: its slots have the values of the last time. */
static void say(struct logic *logic, uint16_t instruction)
{
	for (unsigned i = 0; i < logic->messages; i++)
		if (logic->message_at[i] == instruction)
			return;
	if (logic->messages < LOGIC_MESSAGES)
		logic->message_at[logic->messages++] = instruction;
	else
		logic->unsaid++;
}

/* What a scan that did not end would have left is not known. */
static void doubt_all(struct logic *logic)
{
	for (uint32_t slot = logic->head->constants; slot < logic->head->slots; slot++)
		logic->quality[slot] |= LOGIC_INVALID;
}

static uint32_t octets_moved(const struct logic_instruction *at)
{
	return at->operation == LOGIC_BLOCK || at->operation == LOGIC_SPREAD ? at->c : 1;
}

#ifdef LOGIC_COVERAGE
#define COVER(what)                                                                                          \
	do {                                                                                                 \
		if (logic->covered)                                                                          \
			logic->covered[at - code] |= (what);                                                 \
	} while (0)
#else
#define COVER(what)                                                                                          \
	do {                                                                                                 \
	} while (0)
#endif

#define A          cells[at->a]
#define B          cells[at->b]
#define C          cells[at->c]
#define QUALITY_A  quality[at->a]
#define QUALITY_B  quality[at->b]
#define QUALITY_BC (unsigned)(quality[at->b] | quality[at->c])

#define INTEGER(operation)                                                                                   \
	do {                                                                                                 \
		int64_t result;                                                                              \
		bool fits = !operation(B.i, C.i, &result);                                                   \
                                                                                                             \
		put(logic, at, fits, result, QUALITY_BC);                                                    \
	} while (0)

#define TO_BOOL(expression)                                                                                  \
	do {                                                                                                 \
		A.i = (expression);                                                                          \
		QUALITY_A = (uint8_t)QUALITY_BC;                                                             \
	} while (0)

#define JUMP_TO(target)                                                                                      \
	do {                                                                                                 \
		const struct logic_instruction *to = code + (target);                                        \
                                                                                                             \
		if (to <= at && !spend(&budget, (uint32_t)(at - to) + 1))                                    \
			goto over;                                                                           \
		at = to;                                                                                     \
	} while (0)

static bool spend(uint32_t *budget, uint32_t instructions)
{
	if (*budget < instructions)
		return false;
	*budget -= instructions;
	return true;
}

/*
 * The budget is spent where the way turns back and where it calls, by the instructions that may have run or may run: what
 * is straight needs no counting, and the number is the same on every machine. BLOCK and SPREAD spend their slots.
 * It is one function, however long, so that what it works on stays in registers from one instruction to the next.
 */
static bool run(struct logic *logic, uint32_t budget)
{
	const struct logic_instruction *const code = logic->code;
	union logic_cell *const cells = logic->cells;
	uint8_t *const quality = logic->quality;
	const struct logic_instruction *returns[LOGIC_DEPTH];
	unsigned depth = 0;
	const struct logic_instruction *at = code + logic->routines[logic->head->routines - 1].first;

	for (;;) {
		COVER(LOGIC_RUN);
		switch ((enum logic_operation)at->operation) {
		case LOGIC_MOVE:
			A = B;
			QUALITY_A = QUALITY_B;
			break;
		case LOGIC_BLOCK:
			if (!spend(&budget, octets_moved(at)))
				goto over;
			memmove(&A, &B, at->c * sizeof(A));
			memmove(&QUALITY_A, &QUALITY_B, at->c);
			break;
		case LOGIC_LOAD:
			load(logic, at);
			break;
		case LOGIC_STORE:
			store(logic, at);
			break;
		case LOGIC_ADD:
			INTEGER(__builtin_add_overflow);
			break;
		case LOGIC_SUB:
			INTEGER(__builtin_sub_overflow);
			break;
		case LOGIC_MUL:
			INTEGER(__builtin_mul_overflow);
			break;
		case LOGIC_DIV:
		case LOGIC_MOD:
			divide(logic, at, C.i, QUALITY_BC);
			break;
		case LOGIC_NEG:
			put(logic, at, B.i != INT64_MIN, B.i == INT64_MIN ? 0 : -B.i, QUALITY_B);
			break;
		case LOGIC_ABS:
			put(logic, at, B.i != INT64_MIN, B.i < 0 && B.i != INT64_MIN ? -B.i : B.i, QUALITY_B);
			break;
		case LOGIC_EQ:
			TO_BOOL(B.i == C.i);
			break;
		case LOGIC_NE:
			TO_BOOL(B.i != C.i);
			break;
		case LOGIC_LT:
			TO_BOOL(B.i < C.i);
			break;
		case LOGIC_LE:
			TO_BOOL(B.i <= C.i);
			break;
		case LOGIC_AND:
			TO_BOOL(B.i & C.i);
			break;
		case LOGIC_OR:
			TO_BOOL(B.i | C.i);
			break;
		case LOGIC_XOR:
			TO_BOOL(B.i ^ C.i);
			break;
		case LOGIC_NOT:
			A.i = B.i ^ logic_ranges[at->type].high;
			QUALITY_A = QUALITY_B;
			break;
		case LOGIC_SHL:
		case LOGIC_SHR:
		case LOGIC_ROL:
		case LOGIC_ROR:
			shift(logic, at, C.i, QUALITY_BC);
			break;
		case LOGIC_RADD:
			put_real(logic, at, LOGIC_RANGE, B.r + C.r, QUALITY_BC);
			break;
		case LOGIC_RSUB:
			put_real(logic, at, LOGIC_RANGE, B.r - C.r, QUALITY_BC);
			break;
		case LOGIC_RMUL:
			put_real(logic, at, LOGIC_RANGE, B.r * C.r, QUALITY_BC);
			break;
		case LOGIC_RDIV:
			if (C.r == 0)
				put_nothing(logic, at, LOGIC_DIVISION, QUALITY_BC);
			else
				put_real(logic, at, LOGIC_RANGE, B.r / C.r, QUALITY_BC);
			break;
		case LOGIC_RNEG:
			A.r = -B.r;
			QUALITY_A = QUALITY_B;
			break;
		case LOGIC_RABS:
			A.r = B.r < 0 ? -B.r : B.r;
			QUALITY_A = QUALITY_B;
			break;
		case LOGIC_REQ:
			TO_BOOL(B.r == C.r);
			break;
		case LOGIC_RNE:
			TO_BOOL(B.r != C.r);
			break;
		case LOGIC_RLT:
			TO_BOOL(B.r < C.r);
			break;
		case LOGIC_RLE:
			TO_BOOL(B.r <= C.r);
			break;
		case LOGIC_DADD:
			put_double(logic, at, LOGIC_RANGE, B.d + C.d, QUALITY_BC);
			break;
		case LOGIC_DSUB:
			put_double(logic, at, LOGIC_RANGE, B.d - C.d, QUALITY_BC);
			break;
		case LOGIC_DMUL:
			put_double(logic, at, LOGIC_RANGE, B.d * C.d, QUALITY_BC);
			break;
		case LOGIC_DDIV:
			if (C.d == 0)
				put_nothing(logic, at, LOGIC_DIVISION, QUALITY_BC);
			else
				put_double(logic, at, LOGIC_RANGE, B.d / C.d, QUALITY_BC);
			break;
		case LOGIC_DNEG:
			A.d = -B.d;
			QUALITY_A = QUALITY_B;
			break;
		case LOGIC_DABS:
			A.d = B.d < 0 ? -B.d : B.d;
			QUALITY_A = QUALITY_B;
			break;
		case LOGIC_DEQ:
			TO_BOOL(B.d == C.d);
			break;
		case LOGIC_DNE:
			TO_BOOL(B.d != C.d);
			break;
		case LOGIC_DLT:
			TO_BOOL(B.d < C.d);
			break;
		case LOGIC_DLE:
			TO_BOOL(B.d <= C.d);
			break;
		case LOGIC_EXPT:
			put_double(logic, at, LOGIC_DOMAIN, logic_expt(B.d, C.d), QUALITY_BC);
			break;
		case LOGIC_MATH:
			put_double(logic, at, LOGIC_DOMAIN, logic_real((enum logic_function)at->c, B.d),
				   QUALITY_B);
			break;
		case LOGIC_CONVERT:
			put(logic, at, true, B.i, QUALITY_B);
			break;
		case LOGIC_BITS:
			A.i = B.i & logic_ranges[at->type].high;
			QUALITY_A = QUALITY_B;
			break;
		case LOGIC_I2R:
			A.r = (float)B.i;
			QUALITY_A = QUALITY_B;
			break;
		case LOGIC_I2D:
			A.d = (double)B.i;
			QUALITY_A = QUALITY_B;
			break;
		case LOGIC_R2D:
			A.d = (double)B.r;
			QUALITY_A = QUALITY_B;
			break;
		case LOGIC_D2R:
			put_real(logic, at, LOGIC_RANGE, (float)B.d, QUALITY_B);
			break;
		case LOGIC_ROUND:
			put_whole(logic, at, logic_round(B.d), QUALITY_B);
			break;
		case LOGIC_TRUNC:
			put_whole(logic, at, B.d, QUALITY_B);
			break;
		case LOGIC_JUMP:
			JUMP_TO(at->a);
			continue;
		case LOGIC_ELSIF:
			quality[at->c] |= QUALITY_A;
			goto decide;
		case LOGIC_IF:
			quality[at->c] = QUALITY_A;
		decide:
			if (A.i) {
				COVER(LOGIC_WENT_ON);
				break;
			}
			COVER(LOGIC_JUMPED);
			JUMP_TO(at->b);
			continue;
		case LOGIC_CLEAN:
			if (QUALITY_A)
				break;
			JUMP_TO(at->b);
			continue;
		case LOGIC_SPREAD:
			if (!spend(&budget, octets_moved(at)))
				goto over;
			spread(logic, at);
			break;
		case LOGIC_CALL:
			if (!spend(&budget, logic->routines[at->a].instructions))
				goto over;
			returns[depth++] = at;
			at = code + logic->routines[at->a].first;
			continue;
		case LOGIC_RETURN:
			if (depth == 0)
				return true;
			at = returns[--depth];
			break;
		case LOGIC_QUALITY:
			A.i = QUALITY_B;
			QUALITY_A = 0;
			break;
		case LOGIC_GOOD:
			A.i = (QUALITY_B & LOGIC_NOT_GOOD) == 0;
			QUALITY_A = 0;
			break;
		case LOGIC_AS_GOOD:
			A = B;
			QUALITY_A = 0;
			break;
		case LOGIC_MESSAGE:
			say(logic, (uint16_t)(at - code));
			break;
		case LOGIC_TEXT:
		case LOGIC_JOIN:
		case LOGIC_HEAD:
		case LOGIC_TAIL:
		case LOGIC_LAST:
		case LOGIC_LENGTH:
		case LOGIC_FIND:
		case LOGIC_COMPARE:
		case LOGIC_FORMAT:
			if (!spend(&budget, logic_text_cost(logic, at)))
				goto over;
			if (!logic_text(logic, at))
				count_fault(logic, at, LOGIC_DOMAIN);
			break;
		case LOGIC_OPERATION_COUNT:
			return true;
		}
		at++;
	}
over:
	count_fault(logic, at, LOGIC_BUDGET);
	doubt_all(logic);
	return false;
}

static void set_time(struct logic *logic, uint16_t slot, int64_t value)
{
	if (slot != LOGIC_NO_SLOT)
		logic->cells[slot].i = value;
}

bool logic_scan(struct logic *logic, const struct logic_times *times, uint32_t budget)
{
	set_time(logic, logic->head->uptime, times->uptime_us);
	set_time(logic, logic->head->elapsed, times->elapsed_us);
	set_time(logic, logic->head->now, times->now_us);
	logic->messages = 0;
	logic->unsaid = 0;
	return run(logic, budget);
}

static bool is_value(uint8_t type, union logic_cell value)
{
	if (type == LOGIC_REAL)
		return logic_finite((double)value.r);
	if (type == LOGIC_LREAL)
		return logic_finite(value.d);
	return in_range(type, value.i);
}

void logic_set(struct logic *logic, const struct logic_point *point, const struct logic_value *value)
{
	bool fits = is_value(point->type, value->value);

	logic->cells[point->slot].bits = fits ? value->value.bits : 0;
	logic->quality[point->slot] = (uint8_t)(value->quality | (fits ? 0 : LOGIC_INVALID));
	if (point->time != LOGIC_NO_SLOT) {
		logic->cells[point->time].i = value->time_us;
		logic->quality[point->time] = 0;
	}
}

void logic_get(const struct logic *logic, const struct logic_point *point, struct logic_value *value)
{
	value->value = logic->cells[point->slot];
	value->quality = logic->quality[point->slot];
	value->time_us = point->time != LOGIC_NO_SLOT ? logic->cells[point->time].i : 0;
}
