/* SPDX-License-Identifier: GPL-3.0-or-later */
#include "iec61850/value.h"

#include <float.h>
#include <stdio.h>
#include <string.h>

#include "iec61850/leaf.h"
#include "iec61850/tags.h"
#include "map/limits.h"
#include "map/type.h"
#include "quality/quality.h"

/* Of TypeSpecification. */
enum { COMPONENTS = 0xa1, COMPONENT_NAME = 0x80, COMPONENT_TYPE = 0xa1, FLOAT_TYPE = 0xa7 };

#define DAYS_TO_1984   5113  /* from 1970: binary times count from there */
#define NORMALIZED_ONE 32768 /* what a normalized value of 1 is in the map */
#define EXPONENT_WIDTH 8     /* of a number of 32 bits after IEEE 754 */

/* Values of Mod, Beh, Health (IEC 61850-7-3, 7-4). */
enum { TRANSIENT_BIT = 1 }; /* of a step position's detail */
enum { MODE_ON = 1, HEALTH_OK = 1, HEALTH_ALARM = 3 };

/* A data object as it is now. */
struct state {
	int64_t number;
	float real;
	bool transient;
	bool selected;
	enum map_range range;
	uint16_t quality;
	uint8_t time[8];
	const struct iec61850_object *object; /* of which it is */
	const struct iec61850_block *block;   /* NULL: it is no control block */
};

/* ---- time ------------------------------------------------------------------------------ */

/* How many bits of the fraction of a second are right. */
static uint8_t accuracy(uint32_t error_us)
{
	uint8_t bits = 0;

	while (bits < 24 && (uint64_t)error_us << (bits + 1) <= US_PER_S)
		bits++;
	return bits;
}

void iec61850_time_of(int64_t wall_ns, const struct map_clock *clock, uint8_t out[8])
{
	enum { LEAP_SECONDS_KNOWN = 0x80, NOT_SYNCHRONISED = 0x20, UNSPECIFIED = 0x1f };
	const bool positive = wall_ns > 0;
	const uint32_t seconds = positive ? (uint32_t)(wall_ns / NS_PER_S) : 0;
	const uint32_t fraction =
	    positive ? (uint32_t)(((uint64_t)(wall_ns % NS_PER_S) << 24) / NS_PER_S) : 0;
	uint8_t quality = UNSPECIFIED;

	if (clock->set && clock->source == MAP_CLOCK_SYNCHRONISED)
		quality = LEAP_SECONDS_KNOWN | accuracy(clock->error_us);
	if (!clock->set || clock->source == MAP_CLOCK_HELD || !positive)
		quality |= NOT_SYNCHRONISED;
	for (unsigned i = 0; i < 4; i++)
		out[i] = (uint8_t)(seconds >> (24 - 8 * i));
	for (unsigned i = 0; i < 3; i++)
		out[4 + i] = (uint8_t)(fraction >> (16 - 8 * i));
	out[7] = quality;
}

/* ---- the state of a data object ---------------------------------------------------------- */

static void set_time(const struct iec61850_model *model, int64_t time_ns, struct state *out)
{
	const struct map_clock clock = map_clock_read(model->map);

	iec61850_time_of(time_ns == 0 ? 0 : map_wall_ns(clock, time_ns), &clock, out->time);
}

/* Of before a power cut all that is known of the clock is whether it was set. */
static void set_former_time(int64_t wall_ns, uint8_t time, struct state *out)
{
	const struct map_clock clock = {.set = time == MAP_TIME_WALL, .source = MAP_CLOCK_BY_MASTER};

	iec61850_time_of(wall_ns, &clock, out->time);
}

static void set_sample(const struct iec61850_model *model, uint32_t number, struct map_sample sample,
		       struct state *out)
{
	const struct map_point *point = &model->config->points[number];

	switch (map_class_of(point)) {
	case MAP_CLASS_STATE:
	case MAP_CLASS_PATTERN:
		out->number = (int32_t)sample.value.u; /* 32 bits, as an INT32 has them */
		break;
	case MAP_CLASS_POSITION:
	case MAP_CLASS_TOTAL:
		out->number = sample.value.i;
		break;
	case MAP_CLASS_MEASURED:
		out->number = point->type == MAP_INTEGER ? sample.value.i : 0;
		out->real = (float)map_number(point->type, sample.value);
		if (point->type == MAP_NORMALIZED)
			out->real /= NORMALIZED_ONE;
		break;
	}
	out->range = map_range_of(model->config, number, sample.value);
	out->transient = point->type == MAP_STEP && (sample.detail & TRANSIENT_BIT) != 0;
	out->quality = quality_of_map(sample.quality);
	set_time(model, sample.time_ns, out);
}

/*
 * t is the time of the last change (IEC 61850-7-3, common data classes); the map has that of the last reading. Within a deadband no
 * event tells of a change.
 */
bool iec61850_read_point(const struct iec61850_model *model, uint32_t number, struct map_sample *out)
{
	const struct map_sample *image = &model->image[number];

	if (!map_read(model->map, number, out))
		return false;
	if (image->time_ns != 0 && model->config->points[number].deadband == 0 &&
	    image->value.u == out->value.u && image->quality == out->quality && image->detail == out->detail)
		out->time_ns = image->time_ns;
	return true;
}

bool iec61850_is_selected(const struct iec61850_model *model, uint32_t point)
{
	struct map_command command;

	return map_command_read(model->map, point, &command) && command.state == MAP_ACCEPTED_SELECTION;
}

static bool load_point(const struct iec61850_model *model, uint32_t number, struct state *out)
{
	struct map_sample sample;

	if (!iec61850_read_point(model, number, &sample))
		return false;
	set_sample(model, number, sample, out);
	out->selected = iec61850_is_selected(model, number);
	return true;
}

/* A device is well while one of its points is valid. The time is that of the point by which it was seen. */
static bool load_health(const struct iec61850_model *model, const struct iec61850_device *device,
			struct state *out)
{
	struct map_sample sample = {.quality = MAP_INVALID};

	for (uint32_t i = 0; i < device->count && (sample.quality & MAP_INVALID); i++)
		if (!iec61850_read_point(model, model->points[device->first + i], &sample))
			return false;
	out->number = sample.quality & MAP_INVALID ? HEALTH_ALARM : HEALTH_OK;
	set_time(model, sample.time_ns, out);
	return true;
}

/* What a class has to have, and no point is. An enumeration has no 0. */
static void set_unknown(enum iec61850_enumeration enumeration, struct state *out)
{
	out->number = enumeration != IEC61850_NO_ENUMERATION;
	out->quality = quality_of_map(MAP_INVALID);
	memset(out->time, 0, sizeof(out->time));
}

static bool load(const struct iec61850_model *model, const struct iec61850_object *object, struct state *out)
{
	enum iec61850_enumeration enumeration;
	uint32_t point;

	*out = (struct state){.number = MODE_ON,
			      .object = object,
			      .block = iec61850_block_of(object->device, object->ln, object->number)};
	if (out->block != NULL)
		return true;
	point = iec61850_point_of(model, object);
	if (object->fc == IEC61850_CO) {
		out->number = 0;
		return true;
	}
	if (point != MAP_NONE)
		return load_point(model, point, out);
	set_time(model, model->started_ns, out);
	enumeration = iec61850_class_of(model, object).enumeration;
	if (enumeration == IEC61850_HEALTH_KIND)
		return load_health(model, object->device, out);
	if (object->ln >= IEC61850_LNS_FIXED && enumeration != IEC61850_BEHAVIOUR_KIND)
		set_unknown(enumeration, out);
	return true; /* Mod and Beh are on; Proxy is true, since another device is shown */
}

/* ---- values ------------------------------------------------------------------------------ */

void iec61850_put_bits(struct ber_writer *writer, uint16_t bits, unsigned count)
{
	const uint8_t octets[] = {(uint8_t)((8 - count % 8) % 8), (uint8_t)(bits >> 8), (uint8_t)bits};

	ber_put(writer, IEC61850_TAG_BIT_STRING, octets, 1 + (count + 7) / 8);
}

static void put_float(struct ber_writer *writer, float value)
{
	uint8_t octets[5] = {EXPONENT_WIDTH};
	uint32_t bits;

	memcpy(&bits, &value, sizeof(bits));
	for (unsigned i = 0; i < 4; i++)
		octets[1 + i] = (uint8_t)(bits >> (24 - 8 * i));
	ber_put(writer, IEC61850_TAG_FLOATING_POINT, octets, sizeof(octets));
}

void iec61850_put_reference(struct ber_writer *writer, const struct iec61850_model *model,
			    const struct iec61850_device *device, const char *name)
{
	char text[IEC61850_REFERENCE_SIZE], ld[IEC61850_NAME_SIZE];

	iec61850_device_name(model, device, ld);
	snprintf(text, sizeof(text), "%s/%s", ld, name);
	ber_put_text(writer, IEC61850_TAG_VISIBLE_STRING, text);
}

void iec61850_set_reference(const struct iec61850_model *model, const struct iec61850_device *device,
			    const struct iec61850_set *set, char out[IEC61850_REFERENCE_SIZE])
{
	char ld[IEC61850_NAME_SIZE], name[IEC61850_NAME_SIZE];

	iec61850_device_name(model, device, ld);
	iec61850_set_name(set, name);
	snprintf(out, IEC61850_REFERENCE_SIZE, "%s%s%s", set->ln == NULL ? "@" : ld,
		 set->ln == NULL ? "" : "/", name);
}

void iec61850_put_binary_time(struct ber_writer *writer, int64_t wall_ns)
{
	const int64_t day_ms = S_PER_DAY * MS_PER_S, first_ms = DAYS_TO_1984 * day_ms;
	const int64_t wall_ms = wall_ns / NS_PER_MS < first_ms ? first_ms : wall_ns / NS_PER_MS;
	const int64_t days = wall_ms / day_ms - DAYS_TO_1984;
	const uint32_t ms = (uint32_t)(wall_ms % day_ms);
	const uint8_t octets[] = {(uint8_t)(ms >> 24), (uint8_t)(ms >> 16),  (uint8_t)(ms >> 8),
				  (uint8_t)ms,         (uint8_t)(days >> 8), (uint8_t)days};

	ber_put(writer, IEC61850_TAG_BINARY_TIME, octets, sizeof(octets));
}

void iec61850_put_entry_id(struct ber_writer *writer, const struct iec61850_model *model, uint32_t number)
{
	const uint32_t start = number != 0 ? iec61850_buffer_start(&model->buffer, number) : 0;
	uint8_t octets[IEC61850_ENTRY_ID_OCTETS];

	for (unsigned i = 0; i < 4; i++) {
		octets[i] = (uint8_t)(start >> (24 - 8 * i));
		octets[4 + i] = (uint8_t)(number >> (24 - 8 * i));
	}
	ber_put(writer, IEC61850_TAG_OCTET_STRING, octets, sizeof(octets));
}

void iec61850_put_block_id(struct ber_writer *writer, const struct iec61850_model *model,
			   const struct iec61850_object *object, const struct iec61850_block *block)
{
	char name[IEC61850_NAME_SIZE];

	if (block->id[0] != '\0') {
		ber_put_text(writer, IEC61850_TAG_VISIBLE_STRING, block->id);
		return;
	}
	iec61850_object_name(model, object, name);
	iec61850_put_reference(writer, model, object->device, name);
}

/* Mod, the other one that has a ctlModel, only shows. */
static enum iec61850_ctl_kind control_model(const struct iec61850_model *model,
					    const struct iec61850_object *object)
{
	const uint32_t point = iec61850_point_of(model, object);

	return point == MAP_NONE ? IEC61850_STATUS_ONLY : iec61850_ctl_model(model, point);
}

static const struct map_point *config_of(const struct iec61850_model *model,
					 const struct iec61850_object *object)
{
	return &model->config->points[iec61850_point_of(model, object)];
}

static struct iec61850_unit unit_of(const struct iec61850_model *model, const struct iec61850_object *object)
{
	return iec61850_unit_of(model, config_of(model, object));
}

/* In the unit of the value sent. */
static float number_of(const struct map_config *config, uint32_t point, enum iec61850_leaf leaf)
{
	switch (leaf) {
	case IEC61850_LEAST:
		return config->points[point].min;
	case IEC61850_MOST:
		return config->points[point].max;
	case IEC61850_STEP_SIZE:
		return config->points[point].step;
	case IEC61850_HIGH_HIGH:
		return map_limits_of(config, point)->high_high;
	case IEC61850_HIGH:
		return map_limits_of(config, point)->high;
	case IEC61850_LOW:
		return map_limits_of(config, point)->low;
	case IEC61850_LOW_LOW:
		return map_limits_of(config, point)->low_low;
	case IEC61850_MEASURED_LEAST:
		return -FLT_MAX;
	case IEC61850_MEASURED_MOST:
		return FLT_MAX;
	default:
		return config->points[point].deadband;
	}
}

float iec61850_limit_of(const struct iec61850_model *model, const struct iec61850_object *object,
			enum iec61850_leaf leaf)
{
	const struct map_point *point = config_of(model, object);
	const float value = number_of(model->config, iec61850_point_of(model, object), leaf);

	return point->type == MAP_NORMALIZED ? value / NORMALIZED_ONE : value;
}

/* The address of the client that has the block, or for which it is kept: 4 octets or 16; nobody: none (7-2, 17.2.2.16). */
static void put_owner(struct ber_writer *writer, const struct iec61850_block *block)
{
	static const uint8_t mapped[] = {0, 0, 0, 0, 0, 0, 0, 0, 0, 0, 0xff, 0xff};
	const uint8_t *octets = block->peer.octets;
	size_t skipped = memcmp(octets, mapped, sizeof(mapped)) == 0 ? sizeof(mapped) : 0;

	if (block->owner == NULL && block->reserved_ns == 0)
		skipped = sizeof(block->peer.octets);
	ber_put(writer, IEC61850_TAG_OCTET_STRING, octets + skipped, sizeof(block->peer.octets) - skipped);
}

/* One switch, though it is long: the compiler names the attribute that has no value. */
static void put_node(struct ber_writer *writer, const struct iec61850_model *model,
		     const struct iec61850_node *node, const struct state *state)
{
	const size_t end = writer->at;
	char number[11], reference[IEC61850_REFERENCE_SIZE], description[MAP_NAME_SIZE];

	switch (node->leaf) {
	case IEC61850_STRUCTURE:
	case IEC61850_SBOW:
	case IEC61850_OPER:
	case IEC61850_CANCEL:
		for (unsigned i = node->count; i-- > 0;)
			put_node(writer, model, &node->children[i], state);
		ber_close(writer, IEC61850_TAG_STRUCTURE, end);
		return;
	case IEC61850_BOOLEAN:
		ber_put(writer, IEC61850_TAG_BOOLEAN, (const uint8_t[]){state->number != 0 ? 1 : 0}, 1);
		return;
	case IEC61850_DOUBLE:
		iec61850_put_bits(writer, (uint16_t)((state->number & 3) << 14), 2);
		return;
	case IEC61850_ENUM:
	case IEC61850_STEP:
		ber_put_integer(writer, IEC61850_TAG_INTEGER, (int8_t)state->number);
		return;
	case IEC61850_INTEGER:
	case IEC61850_TOTAL:
		ber_put_integer(writer, IEC61850_TAG_INTEGER, state->number);
		return;
	case IEC61850_RANGE:
		ber_put_integer(writer, IEC61850_TAG_INTEGER, state->range);
		return;
	case IEC61850_DIRECTION:
		ber_put_integer(writer, IEC61850_TAG_INTEGER, 0);
		return;
	case IEC61850_TRANSIENT:
	case IEC61850_PERSISTENT:
		ber_put(writer, IEC61850_TAG_BOOLEAN,
			(const uint8_t[]){node->leaf == IEC61850_TRANSIENT && state->transient}, 1);
		return;
	case IEC61850_FLOAT:
		put_float(writer, state->real);
		return;
	case IEC61850_UNIT:
		put_float(writer, 1.0f);
		return;
	case IEC61850_SI_UNIT:
		ber_put_integer(writer, IEC61850_TAG_INTEGER, unit_of(model, state->object).si);
		return;
	case IEC61850_MULTIPLIER:
		ber_put_integer(writer, IEC61850_TAG_INTEGER, unit_of(model, state->object).exponent);
		return;
	case IEC61850_DEADBAND:
		ber_put_integer(writer, IEC61850_TAG_UNSIGNED, IEC61850_DEADBAND_WHOLE);
		return;
	case IEC61850_DEADBAND_REF:
	case IEC61850_LEAST:
	case IEC61850_MOST:
	case IEC61850_STEP_SIZE:
	case IEC61850_HIGH_HIGH:
	case IEC61850_HIGH:
	case IEC61850_LOW:
	case IEC61850_LOW_LOW:
	case IEC61850_MEASURED_LEAST:
	case IEC61850_MEASURED_MOST:
		put_float(writer, iec61850_limit_of(model, state->object, node->leaf));
		return;
	case IEC61850_CTL_MODEL:
		ber_put_integer(writer, IEC61850_TAG_INTEGER, control_model(model, state->object));
		return;
	case IEC61850_SELD:
		ber_put(writer, IEC61850_TAG_BOOLEAN, (const uint8_t[]){state->selected}, 1);
		return;
	case IEC61850_SBO_TIMEOUT:
		ber_put_integer(writer, IEC61850_TAG_UNSIGNED, map_select_timeout_s(model->map) * MS_PER_S);
		return;
	case IEC61850_OPER_TIMEOUT:
		ber_put_integer(writer, IEC61850_TAG_UNSIGNED, map_command_timeout_s(model->map) * MS_PER_S);
		return;
	case IEC61850_QUALITY:
		iec61850_put_bits(writer, state->quality, QUALITY_BITS);
		return;
	case IEC61850_TIME:
		ber_put(writer, IEC61850_TAG_UTC_TIME, state->time, sizeof(state->time));
		return;
	case IEC61850_DESCRIPTION:
		iec61850_description(model, state->object, description);
		ber_put_text(writer, IEC61850_TAG_VISIBLE_STRING, description);
		return;
	case IEC61850_VENDOR:
		ber_put_text(writer, IEC61850_TAG_VISIBLE_STRING, "OpenRTU");
		return;
	case IEC61850_REVISION:
		ber_put_text(writer, IEC61850_TAG_VISIBLE_STRING, OPENRTU_VERSION);
		return;
	case IEC61850_CONFIGURATION:
		snprintf(number, sizeof(number), "%08x", (unsigned)model->revision);
		ber_put_text(writer, IEC61850_TAG_VISIBLE_STRING, number);
		return;
	case IEC61850_NAME_SPACE:
		ber_put_text(writer, IEC61850_TAG_VISIBLE_STRING, IEC61850_DATA_NAME_SPACE);
		return;
	case IEC61850_SBO:
		ber_put(writer, IEC61850_TAG_VISIBLE_STRING, NULL, 0);
		return;
	case IEC61850_OR_IDENT:
		ber_put(writer, IEC61850_TAG_OCTET_STRING, NULL, 0);
		return;
	case IEC61850_CTL_NUM:
		ber_put_integer(writer, IEC61850_TAG_UNSIGNED, 0);
		return;
	case IEC61850_CHECK:
		iec61850_put_bits(writer, 0, 2);
		return;
	case IEC61850_RPT_ID:
		iec61850_put_block_id(writer, model, state->object, state->block);
		return;
	case IEC61850_DAT_SET:
		iec61850_set_reference(model, state->object->device, iec61850_set_of(model, state->block),
				       reference);
		ber_put_text(writer, IEC61850_TAG_VISIBLE_STRING, reference);
		return;
	case IEC61850_RPT_ENA:
		ber_put(writer, IEC61850_TAG_BOOLEAN, (const uint8_t[]){state->block->enabled}, 1);
		return;
	case IEC61850_RESV:
		ber_put(writer, IEC61850_TAG_BOOLEAN, (const uint8_t[]){state->block->owner != NULL}, 1);
		return;
	case IEC61850_GI:
	case IEC61850_PURGE_BUF:
		ber_put(writer, IEC61850_TAG_BOOLEAN, (const uint8_t[]){0}, 1);
		return;
	case IEC61850_CONF_REV:
		ber_put_integer(writer, IEC61850_TAG_UNSIGNED,
				iec61850_set_of(model, state->block)->revision);
		return;
	case IEC61850_OPT_FLDS:
		iec61850_put_bits(writer, state->block->options, 10);
		return;
	case IEC61850_TRG_OPS:
		iec61850_put_bits(writer, (uint16_t)(state->block->triggers << 8), 6);
		return;
	case IEC61850_BUF_TM:
		ber_put_integer(writer, IEC61850_TAG_UNSIGNED, state->block->buffer_ms);
		return;
	case IEC61850_INTG_PD:
		ber_put_integer(writer, IEC61850_TAG_UNSIGNED, state->block->integrity_ms);
		return;
	case IEC61850_SQ_NUM:
		ber_put_integer(writer, IEC61850_TAG_UNSIGNED, (uint8_t)state->block->number);
		return;
	case IEC61850_LONG_SQ_NUM:
		ber_put_integer(writer, IEC61850_TAG_UNSIGNED, state->block->number);
		return;
	case IEC61850_ENTRY_ID:
		iec61850_put_entry_id(writer, model, state->block->kept->next - 1);
		return;
	case IEC61850_TIME_OF_ENTRY:
		iec61850_put_binary_time(writer, state->block->kept->told_ns);
		return;
	case IEC61850_RESV_TMS:
		ber_put_integer(writer, IEC61850_TAG_INTEGER, state->block->kept->reserved_s);
		return;
	case IEC61850_OWNER:
		put_owner(writer, state->block);
		return;
	}
}

void iec61850_put_sample(struct ber_writer *writer, const struct iec61850_model *model,
			 const struct iec61850_object *object, const struct map_sample *sample, uint8_t time,
			 bool selected)
{
	const struct iec61850_nodes inside = iec61850_nodes_of(model, object->device, object->ln,
							       object->number, (enum iec61850_fc)object->fc);
	const size_t end = writer->at;
	struct state state = {.object = object, .selected = selected};

	set_sample(model, iec61850_point_of(model, object), *sample, &state);
	if (time != MAP_TIME_MONOTONIC)
		set_former_time(sample->time_ns, time, &state);
	if (object->node != NULL) {
		put_node(writer, model, object->node, &state);
		return;
	}
	for (unsigned i = inside.count; i-- > 0;)
		put_node(writer, model, &inside.nodes[i], &state);
	ber_close(writer, IEC61850_TAG_STRUCTURE, end);
}

static bool put_object(struct ber_writer *writer, const struct iec61850_model *model,
		       const struct iec61850_object *object, struct iec61850_nodes inside)
{
	const size_t end = writer->at;
	struct state state;

	if (!load(model, object, &state))
		return false;
	if (object->node != NULL) {
		put_node(writer, model, object->node, &state);
		return true;
	}
	for (unsigned i = inside.count; i-- > 0;)
		put_node(writer, model, &inside.nodes[i], &state);
	ber_close(writer, IEC61850_TAG_STRUCTURE, end);
	return true;
}

static struct iec61850_nodes inside_of(const struct iec61850_model *model,
				       const struct iec61850_object *object)
{
	return iec61850_nodes_of(model, object->device, object->ln, object->number,
				 (enum iec61850_fc)object->fc);
}

/* All data objects under a functional constraint. */
static bool put_fc(struct ber_writer *writer, const struct iec61850_model *model,
		   const struct iec61850_object *object)
{
	const size_t end = writer->at;
	struct iec61850_object each = *object;

	for (each.number = iec61850_object_count(object->device, object->ln); each.number-- > 0;) {
		const struct iec61850_nodes inside = inside_of(model, &each);

		if (inside.count > 0 && !writer->full && !put_object(writer, model, &each, inside))
			return false;
	}
	ber_close(writer, IEC61850_TAG_STRUCTURE, end);
	return true;
}

static bool put_ln(struct ber_writer *writer, const struct iec61850_model *model,
		   const struct iec61850_object *object)
{
	const size_t end = writer->at;
	struct iec61850_object each = *object;

	for (each.fc = IEC61850_FCS; each.fc-- > 0;)
		if (iec61850_has(model, object->device, object->ln, (enum iec61850_fc)each.fc) &&
		    !put_fc(writer, model, &each))
			return false;
	ber_close(writer, IEC61850_TAG_STRUCTURE, end);
	return true;
}

bool iec61850_put_value(struct ber_writer *writer, const struct iec61850_model *model,
			const struct iec61850_object *object)
{
	if (object->fc == IEC61850_WHOLE)
		return put_ln(writer, model, object);
	if (object->number == IEC61850_WHOLE)
		return put_fc(writer, model, object);
	return put_object(writer, model, object, inside_of(model, object));
}

/* ---- types ------------------------------------------------------------------------------- */

/* Puts a name before the type that writer holds since end. */
static void name_component(struct ber_writer *writer, const char *name, size_t end)
{
	ber_close(writer, COMPONENT_TYPE, end);
	ber_put_text(writer, COMPONENT_NAME, name);
	ber_close(writer, BER_SEQUENCE, end);
}

/* Puts a structure around the components that writer holds since end. */
static void close_type(struct ber_writer *writer, size_t end)
{
	ber_close(writer, COMPONENTS, end);
	ber_close(writer, IEC61850_TAG_STRUCTURE, end);
}

static void put_nodes_type(struct ber_writer *writer, struct iec61850_nodes inside);

static void put_node_type(struct ber_writer *writer, const struct iec61850_node *node)
{
	const struct iec61850_leaf_type *type = &iec61850_leaf_types[node->leaf];
	const size_t end = writer->at;

	switch (type->tag) {
	case IEC61850_TAG_STRUCTURE:
		put_nodes_type(writer, (struct iec61850_nodes){node->children, node->count});
		return;
	case IEC61850_TAG_FLOATING_POINT:
		ber_put_integer(writer, BER_INTEGER, EXPONENT_WIDTH);
		ber_put_integer(writer, BER_INTEGER, type->size);
		ber_close(writer, FLOAT_TYPE, end);
		return;
	case IEC61850_TAG_BINARY_TIME:
		ber_put(writer, type->tag, (const uint8_t[]){1}, 1); /* with the date */
		return;
	case IEC61850_TAG_BOOLEAN:
	case IEC61850_TAG_UTC_TIME:
		ber_put(writer, type->tag, NULL, 0);
		return;
	default:
		ber_put_integer(writer, type->tag, type->size);
	}
}

static void put_nodes_type(struct ber_writer *writer, struct iec61850_nodes inside)
{
	const size_t end = writer->at;

	for (unsigned i = inside.count; i-- > 0;) {
		const size_t component = writer->at;

		put_node_type(writer, &inside.nodes[i]);
		name_component(writer, inside.nodes[i].name, component);
	}
	close_type(writer, end);
}

static void put_fc_type(struct ber_writer *writer, const struct iec61850_model *model,
			const struct iec61850_object *object)
{
	const size_t end = writer->at;
	struct iec61850_object each = *object;

	for (each.number = iec61850_object_count(object->device, object->ln); each.number-- > 0;) {
		const struct iec61850_nodes inside = inside_of(model, &each);
		const size_t component = writer->at;
		char name[IEC61850_NAME_SIZE];

		if (inside.count == 0 || writer->full)
			continue;
		put_nodes_type(writer, inside);
		iec61850_object_name(model, &each, name);
		name_component(writer, strrchr(name, '$') + 1, component);
	}
	close_type(writer, end);
}

static void put_ln_type(struct ber_writer *writer, const struct iec61850_model *model,
			const struct iec61850_object *object)
{
	const size_t end = writer->at;
	struct iec61850_object each = *object;

	for (each.fc = IEC61850_FCS; each.fc-- > 0;) {
		const size_t component = writer->at;

		if (!iec61850_has(model, object->device, object->ln, (enum iec61850_fc)each.fc))
			continue;
		put_fc_type(writer, model, &each);
		name_component(writer, iec61850_fc_name(each.fc), component);
	}
	close_type(writer, end);
}

void iec61850_put_type(struct ber_writer *writer, const struct iec61850_model *model,
		       const struct iec61850_object *object)
{
	if (object->fc == IEC61850_WHOLE)
		put_ln_type(writer, model, object);
	else if (object->number == IEC61850_WHOLE)
		put_fc_type(writer, model, object);
	else if (object->node != NULL)
		put_node_type(writer, object->node);
	else
		put_nodes_type(writer, inside_of(model, object));
}
