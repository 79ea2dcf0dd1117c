/* SPDX-License-Identifier: GPL-3.0-or-later */
/* Points and their values: rtuPoints, rtuTotals. */
#include "map/text.h"
#include "snmp/agent.h"

void snmp_point_index(const struct snmp_agent *agent, enum snmp_list list, uint32_t row,
		      uint32_t out[SNMP_INDEX_MAX])
{
	const uint32_t point = agent->lists[list].points[row];

	out[0] = snmp_ca(agent, point);
	out[1] = agent->config->points[point].ioa;
}

#define ROWS(name, list)                                                                                     \
	static uint32_t count_##name(const struct snmp_agent *agent)                                         \
	{                                                                                                    \
		return agent->lists[list].count;                                                             \
	}                                                                                                    \
	static void index_##name(const struct snmp_agent *agent, uint32_t row, uint32_t out[SNMP_INDEX_MAX]) \
	{                                                                                                    \
		snmp_point_index(agent, list, row, out);                                                     \
	}

ROWS(all, SNMP_ALL)
ROWS(singles, SNMP_SINGLES)
ROWS(doubles, SNMP_DOUBLES)
ROWS(steps, SNMP_STEPS)
ROWS(bitstrings, SNMP_BITSTRINGS)
ROWS(measured, SNMP_MEASURED)
ROWS(totals, SNMP_TOTALS)
ROWS(texts, SNMP_TEXTS)

/* ---- what does not change ---------------------------------------------------------------- */

enum {
	POINT_NAME = 3,
	POINT_TYPE,
	POINT_GROUP,
	POINT_COMMANDABLE,
	POINT_SELECT,
	POINT_UNIT,
	POINT_LOW,
	POINT_HIGH
};

/* What is configured for commands, or what its type has, as rtuMeasuredFloat has it. */
static float limit_of(const struct map_point *point, bool high)
{
	const struct map_type_row *type = &map_types[point->type];
	const double end = high ? type->high : type->low;

	if (point->min < point->max)
		return high ? point->max : point->min;
	return (float)(point->type == MAP_ANGLE ? end / MAP_ANGLE_PER_DEGREE : end);
}

static bool read_point(struct snmp_agent *agent, uint32_t column, uint32_t row, struct snmp_value *out)
{
	const struct map_point *point = &agent->config->points[agent->lists[SNMP_ALL].points[row]];
	char name[MAP_NAME_SIZE];

	switch (column) {
	case POINT_NAME:
		map_point_name(agent->config, point, name);
		snmp_put_text(out, name);
		return true;
	case POINT_TYPE:
		snmp_put_number(out, SNMP_INTEGER, snmp_type_number(point->type));
		return true;
	case POINT_GROUP:
		snmp_put_number(out, SNMP_GAUGE, point->group);
		return true;
	case POINT_COMMANDABLE:
		snmp_put_truth(out, (point->flags & MAP_POINT_COMMAND) != 0);
		return true;
	case POINT_SELECT:
		snmp_put_truth(out, (point->flags & MAP_POINT_SELECT) != 0);
		return true;
	case POINT_UNIT:
		snmp_put_text(out, map_unit_of(agent->config, point));
		return true;
	case POINT_LOW:
	case POINT_HIGH:
		snmp_put_float(out, limit_of(point, column == POINT_HIGH));
		return true;
	default:
		return false;
	}
}

const struct snmp_table snmp_point_table = {.prefix = {1, 2, 1},
					    .prefix_length = 3,
					    .first = POINT_NAME,
					    .last = POINT_HIGH,
					    .indexes = 2,
					    .count = count_all,
					    .index = index_all,
					    .read = read_point};

/* ---- values ------------------------------------------------------------------------------ */

enum field {
	FIELD_VALUE,
	FIELD_TEXT,
	FIELD_TRANSIENT,
	FIELD_PRECISION,
	FIELD_FLOAT,
	FIELD_QUALITY,
	FIELD_TIME
};

static bool read_field(struct snmp_agent *agent, enum field field, enum snmp_list list, uint32_t row,
		       struct snmp_value *out)
{
	const uint32_t point = agent->lists[list].points[row];
	const struct map_point *object = &agent->config->points[point];
	const enum map_type type = object->type;
	struct map_sample sample;
	char text[MAP_TEXT_SIZE];

	if (!snmp_sample(agent, point, &sample))
		return false;
	switch (field) {
	case FIELD_TEXT:
		map_text_of(agent->map, point, sample.value, text);
		snmp_put_text(out, text);
		break;
	case FIELD_VALUE:
		snmp_put_number(out, list == SNMP_BITSTRINGS ? SNMP_GAUGE : SNMP_INTEGER,
				snmp_shown_value(type, snmp_decimals(object), sample.value));
		break;
	case FIELD_TRANSIENT:
		snmp_put_truth(out, (sample.detail & 1) != 0);
		break;
	case FIELD_PRECISION:
		snmp_put_number(out, SNMP_INTEGER, snmp_decimals(object));
		break;
	case FIELD_FLOAT:
		snmp_put_float(out, snmp_float_of(type, sample.value));
		break;
	case FIELD_QUALITY:
		snmp_put_quality(out, sample.quality, 0);
		break;
	case FIELD_TIME:
		snmp_put_moment(agent, out, sample.time_ns);
		break;
	}
	return true;
}

/* Columns 1 and on. */
static const enum field plain_fields[] = {FIELD_VALUE, FIELD_QUALITY, FIELD_TIME};
static const enum field text_fields[] = {FIELD_TEXT, FIELD_QUALITY, FIELD_TIME};
static const enum field step_fields[] = {FIELD_VALUE, FIELD_TRANSIENT, FIELD_QUALITY, FIELD_TIME};
static const enum field measured_fields[] = {FIELD_VALUE, FIELD_PRECISION, FIELD_FLOAT, FIELD_QUALITY,
					     FIELD_TIME};

#define READER(name, list, fields)                                                                           \
	static bool read_##name(struct snmp_agent *agent, uint32_t column, uint32_t row,                     \
				struct snmp_value *out)                                                      \
	{                                                                                                    \
		return read_field(agent, fields[column - 1], list, row, out);                                \
	}

READER(singles, SNMP_SINGLES, plain_fields)
READER(doubles, SNMP_DOUBLES, plain_fields)
READER(steps, SNMP_STEPS, step_fields)
READER(bitstrings, SNMP_BITSTRINGS, plain_fields)
READER(measured, SNMP_MEASURED, measured_fields)
READER(texts, SNMP_TEXTS, text_fields)

#define VALUE_TABLE(name, number, fields)                                                                    \
	{                                                                                                    \
		.prefix = {1, 2, number}, .prefix_length = 3, .first = 1,                                    \
		.last = sizeof(fields) / sizeof((fields)[0]), .indexes = 2, .count = count_##name,           \
		.index = index_##name, .read = read_##name                                                   \
	}

const struct snmp_table snmp_value_tables[6] = {
    VALUE_TABLE(singles, 2, plain_fields),     VALUE_TABLE(doubles, 3, plain_fields),
    VALUE_TABLE(steps, 4, step_fields),        VALUE_TABLE(bitstrings, 5, plain_fields),
    VALUE_TABLE(measured, 6, measured_fields), VALUE_TABLE(texts, 7, text_fields),
};

/* ---- totals ------------------------------------------------------------------------------ */

enum {
	TOTAL_VALUE = 1,
	TOTAL_QUALITY,
	TOTAL_TIME,
	TOTAL_FROZEN,
	TOTAL_FROZEN_QUALITY,
	TOTAL_FROZEN_TIME,
	TOTAL_FROZEN_NUMBER,
	TOTAL_GROUP,
	TOTAL_PERIOD
};

static bool read_frozen(const struct snmp_agent *agent, uint32_t column, uint32_t point,
			struct snmp_value *out)
{
	struct map_sample frozen;

	if (!map_total_read(agent->map, point, &frozen))
		return false;
	switch (column) {
	case TOTAL_FROZEN:
		snmp_put_number(out, SNMP_INTEGER, frozen.value.i);
		return true;
	case TOTAL_FROZEN_QUALITY:
		snmp_put_quality(out, frozen.quality, frozen.detail);
		return true;
	case TOTAL_FROZEN_TIME:
		snmp_put_moment(agent, out, frozen.time_ns);
		return true;
	default:
		snmp_put_number(out, SNMP_GAUGE, frozen.detail & MAP_COUNTER_SEQUENCE);
		return true;
	}
}

static bool read_total(struct snmp_agent *agent, uint32_t column, uint32_t row, struct snmp_value *out)
{
	const uint32_t number = agent->lists[SNMP_TOTALS].points[row];
	const struct map_point *point = &agent->config->points[number];

	switch (column) {
	case TOTAL_VALUE:
		return read_field(agent, FIELD_VALUE, SNMP_TOTALS, row, out);
	case TOTAL_QUALITY:
		return read_field(agent, FIELD_QUALITY, SNMP_TOTALS, row, out);
	case TOTAL_TIME:
		return read_field(agent, FIELD_TIME, SNMP_TOTALS, row, out);
	case TOTAL_GROUP:
		snmp_put_number(out, SNMP_GAUGE, point->counter_group);
		return true;
	case TOTAL_PERIOD:
		snmp_put_number(out, SNMP_GAUGE, point->freeze_s);
		return true;
	default:
		return read_frozen(agent, column, number, out);
	}
}

const struct snmp_table snmp_total_table = {.prefix = {1, 4, 1},
					    .prefix_length = 3,
					    .first = TOTAL_VALUE,
					    .last = TOTAL_PERIOD,
					    .indexes = 2,
					    .count = count_totals,
					    .index = index_totals,
					    .read = read_total};
