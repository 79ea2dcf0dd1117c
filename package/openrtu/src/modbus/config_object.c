/* SPDX-License-Identifier: GPL-3.0-or-later */
/* One object of a slave's table, and the point it becomes. */
#include "modbus/config_object.h"

#include <float.h>
#include <math.h>
#include <string.h>

#include "config/meanings.h"

/* What lies between two bits of a double is read with them: one answer of Modbus holds it. */
#define APART_MAX 1024
/* A text changes seldom, and when its device is back all of it is read anyway. */
#define TEXT_PERIOD_MS 3600000u

static const uint32_t first_ioa[] = {1, 10001, 30001, 40001};

static enum map_type object_type(const struct config_value *values, enum modbus_table table)
{
	if (values[OBJECT_TYPE].given)
		return (enum map_type)values[OBJECT_TYPE].integer;
	if (modbus_is_bit_table(table) || values[OBJECT_BIT].given)
		return MAP_SINGLE;
	return modbus_object_is_text(values) ? MAP_BITSTRING : MAP_SCALED;
}

static void check_type(struct modbus_loader *loader, const struct config_place *object, enum map_type type,
		       enum modbus_table table, bool bit)
{
	const struct config_place here = modbus_object_key(object, OBJECT_TYPE);
	bool bits = modbus_is_bit_table(table);

	if ((bits || bit) != ((MODBUS_TYPE(type) & MODBUS_BIT_TYPES) != 0))
		config_error(loader->report, &here, "%s hold no \"%s\", expected one of %s",
			     bit ? "bits" : modbus_table_names[table], modbus_type_names[type],
			     bits || bit
				 ? "single, double"
				 : "step, bitstring, normalized, scaled, float, counter, or the key bit");
}

static void check_meaning(struct modbus_loader *loader, const struct config_place *object,
			  const struct config_value *values, enum map_type type, enum modbus_table table)
{
	for (unsigned key = 0; key < OBJECT_KEYS && !modbus_object_is_text(values); key++) {
		const struct config_place here = modbus_object_key(object, key);
		const struct modbus_applies *applies = &modbus_applies_to[key];

		if (values[key].given && applies->types != 0 && !(applies->types & MODBUS_TYPE(type)))
			config_error(loader->report, &here, "has no meaning for type %s",
				     modbus_type_names[type]);
		if (values[key].given && applies->of_commands && !modbus_is_read_alone(values) &&
		    !modbus_takes_commands(values, table))
			config_error(loader->report, &here, "has no meaning for %s: they cannot be commanded",
				     modbus_table_names[table]);
	}
}

/* Of keys about what could be written as well. */
static void check_writable(struct modbus_loader *loader, const struct config_place *object,
			   const struct config_value *values, unsigned key, enum modbus_table table)
{
	const struct config_place here = modbus_object_key(object, key);

	if (values[key].given && !modbus_is_writable(table))
		config_error(loader->report, &here, "has no meaning for %s, which cannot be written",
			     modbus_table_names[table]);
}

/* What is never read has nothing to say, and needs no second address. */
static void check_write_only(struct modbus_loader *loader, const struct config_place *object,
			     const struct config_value *values, enum modbus_table table)
{
	check_writable(loader, object, values, OBJECT_WRITE_ONLY, table);
	for (unsigned key = 0; values[OBJECT_WRITE_ONLY].integer && key < OBJECT_KEYS; key++) {
		const struct config_place here = modbus_object_key(object, key);

		if (values[key].given && modbus_applies_to[key].of_reading)
			config_error(loader->report, &here, "has no meaning beside write_only");
	}
}

/* key: that of the address of its first bit or register */
static void check_extent(struct modbus_loader *loader, const struct config_place *object, unsigned key,
			 int64_t address, enum map_type type, uint8_t width)
{
	const struct config_place here = modbus_object_key(object, key);
	static const char *const counts[] = {"no", "one", "two", "three", "four"};
	char count[8];

	snprintf(count, sizeof(count), "%u", width);
	if (address + width - 1 > MODBUS_ADDRESS_LAST)
		config_error(loader->report, &here,
			     "%lld is out of range for type %s, which covers %s addresses, expected 0 to %d",
			     (long long)address, modbus_type_names[type],
			     width < sizeof(counts) / sizeof(counts[0]) ? counts[width] : count,
			     MODBUS_ADDRESS_LAST + 1 - width);
}

static void check_second_address(struct modbus_loader *loader, const struct config_place *object,
				 int64_t address, int64_t second)
{
	const struct config_place here = modbus_object_key(object, OBJECT_SECOND);

	if (second == address)
		config_error(loader->report, &here, "is the address of the first bit, expected another one");
	else if (second > address + APART_MAX || second < address - APART_MAX)
		config_error(loader->report, &here, "is %lld away from the first bit, expected at most %d",
			     (long long)(second > address ? second - address : address - second), APART_MAX);
}

static bool is_whole(double number)
{
	return fpclassify(number - rint(number)) == FP_ZERO;
}

/* A step command needs limits, and a value that is an integer moves by integers. Limits hold for set-points without it. */
static void check_step(struct modbus_loader *loader, const struct config_place *object,
		       const struct config_value *values, enum map_type type)
{
	const struct config_place step = modbus_object_key(object, OBJECT_STEP);
	const struct config_place max = modbus_object_key(object, OBJECT_MAX);
	const bool stepped = values[OBJECT_STEP].given;

	if (values[OBJECT_STEP].wrong || values[OBJECT_MIN].wrong || values[OBJECT_MAX].wrong ||
	    !(stepped || values[OBJECT_MIN].given || values[OBJECT_MAX].given))
		return;
	for (unsigned key = OBJECT_MIN; key <= OBJECT_MAX; key++) {
		const struct config_place here = modbus_object_key(object, key);

		if (!values[key].given)
			config_error(
			    loader->report, &here,
			    "is not given: min and max belong together, and step needs both, expected "
			    "a number");
	}
	if (!values[OBJECT_MIN].given || !values[OBJECT_MAX].given)
		return;
	if (stepped && fpclassify(values[OBJECT_STEP].number) == FP_ZERO)
		config_error(loader->report, &step, "is 0, expected more");
	else if (stepped && type != MAP_FLOAT && !is_whole(values[OBJECT_STEP].number))
		config_error(loader->report, &step, "is not an integer, which type %s needs",
			     modbus_type_names[type]);
	if (values[OBJECT_MIN].number >= values[OBJECT_MAX].number)
		config_error(loader->report, &max, "is not above min");
}

/* Keys of reading. */
static void check_read_key(struct modbus_loader *loader, const struct config_place *object, unsigned key)
{
	const struct config_place here = modbus_object_key(object, key);

	if (modbus_is_broadcast(loader->config, loader->config->set_count - 1))
		config_error(loader->report, &here,
			     "has no meaning for slave 0: the broadcast address is never read");
}

static bool is_kept(const struct config_value *values)
{
	return values[OBJECT_WRITE_EVERY].given || values[OBJECT_WRITE_AT_RETURN].integer;
}

/* With another scale, the octets that stood for a value stand for another one. */
static void check_kept_scale(struct modbus_loader *loader, const struct config_place *object,
			     const struct config_value *values, unsigned key)
{
	static const unsigned of_scale[] = {OBJECT_SCALE_REGISTER, OBJECT_SCALE_BY, OBJECT_FACTOR_BY};
	const struct config_place here = modbus_object_key(object, key);

	for (size_t i = 0; i < sizeof(of_scale) / sizeof(of_scale[0]); i++)
		if (values[of_scale[i]].given)
			config_error(loader->report, &here, "has no meaning beside %s",
				     modbus_object_rules[of_scale[i]].name);
}

static void check_kept_pulse(struct modbus_loader *loader, const struct config_place *object,
			     const struct config_value *values)
{
	const struct config_place every = modbus_object_key(object, OBJECT_WRITE_EVERY);

	if (values[OBJECT_WRITE_EVERY].given &&
	    (values[OBJECT_SHORT_PULSE].given || values[OBJECT_LONG_PULSE].given))
		config_note(loader->report, &every,
			    "what is written each %lld ms overwrites a commanded pulse that is under way",
			    (long long)values[OBJECT_WRITE_EVERY].integer);
}

static void check_kept(struct modbus_loader *loader, const struct config_place *object,
		       const struct config_value *values)
{
	const struct config_place value = modbus_object_key(object, OBJECT_WRITE_VALUES);

	for (unsigned key = OBJECT_WRITE_VALUES; key <= OBJECT_WRITE_EVERY; key++)
		if (values[key].given) {
			check_read_key(loader, object, key);
			check_kept_scale(loader, object, values, key);
		}
	if (!values[OBJECT_WRITE_VALUES].given)
		return;
	check_kept_pulse(loader, object, values);
	if (json_array_size(values[OBJECT_WRITE_VALUES].json) == 0)
		config_error(loader->report, &value, "is empty, expected at least one number");
	if (!is_kept(values) && !values[OBJECT_WRITE_EVERY].wrong && !values[OBJECT_WRITE_AT_RETURN].wrong)
		config_error(loader->report, &value,
			     "are never written, expected write_at_return true or write_every_ms beside it");
}

static uint8_t point_flags(const struct config_value *values, enum modbus_table table, bool never_read)
{
	unsigned flags = 0;

	if (values[OBJECT_SELECT].integer)
		flags |= MAP_POINT_SELECT;
	if (modbus_takes_commands(values, table))
		flags |= MAP_POINT_COMMAND;
	if (!values[OBJECT_QUALITY].integer)
		flags |= MAP_POINT_NO_QUALITY;
	if (never_read)
		flags |= MAP_POINT_NEVER_READ;
	if (modbus_object_is_text(values))
		flags |= MAP_POINT_TEXT;
	return (uint8_t)flags;
}

static uint8_t wire_flags(const struct config_value *values)
{
	unsigned flags = 0;

	if (values[OBJECT_INVERTED].integer)
		flags |= MODBUS_INVERTED;
	if (values[OBJECT_UNIMPLEMENTED].integer)
		flags |= MODBUS_UNIMPLEMENTED;
	if (values[OBJECT_SCALE_REGISTER].given)
		flags |= MODBUS_SCALE_REGISTER;
	if (values[OBJECT_WRITE_ADDRESS].given)
		flags |= MODBUS_WRITTEN_ELSEWHERE;
	if (values[OBJECT_WORD_ORDER].integer)
		flags |= MODBUS_WORDS_SWAPPED;
	if (values[OBJECT_BYTE_ORDER].integer)
		flags |= MODBUS_BYTES_SWAPPED;
	if (values[OBJECT_BIT_ORDER].integer)
		flags |= MODBUS_BITS_SWAPPED;
	return (uint8_t)flags;
}

static struct map_point object_point(const struct config_value *values, enum map_type type,
				     enum modbus_table table, bool never_read)
{
	uint16_t address = (uint16_t)values[OBJECT_ADDRESS].integer;

	return (struct map_point){
	    .type = (uint8_t)type,
	    .flags = point_flags(values, table, never_read),
	    .ioa =
		values[OBJECT_IOA].given ? (uint32_t)values[OBJECT_IOA].integer : first_ioa[table] + address,
	    .group = (uint8_t)values[OBJECT_GROUP].integer,
	    .counter_group = (uint8_t)values[OBJECT_COUNTER_GROUP].integer,
	    .send_period_ms = (uint32_t)(values[OBJECT_CYCLIC].integer + values[OBJECT_BACKGROUND].integer),
	    .freeze_s = (uint32_t)values[OBJECT_FREEZE].integer,
	    .short_pulse_ms = (uint16_t)values[OBJECT_SHORT_PULSE].integer,
	    .long_pulse_ms = (uint16_t)values[OBJECT_LONG_PULSE].integer,
	    .deadband = (float)values[OBJECT_DEADBAND].number,
	    .step = (float)values[OBJECT_STEP].number,
	    .min = (float)values[OBJECT_MIN].number,
	    .max = (float)values[OBJECT_MAX].number,
	};
}

static struct modbus_point object_wire(const struct config_value *values, enum map_type type,
				       enum modbus_table table)
{
	uint16_t address = (uint16_t)values[OBJECT_ADDRESS].integer;
	const struct config_value *second =
	    &values[values[OBJECT_SCALE_REGISTER].given ? OBJECT_SCALE_REGISTER : OBJECT_SECOND];
	enum modbus_format format = modbus_object_format(values, type);

	struct modbus_point point = {
	    .address = address,
	    .second_address = (uint16_t)(second->given ? second->integer : address + 1),
	    .table = table & 3u,
	    .type = type & 31u,
	    .width = modbus_object_width(values, type, table) & 7u,
	    .format = format & 31u,
	    .flags = wire_flags(values),
	    .scan_period_ms = (uint32_t)values[OBJECT_PERIOD].integer & MODBUS_PERIOD_MAX_MS,
	};

	if (modbus_is_string(format)) {
		point.width = 0;
		point.second_address = (uint16_t)(address + values[OBJECT_LENGTH].integer - 1);
	}
	modbus_object_bits(values, &point);
	return point;
}

static uint32_t label_of(const struct modbus_point *point)
{
	static const char letters[] = {'c', 'd', 'i', 'h'}; /* of each table */

	return map_label(letters[point->table], point->address, point->bit,
			 modbus_is_register_bit(point) ? 1 : point->field);
}

static void name_point(struct modbus_loader *loader, const struct config_place *object,
		       struct modbus_entry *entry, const struct config_value *name)
{
	const struct config_place here = modbus_object_key(object, OBJECT_NAME);

	entry->named = name->given;
	entry->point.name = label_of(&entry->wire);
	if (!name->given)
		map_point_name(loader->config, &entry->point, entry->name);
	else if (snprintf(entry->name, sizeof(entry->name), "%s%s", entry->prefix, name->text) >=
		 (int)sizeof(entry->name))
		config_error(loader->report, &here, "is longer than %d bytes with its slave's name_prefix",
			     MAP_NAME_SIZE - 1);
}

static void offset_ioa(struct modbus_loader *loader, const struct config_place *object,
		       struct modbus_entry *entry)
{
	const struct config_place here = modbus_object_key(object, OBJECT_IOA);

	entry->point.ioa += entry->ioa_offset;
	if (entry->point.ioa > MODBUS_IOA_MAX)
		config_error(loader->report, &here,
			     "%u is out of range with its slave's ioa_offset, expected at "
			     "most %d",
			     entry->point.ioa, MODBUS_IOA_MAX);
}

static void check_names(struct modbus_loader *loader, const struct config_place *object,
			const struct config_value *values, enum map_type type)
{
	const struct config_place here = modbus_object_key(object, OBJECT_NAMES);
	const struct config_place step = modbus_object_key(object, OBJECT_STEP);

	config_check_meanings(loader->report, &here, type, values[OBJECT_NAMES].json);
	if (values[OBJECT_STEP].given)
		config_error(loader->report, &step,
			     "has no meaning beside names: it would reach values without one");
}

static void check_read_alone(struct modbus_loader *loader, const struct config_place *object,
			     const struct config_value *values, const char *why)
{
	for (unsigned key = 0; key < OBJECT_KEYS; key++) {
		const struct config_place here = modbus_object_key(object, key);

		if (values[key].given && !modbus_applies_to_read_alone(key))
			config_error(loader->report, &here, "has no meaning beside %s", why);
	}
}

/* What it is on is chosen before it is read: nobody chooses it for a command. */
static void check_page(struct modbus_loader *loader, const struct config_place *object,
		       const struct config_value *values, bool may_be_paged)
{
	const struct config_place page = modbus_object_key(object, OBJECT_PAGE);

	check_read_key(loader, object, OBJECT_PAGE);
	if (!may_be_paged)
		config_error(
		    loader->report, &page,
		    "has no meaning without page_address of its slave, which says where it is written");
	check_read_alone(loader, object, values, "page: what is on a page takes no commands");
}

static void check_object(struct modbus_loader *loader, const struct config_place *place,
			 const struct config_value *values, enum map_type type, enum modbus_table table,
			 bool may_be_paged)
{
	const struct config_place name = modbus_object_key(place, OBJECT_NAME);
	const uint8_t width = modbus_object_width(values, type, table);

	check_write_only(loader, place, values, table);
	if (!values[OBJECT_TYPE].wrong) {
		check_type(loader, place, type, table, values[OBJECT_BIT].given);
		check_meaning(loader, place, values, type, table);
		modbus_check_value(loader, place, values, type, table);
	}
	if (!values[OBJECT_TYPE].wrong)
		check_step(loader, place, values, type);
	if (values[OBJECT_SECOND].given && !values[OBJECT_ADDRESS].wrong)
		check_second_address(loader, place, values[OBJECT_ADDRESS].integer,
				     values[OBJECT_SECOND].integer);
	else if (!values[OBJECT_TYPE].wrong && !values[OBJECT_ADDRESS].wrong)
		check_extent(loader, place, values[OBJECT_REGISTER].given ? OBJECT_REGISTER : OBJECT_ADDRESS,
			     values[OBJECT_ADDRESS].integer, type, width);
	if (values[OBJECT_WRITE_ADDRESS].given && !values[OBJECT_TYPE].wrong)
		check_extent(loader, place, OBJECT_WRITE_ADDRESS, values[OBJECT_WRITE_ADDRESS].integer, type,
			     width);
	if (!values[OBJECT_IOA].given && !values[OBJECT_IOA].wrong && !values[OBJECT_ADDRESS].wrong &&
	    !values[OBJECT_BIT].given && !values[OBJECT_BITS].given)
		modbus_check_scheme(loader, place, values, table);
	if (values[OBJECT_NAME].given)
		config_check_name(loader->report, &name, values[OBJECT_NAME].text);
	if (values[OBJECT_NAMES].given && !values[OBJECT_TYPE].wrong)
		check_names(loader, place, values, type);
	if (values[OBJECT_PERIOD].given)
		check_read_key(loader, place, OBJECT_PERIOD);
	if (modbus_object_is_text(values))
		check_read_key(loader, place, OBJECT_FORMAT);
	if (values[OBJECT_SCALE_REGISTER].given)
		check_read_key(loader, place, OBJECT_SCALE_REGISTER);
	if (values[OBJECT_WRITE_ADDRESS].given)
		check_read_key(loader, place, OBJECT_WRITE_ADDRESS);
	if (values[OBJECT_PAGE].given)
		check_page(loader, place, values, may_be_paged);
	check_writable(loader, place, values, OBJECT_READ_ONLY, table);
	if (values[OBJECT_READ_ONLY].integer)
		check_read_alone(loader, place, values, "read_only: it takes no commands");
	check_kept(loader, place, values);
}

static void add_entry(struct modbus_loader *loader, const struct config_place *place,
		      const struct config_value *values, enum map_type type, enum modbus_table table,
		      struct modbus_entry entry)
{
	const uint32_t set = loader->config->set_count - 1;

	entry.point =
	    object_point(values, type, table,
			 values[OBJECT_WRITE_ONLY].integer || modbus_is_broadcast(loader->config, set));
	entry.write_address = (uint16_t)values[OBJECT_WRITE_ADDRESS].integer;
	entry.page = values[OBJECT_PAGE].given ? (uint32_t)values[OBJECT_PAGE].integer + 1 : 0;
	entry.is_kept = is_kept(values);
	entry.kept_every_ms = (uint32_t)values[OBJECT_WRITE_EVERY].integer;
	entry.kept_values = values[OBJECT_WRITE_VALUES].given ? values[OBJECT_WRITE_VALUES].json : NULL;
	entry.wire = object_wire(values, type, table);
	entry.point.set = (uint16_t)set;
	if (values[OBJECT_UNIT].given)
		config_keep_unit(loader->config, &entry.point, values[OBJECT_UNIT].text);
	entry.names = values[OBJECT_NAMES].given ? values[OBJECT_NAMES].json : NULL;
	entry.ln = values[OBJECT_LN].given ? values[OBJECT_LN].text : NULL;
	if (values[OBJECT_DECIMALS].given)
		entry.point.decimals = (uint8_t)(values[OBJECT_DECIMALS].integer + 1);
	if (!modbus_object_scale(loader, place, values, &entry.wire))
		return;
	if (!values[OBJECT_PERIOD].given && !(entry.point.flags & MAP_POINT_NEVER_READ))
		entry.wire.scan_period_ms =
		    (modbus_object_is_text(values) ? TEXT_PERIOD_MS : entry.period_ms) & MODBUS_PERIOD_MAX_MS;
	if (modbus_takes_commands(values, table) &&
	    !(values[OBJECT_READ_BACK].given ? values[OBJECT_READ_BACK].integer : entry.read_back))
		entry.wire.flags |= MODBUS_NO_READ_BACK;
	name_point(loader, place, &entry, &values[OBJECT_NAME]);
	offset_ioa(loader, place, &entry);
	for (unsigned i = 0; i < MODBUS_LINKS; i++)
		entry.links[i] =
		    values[OBJECT_BLOCKED_BY + i].given ? values[OBJECT_BLOCKED_BY + i].text : NULL;
	loader->entries[loader->config->point_count++] = entry;
}

/* Others call "type" what is the format here. */
static void explain_type(struct modbus_loader *loader, const struct config_place *object, const json_t *json)
{
	const struct config_place here = modbus_object_key(object, OBJECT_TYPE);
	const char *written = json_string_value(json);

	for (unsigned i = 0; written != NULL && i < MODBUS_FORMATS; i++) {
		if (modbus_formats[i].name != NULL && strcmp(modbus_formats[i].name, written) == 0)
			config_note(loader->report, &here,
				    "this is a format: write \"type\": \"float\", \"format\": \"%s\"",
				    written);
	}
}

static void read_object(struct modbus_loader *loader, const struct config_place *place,
			enum modbus_table table, struct modbus_entry entry)
{
	struct config_value values[OBJECT_KEYS];
	unsigned errors = loader->report->errors;
	enum map_type type;

	config_read_keys(loader->report, place, entry.json, modbus_object_rules, OBJECT_KEYS, values);
	if (values[OBJECT_TYPE].wrong)
		explain_type(loader, place, values[OBJECT_TYPE].json);
	modbus_read_address(loader, place, table, values);
	type = object_type(values, table);
	check_object(loader, place, values, type, table, entry.may_be_paged);
	if (loader->report->errors == errors && loader->config->point_count < loader->entries_max)
		add_entry(loader, place, values, type, table, entry);
}

/* An object has one of two keys of its address: the slave's goes before the template's. */
static void drop_other_address(json_t *both, const json_t *override)
{
	if (json_object_get(override, MODBUS_KEY_ADDRESS) != NULL)
		json_object_del(both, MODBUS_KEY_REGISTER);
	if (json_object_get(override, MODBUS_KEY_REGISTER) != NULL)
		json_object_del(both, MODBUS_KEY_ADDRESS);
}

/* What the slave has instead of a template's object. NULL: it leaves it out. */
static const json_t *overridden(struct modbus_loader *loader, const json_t *object, const json_t *overrides)
{
	const char *name = json_string_value(json_object_get(object, CONFIG_KEY_NAME));
	json_t *override = name == NULL ? NULL : json_object_get(overrides, name);
	json_t *both;

	if (!json_is_object(override))
		return json_is_null(override) ? NULL : object;
	both = json_copy((json_t *)object);
	drop_other_address(both, override);
	if (both == NULL || json_object_update(both, override) < 0 ||
	    json_array_append_new(loader->files->kept, both) < 0) {
		config_out_of_memory(loader->report);
		return object;
	}
	return both;
}

void modbus_read_objects(struct modbus_loader *loader, const struct config_place *slave,
			 const json_t *objects, enum modbus_table table, struct modbus_entry entry)
{
	const struct config_place array = config_key_of(slave, modbus_table_names[table]);
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
