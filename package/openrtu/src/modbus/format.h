/* SPDX-License-Identifier: GPL-3.0-or-later */
/* What a point's registers hold: a row for each format. */
#ifndef OPENRTU_MODBUS_FORMAT_H
#define OPENRTU_MODBUS_FORMAT_H

#include <stdbool.h>
#include <stdint.h>

/* How the bits of its registers, joined, are a number. */
enum modbus_coding {
	MODBUS_NO_NUMBER, /* bits, or the VTI of a step position */
	MODBUS_SIGNED,    /* two's complement */
	MODBUS_UNSIGNED,
	MODBUS_FLOATING, /* IEEE 754 */
	MODBUS_BCD,      /* four decimal digits a register */
	MODBUS_MOD10, /* a number from -9999 to 9999 a register, the first one in the highest power of 10 000 */
	MODBUS_CHARACTERS, /* a text, in as many registers as its object says: modbus/text.h */
};

/*
 * Of a row: its enumerator, its name in the file, how many registers it has, its coding, and what one of its integer counts.
 * The formats of the file begin with int16.
 */
#define MODBUS_FILE_FORMATS(F)                                                                               \
	F(INT16, "int16", 1, SIGNED, 1)                                                                      \
	F(UINT16, "uint16", 1, UNSIGNED, 1)                                                                  \
	F(INT32, "int32", 2, SIGNED, 1)                                                                      \
	F(UINT32, "uint32", 2, UNSIGNED, 1)                                                                  \
	F(INT48, "int48", 3, SIGNED, 1)                                                                      \
	F(UINT48, "uint48", 3, UNSIGNED, 1)                                                                  \
	F(INT64, "int64", 4, SIGNED, 1)                                                                      \
	F(UINT64, "uint64", 4, UNSIGNED, 1)                                                                  \
	F(FLOAT32, "float32", 2, FLOATING, 1)                                                                \
	F(FLOAT64, "float64", 4, FLOATING, 1)                                                                \
	F(FIXED24_8, "fixed24_8", 2, SIGNED, 1.0 / 256)                                                      \
	F(BCD16, "bcd16", 1, BCD, 1)                                                                         \
	F(BCD32, "bcd32", 2, BCD, 1)                                                                         \
	F(BCD48, "bcd48", 3, BCD, 1)                                                                         \
	F(BCD64, "bcd64", 4, BCD, 1)                                                                         \
	F(MOD10_32, "mod10_32", 2, MOD10, 1)                                                                 \
	F(MOD10_48, "mod10_48", 3, MOD10, 1)                                                                 \
	F(MOD10_64, "mod10_64", 4, MOD10, 1)                                                                 \
	F(STRING, "string", 0, CHARACTERS, 1)                                                                \
	F(STRING16, "string16", 0, CHARACTERS, 1)

#define MODBUS_FORMAT_NUMBER(number, name, registers, coding, one) MODBUS_FORMAT_##number,

enum modbus_format {
	MODBUS_FORMAT_BIT, /* of a register, its number is modbus_point.bit; or of a table of bits */
	MODBUS_FORMAT_VTI, /* the low octet of a register */
	MODBUS_FILE_FORMATS(MODBUS_FORMAT_NUMBER) MODBUS_FORMATS
};

struct modbus_format_row {
	const char *name; /* NULL: not in the file */
	uint8_t registers;
	uint8_t coding;
	double one; /* what the integer 1 counts */
};

/* By enum modbus_format. */
extern const struct modbus_format_row modbus_formats[MODBUS_FORMATS];

/* Of string two characters a register, of string16 one. */
static inline bool modbus_is_string(enum modbus_format format)
{
	return format == MODBUS_FORMAT_STRING || format == MODBUS_FORMAT_STRING16;
}

static inline bool modbus_is_binary(enum modbus_format format)
{
	return modbus_formats[format].coding == MODBUS_SIGNED ||
	       modbus_formats[format].coding == MODBUS_UNSIGNED;
}

#endif
