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

static void mark_urgent(struct modbus_device *device, const struct modbus_command *command)
{
	for (uint32_t i = 0; i < device->read_count; i++) {
		struct modbus_read *read = &device->reads[i];

		if (read->function == command->read_function && command->read_address >= read->address &&
		    command->read_address < (uint32_t)read->address + read->count)
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
		mark_urgent(&line->devices[command->device], command);
		return;
	}
	for (uint32_t i = 0; i < line->device_count; i++)
		mark_urgent(&line->devices[i], command);
}

/* ---- functions that write the same ------------------------------------------------------------------- */

static uint8_t other_function(const struct modbus_request *request)
{
	if (request->count != 1)
		return 0;
	switch (request->function) {
	case MODBUS_WRITE_COIL:
		return MODBUS_WRITE_COILS;
	case MODBUS_WRITE_COILS:
		return MODBUS_WRITE_COIL;
	case MODBUS_WRITE_REGISTER:
		return MODBUS_WRITE_REGISTERS;
	case MODBUS_WRITE_REGISTERS:
		return MODBUS_WRITE_REGISTER;
	default:
		return 0;
	}
}

static uint8_t *learned_function(struct modbus_device *device, uint8_t function)
{
	return modbus_is_bit_function(function) ? &device->writes.coils : &device->writes.registers;
}

static bool is_multiple(uint8_t function)
{
	return function == MODBUS_WRITE_COILS || function == MODBUS_WRITE_REGISTERS;
}

void modbus_choose_function(const struct modbus_device *device, struct modbus_request *request)
{
	uint8_t other = other_function(request);
	uint8_t learned =
	    modbus_is_bit_function(request->function) ? device->writes.coils : device->writes.registers;

	if (other != 0 && (learned != 0 ? learned == other : is_multiple(other) == device->writes_multiple))
		request->function = other;
}

void modbus_take_functions(struct modbus_device *device, uint32_t coils, uint32_t registers)
{
	if (coils == MODBUS_WRITE_COIL || coils == MODBUS_WRITE_COILS)
		device->writes.coils = (uint8_t)coils;
	if (registers == MODBUS_WRITE_REGISTER || registers == MODBUS_WRITE_REGISTERS)
		device->writes.registers = (uint8_t)registers;
}

/* It is the first again: room for it there is, since it was just taken from there. */
static void put_back(struct modbus_line *line)
{
	memmove(&line->commands[1], &line->commands[0], line->command_count * sizeof(line->commands[0]));
	line->commands[0] = line->command;
	line->command_count++;
}

bool modbus_turn(struct modbus_line *line, bool *turned)
{
	struct modbus_device *device = &line->devices[line->device];
	uint8_t unknown = line->request.function, other = other_function(&line->request);

	if (other == 0)
		return false;
	device->writes.unproven &= ~(1u << unknown);
	/* It knows neither. */
	if (*turned) {
		*learned_function(device, unknown) = 0;
		return false;
	}
	*learned_function(device, unknown) = other;
	device->writes.unproven |= 1u << other;
	*turned = true;
	return true;
}

void modbus_function_is_known(struct modbus_line *line, int64_t now_ns)
{
	struct modbus_write_functions *writes = &line->devices[line->device].writes;
	const uint8_t unknown = other_function(&line->request);
	const uint32_t function = unknown == 0 ? 0 : 1u << line->request.function;

	if (!(writes->unproven & function))
		return;
	writes->unproven &= ~function;
	if (line->events->turned != NULL)
		line->events->turned(line->context, line->device, unknown, line->request.function, now_ns);
}

bool modbus_turn_command(struct modbus_line *line)
{
	if (line->command_count == line->command_capacity || !modbus_turn(line, &line->command.turned))
		return false;
	put_back(line);
	return true;
}

void modbus_end_command(struct modbus_line *line, enum modbus_result result, uint8_t exception)
{
	if (result == MODBUS_DONE && line->command.read_function != 0)
		read_back(line, &line->command);
	line->events->command(line->context, &line->command, result, exception);
}
