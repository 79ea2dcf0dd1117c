/* SPDX-License-Identifier: GPL-3.0-or-later */
/* Which keys of an object apply to which types, to commands, to what is read: for who reads a file, and for its schema. */
#include "modbus/config_object.h"

#define NOT_COUNTER  (~MODBUS_TYPE(MAP_COUNTER))
#define OF_ONE_WRITE (NOT_COUNTER & ~MODBUS_TYPE(MAP_DOUBLE)) /* a double may be two */

const struct modbus_applies modbus_applies_to[OBJECT_KEYS] = {
    [OBJECT_NAMES] = {.types = NOT_COUNTER & ~MODBUS_TYPE(MAP_NORMALIZED)},
    [OBJECT_DECIMALS] = {.types = MODBUS_TYPE(MAP_FLOAT)},
    [OBJECT_SELECT] = {.of_commands = true},
    [OBJECT_SIGNED] = {.types = MODBUS_TYPE(MAP_NORMALIZED) | MODBUS_TYPE(MAP_SCALED)},
    [OBJECT_FORMAT] = {.types =
			   MODBUS_MEASURED_TYPES | MODBUS_TYPE(MAP_COUNTER) | MODBUS_TYPE(MAP_BITSTRING)},
    [OBJECT_BIT] = {.types = MODBUS_BIT_TYPES},
    /* A counter of a few bits would go round unnoticed. */
    [OBJECT_BITS] = {.types = MODBUS_MEASURED_TYPES | MODBUS_TYPE(MAP_BITSTRING)},
    [OBJECT_INVERTED] = {.types = MODBUS_BIT_TYPES},
    [OBJECT_BIT_ORDER] = {.types = MODBUS_TYPE(MAP_DOUBLE)},
    [OBJECT_SCALE_POINTS] = {.types = MODBUS_MEASURED_TYPES},
    [OBJECT_SCALE_TABLE] = {.types = MODBUS_MEASURED_TYPES},
    [OBJECT_SCALE_REGISTER] = {.of_reading = true},
    [OBJECT_UNIMPLEMENTED] = {.types = MODBUS_MEASURED_TYPES | MODBUS_TYPE(MAP_COUNTER), .of_reading = true},
    [OBJECT_DEADBAND] = {.types = MODBUS_MEASURED_TYPES | MODBUS_TYPE(MAP_COUNTER), .of_reading = true},
    /* IEC 60870-5-101, 7.2.3: only measured values know COT 1; the others have background scan. */
    [OBJECT_CYCLIC] = {.types = MODBUS_MEASURED_TYPES, .of_reading = true},
    [OBJECT_BACKGROUND] = {.types = MODBUS_BIT_TYPES | MODBUS_TYPE(MAP_STEP) | MODBUS_TYPE(MAP_BITSTRING),
			   .of_reading = true},
    [OBJECT_COUNTER_GROUP] = {.types = MODBUS_TYPE(MAP_COUNTER), .of_reading = true},
    [OBJECT_FREEZE] = {.types = MODBUS_TYPE(MAP_COUNTER), .of_reading = true},
    [OBJECT_SECOND] = {.types = MODBUS_TYPE(MAP_DOUBLE)},
    [OBJECT_SHORT_PULSE] = {.types = MODBUS_BIT_TYPES, .of_commands = true},
    [OBJECT_LONG_PULSE] = {.types = MODBUS_BIT_TYPES, .of_commands = true},
    [OBJECT_STEP] = {.types = MODBUS_MEASURED_TYPES, .of_commands = true, .of_reading = true},
    [OBJECT_MIN] = {.types = MODBUS_MEASURED_TYPES, .of_commands = true},
    [OBJECT_MAX] = {.types = MODBUS_MEASURED_TYPES, .of_commands = true},
    /* IEC 60870-5-101, 7.3.1: of no other type is there one without. */
    [OBJECT_QUALITY] = {.types = MODBUS_TYPE(MAP_NORMALIZED)},
    /* A binary counter reading (BCR) knows IV alone. */
    [OBJECT_BLOCKED_BY] = {.types = NOT_COUNTER, .of_reading = true},
    [OBJECT_SUBSTITUTED_BY] = {.types = NOT_COUNTER, .of_reading = true},
    [OBJECT_NOT_TOPICAL_BY] = {.types = NOT_COUNTER, .of_reading = true},
    [OBJECT_PERIOD] = {.of_reading = true},
    [OBJECT_PAGE] = {.of_reading = true},
    [OBJECT_READ_BACK] = {.of_commands = true, .of_reading = true},
    [OBJECT_WRITE_ADDRESS] = {.of_reading = true},
    [OBJECT_SCALE_BY] = {.types = MODBUS_MEASURED_TYPES, .of_reading = true},
    [OBJECT_FACTOR_BY] = {.types = MODBUS_MEASURED_TYPES, .of_reading = true},
    [OBJECT_WRITE_VALUES] = {.types = OF_ONE_WRITE, .of_commands = true},
    [OBJECT_WRITE_AT_RETURN] = {.types = OF_ONE_WRITE, .of_commands = true},
    [OBJECT_WRITE_EVERY] = {.types = OF_ONE_WRITE, .of_commands = true},
};

/* A text is a bitstring that is read, and nothing else. */
bool modbus_applies_to_texts(unsigned key)
{
	static const unsigned of_numbers[] = {
	    OBJECT_NAMES,  OBJECT_BITS,           OBJECT_WORD_ORDER, OBJECT_UNIT,          OBJECT_SCALE,
	    OBJECT_OFFSET, OBJECT_SCALE_REGISTER, OBJECT_BACKGROUND, OBJECT_WRITE_ADDRESS, OBJECT_WRITE_ONLY};
	const struct modbus_applies *applies = &modbus_applies_to[key];

	for (size_t i = 0; i < sizeof(of_numbers) / sizeof(of_numbers[0]); i++)
		if (of_numbers[i] == key)
			return false;
	return !applies->of_commands &&
	       (applies->types == 0 || (applies->types & MODBUS_TYPE(MAP_BITSTRING)));
}

/* What is on a page, or read only. */
bool modbus_applies_to_read_alone(unsigned key)
{
	return !modbus_applies_to[key].of_commands && key != OBJECT_WRITE_ADDRESS && key != OBJECT_WRITE_ONLY;
}
