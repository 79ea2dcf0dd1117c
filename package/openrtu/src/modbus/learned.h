/* SPDX-License-Identifier: GPL-3.0-or-later */
/*
 * What a device has shown of itself: how fast it answers, and, by the plan in force, what it takes and what not.
 *
 * A read that was refused was divided (plan.h). When it then gives both parts, as they are, only two things can have
 * been wrong with the whole: its length, or the hole between the parts. Where there is no hole between them it is the
 * length, unless the device gives a longer read elsewhere. Where there is one it is the hole, when the device gives
 * something at least as long elsewhere; else nobody can tell, but by the exception. A part that is not given explains the
 * refusal of the whole, and nothing follows. Nor does anything from a read that was not answered (noise spoils
 * long answers first), or refused for another reason than address and quantity (the device may have been starting).
 */
#ifndef OPENRTU_MODBUS_LEARNED_H
#define OPENRTU_MODBUS_LEARNED_H

#include <stdint.h>

#include "plan.h"

/* From the end of a request to the first byte of its answer. All 0: there was none. */
struct modbus_latency {
	uint32_t least_us, most_us;
	uint32_t typical_us; /* mean of the last ones, each weighing 1/16 less than the next */
};

void modbus_latency_add(struct modbus_latency *latency, uint32_t us);

struct modbus_learned {
	/* Bits or registers; 0: none. */
	uint16_t given_bits, given_registers; /* of the longest read that it gives */
	/* Of the shortest that it refused, the parts of which it gives, and which have no hole between them. */
	uint16_t refused_bits, refused_registers;
	uint16_t silent_bits, silent_registers; /* the same of reads that it did not answer */
	/* Between two parts that it gives, of a read that it refused: of all such, that of the shortest read. */
	struct {
		uint8_t function, exception;
		uint16_t address, count; /* 0: there is none */
		uint16_t read;           /* bits or registers of the read */
	} hole;
	/* The first object that it does not give by itself, and how many there are. exception 0: no answer. */
	struct {
		uint8_t function, exception;
		uint16_t address;
		uint32_t count;
	} lacking;
	uint32_t holes_given; /* reads that carry holes, and that it gives */
	uint32_t unclear; /* divided reads from which nothing follows for their exception, or want of one */
	uint32_t open;    /* reads of which it is not known yet whether it gives them */
};

/* Of the reads of one device's plan. */
struct modbus_learned modbus_learn(const struct modbus_read *reads, uint32_t count);

#endif
