/* SPDX-License-Identifier: GPL-3.0-or-later */
/* One object of a slave's table, and the point it becomes. */
#include "rtud/config_parts.h"

#include <float.h>
#include <math.h>
#include <string.h>

#define BIT(n) (1u << (n))

/* What lies between two bits of a double is read with them: one answer of Modbus holds it. */
#define APART_MAX 1024

/* Report 003, section 4.3: from here on coils would reach the discrete inputs' IOA. */
#define SCHEME_LAST 9999
#define MODBUS_LAST 65535
#define IOA_MAX     16777215

static const uint32_t first_ioa[] = {1, 10001, 30001, 40001};

static const char *const type_names[] = {
    [MAP_SINGLE] = "single",       [MAP_DOUBLE] = "double",         [MAP_STEP] = "step",
    [MAP_BITSTRING] = "bitstring", [MAP_NORMALIZED] = "normalized", [MAP_SCALED] = "scaled",
    [MAP_FLOAT] = "float",         [MAP_COUNTER] = "counter",       NULL,
};
static const uint8_t type_widths[] = {
    [MAP_SINGLE] = 1,     [MAP_DOUBLE] = 2, [MAP_STEP] = 1,  [MAP_BITSTRING] = 2,
    [MAP_NORMALIZED] = 1, [MAP_SCALED] = 1, [MAP_FLOAT] = 2, [MAP_COUNTER] = 2,
};

#define OF_BITS      (BIT(MAP_SINGLE) | BIT(MAP_DOUBLE))
#define OF_MEASURED  (BIT(MAP_NORMALIZED) | BIT(MAP_SCALED) | BIT(MAP_FLOAT))
#define OF_TWO_WORDS (BIT(MAP_BITSTRING) | BIT(MAP_FLOAT) | BIT(MAP_COUNTER))
#define NOT_COUNTER  (~BIT(MAP_COUNTER))
#define OF_REGISTERS (BIT(MAP_STEP) | OF_MEASURED | OF_TWO_WORDS)

static const char *const orders[] = {"big", "little", NULL};
static const char *const bit_orders[] = {"off_on", "on_off", NULL};

enum {
	OBJECT_ADDRESS,
	OBJECT_TYPE,
	OBJECT_NAME,
	OBJECT_IOA,
	OBJECT_GROUP,
	OBJECT_SELECT,
	OBJECT_SIGNED,
	OBJECT_WORD_ORDER,
	OBJECT_BYTE_ORDER,
	OBJECT_BIT_ORDER,
	OBJECT_SCALE,
	OBJECT_OFFSET,
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
	OBJECT_PERIOD,
	OBJECT_READ_BACK,
	OBJECT_KEYS
};
static const struct config_rule object_rules[OBJECT_KEYS] = {
    [OBJECT_ADDRESS] = {"address", CONFIG_INTEGER, .required = true, .low = 0, .high = MODBUS_LAST},
    [OBJECT_TYPE] = {"type", CONFIG_CHOICE, .choices = type_names},
    [OBJECT_NAME] = {"name", CONFIG_TEXT, .low = 1, .high = MAP_NAME_SIZE - 1},
    [OBJECT_IOA] = {"ioa", CONFIG_INTEGER, .low = 1, .high = IOA_MAX},
    [OBJECT_GROUP] = {"group", CONFIG_INTEGER, .low = 1, .high = 16},
    [OBJECT_SELECT] = {"select", CONFIG_BOOLEAN},
    [OBJECT_SIGNED] = {"signed", CONFIG_BOOLEAN, .fallback = true},
    [OBJECT_WORD_ORDER] = {"word_order", CONFIG_CHOICE, .choices = orders},
    [OBJECT_BYTE_ORDER] = {"byte_order", CONFIG_CHOICE, .choices = orders},
    [OBJECT_BIT_ORDER] = {"bit_order", CONFIG_CHOICE, .choices = bit_orders},
    [OBJECT_SCALE] = {"scale", CONFIG_NUMBER, .low = -FLT_MAX, .high = FLT_MAX, .fallback = 1},
    [OBJECT_OFFSET] = {"offset", CONFIG_NUMBER, .low = -FLT_MAX, .high = FLT_MAX},
    [OBJECT_DEADBAND] = {"deadband", CONFIG_NUMBER, .low = 0, .high = FLT_MAX},
    [OBJECT_CYCLIC] = {"cyclic_ms", CONFIG_INTEGER, .low = 100, .high = 86400000},
    [OBJECT_BACKGROUND] = {"background_ms", CONFIG_INTEGER, .low = 100, .high = 86400000},
    [OBJECT_COUNTER_GROUP] = {"counter_group", CONFIG_INTEGER, .low = 1, .high = 4},
    [OBJECT_FREEZE] = {"freeze_s", CONFIG_INTEGER, .low = 1, .high = 86400},
    [OBJECT_SECOND] = {"second_address", CONFIG_INTEGER, .low = 0, .high = MODBUS_LAST},
    [OBJECT_SHORT_PULSE] = {"short_pulse_ms", CONFIG_INTEGER, .low = 20, .high = 60000},
    [OBJECT_LONG_PULSE] = {"long_pulse_ms", CONFIG_INTEGER, .low = 20, .high = 60000},
    [OBJECT_STEP] = {"step", CONFIG_NUMBER, .low = 0, .high = FLT_MAX},
    [OBJECT_MIN] = {"min", CONFIG_NUMBER, .low = -FLT_MAX, .high = FLT_MAX},
    [OBJECT_MAX] = {"max", CONFIG_NUMBER, .low = -FLT_MAX, .high = FLT_MAX},
    [OBJECT_QUALITY] = {"quality", CONFIG_BOOLEAN, .fallback = true},
    [OBJECT_BLOCKED_BY] = {"blocked_by", CONFIG_TEXT, .low = 1, .high = MAP_NAME_SIZE - 1},
    [OBJECT_SUBSTITUTED_BY] = {"substituted_by", CONFIG_TEXT, .low = 1, .high = MAP_NAME_SIZE - 1},
    [OBJECT_NOT_TOPICAL_BY] = {"not_topical_by", CONFIG_TEXT, .low = 1, .high = MAP_NAME_SIZE - 1},
    [OBJECT_PERIOD] = {"period_ms", CONFIG_INTEGER, .low = 10, .high = 60000},
    [OBJECT_READ_BACK] = {"read_back", CONFIG_BOOLEAN},
};
const char *const config_status_keys[MAP_STATUS_BITS] = {
    [MAP_BLOCKED_BY] = "blocked_by",
    [MAP_SUBSTITUTED_BY] = "substituted_by",
    [MAP_NOT_TOPICAL_BY] = "not_topical_by",
};
/* The types that give a key a meaning; 0: all do. */
static const unsigned object_key_types[OBJECT_KEYS] = {
    [OBJECT_SIGNED] = BIT(MAP_NORMALIZED) | BIT(MAP_SCALED),
    [OBJECT_WORD_ORDER] = OF_TWO_WORDS,
    [OBJECT_BYTE_ORDER] = OF_REGISTERS,
    [OBJECT_BIT_ORDER] = BIT(MAP_DOUBLE),
    [OBJECT_SCALE] = OF_MEASURED,
    [OBJECT_OFFSET] = OF_MEASURED,
    [OBJECT_DEADBAND] = OF_MEASURED | BIT(MAP_COUNTER),
    [OBJECT_CYCLIC] = OF_MEASURED, /* IEC 60870-5-101, 7.2.3: only measured values know COT 1 */
    [OBJECT_BACKGROUND] = OF_BITS | BIT(MAP_STEP) | BIT(MAP_BITSTRING), /* measured values are cyclic */
    [OBJECT_COUNTER_GROUP] = BIT(MAP_COUNTER),
    [OBJECT_FREEZE] = BIT(MAP_COUNTER),
    [OBJECT_SECOND] = BIT(MAP_DOUBLE),
    [OBJECT_SHORT_PULSE] = OF_BITS,
    [OBJECT_LONG_PULSE] = OF_BITS,
    [OBJECT_STEP] = OF_MEASURED,
    [OBJECT_MIN] = OF_MEASURED,
    [OBJECT_MAX] = OF_MEASURED,
    [OBJECT_QUALITY] = BIT(MAP_NORMALIZED), /* 101, 7.3.1: of no other type is there one without */
    [OBJECT_BLOCKED_BY] = NOT_COUNTER,      /* a BCR knows IV alone */
    [OBJECT_SUBSTITUTED_BY] = NOT_COUNTER,
    [OBJECT_NOT_TOPICAL_BY] = NOT_COUNTER,
};
/* Of commands: they mean nothing where nothing can be commanded. */
static const bool is_command_key[OBJECT_KEYS] = {
    [OBJECT_SELECT] = true, [OBJECT_SHORT_PULSE] = true, [OBJECT_LONG_PULSE] = true, [OBJECT_STEP] = true,
    [OBJECT_MIN] = true,    [OBJECT_MAX] = true,         [OBJECT_READ_BACK] = true,
};

static bool is_bit_table(enum map_table table)
{
	return table == MAP_COILS || table == MAP_DISCRETE_INPUTS;
}

static enum map_type object_type(const struct config_value *values, enum map_table table)
{
	if (values[OBJECT_TYPE].given)
		return (enum map_type)values[OBJECT_TYPE].integer;
	return is_bit_table(table) ? MAP_SINGLE : MAP_SCALED;
}

static void check_type(struct config_loader *loader, const struct config_place *object, enum map_type type,
		       enum map_table table)
{
	const struct config_place here = config_key_of(object, object_rules[OBJECT_TYPE].name);
	bool bits = is_bit_table(table);

	if (bits != ((BIT(type) & OF_BITS) != 0))
		config_error(&loader->report, &here, "%s hold no \"%s\", expected one of %s",
			     config_table_names[table], type_names[type],
			     bits ? "single, double" : "step, bitstring, normalized, scaled, float, counter");
}

static void check_meaning(struct config_loader *loader, const struct config_place *object,
			  const struct config_value *values, enum map_type type, enum map_table table)
{
	for (size_t key = 0; key < OBJECT_KEYS; key++) {
		const struct config_place here = config_key_of(object, object_rules[key].name);

		if (values[key].given && object_key_types[key] != 0 && !(object_key_types[key] & BIT(type)))
			config_error(&loader->report, &here, "has no meaning for type %s", type_names[type]);
		if (values[key].given && is_command_key[key] && !config_is_writable(table))
			config_error(&loader->report, &here,
				     "has no meaning for %s: they cannot be commanded",
				     config_table_names[table]);
	}
}

static void check_extent(struct config_loader *loader, const struct config_place *object, int64_t address,
			 enum map_type type)
{
	const struct config_place here = config_key_of(object, object_rules[OBJECT_ADDRESS].name);

	if (address + type_widths[type] - 1 > MODBUS_LAST)
		config_error(&loader->report, &here,
			     "%lld is out of range for type %s, which covers two addresses, expected 0 to %d",
			     (long long)address, type_names[type], MODBUS_LAST - 1);
}

static void check_second_address(struct config_loader *loader, const struct config_place *object,
				 int64_t address, int64_t second)
{
	const struct config_place here = config_key_of(object, object_rules[OBJECT_SECOND].name);

	if (second == address)
		config_error(&loader->report, &here, "is the address of the first bit, expected another one");
	else if (second > address + APART_MAX || second < address - APART_MAX)
		config_error(&loader->report, &here, "is %lld away from the first bit, expected at most %d",
			     (long long)(second > address ? second - address : address - second), APART_MAX);
}

static bool is_whole(double number)
{
	return fpclassify(number - rint(number)) == FP_ZERO;
}

/* A step command needs all three, and a value that is an integer moves by integers. */
static void check_step(struct config_loader *loader, const struct config_place *object,
		       const struct config_value *values, enum map_type type)
{
	const struct config_place step = config_key_of(object, object_rules[OBJECT_STEP].name);
	const struct config_place max = config_key_of(object, object_rules[OBJECT_MAX].name);
	unsigned given = 0;

	for (size_t key = OBJECT_STEP; key <= OBJECT_MAX; key++) {
		if (values[key].wrong)
			return;
		given += values[key].given;
	}
	for (size_t key = OBJECT_STEP; given > 0 && key <= OBJECT_MAX; key++) {
		const struct config_place here = config_key_of(object, object_rules[key].name);

		if (!values[key].given)
			config_error(&loader->report, &here,
				     "is needed with the others of step, min and max, expected a number");
	}
	if (given < 3)
		return;
	if (fpclassify(values[OBJECT_STEP].number) == FP_ZERO)
		config_error(&loader->report, &step, "is 0, expected more");
	else if (type != MAP_FLOAT && !is_whole(values[OBJECT_STEP].number))
		config_error(&loader->report, &step, "is no integer, as type %s needs it", type_names[type]);
	if (values[OBJECT_MIN].number >= values[OBJECT_MAX].number)
		config_error(&loader->report, &max, "is not above min");
}

static void check_name(struct config_loader *loader, const struct config_place *object, const char *name)
{
	const struct config_place here = config_key_of(object, object_rules[OBJECT_NAME].name);

	if (strpbrk(name, " *?[]\\") != NULL)
		config_error(&loader->report, &here,
			     "has a space or one of *?[]\\, which are for patterns, expected a name without");
}

static void check_scale(struct config_loader *loader, const struct config_place *object, double scale)
{
	const struct config_place here = config_key_of(object, object_rules[OBJECT_SCALE].name);

	if (fpclassify(scale) == FP_ZERO)
		config_error(&loader->report, &here, "is 0, expected another number");
}

static void check_scheme(struct config_loader *loader, const struct config_place *object, int64_t address)
{
	const struct config_place here = config_key_of(object, object_rules[OBJECT_IOA].name);

	if (address > SCHEME_LAST)
		config_error(
		    &loader->report, &here,
		    "is missing: addresses from %d on have no IOA by themselves, expected an integer from "
		    "1 to %d",
		    SCHEME_LAST + 1, IOA_MAX);
}

static void check_period(struct config_loader *loader, const struct config_place *object)
{
	const struct config_place here = config_key_of(object, object_rules[OBJECT_PERIOD].name);

	if (loader->config->devices[loader->config->device_count - 1].unit == 0)
		config_error(&loader->report, &here,
			     "has no meaning for slave 0: the broadcast address is never read");
}

static uint8_t object_flags(const struct config_value *values, enum map_type type, enum map_table table)
{
	unsigned flags = 0;

	if ((object_key_types[OBJECT_SIGNED] & BIT(type)) && values[OBJECT_SIGNED].integer)
		flags |= MAP_POINT_SIGNED;
	if (values[OBJECT_WORD_ORDER].integer)
		flags |= MAP_POINT_WORDS_SWAPPED;
	if (values[OBJECT_BYTE_ORDER].integer)
		flags |= MAP_POINT_BYTES_SWAPPED;
	if (values[OBJECT_BIT_ORDER].integer)
		flags |= MAP_POINT_BITS_SWAPPED;
	if (values[OBJECT_SELECT].integer)
		flags |= MAP_POINT_SELECT;
	if (config_is_writable(table))
		flags |= MAP_POINT_COMMAND;
	if (!values[OBJECT_QUALITY].integer)
		flags |= MAP_POINT_NO_QUALITY;
	return (uint8_t)flags;
}

static struct map_point object_point(const struct config_value *values, enum map_type type,
				     enum map_table table)
{
	uint16_t address = (uint16_t)values[OBJECT_ADDRESS].integer;
	const struct config_value *second = &values[OBJECT_SECOND];

	return (struct map_point){
	    .address = address,
	    .table = (uint8_t)table,
	    .type = (uint8_t)type,
	    .width = type_widths[type],
	    .flags = object_flags(values, type, table),
	    .ioa =
		values[OBJECT_IOA].given ? (uint32_t)values[OBJECT_IOA].integer : first_ioa[table] + address,
	    .group = (uint8_t)values[OBJECT_GROUP].integer,
	    .counter_group = (uint8_t)values[OBJECT_COUNTER_GROUP].integer,
	    .send_period_ms = (uint32_t)(values[OBJECT_CYCLIC].integer + values[OBJECT_BACKGROUND].integer),
	    .freeze_s = (uint32_t)values[OBJECT_FREEZE].integer,
	    .second_address = (uint16_t)(second->given ? second->integer : address + 1),
	    .short_pulse_ms = (uint16_t)values[OBJECT_SHORT_PULSE].integer,
	    .long_pulse_ms = (uint16_t)values[OBJECT_LONG_PULSE].integer,
	    .scan_period_ms = (uint16_t)values[OBJECT_PERIOD].integer,
	    .scale = values[OBJECT_SCALE].number,
	    .offset = values[OBJECT_OFFSET].number,
	    .deadband = values[OBJECT_DEADBAND].number,
	    .step = (float)values[OBJECT_STEP].number,
	    .min = (float)values[OBJECT_MIN].number,
	    .max = (float)values[OBJECT_MAX].number,
	};
}

static void name_point(struct config_loader *loader, struct config_entry *entry,
		       const struct config_value *name)
{
	entry->named = name->given;
	if (name->given)
		snprintf(entry->name, sizeof(entry->name), "%s", name->text);
	else
		map_point_name(loader->config, &entry->point, entry->name);
}

static void check_object(struct config_loader *loader, const struct config_place *place,
			 const struct config_value *values, enum map_type type, enum map_table table)
{
	if (!values[OBJECT_TYPE].wrong) {
		check_type(loader, place, type, table);
		check_meaning(loader, place, values, type, table);
	}
	if (!values[OBJECT_TYPE].wrong)
		check_step(loader, place, values, type);
	if (values[OBJECT_SECOND].given && !values[OBJECT_ADDRESS].wrong)
		check_second_address(loader, place, values[OBJECT_ADDRESS].integer,
				     values[OBJECT_SECOND].integer);
	else if (!values[OBJECT_TYPE].wrong && !values[OBJECT_ADDRESS].wrong)
		check_extent(loader, place, values[OBJECT_ADDRESS].integer, type);
	if (!values[OBJECT_IOA].given && !values[OBJECT_IOA].wrong && !values[OBJECT_ADDRESS].wrong)
		check_scheme(loader, place, values[OBJECT_ADDRESS].integer);
	if (values[OBJECT_NAME].given)
		check_name(loader, place, values[OBJECT_NAME].text);
	if (values[OBJECT_SCALE].given)
		check_scale(loader, place, values[OBJECT_SCALE].number);
	if (values[OBJECT_PERIOD].given)
		check_period(loader, place);
}

/* entry: where it is in the file */
static void read_object(struct config_loader *loader, const struct config_place *place, const json_t *json,
			enum map_table table, struct config_entry entry)
{
	struct config_value values[OBJECT_KEYS];
	unsigned errors = loader->report.errors;
	enum map_type type;

	config_read_keys(&loader->report, place, json, object_rules, OBJECT_KEYS, values);
	type = object_type(values, table);
	check_object(loader, place, values, type, table);
	loader->objects++;
	if (loader->report.errors != errors || loader->config->point_count == loader->entries_max)
		return;
	entry.point = object_point(values, type, table);
	entry.point.device = (uint16_t)(loader->config->device_count - 1);
	if (!values[OBJECT_PERIOD].given)
		entry.point.scan_period_ms = entry.period_ms;
	if (config_is_writable(table) &&
	    !(values[OBJECT_READ_BACK].given ? values[OBJECT_READ_BACK].integer : entry.read_back))
		entry.point.flags |= MAP_POINT_NO_READ_BACK;
	name_point(loader, &entry, &values[OBJECT_NAME]);
	for (unsigned i = 0; i < MAP_STATUS_BITS; i++)
		entry.status[i] =
		    values[OBJECT_BLOCKED_BY + i].given ? values[OBJECT_BLOCKED_BY + i].text : NULL;
	loader->entries[loader->config->point_count++] = entry;
}

void config_read_objects(struct config_loader *loader, const struct config_place *slave,
			 const json_t *objects, enum map_table table, struct config_entry entry)
{
	const struct config_place array = config_key_of(slave, config_table_names[table]);
	const json_t *json;
	size_t i;

	json_array_foreach(objects, i, json)
	{
		const struct config_place place = config_element_of(&array, i);

		entry.object = (uint32_t)i;
		read_object(loader, &place, json, table, entry);
	}
}
