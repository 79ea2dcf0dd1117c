/* SPDX-License-Identifier: GPL-3.0-or-later */
/* How an object's registers become a value: its format, its bits, its scale. */
#include "rtud/config_object.h"

#include <float.h>
#include <math.h>
#include <stdlib.h>

#define BITS_OF_REGISTER 16

static bool is_zero(double number)
{
	return fpclassify(number) == FP_ZERO;
}

static bool is_measured(enum map_type type)
{
	return type == MAP_NORMALIZED || type == MAP_SCALED || type == MAP_FLOAT;
}

static bool is_of_bits(enum map_type type)
{
	return type == MAP_SINGLE || type == MAP_DOUBLE;
}

static bool is_floating(enum map_format format)
{
	return format == MAP_FORMAT_FLOAT32 || format == MAP_FORMAT_FLOAT64;
}

enum map_format config_format(const struct config_value *values, enum map_type type)
{
	static const uint8_t of_types[] = {
	    [MAP_SINGLE] = MAP_FORMAT_BIT,       [MAP_DOUBLE] = MAP_FORMAT_BIT,
	    [MAP_STEP] = MAP_FORMAT_VTI,         [MAP_BITSTRING] = MAP_FORMAT_UINT32,
	    [MAP_NORMALIZED] = MAP_FORMAT_INT16, [MAP_SCALED] = MAP_FORMAT_INT16,
	    [MAP_FLOAT] = MAP_FORMAT_FLOAT32,    [MAP_COUNTER] = MAP_FORMAT_INT32,
	};

	if (values[OBJECT_FORMAT].given)
		return (enum map_format)(MAP_FORMAT_INT16 + values[OBJECT_FORMAT].integer);
	if (values[OBJECT_SIGNED].given && !values[OBJECT_SIGNED].integer)
		return MAP_FORMAT_UINT16;
	return (enum map_format)of_types[type];
}

uint8_t config_width(enum map_type type, enum map_format format, enum map_table table)
{
	static const uint8_t of_formats[] = {
	    [MAP_FORMAT_BIT] = 1,     [MAP_FORMAT_VTI] = 1,   [MAP_FORMAT_INT16] = 1,
	    [MAP_FORMAT_UINT16] = 1,  [MAP_FORMAT_INT32] = 2, [MAP_FORMAT_UINT32] = 2,
	    [MAP_FORMAT_FLOAT32] = 2, [MAP_FORMAT_INT64] = 4, [MAP_FORMAT_UINT64] = 4,
	    [MAP_FORMAT_FLOAT64] = 4,
	};

	return config_is_bit_table(table) && type == MAP_DOUBLE ? 2 : of_formats[format];
}

/* ---- format and bits --------------------------------------------------------------------- */

static void check_format(struct config_loader *loader, const struct config_place *object,
			 const struct config_value *values, enum map_type type)
{
	const struct config_place format = config_object_key(object, OBJECT_FORMAT);
	const struct config_place is_signed = config_object_key(object, OBJECT_SIGNED);
	enum map_format has = config_format(values, type);

	if (!values[OBJECT_FORMAT].given)
		return;
	if (values[OBJECT_SIGNED].given)
		config_error(&loader->report, &is_signed, "has no meaning beside format, which includes it");
	if (type == MAP_BITSTRING && has != MAP_FORMAT_UINT16 && has != MAP_FORMAT_UINT32)
		config_error(&loader->report, &format,
			     "\"%s\" is not a format of type %s, expected one of uint16, uint32",
			     values[OBJECT_FORMAT].text, config_type_names[type]);
}

static void check_orders(struct config_loader *loader, const struct config_place *object,
			 const struct config_value *values, enum map_type type, enum map_table table)
{
	const struct config_place here = config_object_key(object, OBJECT_WORD_ORDER);
	const struct config_place bytes = config_object_key(object, OBJECT_BYTE_ORDER);
	bool lone = config_is_bit_table(table) || config_width(type, config_format(values, type), table) == 1;

	if (values[OBJECT_WORD_ORDER].given && lone && !values[OBJECT_FORMAT].given)
		config_error(&loader->report, &here, "has no meaning for type %s", config_type_names[type]);
	else if (values[OBJECT_WORD_ORDER].given && lone)
		config_error(&loader->report, &here, "has no meaning for format %s, which is one register",
			     values[OBJECT_FORMAT].text);
	if (values[OBJECT_BYTE_ORDER].given && config_is_bit_table(table))
		config_error(&loader->report, &bytes, "has no meaning for type %s", config_type_names[type]);
}

static void check_unimplemented(struct config_loader *loader, const struct config_place *object,
				const struct config_value *values, enum map_type type)
{
	const struct config_place here = config_object_key(object, OBJECT_UNIMPLEMENTED);

	if (values[OBJECT_UNIMPLEMENTED].given && is_floating(config_format(values, type)))
		config_error(&loader->report, &here,
			     "has no meaning for floating point: a NaN is invalid anyway");
}

/* A bit has no address of its own, so the report's scheme has no IOA for it. */
static void check_bit(struct config_loader *loader, const struct config_place *object,
		      const struct config_value *values, enum map_type type, enum map_table table)
{
	const struct config_place bit = config_object_key(object, OBJECT_BIT);
	const struct config_place ioa = config_object_key(object, OBJECT_IOA);

	if (!values[OBJECT_BIT].given)
		return;
	if (config_is_bit_table(table)) {
		config_error(&loader->report, &bit, "has no meaning for %s: each address is a bit",
			     config_table_names[table]);
		return;
	}
	if (type == MAP_DOUBLE && values[OBJECT_BIT].integer == BITS_OF_REGISTER - 1)
		config_error(&loader->report, &bit,
			     "%d is out of range for type double, which covers two bits, expected 0 to %d",
			     BITS_OF_REGISTER - 1, BITS_OF_REGISTER - 2);
	if (!values[OBJECT_IOA].given && !values[OBJECT_IOA].wrong)
		config_error(&loader->report, &ioa,
			     "is missing: a bit of a register has no IOA by itself, expected an integer");
}

/* A register is no coil: its bits have no second address and no pulses. */
static void check_register_bit(struct config_loader *loader, const struct config_place *object,
			       const struct config_value *values, enum map_table table)
{
	static const unsigned keys[] = {OBJECT_SECOND, OBJECT_SHORT_PULSE, OBJECT_LONG_PULSE};

	if (config_is_bit_table(table))
		return;
	for (size_t i = 0; i < sizeof(keys) / sizeof(keys[0]); i++) {
		const struct config_place here = config_object_key(object, keys[i]);

		if (values[keys[i]].given)
			config_error(&loader->report, &here, "has no meaning for a bit of a register");
	}
}

/* ---- scale ------------------------------------------------------------------------------- */

/* A counter that may wrap is sent as it is, or it would jump. */
static bool may_be_scaled(const struct config_value *values, enum map_type type)
{
	enum map_format format = config_format(values, type);

	return is_measured(type) ||
	       (type == MAP_COUNTER &&
		(is_floating(format) || format == MAP_FORMAT_INT64 || format == MAP_FORMAT_UINT64));
}

static void check_may_be_scaled(struct config_loader *loader, const struct config_place *object,
				const struct config_value *values, enum map_type type, unsigned key)
{
	const struct config_place here = config_object_key(object, key);

	if (!values[key].given || may_be_scaled(values, type))
		return;
	if (type == MAP_COUNTER)
		config_error(&loader->report, &here,
			     "has no meaning for a counter that wraps, expected one of format int64, "
			     "uint64, float32, float64");
	else
		config_error(&loader->report, &here, "has no meaning for type %s", config_type_names[type]);
}

static void check_scale(struct config_loader *loader, const struct config_place *object,
			const struct config_value *values, enum map_type type)
{
	const struct config_place scale = config_object_key(object, OBJECT_SCALE);

	check_may_be_scaled(loader, object, values, type, OBJECT_SCALE);
	check_may_be_scaled(loader, object, values, type, OBJECT_OFFSET);
	check_may_be_scaled(loader, object, values, type, OBJECT_SCALE_REGISTER);
	if (values[OBJECT_SCALE].given && is_zero(values[OBJECT_SCALE].number))
		config_error(&loader->report, &scale, "is 0, expected another number");
}

/* One way to scale, not two. */
static void check_scale_alone(struct config_loader *loader, const struct config_place *object,
			      const struct config_value *values)
{
	unsigned first = OBJECT_KEYS;

	for (unsigned key = OBJECT_SCALE; key <= OBJECT_SCALE_TABLE; key++) {
		const struct config_place here = config_object_key(object, key);

		if (!values[key].given)
			continue;
		if (first == OBJECT_KEYS)
			first = key;
		else if (key != OBJECT_OFFSET)
			config_error(&loader->report, &here, "has no meaning beside %s",
				     config_object_rules[first].name);
	}
}

/* One register cannot be a value and its power of ten. */
static void check_scale_register(struct config_loader *loader, const struct config_place *object,
				 const struct config_value *values, enum map_type type, enum map_table table)
{
	const struct config_place here = config_object_key(object, OBJECT_SCALE_REGISTER);
	int64_t address = values[OBJECT_ADDRESS].integer, scale = values[OBJECT_SCALE_REGISTER].integer;

	if (!values[OBJECT_SCALE_REGISTER].given || !values[OBJECT_ADDRESS].given)
		return;
	if (scale >= address && scale < address + config_width(type, config_format(values, type), table))
		config_error(&loader->report, &here,
			     "%lld is a register of the object itself, expected another", (long long)scale);
}

static bool read_finite(const json_t *json, double *number)
{
	*number = json_number_value(json);
	return json_is_number(json) && fabs(*number) <= (double)FLT_MAX;
}

/* [raw, value] */
static bool read_knot(const json_t *json, struct map_knot *knot)
{
	return json_array_size(json) == 2 && read_finite(json_array_get(json, 0), &knot->raw) &&
	       read_finite(json_array_get(json, 1), &knot->value);
}

/* Returns how many there are, 0 when one is wrong, which has been reported. */
static unsigned read_knots(struct config_loader *loader, const struct config_place *array, const json_t *json,
			   struct map_knot knots[CONFIG_KNOTS_MAX])
{
	unsigned count = (unsigned)json_array_size(json);

	for (unsigned i = 0; i < count; i++) {
		const struct config_place here = config_element_of(array, i);

		if (!read_knot(json_array_get(json, i), &knots[i]))
			config_error(&loader->report, &here, "is not a pair [raw, value] of numbers");
		else if (i > 0 && knots[i].raw <= knots[i - 1].raw)
			config_error(&loader->report, &here,
				     "has no raw value above that of the pair before");
		else
			continue;
		return 0;
	}
	return count;
}

static void check_scale_points(struct config_loader *loader, const struct config_place *object,
			       const json_t *json)
{
	const struct config_place here = config_object_key(object, OBJECT_SCALE_POINTS);
	struct map_knot knots[CONFIG_KNOTS_MAX];

	if (json_array_size(json) != 2)
		config_error(&loader->report, &here, "has %zu elements, expected two pairs [raw, value]",
			     json_array_size(json));
	else if (read_knots(loader, &here, json, knots) == 2 && is_zero(knots[1].value - knots[0].value))
		config_error(&loader->report, &here, "has the same value twice, expected two different ones");
}

/* What is written goes through the table backwards. */
static void check_reversible(struct config_loader *loader, const struct config_place *here,
			     const struct map_knot *knots, unsigned count)
{
	bool rises = knots[1].value > knots[0].value;

	for (unsigned i = 1; i < count; i++)
		if (is_zero(knots[i].value - knots[i - 1].value) ||
		    (knots[i].value > knots[i - 1].value) != rises) {
			config_error(&loader->report, here,
				     "neither rises nor falls all the way, as a value that can be commanded "
				     "needs it");
			return;
		}
}

static void check_scale_table(struct config_loader *loader, const struct config_place *object,
			      const json_t *json, enum map_table table)
{
	const struct config_place here = config_object_key(object, OBJECT_SCALE_TABLE);
	struct map_knot knots[CONFIG_KNOTS_MAX];
	unsigned count;

	if (json_array_size(json) < 2) {
		config_error(&loader->report, &here,
			     "has %zu elements, expected at least two pairs [raw, value]",
			     json_array_size(json));
		return;
	}
	count = read_knots(loader, &here, json, knots);
	if (count > 0 && config_is_writable(table))
		check_reversible(loader, &here, knots, count);
}

void config_check_value(struct config_loader *loader, const struct config_place *object,
			const struct config_value *values, enum map_type type, enum map_table table)
{
	check_format(loader, object, values, type);
	check_orders(loader, object, values, type, table);
	check_unimplemented(loader, object, values, type);
	check_bit(loader, object, values, type, table);
	if (is_of_bits(type))
		check_register_bit(loader, object, values, table);
	check_scale(loader, object, values, type);
	check_scale_alone(loader, object, values);
	check_scale_register(loader, object, values, type, table);
	if (values[OBJECT_SCALE_POINTS].given)
		check_scale_points(loader, object, values[OBJECT_SCALE_POINTS].json);
	if (values[OBJECT_SCALE_TABLE].given)
		check_scale_table(loader, object, values[OBJECT_SCALE_TABLE].json, table);
}

static void scale_by_points(const json_t *json, struct map_point *point)
{
	struct map_knot a, b;

	read_knot(json_array_get(json, 0), &a);
	read_knot(json_array_get(json, 1), &b);
	point->scale = (b.value - a.value) / (b.raw - a.raw);
	point->offset = a.value - a.raw * point->scale;
}

static bool keep_knots(struct config_loader *loader, const struct config_place *object, const json_t *json,
		       struct map_point *point)
{
	const struct config_place here = config_object_key(object, OBJECT_SCALE_TABLE);
	struct map_config *config = loader->config;
	uint32_t count = (uint32_t)json_array_size(json);
	struct map_knot *knots;

	if (config->knot_count + count > MAP_KNOTS_MAX) {
		config_error(&loader->report, &here,
			     "is too long: all tables together have more than %d pairs", MAP_KNOTS_MAX);
		return false;
	}
	knots = reallocarray(config->knots, config->knot_count + (size_t)count, sizeof(*config->knots));
	if (knots == NULL) {
		config_out_of_memory(loader);
		return false;
	}
	config->knots = knots;
	point->first_knot = (uint16_t)config->knot_count;
	point->knot_count = (uint8_t)count;
	for (uint32_t i = 0; i < count; i++)
		read_knot(json_array_get(json, i), &knots[config->knot_count++]);
	return true;
}

bool config_scale(struct config_loader *loader, const struct config_place *object,
		  const struct config_value *values, struct map_point *point)
{
	point->scale = values[OBJECT_SCALE].number;
	point->offset = values[OBJECT_OFFSET].number;
	if (values[OBJECT_SCALE_POINTS].given)
		scale_by_points(values[OBJECT_SCALE_POINTS].json, point);
	if (values[OBJECT_SCALE_TABLE].given)
		return keep_knots(loader, object, values[OBJECT_SCALE_TABLE].json, point);
	return true;
}
