/* SPDX-License-Identifier: GPL-3.0-or-later */
/*
 * Reads blocks on one line over and over, by plain libmodbus: what a loop around its calls makes of a read plan.
 *
 *     line_loop DEVICE BAUD STOP_BITS UNIT:FUNCTION:ADDRESS:COUNT ...
 *
 * Prints "ready" once the line is open; what was read, the devices' counters say. A device that does not answer costs
 * libmodbus' own time-out, and the loop goes on.
 */
#include <errno.h>
#include <modbus.h>
#include <stdbool.h>
#include <stdint.h>
#include <stdio.h>
#include <stdlib.h>

#define BLOCKS_MAX 512

struct block {
	int unit, function, address, count;
};

static bool parse(const char *text, struct block *block)
{
	char rest;

	return sscanf(text, "%d:%d:%d:%d%c", &block->unit, &block->function, &block->address, &block->count,
		      &rest) == 4 &&
	       block->count > 0 && block->count <= MODBUS_MAX_READ_REGISTERS;
}

static void read_block(modbus_t *line, const struct block *block)
{
	uint8_t bits[MODBUS_MAX_READ_REGISTERS];
	uint16_t registers[MODBUS_MAX_READ_REGISTERS];

	modbus_set_slave(line, block->unit);
	switch (block->function) {
	case MODBUS_FC_READ_COILS:
		modbus_read_bits(line, block->address, block->count, bits);
		break;
	case MODBUS_FC_READ_DISCRETE_INPUTS:
		modbus_read_input_bits(line, block->address, block->count, bits);
		break;
	case MODBUS_FC_READ_HOLDING_REGISTERS:
		modbus_read_registers(line, block->address, block->count, registers);
		break;
	default:
		modbus_read_input_registers(line, block->address, block->count, registers);
		break;
	}
}

int main(int argc, char **argv)
{
	struct block blocks[BLOCKS_MAX];
	const int count = argc - 4;
	modbus_t *line;

	if (count < 1 || count > BLOCKS_MAX)
		return 2;
	for (int i = 0; i < count; i++)
		if (!parse(argv[4 + i], &blocks[i]))
			return 2;
	line = modbus_new_rtu(argv[1], atoi(argv[2]), 'N', 8, atoi(argv[3]));
	if (line == NULL || modbus_connect(line) < 0) {
		fprintf(stderr, "%s: %s\n", argv[1], modbus_strerror(errno));
		return 1;
	}
	puts("ready");
	fflush(stdout);
	for (;;)
		for (int i = 0; i < count; i++)
			read_block(line, &blocks[i]);
}
