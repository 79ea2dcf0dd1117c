/* SPDX-License-Identifier: GPL-3.0-or-later */
/* "data_sets": data sets that somebody has chosen, and their report control blocks. */
#include <ctype.h>
#include <stdlib.h>
#include <string.h>

#include "config/names.h"
#include "iec61850/config.h"
#include "iec61850/config_part.h"
#include "iec61850/kept.h"
#include "iec61850/model.h"

#define LLN0 "LLN0"

enum { CB_NAME, BUFFERED, INSTANCES, ID, TRIGGERS, OPTIONS, BUFFER_MS, INTEGRITY_MS, REPORT_KEYS };
static const struct config_rule report_rules[REPORT_KEYS] = {
    [CB_NAME] = {CONFIG_KEY_NAME, CONFIG_TEXT, .required = true, .low = 1, .high = IEC61850_CB_SIZE - 1,
		 CONFIG_SAYS("Name before the index of two digits.", .pattern = "^[A-Za-z][A-Za-z0-9_]*$",
			     .json = CONFIG_JSON({"examples" : ["brcbBay"]}))},
    [BUFFERED] = {"buffered", CONFIG_BOOLEAN, CONFIG_SAYS("Whether changes are kept for it.")},
    [INSTANCES] = {"instances", CONFIG_INTEGER, .low = 1, .high = IEC61850_INSTANCES_MAX, .fallback = 1,
		   CONFIG_SAYS("Control blocks, one for each client at a time.")},
    [ID] = {"id", CONFIG_TEXT, .low = 1, .high = IEC61850_RPT_ID_SIZE - 1,
	    CONFIG_SAYS("RptID at first; if it is not given, the reference.")},
    [TRIGGERS] = {"triggers", CONFIG_ARRAY, .high = 5,
		  CONFIG_SAYS("TrgOps at first.",
			      .json = CONFIG_JSON(
				  {"items" : {"enum" : [ "dchg", "qchg", "dupd", "period", "gi" ]}}))},
    [OPTIONS] = {"options", CONFIG_ARRAY, .high = 8,
		 CONFIG_SAYS("OptFlds at first; bufOvfl and entryID of buffered ones alone.",
			     .json = CONFIG_JSON({
				     "items" : {
					     "enum" : [
						     "seqNum", "timeStamp", "reasonCode", "dataSet",
						     "dataRef", "bufOvfl", "entryID", "configRef"
					     ]
				     }
			     }))},
    [BUFFER_MS] = {"buffer_ms", CONFIG_INTEGER, .low = 0, .high = UINT32_MAX, CONFIG_SAYS("BufTm at first.")},
    [INTEGRITY_MS] = {"integrity_ms", CONFIG_INTEGER, .low = 0, .high = UINT32_MAX,
		      CONFIG_SAYS("IntgPd at first; 0, or 100 at least.")},
};
CONFIG_TABLE(report_table, .name = "report", .rules = report_rules, .count = REPORT_KEYS);

enum { NAME, LN, CONF_REV, POINTS, REPORTS, SET_KEYS };
static const struct config_rule set_rules[SET_KEYS] = {
    [NAME] = {CONFIG_KEY_NAME, CONFIG_TEXT, .required = true, .low = 1, .high = IEC61850_SET_SIZE - 1,
	      CONFIG_SAYS("Name in its logical node: a letter, then letters, digits and underscores.",
			  .pattern = "^[A-Za-z][A-Za-z0-9_]*$", .json = CONFIG_JSON({"examples" : ["Bay"]}))},
    [LN] = {"ln", CONFIG_TEXT, .low = 1, .high = IEC61850_LN_SIZE - 1,
	    CONFIG_SAYS("Logical node whose it is, with its control blocks: LLN0, or one that has a point of "
			"the same device.",
			.otherwise_text = LLN0)},
    [CONF_REV] = {"conf_rev", CONFIG_INTEGER, .low = 1, .high = UINT32_MAX,
		  CONFIG_SAYS("ConfRev of its control blocks; if it is not given, a number of the members.")},
    [POINTS] = {"points", CONFIG_ARRAY, .required = true, .high = UINT16_MAX,
		CONFIG_SAYS("Names of points of one common address, each once; with `[stVal]` behind a name, "
			    "of that attribute alone.",
			    .see = "iec61850.md#data-sets-and-reports",
			    .json = CONFIG_JSON({"minItems" : 1, "items" : {"type" : "string"}}))},
    [REPORTS] = {"reports", CONFIG_ARRAY, .high = IEC61850_SET_REPORTS_MAX,
		 CONFIG_SAYS("Its report control blocks, 8 at most.", .table = &report_table)},
};
CONFIG_SHARED_TABLE(iec61850_set_table, .name = "data_set", .rules = set_rules, .count = SET_KEYS);

/* As IEC 61850-6 names them. */
struct word {
	const char *text;
	uint16_t bit;
};
static const struct word triggers[] = {{"dchg", IEC61850_DATA_CHANGE},
				       {"qchg", IEC61850_QUALITY_CHANGE},
				       {"dupd", IEC61850_DATA_UPDATE},
				       {"period", IEC61850_INTEGRITY},
				       {"gi", IEC61850_GENERAL}};
static const struct word options[] = {{"seqNum", IEC61850_SEQUENCE},   {"timeStamp", IEC61850_TIME_STAMP},
				      {"reasonCode", IEC61850_REASON}, {"dataSet", IEC61850_SET_NAME},
				      {"dataRef", IEC61850_REFERENCE}, {"bufOvfl", IEC61850_OVERFLOW},
				      {"entryID", IEC61850_ENTRY},     {"configRef", IEC61850_CONF_REVISION}};
#define COUNT(array) ((unsigned)(sizeof(array) / sizeof((array)[0])))

/* Records of what grows while the file is read. */
struct growing {
	void *records;
	size_t size;
	uint32_t count;
};

static void *grow(struct config_loader *loader, struct growing *growing)
{
	const uint32_t count = growing->count;

	if ((count & (count - 1)) == 0) { /* it has as much room as the power of two says */
		void *records =
		    realloc(growing->records, (count == 0 ? 1 : 2 * (size_t)count) * growing->size);

		if (records == NULL) {
			config_out_of_memory(&loader->report);
			return NULL;
		}
		growing->records = records;
	}
	return memset((uint8_t *)growing->records + growing->count++ * growing->size, 0, growing->size);
}

/* What is read, until it has its place in the configuration. */
struct chosen {
	struct growing sets, members, reports;
};

static void check_name(struct config_loader *loader, const struct config_place *in, const char *name)
{
	const struct config_place here = config_key_of(in, CONFIG_KEY_NAME);
	bool good = isalpha((unsigned char)*name);

	for (const char *c = name; *c != '\0'; c++)
		good = good && (isalnum((unsigned char)*c) || *c == '_');
	if (!good)
		config_error(&loader->report, &here,
			     "\"%s\" is no name of SCL, expected a letter, then letters, digits and _", name);
}

static uint16_t read_words(struct config_loader *loader, const struct config_place *place,
			   const struct config_value *value, const struct word *words, unsigned count)
{
	uint16_t bits = 0;

	for (size_t i = 0; value->given && i < json_array_size(value->json); i++) {
		const struct config_place here = config_element_of(place, i);
		const char *text = json_string_value(json_array_get(value->json, i));
		char expected[160] = "";
		unsigned word = 0;

		while (word < count && (text == NULL || strcmp(words[word].text, text) != 0))
			word++;
		if (word < count) {
			bits |= words[word].bit;
			continue;
		}
		for (word = 0; word < count; word++)
			snprintf(expected + strlen(expected), sizeof(expected) - strlen(expected), " %s",
				 words[word].text);
		config_error(&loader->report, &here, "is none of%s", expected);
	}
	return bits;
}

static void read_report(struct config_loader *loader, const struct config_place *place, const json_t *json,
			struct chosen *chosen)
{
	const struct config_place trigger_place = config_key_of(place, report_rules[TRIGGERS].name);
	const struct config_place option_place = config_key_of(place, report_rules[OPTIONS].name);
	const unsigned errors = loader->report.errors;
	struct config_value values[REPORT_KEYS];
	struct iec61850_report *report;

	config_read_keys(&loader->report, place, json, report_rules, REPORT_KEYS, values);
	if (loader->report.errors != errors)
		return;
	report = grow(loader, &chosen->reports);
	if (report == NULL)
		return;
	report->set = (uint16_t)(chosen->sets.count - 1);
	check_name(loader, place, values[CB_NAME].text);
	snprintf(report->name, sizeof(report->name), "%s", values[CB_NAME].text);
	snprintf(report->id, sizeof(report->id), "%s", values[ID].given ? values[ID].text : "");
	report->buffered = values[BUFFERED].integer != 0;
	report->instances = (uint8_t)values[INSTANCES].integer;
	report->buffer_ms = (uint32_t)values[BUFFER_MS].integer;
	report->integrity_ms = (uint32_t)values[INTEGRITY_MS].integer;
	if (report->integrity_ms > 0 && report->integrity_ms < IEC61850_INTEGRITY_MS_MIN)
		config_error(&loader->report, place, "has an integrity_ms of %u, expected 0 or %d at least",
			     (unsigned)report->integrity_ms, IEC61850_INTEGRITY_MS_MIN);
	report->triggers =
	    (uint8_t)read_words(loader, &trigger_place, &values[TRIGGERS], triggers, COUNT(triggers));
	report->options = read_words(loader, &option_place, &values[OPTIONS], options, COUNT(options));
	if (!report->buffered && (report->options & ~(unsigned)IEC61850_OPTIONS))
		config_error(
		    &loader->report, &option_place,
		    "has bufOvfl or entryID, which are of buffered reports alone: leave them out, or set "
		    "\"buffered\"");
}

static bool has_member(const struct growing *members, const struct iec61850_data_set *set,
		       const struct iec61850_chosen *member)
{
	const struct iec61850_chosen *there = members->records;

	for (uint32_t i = set->first_member; i < members->count; i++)
		if (there[i].point == member->point && strcmp(there[i].attribute, member->attribute) == 0)
			return true;
	return false;
}

/* What a point has under ST or MX, however it is controlled. */
static struct iec61850_nodes inside_of(const struct map_config *config, uint32_t point)
{
	const enum iec61850_cdc cdc = iec61850_configured_cdc(config, point);
	struct iec61850_nodes measured;

	measured = iec61850_cdc_nodes(cdc, IEC61850_STATUS_ONLY, IEC61850_MX);
	return measured.count > 0 ? measured : iec61850_cdc_nodes(cdc, IEC61850_STATUS_ONLY, IEC61850_ST);
}

/* q0.position, or q0.position[stVal]: no name of a point has brackets. */
static void split(const char *text, char point[MAP_NAME_SIZE], char attribute[MAP_NAME_SIZE])
{
	const size_t size = strcspn(text, "[");
	const char *end = strchr(text + size, ']');

	snprintf(point, MAP_NAME_SIZE, "%.*s", (int)size, text);
	attribute[0] = '\0';
	if (text[size] == '[' && end != NULL && end[1] == '\0')
		snprintf(attribute, MAP_NAME_SIZE, "%.*s", (int)(end - text - (ptrdiff_t)size - 1),
			 text + size + 1);
	else if (text[size] == '[')
		point[0] = '\0'; /* it is none */
}

static void check_attribute(struct config_loader *loader, const struct config_place *place, uint32_t point,
			    const char *attribute)
{
	const struct iec61850_nodes inside = inside_of(loader->config, point);
	char known[160] = "";

	if (attribute[0] == '\0' || iec61850_cdc_find(inside, attribute) != NULL)
		return;
	for (unsigned i = 0; i < inside.count; i++)
		snprintf(known + strlen(known), sizeof(known) - strlen(known), " %s", inside.nodes[i].name);
	config_error(&loader->report, place,
		     "has no attribute \"%s\", expected one of%s, or a part of it as mag.f", attribute,
		     known);
}

static void read_member(struct config_loader *loader, const struct config_place *place, const json_t *json,
			struct chosen *chosen)
{
	const struct map_config *config = loader->config;
	const struct iec61850_data_set *set =
	    (struct iec61850_data_set *)chosen->sets.records + chosen->sets.count - 1;
	const struct iec61850_chosen *members = chosen->members.records;
	char name[MAP_NAME_SIZE], attribute[MAP_NAME_SIZE];
	struct iec61850_chosen member = {.point = MAP_NONE}, *kept;

	if (json_is_string(json)) {
		split(json_string_value(json), name, attribute);
		member.point = config_index_name(&loader->index, config, name);
	}
	if (member.point == MAP_NONE) {
		config_error(&loader->report, place, "is the name of no point");
		return;
	}
	if (chosen->members.count > set->first_member &&
	    config->sets[config->points[member.point].set].ca !=
		config->sets[config->points[members[set->first_member].point].set].ca)
		config_error(&loader->report, place,
			     "\"%s\" is of another common address than the first point: a data set is of one "
			     "logical device",
			     name);
	check_attribute(loader, place, member.point, attribute);
	snprintf(member.attribute, sizeof(member.attribute), "%.*s", IEC61850_ATTRIBUTE_SIZE - 1, attribute);
	if (has_member(&chosen->members, set, &member))
		config_error(&loader->report, place, "\"%s\" is in the data set already",
			     json_string_value(json));
	kept = grow(loader, &chosen->members);
	if (kept != NULL)
		*kept = member;
}

/* Whether a point is in the logical node. */
static bool is_in(const struct map_config *config, const char *ln, uint32_t point)
{
	const struct iec61850_assignment *assigned = iec61850_assigned_to(config, point);

	return strcmp(assigned == NULL ? "GGIO1" : assigned->ln, ln) == 0;
}

/* LLN0, or a logical node of a point of the device. */
static void check_ln(struct config_loader *loader, const struct config_place *place,
		     const struct iec61850_data_set *set, uint32_t member)
{
	const struct config_place here = config_key_of(place, set_rules[LN].name);
	const struct map_config *config = loader->config;
	const uint16_t ca = config->sets[config->points[member].set].ca;

	if (strcmp(set->ln, LLN0) == 0)
		return;
	for (uint32_t i = 0; i < config->point_count; i++)
		if (config->sets[config->points[i].set].ca == ca && is_in(config, set->ln, i))
			return;
	config_error(&loader->report, &here, "\"%s\" is no logical node of CA %u that has a point, nor " LLN0,
		     set->ln, (unsigned)ca);
}

static void read_set(struct config_loader *loader, const struct config_place *place, const json_t *json,
		     struct chosen *chosen)
{
	const struct config_place points = config_key_of(place, set_rules[POINTS].name);
	const struct config_place reports = config_key_of(place, set_rules[REPORTS].name);
	const unsigned errors = loader->report.errors;
	struct config_value values[SET_KEYS];
	struct iec61850_data_set *set;

	config_read_keys(&loader->report, place, json, set_rules, SET_KEYS, values);
	if (loader->report.errors != errors)
		return;
	check_name(loader, place, values[NAME].text);
	set = grow(loader, &chosen->sets);
	if (set == NULL)
		return;
	snprintf(set->name, sizeof(set->name), "%s", values[NAME].text);
	snprintf(set->ln, sizeof(set->ln), "%s", values[LN].given ? values[LN].text : LLN0);
	set->conf_rev = (uint32_t)values[CONF_REV].integer;
	set->first_member = chosen->members.count;
	for (size_t i = 0; i < json_array_size(values[POINTS].json); i++) {
		const struct config_place here = config_element_of(&points, i);

		read_member(loader, &here, json_array_get(values[POINTS].json, i), chosen);
	}
	set->member_count = chosen->members.count - set->first_member;
	if (json_array_size(values[POINTS].json) == 0)
		config_error(&loader->report, &points, "has no point, expected one at least");
	if (loader->report.errors == errors)
		check_ln(loader, place, set,
			 ((struct iec61850_chosen *)chosen->members.records)[set->first_member].point);
	for (size_t i = 0; values[REPORTS].given && i < json_array_size(values[REPORTS].json); i++) {
		const struct config_place here = config_element_of(&reports, i);

		read_report(loader, &here, json_array_get(values[REPORTS].json, i), chosen);
	}
}

/* ---- all of them --------------------------------------------------------------------------- */

static uint16_t ca_of(const struct map_config *config, const struct chosen *chosen,
		      const struct iec61850_data_set *set)
{
	const struct iec61850_chosen *members = chosen->members.records;

	return config->sets[config->points[members[set->first_member].point].set].ca;
}

static void check_twice(struct config_loader *loader, const struct config_place *place,
			const struct chosen *chosen)
{
	const struct iec61850_data_set *sets = chosen->sets.records;
	const struct iec61850_report *reports = chosen->reports.records;
	uint32_t kept = 0;

	for (uint32_t i = 0; i < chosen->sets.count; i++)
		for (uint32_t j = 0; j < i; j++)
			if (strcmp(sets[i].name, sets[j].name) == 0 && strcmp(sets[i].ln, sets[j].ln) == 0 &&
			    ca_of(loader->config, chosen, &sets[i]) ==
				ca_of(loader->config, chosen, &sets[j]))
				config_error(
				    &loader->report, place,
				    "has two data sets \"%s\" of CA %u: expected another name for one",
				    sets[i].name, (unsigned)ca_of(loader->config, chosen, &sets[i]));
	for (uint32_t i = 0; i < chosen->reports.count; i++) {
		kept += reports[i].buffered ? reports[i].instances : 0;
		for (uint32_t j = 0; j < i; j++)
			if (strcmp(reports[i].name, reports[j].name) == 0 &&
			    strcmp(sets[reports[i].set].ln, sets[reports[j].set].ln) == 0 &&
			    ca_of(loader->config, chosen, &sets[reports[i].set]) ==
				ca_of(loader->config, chosen, &sets[reports[j].set]))
				config_error(&loader->report, place,
					     "has two control blocks \"%s\" of one logical node: expected "
					     "another name for one",
					     reports[i].name);
	}
	if (kept > IEC61850_KEPT_ALL)
		config_error(&loader->report, place, "has %u buffered control blocks, expected %u at most",
			     (unsigned)kept, IEC61850_KEPT_ALL);
}

static int by_name(const void *a, const void *b, void *context)
{
	const struct iec61850_data_set *sets = context;
	const struct iec61850_data_set *one = &sets[*(const uint16_t *)a],
				       *other = &sets[*(const uint16_t *)b];
	const int by_ln = strcmp(one->ln, other->ln);

	return by_ln != 0 ? by_ln : strcmp(one->name, other->name);
}

/* Clients see data sets in the order of their names. */
static void sort(struct chosen *chosen)
{
	struct iec61850_data_set *sets = chosen->sets.records, sorted[IEC61850_DATA_SETS_MAX] = {0};
	struct iec61850_report *reports = chosen->reports.records;
	uint16_t order[IEC61850_DATA_SETS_MAX], now[IEC61850_DATA_SETS_MAX] = {0};
	const uint32_t count = chosen->sets.count;

	for (uint32_t i = 0; i < count; i++)
		order[i] = (uint16_t)i;
	qsort_r(order, count, sizeof(*order), by_name, sets);
	for (uint32_t i = 0; i < count; i++) {
		sorted[i] = sets[order[i]];
		now[order[i]] = (uint16_t)i;
	}
	memcpy(sets, sorted, count * sizeof(*sets));
	for (uint32_t i = 0; i < chosen->reports.count; i++)
		reports[i].set = now[reports[i].set];
}

static void keep(struct map_config *config, uint32_t id, const struct growing *growing)
{
	if (growing->records != NULL)
		map_add_section(config, id, (uint32_t)growing->size, growing->count, growing->records);
}

bool iec61850_take_sets(struct config_loader *loader, const struct config_place *place, const json_t *array)
{
	struct chosen chosen = {.sets = {.size = sizeof(struct iec61850_data_set)},
				.members = {.size = sizeof(struct iec61850_chosen)},
				.reports = {.size = sizeof(struct iec61850_report)}};
	const unsigned errors = loader->report.errors;

	if (array == NULL)
		return true;
	if (!config_index_renew(&loader->index, loader->config))
		return false;
	for (size_t i = 0; i < json_array_size(array) && i < IEC61850_DATA_SETS_MAX; i++) {
		const struct config_place here = config_element_of(place, i);

		read_set(loader, &here, json_array_get(array, i), &chosen);
	}
	if (loader->report.errors == errors && chosen.sets.count > 0) {
		check_twice(loader, place, &chosen);
		sort(&chosen);
	}
	keep(loader->config, IEC61850_DATA_SETS, &chosen.sets);
	keep(loader->config, IEC61850_MEMBERS, &chosen.members);
	keep(loader->config, IEC61850_REPORTS, &chosen.reports);
	return true;
}
