/* SPDX-License-Identifier: GPL-3.0-or-later */
/* One object of a slave's table, and the point it becomes. */
#include "rtud/config_object.h"

#include <float.h>
#include <math.h>
#include <string.h>

#define BIT(n) (1u << (n))

/* What lies between two bits of a double is read with them: one answer of Modbus holds it. */
#define APART_MAX 1024

/* The report, section 4.3: from here on coils would reach the discrete inputs' IOA. */
#define SCHEME_LAST 9999
#define MODBUS_LAST 65535
#define IOA_MAX     16777215

static const uint32_t first_ioa[] = {1, 10001, 30001, 40001};

const char *const config_type_names[] = {
    [MAP_SINGLE] = "single",       [MAP_DOUBLE] = "double",         [MAP_STEP] = "step",
    [MAP_BITSTRING] = "bitstring", [MAP_NORMALIZED] = "normalized", [MAP_SCALED] = "scaled",
    [MAP_FLOAT] = "float",         [MAP_COUNTER] = "counter",       NULL,
};
#define OF_BITS     (BIT(MAP_SINGLE) | BIT(MAP_DOUBLE))
#define OF_MEASURED (BIT(MAP_NORMALIZED) | BIT(MAP_SCALED) | BIT(MAP_FLOAT))
#define NOT_COUNTER (~BIT(MAP_COUNTER))

static const char *const orders[] = {"big", "little", NULL};
static const char *const formats[] = {
    "int16",  "uint16",  "int32",   "uint32", "int64",
    "uint64", "float32", "float64", NULL}; /* as enum map_format from INT16 on */
static const char *const bit_orders[] = {"off_on", "on_off", NULL};

const struct config_rule config_object_rules[OBJECT_KEYS] = {
    [OBJECT_ADDRESS] = {"address", CONFIG_INTEGER, .required = true, .low = 0, .high = MODBUS_LAST},
    [OBJECT_TYPE] = {"type", CONFIG_CHOICE, .choices = config_type_names},
    [OBJECT_NAME] = {CONFIG_KEY_NAME, CONFIG_TEXT, .low = 1, .high = MAP_NAME_SIZE - 1},
    [OBJECT_UNIT] = {"unit", CONFIG_TEXT, .low = 1, .high = 15},
    [OBJECT_IOA] = {"ioa", CONFIG_INTEGER, .low = 1, .high = IOA_MAX},
    [OBJECT_GROUP] = {"group", CONFIG_INTEGER, .low = 1, .high = 16},
    [OBJECT_SELECT] = {"select", CONFIG_BOOLEAN},
    [OBJECT_FORMAT] = {"format", CONFIG_CHOICE, .choices = formats},
    [OBJECT_BIT] = {"bit", CONFIG_INTEGER, .low = 0, .high = 15},
    [OBJECT_INVERTED] = {"inverted", CONFIG_BOOLEAN},
    [OBJECT_SIGNED] = {"signed", CONFIG_BOOLEAN, .fallback = true},
    [OBJECT_WORD_ORDER] = {"word_order", CONFIG_CHOICE, .choices = orders},
    [OBJECT_BYTE_ORDER] = {"byte_order", CONFIG_CHOICE, .choices = orders},
    [OBJECT_BIT_ORDER] = {"bit_order", CONFIG_CHOICE, .choices = bit_orders},
    [OBJECT_SCALE] = {"scale", CONFIG_NUMBER, .low = -FLT_MAX, .high = FLT_MAX, .fallback = 1},
    [OBJECT_OFFSET] = {"offset", CONFIG_NUMBER, .low = -FLT_MAX, .high = FLT_MAX},
    [OBJECT_SCALE_POINTS] = {"scale_points", CONFIG_ARRAY, .high = CONFIG_KNOTS_MAX},
    [OBJECT_SCALE_TABLE] = {"scale_table", CONFIG_ARRAY, .high = CONFIG_KNOTS_MAX},
    [OBJECT_SCALE_REGISTER] = {"scale_register", CONFIG_INTEGER, .low = 0, .high = MODBUS_LAST},
    [OBJECT_UNIMPLEMENTED] = {"unimplemented", CONFIG_BOOLEAN},
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
    [OBJECT_FORMAT] = OF_MEASURED | BIT(MAP_COUNTER) | BIT(MAP_BITSTRING),
    [OBJECT_BIT] = OF_BITS,
    [OBJECT_INVERTED] = OF_BITS,
    [OBJECT_BIT_ORDER] = BIT(MAP_DOUBLE),
    [OBJECT_SCALE_POINTS] = OF_MEASURED,
    [OBJECT_SCALE_TABLE] = OF_MEASURED,
    [OBJECT_UNIMPLEMENTED] = OF_MEASURED | BIT(MAP_COUNTER),
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

static enum map_type object_type(const struct config_value *values, enum map_table table)
{
	if (values[OBJECT_TYPE].given)
		return (enum map_type)values[OBJECT_TYPE].integer;
	return config_is_bit_table(table) || values[OBJECT_BIT].given ? MAP_SINGLE : MAP_SCALED;
}

static void check_type(struct config_loader *loader, const struct config_place *object, enum map_type type,
		       enum map_table table, bool bit)
{
	const struct config_place here = config_object_key(object, OBJECT_TYPE);
	bool bits = config_is_bit_table(table);

	if ((bits || bit) != ((BIT(type) & OF_BITS) != 0))
		config_error(&loader->report, &here, "%s hold no \"%s\", expected one of %s",
			     bit ? "bits" : config_table_names[table], config_type_names[type],
			     bits || bit
				 ? "single, double"
				 : "step, bitstring, normalized, scaled, float, counter, or the key bit");
}

static void check_meaning(struct config_loader *loader, const struct config_place *object,
			  const struct config_value *values, enum map_type type, enum map_table table)
{
	for (unsigned key = 0; key < OBJECT_KEYS; key++) {
		const struct config_place here = config_object_key(object, key);

		if (values[key].given && object_key_types[key] != 0 && !(object_key_types[key] & BIT(type)))
			config_error(&loader->report, &here, "has no meaning for type %s",
				     config_type_names[type]);
		if (values[key].given && is_command_key[key] && !config_is_writable(table))
			config_error(&loader->report, &here,
				     "has no meaning for %s: they cannot be commanded",
				     config_table_names[table]);
	}
}

static void check_extent(struct config_loader *loader, const struct config_place *object, int64_t address,
			 enum map_type type, uint8_t width)
{
	const struct config_place here = config_object_key(object, OBJECT_ADDRESS);

	if (address + width - 1 > MODBUS_LAST)
		config_error(&loader->report, &here,
			     "%lld is out of range for type %s, which covers %s addresses, expected 0 to %d",
			     (long long)address, config_type_names[type], width == 2 ? "two" : "four",
			     MODBUS_LAST + 1 - width);
}

static void check_second_address(struct config_loader *loader, const struct config_place *object,
				 int64_t address, int64_t second)
{
	const struct config_place here = config_object_key(object, OBJECT_SECOND);

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
	const struct config_place step = config_object_key(object, OBJECT_STEP);
	const struct config_place max = config_object_key(object, OBJECT_MAX);
	unsigned given = 0;

	for (unsigned key = OBJECT_STEP; key <= OBJECT_MAX; key++) {
		if (values[key].wrong)
			return;
		given += values[key].given;
	}
	for (unsigned key = OBJECT_STEP; given > 0 && key <= OBJECT_MAX; key++) {
		const struct config_place here = config_object_key(object, key);

		if (!values[key].given)
			config_error(&loader->report, &here,
				     "is not given: step, min and max belong together, expected a number");
	}
	if (given < 3)
		return;
	if (fpclassify(values[OBJECT_STEP].number) == FP_ZERO)
		config_error(&loader->report, &step, "is 0, expected more");
	else if (type != MAP_FLOAT && !is_whole(values[OBJECT_STEP].number))
		config_error(&loader->report, &step, "is not an integer, which type %s needs",
			     config_type_names[type]);
	if (values[OBJECT_MIN].number >= values[OBJECT_MAX].number)
		config_error(&loader->report, &max, "is not above min");
}

void config_check_name(struct config_loader *loader, const struct config_place *place, const char *name)
{
	if (strpbrk(name, " *?[]\\") != NULL)
		config_error(&loader->report, place,
			     "has a space or one of *?[]\\, which are for patterns, expected a name without");
}

static void check_scheme(struct config_loader *loader, const struct config_place *object, int64_t address)
{
	const struct config_place here = config_object_key(object, OBJECT_IOA);

	if (address > SCHEME_LAST)
		config_error(
		    &loader->report, &here,
		    "is missing: addresses from %d on have no IOA by themselves, expected an integer from "
		    "1 to %d",
		    SCHEME_LAST + 1, IOA_MAX);
}

/* Keys of reading. */
static void check_read_key(struct config_loader *loader, const struct config_place *object, unsigned key)
{
	const struct config_place here = config_object_key(object, key);

	if (loader->config->devices[loader->config->device_count - 1].unit == 0)
		config_error(&loader->report, &here,
			     "has no meaning for slave 0: the broadcast address is never read");
}

static uint16_t object_flags(const struct config_value *values, enum map_table table)
{
	unsigned flags = 0;

	if (values[OBJECT_INVERTED].integer)
		flags |= MAP_POINT_INVERTED;
	if (values[OBJECT_UNIMPLEMENTED].integer)
		flags |= MAP_POINT_UNIMPLEMENTED;
	if (values[OBJECT_SCALE_REGISTER].given)
		flags |= MAP_POINT_SCALE_REGISTER;
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
	return (uint16_t)flags;
}

static struct map_point object_point(const struct config_value *values, enum map_type type,
				     enum map_table table)
{
	uint16_t address = (uint16_t)values[OBJECT_ADDRESS].integer;
	const struct config_value *second =
	    &values[values[OBJECT_SCALE_REGISTER].given ? OBJECT_SCALE_REGISTER : OBJECT_SECOND];
	enum map_format format = config_format(values, type);

	return (struct map_point){
	    .address = address,
	    .table = (uint8_t)table,
	    .type = (uint8_t)type,
	    .width = config_width(type, format, table) & 15u,
	    .format = format & 15u,
	    .flags = object_flags(values, table),
	    .bit = (unsigned)values[OBJECT_BIT].integer & 15u,
	    .ioa =
		values[OBJECT_IOA].given ? (uint32_t)values[OBJECT_IOA].integer : first_ioa[table] + address,
	    .group = (uint8_t)values[OBJECT_GROUP].integer,
	    .counter_group = (unsigned)values[OBJECT_COUNTER_GROUP].integer & 15u,
	    .send_period_ms = (uint32_t)(values[OBJECT_CYCLIC].integer + values[OBJECT_BACKGROUND].integer),
	    .freeze_s = (uint32_t)values[OBJECT_FREEZE].integer,
	    .second_address = (uint16_t)(second->given ? second->integer : address + 1),
	    .short_pulse_ms = (uint16_t)values[OBJECT_SHORT_PULSE].integer,
	    .long_pulse_ms = (uint16_t)values[OBJECT_LONG_PULSE].integer,
	    .scan_period_ms = (uint16_t)values[OBJECT_PERIOD].integer,
	    .deadband = (float)values[OBJECT_DEADBAND].number,
	    .step = (float)values[OBJECT_STEP].number,
	    .min = (float)values[OBJECT_MIN].number,
	    .max = (float)values[OBJECT_MAX].number,
	};
}

static void name_point(struct config_loader *loader, const struct config_place *object,
		       struct config_entry *entry, const struct config_value *name)
{
	const struct config_place here = config_object_key(object, OBJECT_NAME);

	entry->named = name->given;
	if (!name->given)
		map_point_name(loader->config, &entry->point, entry->name);
	else if (snprintf(entry->name, sizeof(entry->name), "%s%s", entry->prefix, name->text) >=
		 (int)sizeof(entry->name))
		config_error(&loader->report, &here, "is longer than %d bytes with its slave's name_prefix",
			     MAP_NAME_SIZE - 1);
}

static void offset_ioa(struct config_loader *loader, const struct config_place *object,
		       struct config_entry *entry)
{
	const struct config_place here = config_object_key(object, OBJECT_IOA);

	entry->point.ioa += entry->ioa_offset;
	if (entry->point.ioa > IOA_MAX)
		config_error(&loader->report, &here,
			     "%u is out of range with its slave's ioa_offset, expected at "
			     "most %d",
			     entry->point.ioa, IOA_MAX);
}

static void check_object(struct config_loader *loader, const struct config_place *place,
			 const struct config_value *values, enum map_type type, enum map_table table)
{
	const struct config_place name = config_object_key(place, OBJECT_NAME);

	if (!values[OBJECT_TYPE].wrong) {
		check_type(loader, place, type, table, values[OBJECT_BIT].given);
		check_meaning(loader, place, values, type, table);
		config_check_value(loader, place, values, type, table);
	}
	if (!values[OBJECT_TYPE].wrong)
		check_step(loader, place, values, type);
	if (values[OBJECT_SECOND].given && !values[OBJECT_ADDRESS].wrong)
		check_second_address(loader, place, values[OBJECT_ADDRESS].integer,
				     values[OBJECT_SECOND].integer);
	else if (!values[OBJECT_TYPE].wrong && !values[OBJECT_ADDRESS].wrong)
		check_extent(loader, place, values[OBJECT_ADDRESS].integer, type,
			     config_width(type, config_format(values, type), table));
	if (!values[OBJECT_IOA].given && !values[OBJECT_IOA].wrong && !values[OBJECT_ADDRESS].wrong &&
	    !values[OBJECT_BIT].given)
		check_scheme(loader, place, values[OBJECT_ADDRESS].integer);
	if (values[OBJECT_NAME].given)
		config_check_name(loader, &name, values[OBJECT_NAME].text);
	if (values[OBJECT_PERIOD].given)
		check_read_key(loader, place, OBJECT_PERIOD);
	if (values[OBJECT_SCALE_REGISTER].given)
		check_read_key(loader, place, OBJECT_SCALE_REGISTER);
}

static void add_entry(struct config_loader *loader, const struct config_place *place,
		      const struct config_value *values, enum map_type type, enum map_table table,
		      struct config_entry entry)
{
	entry.point = object_point(values, type, table);
	entry.point.device = (uint16_t)(loader->config->device_count - 1);
	if (!config_scale(loader, place, values, &entry.point))
		return;
	if (!values[OBJECT_PERIOD].given)
		entry.point.scan_period_ms = entry.period_ms;
	if (config_is_writable(table) &&
	    !(values[OBJECT_READ_BACK].given ? values[OBJECT_READ_BACK].integer : entry.read_back))
		entry.point.flags |= MAP_POINT_NO_READ_BACK;
	name_point(loader, place, &entry, &values[OBJECT_NAME]);
	offset_ioa(loader, place, &entry);
	for (unsigned i = 0; i < MAP_STATUS_BITS; i++)
		entry.status[i] =
		    values[OBJECT_BLOCKED_BY + i].given ? values[OBJECT_BLOCKED_BY + i].text : NULL;
	loader->entries[loader->config->point_count++] = entry;
}

static void read_object(struct config_loader *loader, const struct config_place *place, enum map_table table,
			struct config_entry entry)
{
	struct config_value values[OBJECT_KEYS];
	unsigned errors = loader->report.errors;
	enum map_type type;

	config_read_keys(&loader->report, place, entry.json, config_object_rules, OBJECT_KEYS, values);
	type = object_type(values, table);
	check_object(loader, place, values, type, table);
	if (loader->report.errors == errors && loader->config->point_count < loader->entries_max)
		add_entry(loader, place, values, type, table, entry);
}

/* What the slave has instead of a template's object. NULL: it leaves it out. */
static const json_t *overridden(struct config_loader *loader, const json_t *object, const json_t *overrides)
{
	const char *name = json_string_value(json_object_get(object, CONFIG_KEY_NAME));
	json_t *override = name == NULL ? NULL : json_object_get(overrides, name);
	json_t *both;

	if (!json_is_object(override))
		return json_is_null(override) ? NULL : object;
	both = json_copy((json_t *)object);
	if (both == NULL || json_object_update(both, override) < 0 ||
	    json_array_append_new(loader->kept, both) < 0) {
		config_out_of_memory(loader);
		return object;
	}
	return both;
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

		if (loader->objects++ >= CONFIG_POINTS_MAX)
			continue;
		entry.object = (uint32_t)i;
		entry.json = entry.template != NULL ? overridden(loader, json, entry.overrides) : json;
		if (entry.json != NULL)
			read_object(loader, &place, table, entry);
	}
}
