/* SPDX-License-Identifier: GPL-3.0-or-later */
/* The keys of an object, which config_object.c reads; config_value.c makes of some of them how registers become a value. */
#ifndef OPENRTU_MODBUS_CONFIG_OBJECT_H
#define OPENRTU_MODBUS_CONFIG_OBJECT_H

#include "modbus/config_loader.h"

/* Points of a scaling table. */
#define MODBUS_OBJECT_KNOTS_MAX 32
#define MODBUS_OBJECT_KEPT_MAX  32 /* values that are written in turn */
#define MODBUS_IOA_MAX          16777215

enum {
	OBJECT_ADDRESS,
	OBJECT_REGISTER,
	OBJECT_TYPE,
	OBJECT_NAME,
	OBJECT_UNIT,
	OBJECT_NAMES,
	OBJECT_DECIMALS,
	OBJECT_LN,
	OBJECT_IOA,
	OBJECT_GROUP,
	OBJECT_SELECT,
	OBJECT_FORMAT,
	OBJECT_LENGTH,
	OBJECT_BIT,
	OBJECT_BITS,
	OBJECT_INVERTED,
	OBJECT_SIGNED,
	OBJECT_WORD_ORDER,
	OBJECT_BYTE_ORDER,
	OBJECT_BIT_ORDER,
	OBJECT_SCALE,
	OBJECT_OFFSET,
	OBJECT_SCALE_POINTS,
	OBJECT_SCALE_TABLE,
	OBJECT_SCALE_REGISTER,
	OBJECT_UNIMPLEMENTED,
	OBJECT_DEADBAND,
	OBJECT_CYCLIC,
	OBJECT_BACKGROUND,
	OBJECT_COUNTER_GROUP,
	OBJECT_FREEZE,
	OBJECT_SECOND,
	OBJECT_SHORT_PULSE,
	OBJECT_LONG_PULSE,
	OBJECT_STEP,
	OBJECT_MIN,
	OBJECT_MAX,
	OBJECT_QUALITY,
	OBJECT_BLOCKED_BY,
	OBJECT_SUBSTITUTED_BY,
	OBJECT_NOT_TOPICAL_BY,
	OBJECT_SCALE_BY,
	OBJECT_FACTOR_BY,
	OBJECT_PERIOD,
	OBJECT_PAGE,
	OBJECT_READ_BACK,
	OBJECT_WRITE_ADDRESS,
	OBJECT_WRITE_ONLY,
	OBJECT_READ_ONLY,
	OBJECT_WRITE_VALUES,
	OBJECT_WRITE_AT_RETURN,
	OBJECT_WRITE_EVERY,
	OBJECT_KEYS
};
extern const struct config_rule modbus_object_rules[OBJECT_KEYS];

/* By enum map_type. */
extern const char *const modbus_type_names[];

#define MODBUS_TYPE(type)     (1u << (type))
#define MODBUS_BIT_TYPES      (MODBUS_TYPE(MAP_SINGLE) | MODBUS_TYPE(MAP_DOUBLE))
#define MODBUS_MEASURED_TYPES (MODBUS_TYPE(MAP_NORMALIZED) | MODBUS_TYPE(MAP_SCALED) | MODBUS_TYPE(MAP_FLOAT))
#define MODBUS_REGISTER_TYPES                                                                                \
	(MODBUS_MEASURED_TYPES | MODBUS_TYPE(MAP_STEP) | MODBUS_TYPE(MAP_BITSTRING) |                        \
	 MODBUS_TYPE(MAP_COUNTER))

/* What a key applies to. */
struct modbus_applies {
	unsigned types;   /* objects of one of these; 0: of each */
	bool of_commands; /* where something can be commanded */
	bool of_reading;  /* where something is read, or commands go elsewhere */
};
extern const struct modbus_applies modbus_applies_to[OBJECT_KEYS];
/* To an object whose registers are a text. */
bool modbus_applies_to_texts(unsigned key);
/* To one that is on a page. */
bool modbus_applies_to_read_alone(unsigned key);

static inline bool modbus_is_bit_table(enum modbus_table table)
{
	return table == MODBUS_COILS || table == MODBUS_DISCRETE_INPUTS;
}

/* A text: the object's point is a bitstring that stands for it. */
static inline bool modbus_object_is_text(const struct config_value *values)
{
	return values[OBJECT_FORMAT].given &&
	       modbus_is_string((enum modbus_format)(MODBUS_FORMAT_INT16 + values[OBJECT_FORMAT].integer));
}

/* It takes no commands, whatever its table. */
static inline bool modbus_is_read_alone(const struct config_value *values)
{
	return values[OBJECT_PAGE].given || values[OBJECT_READ_ONLY].integer != 0;
}

/* What is in a table that is only read takes commands where they go elsewhere. */
static inline bool modbus_takes_commands(const struct config_value *values, enum modbus_table table)
{
	return (modbus_is_writable(table) || values[OBJECT_WRITE_ADDRESS].given) &&
	       !modbus_object_is_text(values) && !modbus_is_read_alone(values);
}

static inline struct config_place modbus_object_key(const struct config_place *object, unsigned key)
{
	return config_key_of(object, modbus_object_rules[key].name);
}

/* ---- config_number.c --------------------------------------------------------------------- */

/* The address is given in one of two ways: as it is on the wire, or as a manual's number. Makes it the first of these. */
void modbus_read_address(struct modbus_loader *loader, const struct config_place *object,
			 enum modbus_table table, struct config_value *values);
/* Reports an address that has no IOA by itself, and that the object gives none. */
void modbus_check_scheme(struct modbus_loader *loader, const struct config_place *object,
			 const struct config_value *values, enum modbus_table table);

/* ---- config_value.c ---------------------------------------------------------------------- */

/* What the object's bits or registers hold: by its keys, or what its type has without them. */
enum modbus_format modbus_object_format(const struct config_value *values, enum map_type type);
/* Bits or registers that it covers. */
uint8_t modbus_object_width(const struct config_value *values, enum map_type type, enum modbus_table table);
/* Reports what does not go together of type, format, bits and scale. */
void modbus_check_value(struct modbus_loader *loader, const struct config_place *object,
			const struct config_value *values, enum map_type type, enum modbus_table table);
/* Fills in which bits of its register the point has. The object has no errors. */
void modbus_object_bits(const struct config_value *values, struct modbus_point *point);
/* Fills in the point's scale, offset and knots. The object has no errors. False: there is no room, which is reported. */
bool modbus_object_scale(struct modbus_loader *loader, const struct config_place *object,
			 const struct config_value *values, struct modbus_point *point);

#endif
