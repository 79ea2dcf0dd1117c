/* SPDX-License-Identifier: GPL-3.0-or-later */
/*
 * `logic-desk FILE`: a program on the desk; openrtu logic starts it and speaks with it, one line for one line.
 * "scan UPTIME ELAPSED NOW BUDGET", then VALUE:QUALITY:TIME of each point that the program only reads and STATE:RESULT of
 * each command, ACTIVE:VALUE of each request -> VALUE:QUALITY of each point that it writes, EXECUTE:QUALITY:VALUE:SELECT
 * of each command, DECISION:RESULT of each request, then the faults, the last one's kind and line. Values are the bits of a cell in hexadecimal digits, times are decimal.
 * "messages" -> LINE:TEXT of each message of the last scan, the text in hexadecimal digits, then how many found no room.
 * "reload FILE" -> how many retained variables go on. "coverage" -> a digit for each instruction, LOGIC_RUN, ….
 */
#include <errno.h>
#include <inttypes.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

#include "logic/logic.h"

#define FILE_MAX (4 << 20)

struct machine {
	struct logic logic;
	void *memory;
};

static uint8_t *read_file(const char *path, size_t *size)
{
	FILE *file = fopen(path, "rb");
	uint8_t *octets = malloc(FILE_MAX);

	if (!file || !octets) {
		fprintf(stderr, "logic-desk: %s: %s\n", path, strerror(errno));
		free(octets);
		if (file)
			fclose(file);
		return NULL;
	}
	*size = fread(octets, 1, FILE_MAX, file);
	fclose(file);
	return octets;
}

static bool load_machine(struct machine *machine, const char *path)
{
	size_t size = 0;
	uint8_t *octets = read_file(path, &size);
	size_t memory;
	const char *refusal = "it is not a program, or it is from another version";

	if (!octets)
		return false;
	memory = logic_memory(octets, size);
	machine->memory = malloc(memory + 1);
	if (memory && machine->memory)
		refusal = logic_load(&machine->logic, machine->memory, octets, size);
	free(octets);
	if (refusal) {
		fprintf(stderr, "logic-desk: %s: %s\n", path, refusal);
		free(machine->memory);
		return false;
	}
	machine->logic.covered = calloc(machine->logic.head->code, 1);
	return true;
}

static void free_machine(struct machine *machine)
{
	free(machine->logic.covered);
	free(machine->memory);
}

static uint64_t take_number(char **at, int base)
{
	uint64_t number = strtoull(*at, at, base);

	while (**at == ' ' || **at == ':')
		(*at)++;
	return number;
}

static void take_inputs(struct logic *logic, char *at)
{
	for (uint16_t i = 0; i < logic->head->points; i++) {
		struct logic_value value = {.quality = 0};

		if (logic->points[i].written)
			continue;
		value.value.bits = take_number(&at, 16);
		value.quality = (uint8_t)take_number(&at, 16);
		value.time_us = (int64_t)take_number(&at, 10);
		logic_set(logic, &logic->points[i], &value);
	}
	for (uint16_t i = 0; i < logic->head->commands; i++) {
		logic_tell(logic, logic->commands[i].state, (uint8_t)take_number(&at, 16));
		logic_tell(logic, logic->commands[i].result, (uint8_t)take_number(&at, 16));
	}
	for (uint16_t i = 0; i < logic->head->requests; i++) {
		union logic_cell value;

		logic_tell(logic, logic->requests[i].active, take_number(&at, 16) != 0);
		value.bits = take_number(&at, 16);
		logic_tell_number(logic, logic->requests[i].value, value.d);
	}
}

static void print_outputs(const struct logic *logic)
{
	for (uint16_t i = 0; i < logic->head->points; i++) {
		struct logic_value value;

		logic_get(logic, &logic->points[i], &value);
		if (logic->points[i].written)
			printf("%" PRIx64 ":%x ", value.value.bits, value.quality);
	}
	for (uint16_t i = 0; i < logic->head->commands; i++) {
		const struct logic_command *command = &logic->commands[i];
		unsigned quality = logic->quality[command->execute] | logic->quality[command->value] |
				   logic->quality[command->select];

		printf("%" PRIx64 ":%x:%" PRIx64 ":%" PRIx64 " ", logic->cells[command->execute].bits,
		       quality, logic->cells[command->value].bits, logic->cells[command->select].bits);
	}
	for (uint16_t i = 0; i < logic->head->requests; i++) {
		struct logic_verdict verdict = logic_judge(logic, &logic->requests[i]);

		printf("%x:%x ", (unsigned)verdict.decision, verdict.result);
	}
	for (unsigned i = 0; i < LOGIC_FAULTS; i++)
		printf("%" PRIu32 " ", logic->faults[i]);
	printf("%u %u\n", logic->last_fault, logic->last_line);
}

static void print_messages(const struct logic *logic)
{
	for (unsigned i = 0; i < logic->messages; i++) {
		char text[256];

		logic_message(logic, i, text, sizeof(text));
		printf("%u:", logic->lines[logic->message_at[i]]);
		for (const char *at = text; *at != '\0'; at++)
			printf("%02x", (unsigned)(unsigned char)*at);
		putchar(' ');
	}
	printf("%" PRIu32 "\n", logic->unsaid);
}

static void scan(struct logic *logic, char *at)
{
	struct logic_times times;
	uint32_t budget;

	times.uptime_us = (int64_t)take_number(&at, 10);
	times.elapsed_us = (int64_t)take_number(&at, 10);
	times.now_us = (int64_t)take_number(&at, 10);
	budget = (uint32_t)take_number(&at, 10);
	take_inputs(logic, at);
	logic_scan(logic, &times, budget);
	print_outputs(logic);
}

static bool reload(struct machine *machine, const char *path)
{
	struct machine next;

	if (!load_machine(&next, path))
		return false;
	printf("%u\n", logic_carry(&next.logic, &machine->logic));
	free_machine(machine);
	*machine = next;
	return true;
}

static void print_coverage(const struct logic *logic)
{
	for (uint16_t i = 0; i < logic->head->code; i++)
		putchar('0' + logic->covered[i]);
	putchar('\n');
}

int main(int argc, char **argv)
{
	struct machine machine;
	char *line = NULL;
	size_t room = 0;
	bool good = true;

	if (argc != 2 || !load_machine(&machine, argv[1])) {
		if (argc != 2)
			fprintf(stderr,
				"usage: logic-desk FILE\nopenrtu logic starts it; see docs/logic.md\n");
		return 2;
	}
	while (good && getline(&line, &room, stdin) > 0) {
		line[strcspn(line, "\n")] = '\0';
		if (strncmp(line, "scan ", 5) == 0)
			scan(&machine.logic, line + 5);
		else if (strncmp(line, "reload ", 7) == 0)
			good = reload(&machine, line + 7);
		else if (strcmp(line, "messages") == 0)
			print_messages(&machine.logic);
		else if (strcmp(line, "coverage") == 0)
			print_coverage(&machine.logic);
		else
			good = false;
		fflush(stdout);
	}
	free(line);
	free_machine(&machine);
	return good ? 0 : 2;
}
