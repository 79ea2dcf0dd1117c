/* SPDX-License-Identifier: GPL-3.0-or-later */
/*
 * What a device is known by: the objects of its identification, which the gateway compares, and registers with values that others
 * do not have there, which `openrtu scan` compares: the gateway reads none of them for this.
 */
#include "config/sections.h"
#include "modbus/config_object.h"
#include "modbus/config_part.h"

#define VALUES_MAX         32 /* that one register may have */
#define REGISTERS_MAX      16
#define REGISTER_VALUE_MAX 65535

CONFIG_TABLE(known_register_table, .name = "known_register",
	     .json = CONFIG_JSON({
		     "type" : "array",
		     "minItems" : 2,
		     "maxItems" : 33,
		     "items" : {"type" : "integer", "minimum" : 0, "maximum" : 65535}
	     }));

/* The objects come first, by their numbers. */
enum {
	IDENTIFICATION_INPUT = MODBUS_IDENTITY_OBJECTS,
	IDENTIFICATION_HOLDING,
	IDENTIFICATION_KEYS,
};
#define IDENTIFIED(name, says)                                                                               \
	{name,                                                                                               \
	 CONFIG_TEXT,                                                                                        \
	 .page = true,                                                                                       \
	 .low = 1,                                                                                           \
	 .high = MODBUS_IDENTITY_TEXT,                                                                       \
	 CONFIG_SAYS(says, .pattern = "^[ -~\\u00a0-\\u00ff]*$")},
#define KNOWN_REGISTERS(name, says)                                                                          \
	{                                                                                                    \
		name, CONFIG_ARRAY, .page = true, .high = REGISTERS_MAX,                                     \
				    CONFIG_SAYS(says, .forms = CONFIG_FORMS(&known_register_table),          \
						.json = CONFIG_JSON({                                        \
							"items" : {"$ref" : "#/$defs/known_register"},       \
							"examples" : [[[ 11, 1648, 1649 ]]]                  \
						}))                                                          \
	}
static const struct config_rule identification_rules[IDENTIFICATION_KEYS] = {
    MODBUS_IDENTITY_NAMES(IDENTIFIED) /* and a comma behind each */
    KNOWN_REGISTERS("input_registers",
		    "Input registers, each an array of its Modbus address and the values it may have."),
    KNOWN_REGISTERS("holding_registers",
		    "Holding registers, each an array of its Modbus address and the values it may have."),
};
const struct config_inside modbus_identification_inside = {.rules = identification_rules,
							   .count = IDENTIFICATION_KEYS};
CONFIG_SHARED_TABLE(modbus_identification_table, .name = "identification", .rules = identification_rules,
		    .count = IDENTIFICATION_KEYS);

/* UTF-8 of what Latin-1 has, as Latin-1. False: it has others. */
static bool as_latin(const char *text, char out[MODBUS_IDENTITY_TEXT + 1])
{
	size_t length = 0;

	for (const uint8_t *at = (const uint8_t *)text; *at != '\0'; at++) {
		uint8_t octet = *at;

		if (octet >= 0x80 && (octet & ~1u) != 0xC2)
			return false;
		if (octet >= 0x80)
			octet = (uint8_t)((octet & 3u) << 6 | (*++at & 0x3Fu));
		if (length == MODBUS_IDENTITY_TEXT)
			return false;
		out[length++] = (char)octet;
	}
	out[length] = '\0';
	return true;
}

static void keep_object(struct modbus_loader *loader, const struct config_place *identification,
			uint8_t object, const char *text)
{
	const struct config_place key = config_key_of(identification, identification_rules[object].name);
	struct modbus_expected *expected = map_next_record(loader->config, MODBUS_EXPECTED);

	*expected = (struct modbus_expected){.slave = loader->config->set_count - 1, .object = object};
	if (!as_latin(text, expected->text))
		config_error(loader->report, &key, "has characters that no device sends, expected Latin-1");
}

static bool is_known_register(const json_t *json)
{
	size_t count = json_array_size(json);

	for (size_t i = 0; i < count; i++) {
		const json_t *number = json_array_get(json, i);

		if (!json_is_integer(number) || json_integer_value(number) < 0 ||
		    json_integer_value(number) > REGISTER_VALUE_MAX)
			return false;
	}
	return count >= 2 && count <= 1 + VALUES_MAX;
}

static void check_registers(struct modbus_loader *loader, const struct config_place *array,
			    const json_t *registers)
{
	for (size_t i = 0; i < json_array_size(registers); i++) {
		const struct config_place here = config_element_of(array, i);

		if (!is_known_register(json_array_get(registers, i)))
			config_error(
			    loader->report, &here,
			    "is not a register's address and its values, expected 2 to %d integers from "
			    "0 to %d",
			    1 + VALUES_MAX, REGISTER_VALUE_MAX);
	}
}

void modbus_read_identification(struct modbus_loader *loader, const struct config_place *slave,
				const char *key, const json_t *json)
{
	const struct config_place here = config_key_of(slave, key);
	struct config_value values[IDENTIFICATION_KEYS];

	config_read_keys(loader->report, &here, json, identification_rules, IDENTIFICATION_KEYS, values);
	if (modbus_says_objects(json) &&
	    !config_make_room(loader->report, loader->config, MODBUS_EXPECTED, sizeof(struct modbus_expected),
			      MODBUS_IDENTITY_OBJECTS))
		return;
	for (uint8_t i = 0; i < MODBUS_IDENTITY_OBJECTS; i++)
		if (values[i].given)
			keep_object(loader, &here, i, values[i].text);
	for (size_t i = IDENTIFICATION_INPUT; i < IDENTIFICATION_KEYS; i++) {
		const struct config_place array = config_key_of(&here, identification_rules[i].name);

		if (values[i].given)
			check_registers(loader, &array, values[i].json);
	}
}

bool modbus_says_objects(const json_t *json)
{
	for (size_t i = 0; i < MODBUS_IDENTITY_OBJECTS; i++)
		if (json_object_get(json, identification_rules[i].name) != NULL)
			return true;
	return false;
}
