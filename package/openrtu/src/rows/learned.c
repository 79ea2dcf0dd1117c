/* SPDX-License-Identifier: GPL-3.0-or-later */
#include "rows/learned.h"

#include <stdio.h>

#define COUNT(array) (sizeof(array) / sizeof((array)[0]))

void learned_objects(uint32_t function, uint32_t address, uint32_t count, char out[LEARNED_WORDS_SIZE])
{
	static const char *const tables[] = {"object", "coil", "discrete input", "holding register",
					     "input register"};
	const char *table = tables[function < COUNT(tables) ? function : 0];

	if (count > 1)
		snprintf(out, LEARNED_WORDS_SIZE, "%ss %u to %u", table, address, address + count - 1);
	else
		snprintf(out, LEARNED_WORDS_SIZE, "%s %u", table, address);
}

static json_t *hole_json(const struct modbus_learned_stats *learned)
{
	if (learned->hole_count == 0)
		return json_null();
	return json_pack("{s:I, s:I, s:I, s:I, s:I}", "function", (json_int_t)learned->hole_function,
			 "address", (json_int_t)learned->hole_address, "count",
			 (json_int_t)learned->hole_count, "exception", (json_int_t)learned->hole_exception,
			 "read", (json_int_t)learned->hole_read);
}

static json_t *lacking_json(const struct modbus_learned_stats *learned)
{
	if (learned->lacking_count == 0)
		return json_null();
	return json_pack("{s:I, s:I, s:I, s:I}", "function", (json_int_t)learned->lacking_function, "address",
			 (json_int_t)learned->lacking_address, "exception",
			 (json_int_t)learned->lacking_exception, "count", (json_int_t)learned->lacking_count);
}

json_t *learned_json(const struct modbus_learned_stats *learned)
{
	return json_pack(
	    "{s:I, s:I, s:I, s:I, s:I, s:I, s:o, s:o, s:I, s:I, s:I}", "given_bits",
	    (json_int_t)learned->given_bits, "given_registers", (json_int_t)learned->given_registers,
	    "refused_bits", (json_int_t)learned->refused_bits, "refused_registers",
	    (json_int_t)learned->refused_registers, "silent_bits", (json_int_t)learned->silent_bits,
	    "silent_registers", (json_int_t)learned->silent_registers, "hole", hole_json(learned), "lacking",
	    lacking_json(learned), "holes_given", (json_int_t)learned->holes_given, "unclear",
	    (json_int_t)learned->unclear, "open", (json_int_t)learned->open);
}
