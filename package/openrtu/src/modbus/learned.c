/* SPDX-License-Identifier: GPL-3.0-or-later */
#include "learned.h"

#include "frame.h"

#define LATENCY_WEIGHT 16

void modbus_latency_add(struct modbus_latency *latency, uint32_t us)
{
	bool first = latency->most_us == 0 && latency->least_us == 0;
	int64_t away = (int64_t)us - latency->typical_us;

	latency->typical_us = first ? us : (uint32_t)(latency->typical_us + away / LATENCY_WEIGHT);
	if (first || us < latency->least_us)
		latency->least_us = us;
	if (us > latency->most_us)
		latency->most_us = us;
}

static bool is_given(const struct modbus_read *read)
{
	return read->given && read->pause_ns == 0;
}

/* For good, as far as is known. What a busy device does not give now says nothing about it. */
static bool is_lacking(const struct modbus_read *read)
{
	return read->pause_ns > 0 && !modbus_is_of_the_moment(read->exception);
}

static uint32_t end_of(const struct modbus_read *read)
{
	return (uint32_t)read->address + read->count;
}

static void take_read(struct modbus_learned *learned, const struct modbus_read *read)
{
	uint16_t *longest =
	    modbus_is_bit_function(read->function) ? &learned->given_bits : &learned->given_registers;

	if (is_given(read)) {
		if (read->count > *longest)
			*longest = read->count;
		learned->holes_given += read->holed;
	} else if (!is_lacking(read)) {
		learned->open++;
	} else if (learned->lacking.count++ == 0) {
		learned->lacking.function = read->function;
		learned->lacking.exception = read->exception;
		learned->lacking.address = read->address;
	}
}

static void take_shortest(uint16_t *shortest, uint16_t length)
{
	if (*shortest == 0 || length < *shortest)
		*shortest = length;
}

static void take_length(struct modbus_learned *learned, uint8_t function, uint16_t length)
{
	take_shortest(modbus_is_bit_function(function) ? &learned->refused_bits : &learned->refused_registers,
		      length);
}

/* It may be too long, where noise is no cause. */
static void take_silence(struct modbus_learned *learned, uint8_t function, uint16_t length)
{
	take_shortest(modbus_is_bit_function(function) ? &learned->silent_bits : &learned->silent_registers,
		      length);
}

static void take_hole(struct modbus_learned *learned, const struct modbus_read *before,
		      const struct modbus_read *behind, uint16_t length)
{
	if (learned->hole.count > 0 && length >= learned->hole.read)
		return;
	learned->hole.function = before->function;
	learned->hole.exception = behind->whole_exception;
	learned->hole.address = (uint16_t)end_of(before);
	learned->hole.count = (uint16_t)(behind->address - end_of(before));
	learned->hole.read = length;
}

/* Two parts that were one read, and that the device gives. */
static void take_parts(struct modbus_learned *learned, const struct modbus_read *before,
		       const struct modbus_read *behind)
{
	uint32_t end = end_of(behind) > end_of(before) ? end_of(behind) : end_of(before);
	uint16_t length = (uint16_t)(end - before->address);

	if (behind->whole_exception == 0 && behind->address <= end_of(before))
		take_silence(learned, before->function, length);
	if (behind->whole_exception != MODBUS_ILLEGAL_ADDRESS &&
	    behind->whole_exception != MODBUS_ILLEGAL_VALUE)
		learned->unclear++;
	else if (behind->address > end_of(before))
		take_hole(learned, before, behind, length);
	else
		take_length(learned, before->function, length);
}

struct modbus_learned modbus_learn(const struct modbus_read *reads, uint32_t count)
{
	struct modbus_learned learned = {.open = 0};

	for (uint32_t i = 0; i < count; i++) {
		take_read(&learned, &reads[i]);
		/* A part that was divided once more begins as the whole did, but is not followed by its second part. */
		if (i > 0 && reads[i].whole == reads[i - 1].first + 1 && is_given(&reads[i - 1]) &&
		    is_given(&reads[i]))
			take_parts(&learned, &reads[i - 1], &reads[i]);
	}
	return learned;
}
