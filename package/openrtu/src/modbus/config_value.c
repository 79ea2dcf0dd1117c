/* SPDX-License-Identifier: GPL-3.0-or-later */
/* How an object's registers become a value: its format, its bits, its scale. */
#include "modbus/config_object.h"

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

static bool is_floating(enum modbus_format format)
{
	return modbus_formats[format].coding == MODBUS_FLOATING;
}

enum modbus_format modbus_object_format(const struct config_value *values, enum map_type type)
{
	static const uint8_t of_types[] = {
	    [MAP_SINGLE] = MODBUS_FORMAT_BIT,       [MAP_DOUBLE] = MODBUS_FORMAT_BIT,
	    [MAP_STEP] = MODBUS_FORMAT_VTI,         [MAP_BITSTRING] = MODBUS_FORMAT_UINT32,
	    [MAP_NORMALIZED] = MODBUS_FORMAT_INT16, [MAP_SCALED] = MODBUS_FORMAT_INT16,
	    [MAP_FLOAT] = MODBUS_FORMAT_FLOAT32,    [MAP_COUNTER] = MODBUS_FORMAT_INT32,
	};

	if (values[OBJECT_FORMAT].given)
		return (enum modbus_format)(MODBUS_FORMAT_INT16 + values[OBJECT_FORMAT].integer);
	if (values[OBJECT_BITS].given || (values[OBJECT_SIGNED].given && !values[OBJECT_SIGNED].integer))
		return MODBUS_FORMAT_UINT16;
	return (enum modbus_format)of_types[type];
}

uint8_t modbus_object_width(const struct config_value *values, enum map_type type, enum modbus_table table)
{
	const enum modbus_format format = modbus_object_format(values, type);

	if (modbus_is_string(format))
		return (uint8_t)values[OBJECT_LENGTH].integer;
	return modbus_is_bit_table(table) && type == MAP_DOUBLE ? 2 : modbus_formats[format].registers;
}

/* ---- format and bits --------------------------------------------------------------------- */

static void check_format(struct modbus_loader *loader, const struct config_place *object,
			 const struct config_value *values, enum map_type type)
{
	const struct config_place format = modbus_object_key(object, OBJECT_FORMAT);
	const struct config_place is_signed = modbus_object_key(object, OBJECT_SIGNED);
	enum modbus_format has = modbus_object_format(values, type);

	if (!values[OBJECT_FORMAT].given)
		return;
	if (values[OBJECT_SIGNED].given)
		config_error(loader->report, &is_signed, "has no meaning beside format, which includes it");
	if (type == MAP_BITSTRING && has != MODBUS_FORMAT_UINT16 && has != MODBUS_FORMAT_UINT32 &&
	    !modbus_is_string(has))
		config_error(
		    loader->report, &format,
		    "\"%s\" is not a format of type %s, expected one of uint16, uint32, string, string16",
		    values[OBJECT_FORMAT].text, modbus_type_names[type]);
	if (type == MAP_COUNTER && has == MODBUS_FORMAT_FIXED24_8)
		config_error(loader->report, &format,
			     "\"%s\" is not a format of type %s, which has no fractions",
			     values[OBJECT_FORMAT].text, modbus_type_names[type]);
}

/* It is read, and nothing else. */
static void check_text(struct modbus_loader *loader, const struct config_place *object,
		       const struct config_value *values, enum map_type type)
{
	const struct config_place here = modbus_object_key(object, OBJECT_FORMAT);
	const struct config_place length = modbus_object_key(object, OBJECT_LENGTH);

	if (type != MAP_BITSTRING)
		config_error(loader->report, &here,
			     "\"%s\" is a text, which type %s does not hold, expected bitstring or no type",
			     values[OBJECT_FORMAT].text, modbus_type_names[type]);
	if (!values[OBJECT_LENGTH].given && !values[OBJECT_LENGTH].wrong)
		config_error(loader->report, &length,
			     "is missing: a text needs the number of its registers, expected 1 to %d",
			     MODBUS_TEXT_MAX);
	for (unsigned key = 0; key < OBJECT_KEYS; key++) {
		const struct config_place other = modbus_object_key(object, key);

		if (values[key].given && !modbus_applies_to_texts(key))
			config_error(loader->report, &other, "has no meaning for a text (format %s)",
				     values[OBJECT_FORMAT].text);
	}
}

static void check_length(struct modbus_loader *loader, const struct config_place *object,
			 const struct config_value *values)
{
	const struct config_place length = modbus_object_key(object, OBJECT_LENGTH);

	if (values[OBJECT_LENGTH].given && !values[OBJECT_FORMAT].wrong)
		config_error(loader->report, &length,
			     "has no meaning: it is of texts, expected format string or string16 beside it");
}

static void check_orders(struct modbus_loader *loader, const struct config_place *object,
			 const struct config_value *values, enum map_type type, enum modbus_table table)
{
	const struct config_place here = modbus_object_key(object, OBJECT_WORD_ORDER);
	const struct config_place bytes = modbus_object_key(object, OBJECT_BYTE_ORDER);
	bool lone = modbus_is_bit_table(table) || modbus_object_width(values, type, table) == 1;

	if (values[OBJECT_WORD_ORDER].given && lone && !values[OBJECT_FORMAT].given)
		config_error(loader->report, &here, "has no meaning for type %s", modbus_type_names[type]);
	else if (values[OBJECT_WORD_ORDER].given && lone)
		config_error(loader->report, &here, "has no meaning for format %s, which is one register",
			     values[OBJECT_FORMAT].text);
	if (values[OBJECT_BYTE_ORDER].given && modbus_is_bit_table(table))
		config_error(loader->report, &bytes, "has no meaning for type %s", modbus_type_names[type]);
}

static void check_unimplemented(struct modbus_loader *loader, const struct config_place *object,
				const struct config_value *values, enum map_type type)
{
	const struct config_place here = modbus_object_key(object, OBJECT_UNIMPLEMENTED);
	enum modbus_format format = modbus_object_format(values, type);

	if (!values[OBJECT_UNIMPLEMENTED].given)
		return;
	if (is_floating(format))
		config_error(loader->report, &here,
			     "has no meaning for floating point: a NaN is invalid anyway");
	else if (modbus_formats[format].coding == MODBUS_BCD || modbus_formats[format].coding == MODBUS_MOD10)
		config_error(loader->report, &here,
			     "has no meaning for format %s: what is no decimal digit is invalid anyway",
			     values[OBJECT_FORMAT].text);
}

/* What has no address of its own, the report's scheme has no IOA for. */
static void check_ioa(struct modbus_loader *loader, const struct config_place *object,
		      const struct config_value *values)
{
	const struct config_place ioa = modbus_object_key(object, OBJECT_IOA);

	if (!values[OBJECT_IOA].given && !values[OBJECT_IOA].wrong)
		config_error(loader->report, &ioa,
			     "is missing: a bit of a register has no IOA by itself, expected an integer");
}

static void check_bit(struct modbus_loader *loader, const struct config_place *object,
		      const struct config_value *values, enum map_type type, enum modbus_table table)
{
	const struct config_place bit = modbus_object_key(object, OBJECT_BIT);

	if (!values[OBJECT_BIT].given)
		return;
	if (modbus_is_bit_table(table)) {
		config_error(loader->report, &bit, "has no meaning for %s: each address is a bit",
			     modbus_table_names[table]);
		return;
	}
	if (type == MAP_DOUBLE && values[OBJECT_BIT].integer == BITS_OF_REGISTER - 1)
		config_error(loader->report, &bit,
			     "%d is out of range for type double, which covers two bits, expected 0 to %d",
			     BITS_OF_REGISTER - 1, BITS_OF_REGISTER - 2);
	check_ioa(loader, object, values);
}

/* First and last; the array has been read as one. False: these are no two such numbers. */
static bool read_bits(const json_t *json, int64_t *first, int64_t *last)
{
	const json_t *low = json_array_get(json, 0), *high = json_array_get(json, 1);

	*first = json_integer_value(low);
	*last = json_integer_value(high);
	return json_array_size(json) == 2 && json_is_integer(low) && json_is_integer(high) && *first >= 0 &&
	       *first <= *last && *last < BITS_OF_REGISTER;
}

static void check_bits(struct modbus_loader *loader, const struct config_place *object,
		       const struct config_value *values, enum map_type type, enum modbus_table table)
{
	const struct config_place bits = modbus_object_key(object, OBJECT_BITS);
	const struct config_place is_signed = modbus_object_key(object, OBJECT_SIGNED);
	enum modbus_format format = modbus_object_format(values, type);
	int64_t first, last;

	if (!values[OBJECT_BITS].given || is_of_bits(type) || modbus_is_bit_table(table))
		return;
	if (!read_bits(values[OBJECT_BITS].json, &first, &last))
		config_error(
		    loader->report, &bits,
		    "is not the first and the last bit of a register, expected two integers from 0 to "
		    "%d, the greater one last",
		    BITS_OF_REGISTER - 1);
	if (modbus_formats[format].registers > 1)
		config_error(loader->report, &bits,
			     "has no meaning for format %s, which is more than one register",
			     modbus_formats[format].name);
	if (values[OBJECT_SIGNED].given)
		config_error(loader->report, &is_signed,
			     "has no meaning beside bits: format int16 has a sign");
	check_ioa(loader, object, values);
}

void modbus_object_bits(const struct config_value *values, struct modbus_point *point)
{
	int64_t first, last;

	point->bit = (unsigned)values[OBJECT_BIT].integer & 15u;
	if (!values[OBJECT_BITS].given || !read_bits(values[OBJECT_BITS].json, &first, &last))
		return;
	point->bit = (unsigned)first & 15u;
	point->field = (unsigned)(last - first + 1) & 15u; /* all of them are no field */
}

/* A register is no coil: its bits have no second address and no pulses. */
static void check_register_bit(struct modbus_loader *loader, const struct config_place *object,
			       const struct config_value *values, enum modbus_table table)
{
	static const unsigned keys[] = {OBJECT_SECOND, OBJECT_SHORT_PULSE, OBJECT_LONG_PULSE};

	if (modbus_is_bit_table(table))
		return;
	for (size_t i = 0; i < sizeof(keys) / sizeof(keys[0]); i++) {
		const struct config_place here = modbus_object_key(object, keys[i]);

		if (values[keys[i]].given)
			config_error(loader->report, &here, "has no meaning for a bit of a register");
	}
}

/* ---- scale ------------------------------------------------------------------------------- */

/* A counter that may wrap is sent as it is, or it would jump. */
static bool may_be_scaled(const struct config_value *values, enum map_type type)
{
	enum modbus_format format = modbus_object_format(values, type);

	return is_measured(type) ||
	       (type == MAP_COUNTER && (is_floating(format) || modbus_formats[format].registers > 2));
}

static void check_may_be_scaled(struct modbus_loader *loader, const struct config_place *object,
				const struct config_value *values, enum map_type type, unsigned key)
{
	const struct config_place here = modbus_object_key(object, key);

	if (!values[key].given || may_be_scaled(values, type))
		return;
	if (type == MAP_COUNTER)
		config_error(loader->report, &here,
			     "has no meaning for a counter that wraps, expected a format of three or four "
			     "registers, or float32");
	else
		config_error(loader->report, &here, "has no meaning for type %s", modbus_type_names[type]);
}

static void check_scale(struct modbus_loader *loader, const struct config_place *object,
			const struct config_value *values, enum map_type type)
{
	const struct config_place scale = modbus_object_key(object, OBJECT_SCALE);

	check_may_be_scaled(loader, object, values, type, OBJECT_SCALE);
	check_may_be_scaled(loader, object, values, type, OBJECT_OFFSET);
	check_may_be_scaled(loader, object, values, type, OBJECT_SCALE_REGISTER);
	if (values[OBJECT_SCALE].given && is_zero(values[OBJECT_SCALE].number))
		config_error(loader->report, &scale, "is 0, expected another number");
}

/* One way to scale, not two. */
static void check_scale_alone(struct modbus_loader *loader, const struct config_place *object,
			      const struct config_value *values)
{
	unsigned first = OBJECT_KEYS;

	for (unsigned key = OBJECT_SCALE; key <= OBJECT_SCALE_TABLE; key++) {
		const struct config_place here = modbus_object_key(object, key);

		if (!values[key].given)
			continue;
		if (first == OBJECT_KEYS)
			first = key;
		else if (key != OBJECT_OFFSET)
			config_error(loader->report, &here, "has no meaning beside %s",
				     modbus_object_rules[first].name);
	}
}

/* One power of ten, and no knots that a factor would move. */
static void check_scale_links(struct modbus_loader *loader, const struct config_place *object,
			      const struct config_value *values)
{
	const struct config_place scale = modbus_object_key(object, OBJECT_SCALE_BY);
	const struct config_place factor = modbus_object_key(object, OBJECT_FACTOR_BY);

	if (values[OBJECT_SCALE_BY].given && values[OBJECT_SCALE_REGISTER].given)
		config_error(loader->report, &scale, "has no meaning beside scale_register");
	if (values[OBJECT_FACTOR_BY].given && values[OBJECT_SCALE_TABLE].given)
		config_error(loader->report, &factor, "has no meaning beside scale_table");
}

/* One register cannot be a value and its power of ten. */
static void check_scale_register(struct modbus_loader *loader, const struct config_place *object,
				 const struct config_value *values, enum map_type type,
				 enum modbus_table table)
{
	const struct config_place here = modbus_object_key(object, OBJECT_SCALE_REGISTER);
	int64_t address = values[OBJECT_ADDRESS].integer, scale = values[OBJECT_SCALE_REGISTER].integer;

	if (!values[OBJECT_SCALE_REGISTER].given || values[OBJECT_ADDRESS].wrong)
		return;
	if (scale >= address && scale < address + modbus_object_width(values, type, table))
		config_error(loader->report, &here,
			     "%lld is a register of the object itself, expected another", (long long)scale);
}

static bool read_finite(const json_t *json, double *number)
{
	*number = json_number_value(json);
	return json_is_number(json) && fabs(*number) <= (double)FLT_MAX;
}

/* [raw, value] */
static bool read_knot(const json_t *json, struct modbus_knot *knot)
{
	return json_array_size(json) == 2 && read_finite(json_array_get(json, 0), &knot->raw) &&
	       read_finite(json_array_get(json, 1), &knot->value);
}

/* Returns how many there are, 0 when one is wrong, which has been reported. */
static unsigned read_knots(struct modbus_loader *loader, const struct config_place *array, const json_t *json,
			   struct modbus_knot knots[MODBUS_OBJECT_KNOTS_MAX])
{
	unsigned count = (unsigned)json_array_size(json);

	for (unsigned i = 0; i < count; i++) {
		const struct config_place here = config_element_of(array, i);

		if (!read_knot(json_array_get(json, i), &knots[i]))
			config_error(loader->report, &here, "is not a pair [raw, value] of numbers");
		else if (i > 0 && knots[i].raw <= knots[i - 1].raw)
			config_error(loader->report, &here, "has no raw value above that of the pair before");
		else
			continue;
		return 0;
	}
	return count;
}

static void check_scale_points(struct modbus_loader *loader, const struct config_place *object,
			       const json_t *json)
{
	const struct config_place here = modbus_object_key(object, OBJECT_SCALE_POINTS);
	struct modbus_knot knots[MODBUS_OBJECT_KNOTS_MAX];

	if (json_array_size(json) != 2)
		config_error(loader->report, &here, "has %zu elements, expected two pairs [raw, value]",
			     json_array_size(json));
	else if (read_knots(loader, &here, json, knots) == 2 && is_zero(knots[1].value - knots[0].value))
		config_error(loader->report, &here, "has the same value twice, expected two different ones");
}

/* What is written goes through the table backwards. */
static void check_reversible(struct modbus_loader *loader, const struct config_place *here,
			     const struct modbus_knot *knots, unsigned count)
{
	bool rises = knots[1].value > knots[0].value;

	for (unsigned i = 1; i < count; i++)
		if (is_zero(knots[i].value - knots[i - 1].value) ||
		    (knots[i].value > knots[i - 1].value) != rises) {
			config_error(loader->report, here,
				     "must rise all the way or fall all the way, because the value can be "
				     "commanded");
			return;
		}
}

static void check_scale_table(struct modbus_loader *loader, const struct config_place *object,
			      const json_t *json, bool commanded)
{
	const struct config_place here = modbus_object_key(object, OBJECT_SCALE_TABLE);
	struct modbus_knot knots[MODBUS_OBJECT_KNOTS_MAX];
	unsigned count;

	if (json_array_size(json) < 2) {
		config_error(loader->report, &here,
			     "has %zu elements, expected at least two pairs [raw, value]",
			     json_array_size(json));
		return;
	}
	count = read_knots(loader, &here, json, knots);
	if (count > 0 && commanded)
		check_reversible(loader, &here, knots, count);
}

void modbus_check_value(struct modbus_loader *loader, const struct config_place *object,
			const struct config_value *values, enum map_type type, enum modbus_table table)
{
	check_format(loader, object, values, type);
	if (modbus_object_is_text(values)) {
		check_text(loader, object, values, type);
		return;
	}
	check_length(loader, object, values);
	check_orders(loader, object, values, type, table);
	check_unimplemented(loader, object, values, type);
	check_bit(loader, object, values, type, table);
	check_bits(loader, object, values, type, table);
	if (is_of_bits(type))
		check_register_bit(loader, object, values, table);
	check_scale(loader, object, values, type);
	check_scale_alone(loader, object, values);
	check_scale_register(loader, object, values, type, table);
	check_scale_links(loader, object, values);
	if (values[OBJECT_SCALE_POINTS].given)
		check_scale_points(loader, object, values[OBJECT_SCALE_POINTS].json);
	if (values[OBJECT_SCALE_TABLE].given)
		check_scale_table(loader, object, values[OBJECT_SCALE_TABLE].json,
				  modbus_takes_commands(values, table));
}

static void scale_by_points(const json_t *json, struct modbus_point *point)
{
	struct modbus_knot a, b;

	read_knot(json_array_get(json, 0), &a);
	read_knot(json_array_get(json, 1), &b);
	point->scale = (b.value - a.value) / (b.raw - a.raw);
	point->offset = a.value - a.raw * point->scale;
}

static bool keep_knots(struct modbus_loader *loader, const struct config_place *object, const json_t *json,
		       struct modbus_point *point)
{
	const struct config_place here = modbus_object_key(object, OBJECT_SCALE_TABLE);
	struct map_config *config = loader->config;
	uint32_t count = (uint32_t)json_array_size(json);
	uint32_t used = map_record_count(config, MODBUS_KNOTS);
	struct modbus_knot *knots;

	if (used + count > MODBUS_KNOTS_MAX) {
		config_error(loader->report, &here,
			     "is too long: all tables together have more than %d pairs", MODBUS_KNOTS_MAX);
		return false;
	}
	knots = reallocarray(modbus_knots(config), used + (size_t)count, sizeof(*knots));
	if (knots == NULL) {
		config_out_of_memory(loader->report);
		return false;
	}
	map_move_section(config, MODBUS_KNOTS, knots);
	point->first_knot = (uint16_t)used;
	point->knot_count = count & 63u;
	for (uint32_t i = 0; i < count; i++)
		read_knot(json_array_get(json, i), map_next_record(config, MODBUS_KNOTS));
	return true;
}

bool modbus_object_scale(struct modbus_loader *loader, const struct config_place *object,
			 const struct config_value *values, struct modbus_point *point)
{
	point->scale = values[OBJECT_SCALE].number;
	point->offset = values[OBJECT_OFFSET].number;
	if (values[OBJECT_SCALE_POINTS].given)
		scale_by_points(values[OBJECT_SCALE_POINTS].json, point);
	if (values[OBJECT_SCALE_TABLE].given)
		return keep_knots(loader, object, values[OBJECT_SCALE_TABLE].json, point);
	return true;
}
