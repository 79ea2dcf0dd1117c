/* SPDX-License-Identifier: GPL-3.0-or-later */
/* The list of points that a control centre's engineer asks for, and from which the file can be made again. */
#include <stdlib.h>
#include <string.h>

#include "iec104/carrier.h"
#include "modbus/config_object.h"
#include "modbus/config_part.h"
#include "rtud/config_parts.h"

/* IEC 60870-5-101, 7.3.1 and 7.3.2, by enum map_type. */
static const struct {
	const char *plain, *event, *command;
} types[] = {
    [MAP_SINGLE] = {"M_SP_NA_1", "M_SP_TB_1", "C_SC_NA_1"},
    [MAP_DOUBLE] = {"M_DP_NA_1", "M_DP_TB_1", "C_DC_NA_1"},
    [MAP_STEP] = {"M_ST_NA_1", "M_ST_TB_1", ""},
    [MAP_BITSTRING] = {"M_BO_NA_1", "M_BO_TB_1", "C_BO_NA_1"},
    [MAP_NORMALIZED] = {"M_ME_NA_1", "M_ME_TD_1", "C_SE_NA_1"},
    [MAP_SCALED] = {"M_ME_NB_1", "M_ME_TE_1", "C_SE_NB_1"},
    [MAP_FLOAT] = {"M_ME_NC_1", "M_ME_TF_1", "C_SE_NC_1"},
    [MAP_COUNTER] = {"M_IT_NA_1", "M_IT_TB_1", ""},
};
#define NO_QUALITY "M_ME_ND_1"
#define PRIVATE    "private"
#define STEP       "C_RC_NA_1"

/* Columns of the control centre, of the Modbus side, and all other keys of an object. */
static const char *const centre_columns[] = {"ca",   "ioa",  "type",      "event_type", "command_type",
					     "name", "unit", "direction", "group",      "device"};
static const char *const modbus_columns[] = {"port", "id", "table"};
static const unsigned object_columns[] = {
    OBJECT_ADDRESS,
    OBJECT_SECOND,
    OBJECT_FORMAT,
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
    OBJECT_LN,
    OBJECT_DEADBAND,
    OBJECT_CYCLIC,
    OBJECT_BACKGROUND,
    OBJECT_COUNTER_GROUP,
    OBJECT_FREEZE,
    OBJECT_PERIOD,
    OBJECT_SELECT,
    OBJECT_SHORT_PULSE,
    OBJECT_LONG_PULSE,
    OBJECT_STEP,
    OBJECT_MIN,
    OBJECT_MAX,
    OBJECT_READ_BACK,
    OBJECT_WRITE_ADDRESS,
    OBJECT_WRITE_ONLY,
    OBJECT_BLOCKED_BY,
    OBJECT_SUBSTITUTED_BY,
    OBJECT_NOT_TOPICAL_BY,
    OBJECT_SCALE_BY,
    OBJECT_FACTOR_BY,
    OBJECT_DECIMALS,
    OBJECT_NAMES,
    OBJECT_WRITE_VALUES,
    OBJECT_WRITE_AT_RETURN,
    OBJECT_WRITE_EVERY,
    OBJECT_LENGTH,
    OBJECT_PAGE,
    OBJECT_READ_ONLY,
};
#define DIGITS_LEAST 15 /* of a double */
#define DIGITS_MOST  17
#define COUNT(array) (sizeof(array) / sizeof((array)[0]))

struct row {
	const struct map_config *config;
	const struct map_point *point;
	const struct map_set *set;
	const struct modbus_slave *slave; /* NULL: as of the next one */
	const struct modbus_entry *entry; /* NULL: of the gateway's own station */
};

static int by_address(const void *left, const void *right)
{
	const struct row *a = left, *b = right;

	if (a->set->ca != b->set->ca)
		return a->set->ca < b->set->ca ? -1 : 1;
	return (a->point->ioa > b->point->ioa) - (a->point->ioa < b->point->ioa);
}

static const char *type_of(const struct row *row, bool event)
{
	if (row->point->flags & MAP_POINT_NO_QUALITY)
		return NO_QUALITY;
	if (row->point->flags & MAP_POINT_POSITION)
		return PRIVATE;
	return event ? types[iec104_carrier_of(row->point)].event
		     : types[iec104_carrier_of(row->point)].plain;
}

static const char *command_of(const struct row *row)
{
	if (!(row->point->flags & MAP_POINT_COMMAND))
		return "";
	if (row->point->type == MAP_STEP && row->point->step > 0)
		return STEP;
	return types[iec104_carrier_of(row->point)].command;
}

/* What a register takes beside its set-points. */
static const char *steps_of(const struct row *row)
{
	return row->point->step > 0 && row->point->type != MAP_STEP ? " " STEP : "";
}

static const char *direction_of(const struct row *row)
{
	if (row->point->flags & MAP_POINT_NEVER_READ)
		return "control";
	return command_of(row)[0] != '\0' ? "both" : "monitor";
}

static const char *text_of(const struct row *row, unsigned key)
{
	const char *text =
	    row->entry == NULL
		? NULL
		: json_string_value(json_object_get(row->entry->json, modbus_object_rules[key].name));

	return text == NULL ? "" : text;
}

static void group_of(const struct row *row, char out[8])
{
	out[0] = '\0';
	if (row->point->group > 0)
		snprintf(out, 8, "%u", row->point->group);
}

/* ---- CSV --------------------------------------------------------------------------------- */

/* RFC 4180, but for the ends of lines. */
static void put_cell(FILE *out, const char *text)
{
	if (strpbrk(text, ",\"") == NULL) {
		fputs(text, out);
		return;
	}
	fputc('"', out);
	for (; *text != '\0'; text++) {
		if (*text == '"')
			fputc('"', out);
		fputc(*text, out);
	}
	fputc('"', out);
}

static void put_next(FILE *out, const char *text)
{
	fputc(',', out);
	put_cell(out, text);
}

/* The fewest digits that are read as the same number again: 0.1, where all 17 are 0.10000000000000001. NULL: no memory. */
static char *shortest(const json_t *number)
{
	char *text = NULL;
	bool same = false;

	for (int digits = DIGITS_LEAST; !same && digits <= DIGITS_MOST; digits++) {
		json_t *again;

		free(text);
		text = json_dumps(number, JSON_ENCODE_ANY | JSON_REAL_PRECISION(digits));
		again = text != NULL ? json_loads(text, JSON_DECODE_ANY, NULL) : NULL;
		same = json_equal(number, again);
		json_decref(again);
	}
	return text;
}

/* Compact JSON of a value that has been read: its arrays are of points of a table, and no deeper. False: no memory. */
static bool write_json(FILE *out, const json_t *json)
{
	const json_t *element;
	bool good = true;
	char *text;
	size_t i;

	if (json_is_array(json)) {
		fputc('[', out);
		json_array_foreach(json, i, element)
		{
			fputs(i == 0 ? "" : ",", out);
			good &= write_json(out, element);
		}
		fputc(']', out);
		return good;
	}
	text = shortest(json);
	fputs(text != NULL ? text : "", out);
	good = text != NULL;
	free(text);
	return good;
}

/* As the file has it, a string without its quotation marks. */
static bool put_value(FILE *out, const json_t *json)
{
	char *text = NULL;
	size_t size;
	FILE *stream;
	bool good;

	if (json == NULL || json_is_string(json)) {
		put_next(out, json != NULL ? json_string_value(json) : "");
		return true;
	}
	stream = open_memstream(&text, &size);
	if (stream == NULL)
		return false;
	good = write_json(stream, json);
	good &= fclose(stream) == 0;
	if (good)
		put_next(out, text);
	free(text);
	return good;
}

static void put_number(FILE *out, uint32_t number)
{
	fputc(',', out);
	if (number > 0)
		fprintf(out, "%u", number);
}

/* What the slave has of it is the object's own in the list. */
static bool put_key(FILE *out, const struct row *row, unsigned key)
{
	const json_t *json = json_object_get(row->entry->json, modbus_object_rules[key].name);
	char name[MAP_NAME_SIZE];

	if (key == OBJECT_ADDRESS) {
		fprintf(out, ",%u", row->entry->wire.address); /* however the file says it */
	} else if (key == OBJECT_PERIOD) {
		put_number(out, row->entry->wire.scan_period_ms);
	} else if (key == OBJECT_READ_BACK && (row->entry->wire.flags & MODBUS_NO_READ_BACK)) {
		put_next(out, "false");
	} else if (key >= OBJECT_BLOCKED_BY && key <= OBJECT_FACTOR_BY && json != NULL) {
		uint32_t place =
		    modbus_extra_of(row->config, &row->entry->wire)->links[key - OBJECT_BLOCKED_BY] - 1u;

		map_point_name(row->config, &row->config->points[row->set->first_point + place], name);
		put_next(out, name);
	} else {
		return put_value(out, json);
	}
	return true;
}

static bool put_modbus(FILE *out, const struct row *row)
{
	bool good = true;

	if (row->entry == NULL) {
		for (size_t i = 0; i < COUNT(modbus_columns) + COUNT(object_columns); i++)
			fputc(',', out);
		return true;
	}
	fprintf(out, ",%u,%u,%s", modbus_ports(row->config)[row->slave->port].port, row->slave->unit,
		modbus_table_names[row->entry->wire.table]);
	for (size_t i = 0; i < COUNT(object_columns); i++)
		good &= put_key(out, row, object_columns[i]);
	return good;
}

static void put_csv_head(FILE *out)
{
	for (size_t i = 0; i < COUNT(centre_columns); i++)
		fprintf(out, "%s%s", i == 0 ? "" : ",", centre_columns[i]);
	for (size_t i = 0; i < COUNT(modbus_columns); i++)
		fprintf(out, ",%s", modbus_columns[i]);
	for (size_t i = 0; i < COUNT(object_columns); i++)
		fprintf(out, ",%s", modbus_object_rules[object_columns[i]].name);
	fputc('\n', out);
}

static bool put_csv(FILE *out, const struct row *row)
{
	char name[MAP_NAME_SIZE], group[8];
	bool good;

	map_point_name(row->config, row->point, name);
	group_of(row, group);
	fprintf(out, "%u,%u,%s,%s,%s%s", row->set->ca, row->point->ioa, type_of(row, false),
		type_of(row, true), command_of(row), steps_of(row));
	put_next(out, name);
	put_next(out, text_of(row, OBJECT_UNIT));
	put_next(out, direction_of(row));
	put_next(out, group);
	put_next(out, row->set->name);
	good = put_modbus(out, row);
	fputc('\n', out);
	return good;
}

/* ---- Markdown ---------------------------------------------------------------------------- */

static void put_markdown_cell(FILE *out, const char *text)
{
	fputs(" ", out);
	for (; *text != '\0'; text++) {
		if (*text == '|' || *text == '\\')
			fputc('\\', out);
		fputc(*text, out);
	}
	fputs(" |", out);
}

static void put_markdown_head(FILE *out)
{
	fputs("| CA | IOA | type | event | command | name | unit | direction | group | device |\n"
	      "|---|---|---|---|---|---|---|---|---|---|\n",
	      out);
}

static void put_markdown(FILE *out, const struct row *row)
{
	char name[MAP_NAME_SIZE], group[8], command[32];

	map_point_name(row->config, row->point, name);
	group_of(row, group);
	snprintf(command, sizeof(command), "%s%s", command_of(row), steps_of(row));
	const char *const cells[] = {type_of(row, false),       type_of(row, true), command, name,
				     text_of(row, OBJECT_UNIT), direction_of(row),  group,   row->set->name};

	fprintf(out, "| %u | %u |", row->set->ca, row->point->ioa);
	for (size_t i = 0; i < COUNT(cells); i++)
		put_markdown_cell(out, cells[i]);
	fputc('\n', out);
}

/* What the part of Modbus has kept of its objects. */
static const struct modbus_entry *entries_of(const struct rtud_loader *loader)
{
	for (size_t i = 0; i < loader->part_count; i++)
		if (loader->parts[i] == &modbus_part)
			return ((const struct modbus_loader *)loader->own[i])->entries;
	return NULL;
}

bool config_list_points(const struct rtud_loader *loader, enum config_list list, FILE *out)
{
	const struct modbus_entry *entries = entries_of(loader);
	const struct map_config *config = loader->files.config;
	struct row *rows = calloc((size_t)config->point_count + 1, sizeof(*rows));
	uint32_t slaves = modbus_slave_count(config);
	bool good = rows != NULL;

	for (uint32_t i = 0; rows != NULL && i < config->point_count; i++)
		rows[i] = (struct row){.config = config,
				       .point = &config->points[i],
				       .set = &config->sets[config->points[i].set],
				       .slave = config->points[i].set < slaves
						    ? &modbus_slaves(config)[config->points[i].set]
						    : NULL,
				       .entry = config->points[i].set < slaves ? &entries[i] : NULL};
	if (rows != NULL)
		qsort(rows, config->point_count, sizeof(*rows), by_address);
	if (list == CONFIG_CSV)
		put_csv_head(out);
	else
		put_markdown_head(out);
	for (uint32_t i = 0; rows != NULL && i < config->point_count; i++) {
		if (list == CONFIG_CSV)
			good &= put_csv(out, &rows[i]);
		else
			put_markdown(out, &rows[i]);
	}
	free(rows);
	return good;
}
