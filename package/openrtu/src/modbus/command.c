/* SPDX-License-Identifier: GPL-3.0-or-later */
/* Commands that wait for their turn on a line, and how each ends. */
#include <string.h>

#include "modbus/line_parts.h"

struct modbus_command modbus_take_command(struct modbus_line *line, uint32_t place)
{
	struct modbus_command command = line->commands[place];

	line->command_count--;
	memmove(&line->commands[place], &line->commands[place + 1],
		(line->command_count - place) * sizeof(command));
	return command;
}

void modbus_drop_commands(struct modbus_line *line)
{
	while (line->command_count > 0) {
		struct modbus_command command = modbus_take_command(line, 0);

		line->events->command(line->context, &command, MODBUS_NOT_SENT, 0);
	}
}

void modbus_drop_old_commands(struct modbus_line *line, int64_t now_ns)
{
	for (uint32_t place = 0; place < line->command_count;) {
		if (now_ns <= line->commands[place].deadline_ns) {
			place++;
			continue;
		}
		struct modbus_command command = modbus_take_command(line, place);
		line->events->command(line->context, &command, MODBUS_TOO_OLD, 0);
	}
}

static uint8_t function_that_reads(uint8_t write_function)
{
	return modbus_is_bit_function(write_function) ? MODBUS_READ_COILS : MODBUS_READ_HOLDING_REGISTERS;
}

static void mark_urgent(struct modbus_device *device, const struct modbus_request *written)
{
	for (uint32_t i = 0; i < device->read_count; i++) {
		struct modbus_read *read = &device->reads[i];

		if (read->function == function_that_reads(written->function) &&
		    written->address >= read->address &&
		    written->address < (uint32_t)read->address + read->count)
			read->urgent = true;
	}
}

/*
 * What was written is read back soon, so that the change is seen; a broadcast may have changed every
 * device.
 */
static void read_back(struct modbus_line *line, const struct modbus_command *command)
{
	line->urgent = true;
	if (!line->devices[command->device].broadcast) {
		mark_urgent(&line->devices[command->device], &command->request);
		return;
	}
	for (uint32_t i = 0; i < line->device_count; i++)
		mark_urgent(&line->devices[i], &command->request);
}

void modbus_end_command(struct modbus_line *line, enum modbus_result result, uint8_t exception)
{
	if (result == MODBUS_DONE && !line->command.no_read_back)
		read_back(line, &line->command);
	line->events->command(line->context, &line->command, result, exception);
}
