/* SPDX-License-Identifier: GPL-3.0-or-later */
/*
 * libFuzzer on programs: the first octet is the number of scans, the eight behind it are what each input reads, the rest is the
 * file. Its lengths and CRC are made right, so that the verifier alone decides. What must hold: a program that is accepted stays
 * within its memory, ends each scan, and leaves values that their types have.
 */
#include <string.h>

#include "fuzz/input.h"
#include "logic/logic.h"
#include "logic/real.h"
#include "logic/test_seal.h"

#define FILE_MAX 4096
#define BUDGET   2000

/* What the sections leave are the names: a changed count moves the sections, and the length is still right. */
static void fit(struct logic_head *head, uint8_t *octets, size_t size)
{
	size_t sections =
	    sizeof(*head) + head->initial * sizeof(struct logic_initial) +
	    head->arrays * sizeof(struct logic_array) + head->routines * sizeof(struct logic_routine) +
	    head->points * sizeof(struct logic_point) + head->commands * sizeof(struct logic_command) +
	    head->requests * sizeof(struct logic_request) + head->retained * sizeof(struct logic_retained) +
	    head->strings * sizeof(struct logic_string) + head->code * sizeof(struct logic_instruction) +
	    (head->slots + 3U) / 4 * 4 + (head->code + 1U) / 2 * 4;

	head->size = (uint32_t)size;
	head->names = size > sections ? (uint32_t)(size - sections) : 0;
	octets[size - 1] = 0;
	seal(head, size);
}

static void check_values(const struct logic *logic)
{
	for (uint16_t slot = 0; slot < logic->head->slots; slot++) {
		uint8_t type = logic->types[slot];
		union logic_cell cell = logic->cells[slot];

		if (type == LOGIC_REAL)
			CHECK(logic_finite((double)cell.r));
		else if (type == LOGIC_LREAL)
			CHECK(logic_finite(cell.d));
		else
			CHECK(cell.i >= logic_ranges[type].low && cell.i <= logic_ranges[type].high);
	}
}

static void check_messages(const struct logic *logic)
{
	char text[20];

	CHECK(logic->messages <= LOGIC_MESSAGES);
	for (unsigned i = 0; i < logic->messages; i++) {
		logic_message(logic, i, text, sizeof(text));
		CHECK(strlen(text) < sizeof(text));
		for (const char *at = text; *at != '\0'; at++)
			CHECK((unsigned char)*at >= ' ' && *at != 0x7f);
	}
}

static void run(struct logic *logic, unsigned scans, const uint8_t *given)
{
	for (unsigned n = 0; n < scans; n++) {
		struct logic_times times = {n, 1, n};
		struct logic_value value = {.time_us = n};

		memcpy(&value.value, given, sizeof(value.value));
		for (uint16_t i = 0; i < logic->head->points; i++) {
			value.quality = given[i % 8] & 0xf1;
			logic_set(logic, &logic->points[i], &value);
		}
		logic_scan(logic, &times, BUDGET);
		check_values(logic);
		check_messages(logic);
		CHECK(logic->last_fault < LOGIC_FAULTS);
	}
}

int LLVMFuzzerTestOneInput(const uint8_t *data, size_t size)
{
	static union {
		struct logic_head head;
		uint8_t octets[FILE_MAX];
	} file;
	struct logic logic;
	uint8_t given[8];
	unsigned scans;
	size_t memory;
	void *own;

	input = (struct input){data, data + size};
	scans = next_octet() % 5;
	for (size_t i = 0; i < sizeof(given); i++)
		given[i] = next_octet();
	size = (size_t)(input.end - input.at);
	if (size < sizeof(struct logic_head) || size > FILE_MAX)
		return 0;
	memcpy(file.octets, input.at, size);
	fit(&file.head, file.octets, size);
	memory = logic_memory(&file, size);
	if (memory == 0)
		return 0;
	own = malloc(memory); /* of just that size: AddressSanitizer guards its ends */
	if (own && !logic_load(&logic, own, &file, size)) {
		check_values(&logic);
		run(&logic, scans, given);
		logic_carry(&logic, &logic);
	}
	free(own);
	return 0;
}
