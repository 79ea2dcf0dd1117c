/* SPDX-License-Identifier: GPL-3.0-or-later */
#include "slave.h"

#include <string.h>

/* Clause 7. */
enum exception { NO_EXCEPTION, ILLEGAL_FUNCTION, ILLEGAL_DATA_ADDRESS, ILLEGAL_DATA_VALUE };

/* Clauses 6.1 to 6.12: most that one request may name. */
#define READ_BITS_MAX       2000
#define READ_REGISTERS_MAX  125
#define WRITE_BITS_MAX      1968
#define WRITE_REGISTERS_MAX 123

#define MS 1000000

#define COIL_ON  0xff00
#define COIL_OFF 0x0000

struct transaction {
	struct slave *slave;
	const uint8_t *request;
	size_t request_size;
	uint8_t *answer;
	size_t answer_size;
	struct slave_access access;
};

static uint16_t get_u16(const uint8_t *bytes)
{
	return (uint16_t)(bytes[0] << 8 | bytes[1]);
}

static void put_u16(uint8_t *bytes, uint16_t value)
{
	bytes[0] = (uint8_t)(value >> 8);
	bytes[1] = (uint8_t)value;
}

/* Checks quantity and existence in the order of the specification's state diagrams: 3 before 2. */
static enum exception name_cells(struct transaction *t, enum slave_table table, unsigned count,
				 unsigned count_max)
{
	const unsigned first = get_u16(t->request + 1);

	if (count < 1 || count > count_max)
		return ILLEGAL_DATA_VALUE;
	for (unsigned i = 0; i < count; i++)
		if (!slave_exists(t->slave, table, (long)first + i))
			return ILLEGAL_DATA_ADDRESS;
	t->access.table = table;
	t->access.first = (uint16_t)first;
	t->access.count = (uint16_t)count;
	return NO_EXCEPTION;
}

static uint16_t *cells(struct transaction *t)
{
	return t->slave->table[t->access.table].value + t->access.first;
}

/* The answer to a write repeats the first five bytes of the request. */
static enum exception confirm_write(struct transaction *t)
{
	memcpy(t->answer, t->request, 5);
	t->answer_size = 5;
	t->access.write = true;
	t->slave->stats.writes++;
	return NO_EXCEPTION;
}

static enum exception read_bits(struct transaction *t, enum slave_table table)
{
	if (t->request_size != 5)
		return ILLEGAL_DATA_VALUE;

	const enum exception refused = name_cells(t, table, get_u16(t->request + 3), READ_BITS_MAX);

	if (refused)
		return refused;

	const size_t bytes = (t->access.count + 7u) / 8;

	t->answer[0] = t->request[0];
	t->answer[1] = (uint8_t)bytes;
	memset(t->answer + 2, 0, bytes);
	for (unsigned i = 0; i < t->access.count; i++)
		if (cells(t)[i])
			t->answer[2 + i / 8] |= (uint8_t)(1u << i % 8);
	t->answer_size = 2 + bytes;
	return NO_EXCEPTION;
}

static enum exception read_registers(struct transaction *t, enum slave_table table)
{
	if (t->request_size != 5)
		return ILLEGAL_DATA_VALUE;

	const enum exception refused = name_cells(t, table, get_u16(t->request + 3), READ_REGISTERS_MAX);

	if (refused)
		return refused;
	t->answer[0] = t->request[0];
	t->answer[1] = (uint8_t)(2 * t->access.count);
	for (unsigned i = 0; i < t->access.count; i++)
		put_u16(t->answer + 2 + 2 * i, cells(t)[i]);
	t->answer_size = 2 + 2u * t->access.count;
	return NO_EXCEPTION;
}

static enum exception write_coil(struct transaction *t, enum slave_table table)
{
	if (t->request_size != 5)
		return ILLEGAL_DATA_VALUE;

	const uint16_t value = get_u16(t->request + 3);

	if (value != COIL_ON && value != COIL_OFF)
		return ILLEGAL_DATA_VALUE;

	const enum exception refused = name_cells(t, table, 1, 1);

	if (refused)
		return refused;
	cells(t)[0] = value == COIL_ON;
	return confirm_write(t);
}

static enum exception write_register(struct transaction *t, enum slave_table table)
{
	if (t->request_size != 5)
		return ILLEGAL_DATA_VALUE;

	const enum exception refused = name_cells(t, table, 1, 1);

	if (refused)
		return refused;
	cells(t)[0] = get_u16(t->request + 3);
	return confirm_write(t);
}

/* Mask write register: the bits of the first mask stay, those of the second come where it has none. */
static enum exception mask_register(struct transaction *t, enum slave_table table)
{
	if (t->request_size != 7)
		return ILLEGAL_DATA_VALUE;

	const enum exception refused = name_cells(t, table, 1, 1);
	const uint16_t stay = get_u16(t->request + 3), come = get_u16(t->request + 5);

	if (refused)
		return refused;
	cells(t)[0] = (uint16_t)((cells(t)[0] & stay) | (come & ~stay));
	confirm_write(t);
	memcpy(t->answer, t->request, 7);
	t->answer_size = 7;
	return NO_EXCEPTION;
}

/* The byte count must be what the quantity needs and what came behind it. */
static bool byte_count_fits(const struct transaction *t, size_t needed)
{
	return t->request_size == 6 + needed && t->request[5] == needed;
}

static enum exception write_coils(struct transaction *t, enum slave_table table)
{
	if (t->request_size < 6)
		return ILLEGAL_DATA_VALUE;

	const unsigned count = get_u16(t->request + 3);

	if (!byte_count_fits(t, (count + 7) / 8))
		return ILLEGAL_DATA_VALUE;

	const enum exception refused = name_cells(t, table, count, WRITE_BITS_MAX);

	if (refused)
		return refused;
	for (unsigned i = 0; i < count; i++)
		cells(t)[i] = t->request[6 + i / 8] >> i % 8 & 1;
	return confirm_write(t);
}

static enum exception write_registers(struct transaction *t, enum slave_table table)
{
	if (t->request_size < 6)
		return ILLEGAL_DATA_VALUE;

	const unsigned count = get_u16(t->request + 3);

	if (!byte_count_fits(t, 2u * count))
		return ILLEGAL_DATA_VALUE;

	const enum exception refused = name_cells(t, table, count, WRITE_REGISTERS_MAX);

	if (refused)
		return refused;
	for (unsigned i = 0; i < count; i++)
		cells(t)[i] = get_u16(t->request + 6 + 2 * i);
	return confirm_write(t);
}

/* Clause 6.21, of the streams of basic and regular objects: as many as one answer holds. */
static enum exception identify(struct transaction *t, enum slave_table table)
{
	const unsigned last = t->request_size == 4 && t->request[2] == 1 ? 3 : SLAVE_IDENTIFIED;
	unsigned object;

	(void)table;
	if (t->slave->identification[0][0] == '\0' || t->request_size < 2 || t->request[1] != 14)
		return ILLEGAL_FUNCTION;
	if (t->request_size != 4 || t->request[2] < 1 || t->request[2] > 2)
		return ILLEGAL_DATA_VALUE;
	if (t->request[3] >= SLAVE_IDENTIFIED)
		return ILLEGAL_DATA_ADDRESS;
	memcpy(t->answer, (const uint8_t[]){43, 14, t->request[2], 0x02, 0, 0, 0}, 7);
	t->answer_size = 7;
	for (object = t->request[3]; object < last; object++) {
		const char *text = t->slave->identification[object];
		const size_t length = strlen(text);

		if (length == 0)
			continue;
		if (t->answer_size + 2 + length > SLAVE_PDU_MAX)
			break;
		t->answer[t->answer_size] = (uint8_t)object;
		t->answer[t->answer_size + 1] = (uint8_t)length;
		memcpy(t->answer + t->answer_size + 2, text, length);
		t->answer_size += 2 + length;
		t->answer[6]++;
	}
	if (object < last) {
		t->answer[4] = 0xff;
		t->answer[5] = (uint8_t)object;
	}
	return NO_EXCEPTION;
}

static const struct {
	uint8_t code;
	enum exception (*execute)(struct transaction *t, enum slave_table table);
	enum slave_table table;
} functions[] = {
    {1, read_bits, SLAVE_COILS},
    {2, read_bits, SLAVE_DISCRETE_INPUTS},
    {3, read_registers, SLAVE_HOLDING_REGISTERS},
    {4, read_registers, SLAVE_INPUT_REGISTERS},
    {5, write_coil, SLAVE_COILS},
    {6, write_register, SLAVE_HOLDING_REGISTERS},
    {15, write_coils, SLAVE_COILS},
    {16, write_registers, SLAVE_HOLDING_REGISTERS},
    {22, mask_register, SLAVE_HOLDING_REGISTERS},
    {43, identify, SLAVE_TABLES},
};

static enum exception execute(struct transaction *t)
{
	for (size_t i = 0; i < sizeof functions / sizeof *functions; i++)
		if (functions[i].code == t->request[0])
			return functions[i].execute(t, functions[i].table);
	return ILLEGAL_FUNCTION;
}

size_t slave_execute(struct slave *slave, const uint8_t *request, size_t size, uint8_t answer[SLAVE_PDU_MAX],
		     struct slave_access *access)
{
	struct transaction t = {.slave = slave, .request = request, .request_size = size, .answer = answer};
	const enum exception refused = execute(&t);

	if (refused) {
		answer[0] = request[0] | 0x80;
		answer[1] = (uint8_t)refused;
		t.answer_size = 2;
	}
	*access = t.access;
	return t.answer_size;
}

bool slave_is_too_long(const struct slave_fault *fault, const uint8_t *request, size_t size)
{
	return fault->kind == SLAVE_LIMIT && request[0] <= 4 && size == 5 &&
	       get_u16(request + 3) > fault->argument;
}

struct slave_fault slave_take_fault(struct slave *slave, uint8_t function)
{
	struct slave_fault *fault = &slave->fault;
	const struct slave_fault taken = *fault;

	if (fault->function && fault->function != function)
		return (struct slave_fault){.kind = SLAVE_HEALTHY};
	if (fault->remaining && --fault->remaining == 0)
		*fault = (struct slave_fault){.kind = SLAVE_HEALTHY};
	return taken;
}

bool slave_hears(const struct slave *slave, const struct slave_fault *fault, int64_t at_ns)
{
	return fault->kind != SLAVE_MUTE && (fault->kind != SLAVE_DEAF || at_ns >= slave->deaf_until_ns);
}

void slave_answered(struct slave *slave, const struct slave_fault *fault, int64_t end_ns)
{
	if (fault->kind == SLAVE_DEAF)
		slave->deaf_until_ns = end_ns + (int64_t)fault->argument * MS;
}

bool slave_exists(const struct slave *slave, enum slave_table table, long address)
{
	return address >= 0 && address < SLAVE_TABLE_CELLS && slave->table[table].exists[address];
}

bool slave_set(struct slave *slave, enum slave_table table, long address, long value)
{
	const bool bits = slave_table_has_bits(table);

	if (!slave_exists(slave, table, address) || value < (bits ? 0 : INT16_MIN) ||
	    value > (bits ? 1 : UINT16_MAX))
		return false;
	slave->table[table].value[address] = (uint16_t)value;
	return true;
}

bool slave_table_has_bits(enum slave_table table)
{
	return table == SLAVE_COILS || table == SLAVE_DISCRETE_INPUTS;
}

static const char *const table_names[SLAVE_TABLES] = {"coils", "discrete_inputs", "input_registers",
						      "holding_registers"};
static const char *const table_marks[SLAVE_TABLES] = {"C", "DI", "IR", "HR"};

enum slave_table slave_table_named(const char *name)
{
	enum slave_table table = SLAVE_COILS;

	while (table < SLAVE_TABLES && strcmp(table_names[table], name) != 0)
		table++;
	return table;
}

const char *slave_table_name(enum slave_table table)
{
	return table_names[table];
}

const char *slave_table_mark(enum slave_table table)
{
	return table_marks[table];
}

const char *slave_fault_name(enum slave_fault_kind kind)
{
	static const char *const names[] = {
	    [SLAVE_HEALTHY] = "",
	    [SLAVE_MUTE] = "mute",
	    [SLAVE_DELAY] = "delay",
	    [SLAVE_LATE] = "late",
	    [SLAVE_DEAF] = "deaf",
	    [SLAVE_CORRUPT] = "corrupt",
	    [SLAVE_EXCEPTION] = "exception",
	    [SLAVE_ECHO] = "echo",
	    [SLAVE_NOISE] = "noise",
	    [SLAVE_WRONG_UNIT] = "wrong-unit",
	    [SLAVE_TRUNCATE] = "truncate",
	    [SLAVE_LIMIT] = "limit",
	    [SLAVE_WRONG_FUNCTION] = "wrong-function",
	    [SLAVE_WRONG_LENGTH] = "wrong-length",
	    [SLAVE_WRONG_ECHO] = "wrong-echo",
	    [SLAVE_OVERRIDE] = "override",
	};
	return names[kind];
}
