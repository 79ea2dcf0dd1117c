/* SPDX-License-Identifier: GPL-3.0-or-later */
/* The full form: places, transitions, arcs, and which transitions a module's scan fires. */
#include "config/names.h"
#include "synch/arrow.h"
#include "synch/config_builder.h"

#define TOKENS_MAX 1000 /* at the start, and of a capacity */

enum { PLACE_NAME, PLACE_TOKENS, PLACE_CAPACITY, PLACE_KEYS };
static const struct config_rule place_rules[PLACE_KEYS] = {
    [PLACE_NAME] = {CONFIG_KEY_NAME, CONFIG_TEXT, .required = true, .low = 1, .high = MAP_NAME_SIZE - 1,
		    CONFIG_SAYS(
			"Name, of letters, digits, `-`, `_` and `.`, which no other place or transition has.",
			.pattern = "^[A-Za-z0-9._-]*$")},
    [PLACE_TOKENS] = {"tokens", CONFIG_INTEGER, .low = 0, .high = TOKENS_MAX,
		      CONFIG_SAYS("Tokens in it at the start.")},
    [PLACE_CAPACITY] =
	{"capacity", CONFIG_INTEGER, .low = 1, .high = TOKENS_MAX,
	 CONFIG_SAYS("Tokens that it can hold; further ones are lost, and counted. Without it, 65534.")},
};
CONFIG_TABLE(net_place_table, .name = "net_place", .rules = place_rules, .count = PLACE_KEYS);

enum { POINT_NAME, POINT_TRANSITION, POINT_KEYS };
static const struct config_rule point_rules[POINT_KEYS] = {
    [POINT_NAME] =
	{CONFIG_KEY_NAME, CONFIG_TEXT, .required = true, .low = 1, .high = MAP_NAME_SIZE - 1,
	 CONFIG_SAYS(
	     "Name by which the module fires it, once in the module, of letters, digits, `-`, `_` and `.`.",
	     .pattern = "^[A-Za-z0-9._-]*$")},
    [POINT_TRANSITION] = {"transition", CONFIG_TEXT, .required = true, .low = 1, .high = MAP_NAME_SIZE - 1,
			  CONFIG_SAYS("Transition that it fires.",
				      .json = CONFIG_JSON({"examples" : ["half"]}))},
};
CONFIG_TABLE(net_point_table, .name = "net_point", .rules = point_rules, .count = POINT_KEYS);

static const char *const deaths[] = {
    [SYNCH_RETURN] = "return", [SYNCH_HOLD] = "hold", [SYNCH_FIRE] = "fire", NULL};

enum { MODULE_NAME, MODULE_BEGIN, MODULE_END, MODULE_POINTS, MODULE_DEATH, MODULE_KEYS };
static const struct config_rule module_rules[MODULE_KEYS] = {
    [MODULE_NAME] = {CONFIG_KEY_NAME, CONFIG_TEXT, .required = true, .low = 1, .high = MAP_NAME_SIZE - 1,
		     CONFIG_SAYS("Name of a module, of a program of logic, or of a line, as `line1`.",
				 .json = CONFIG_JSON({"examples" : ["mixer"]}))},
    [MODULE_BEGIN] = {"scan_begin", CONFIG_TEXT, .low = 1, .high = MAP_NAME_SIZE - 1,
		      CONFIG_SAYS(
			  "Transition that each of its scans fires to begin, and waits for. Not for a line.",
			  .json = CONFIG_JSON({"examples" : ["begin"]}))},
    [MODULE_END] = {"scan_end", CONFIG_TEXT, .low = 1, .high = MAP_NAME_SIZE - 1,
		    CONFIG_SAYS("Transition that each of its scans fires when its outputs are published.",
				.json = CONFIG_JSON({"examples" : ["end"]}))},
    [MODULE_POINTS] =
	{"points", CONFIG_ARRAY, .high = SYNCH_POINTS_MAX,
	 CONFIG_SAYS("Synchronisation points, which the module fires by name within a scan. Not for a line.",
		     .table = &net_point_table,
		     .json = CONFIG_JSON({"examples" : [[ {"name" : "p", "transition" : "half"} ]]}))},
    [MODULE_DEATH] = {"on_death", CONFIG_CHOICE, .choices = deaths, .fallback = SYNCH_RETURN,
		      CONFIG_SAYS(
			  "What becomes of the tokens of its scan when it dies or hangs: they return, are "
			  "held for its next process, or its `scan_end` fires. Not for a line.")},
};
CONFIG_TABLE(net_module_table, .name = "net_module", .rules = module_rules, .count = MODULE_KEYS);

enum { NET_PLACES, NET_TRANSITIONS, NET_ARCS, NET_MODULES, NET_KEYS };
static const struct config_rule net_rules[NET_KEYS] = {
    [NET_PLACES] = {"places", CONFIG_ARRAY, .high = SYNCH_PLACES_MAX,
		    CONFIG_SAYS("Where tokens lie, at most 64.", .table = &net_place_table,
				.json =
				    CONFIG_JSON({"examples" : [ [], [ {"name" : "free", "tokens" : 2} ] ]}))},
    [NET_TRANSITIONS] = {"transitions", CONFIG_ARRAY, .high = SYNCH_TRANSITIONS_MAX,
			 CONFIG_SAYS("Names of what modules fire, at most 64, each of letters, digits, `-`, "
				     "`_` and `.`. Each is fired by one `scan_begin`, `scan_end` or point.",
				     .json = CONFIG_JSON({
					     "items" : {
						     "type" : "string",
						     "minLength" : 1,
						     "maxLength" : 39,
						     "pattern" : "^[A-Za-z0-9._-]*$"
					     },
					     "examples" : [[ "begin", "end", "half" ]]
				     }))},
    [NET_ARCS] =
	{"arcs", CONFIG_ARRAY, .high = SYNCH_ARCS_MAX,
	 CONFIG_SAYS(
	     "Arrows from a place to a transition or back, at most 512, with weights from 1 to 255. The "
	     "weight 0 from a place to a transition: it fires only while the place is empty.",
	     .json = CONFIG_JSON({
		     "items" : {
			     "type" : "string",
			     "pattern" :
				 "^ *[A-Za-z0-9._-]{1,39} +(-\\([0-9]{1,3}\\))?-> +[A-Za-z0-9._-]{1,39} *$"
		     },
		     "examples" : [ [], [ "free -> begin", "end -(3)-> free" ], ["free -(0)-> half"] ]
	     }))},
    [NET_MODULES] = {"modules", CONFIG_ARRAY, .high = SYNCH_PARTICIPANTS_MAX,
		     CONFIG_SAYS("What scans fire, and what becomes of a module's tokens when it dies.",
				 .table = &net_module_table, .json = CONFIG_JSON({"examples" : [[]]}))},
};
CONFIG_SHARED_TABLE(synch_net_table, .name = "net", .rules = net_rules, .count = NET_KEYS);

/* ---- places, transitions, arcs ----------------------------------------------------------- */

static bool check_name(struct synch_builder *builder, const struct config_place *place, const char *name)
{
	if (name != NULL && synch_is_name(name))
		return true;
	config_error(&builder->loader->report, place,
		     "is no name, expected up to %d letters, digits, -, _ and .", MAP_NAME_SIZE - 1);
	return false;
}

static void read_place(struct synch_builder *builder, const struct config_place *here, const json_t *json)
{
	const struct config_place tokens = config_key_of(here, place_rules[PLACE_TOKENS].name);
	struct config_value values[PLACE_KEYS];

	config_read_keys(&builder->loader->report, here, json, place_rules, PLACE_KEYS, values);
	if (!values[PLACE_NAME].given || !check_name(builder, here, values[PLACE_NAME].text))
		return;
	if (values[PLACE_CAPACITY].given && values[PLACE_TOKENS].integer > values[PLACE_CAPACITY].integer)
		config_error(&builder->loader->report, &tokens, "is more than its capacity, %lld",
			     (long long)values[PLACE_CAPACITY].integer);
	synch_add_place(builder, here, values[PLACE_NAME].text, (uint16_t)values[PLACE_TOKENS].integer,
			(uint16_t)values[PLACE_CAPACITY].integer);
}

static void read_arc(struct synch_builder *builder, const struct config_place *here, const char *text)
{
	struct config_report *report = &builder->loader->report;
	const struct synch_tables *tables = builder->tables;
	struct synch_arrow arrow;
	uint8_t from, to;

	if (text == NULL || !synch_read_arrow(text, &arrow)) {
		config_error(
		    report, here,
		    "is no arc, expected one like \"place -> transition\" or \"transition -(2)-> place\"");
		return;
	}
	from = synch_find_place(tables, arrow.from);
	to = synch_find_transition(tables, arrow.to);
	if (from != SYNCH_NOTHING && to != SYNCH_NOTHING) {
		synch_add_arc(builder, here, arrow.weight > 0 ? SYNCH_TAKES : SYNCH_UNLESS, from, to,
			      arrow.weight);
		return;
	}
	from = synch_find_transition(tables, arrow.from);
	to = synch_find_place(tables, arrow.to);
	if (from == SYNCH_NOTHING || to == SYNCH_NOTHING)
		config_error(
		    report, here,
		    "leads from no place to a transition, nor from a transition to a place: are both in "
		    "\"places\" and \"transitions\"?");
	else if (arrow.weight == 0)
		config_error(report, here, "has the weight 0, which only an arc to a transition can have");
	else
		synch_add_arc(builder, here, SYNCH_GIVES, to, from, arrow.weight);
}

/* ---- modules ----------------------------------------------------------------------------- */

static bool is_fired(const struct synch_tables *tables, uint8_t transition)
{
	for (uint32_t i = 0; i < tables->participant_count; i++)
		if (tables->participants[i].begin == transition || tables->participants[i].end == transition)
			return true;
	for (uint32_t i = 0; i < tables->point_count; i++)
		if (tables->points[i].transition == transition)
			return true;
	return false;
}

/* A transition that something fires here; SYNCH_NOTHING: it was reported why not. */
static uint8_t take_transition(struct synch_builder *builder, const struct config_place *here,
			       const char *name)
{
	const uint8_t transition = synch_find_transition(builder->tables, name);

	if (transition == SYNCH_NOTHING) {
		config_error(&builder->loader->report, here, "\"%s\" is none of \"transitions\"", name);
		return SYNCH_NOTHING;
	}
	if (is_fired(builder->tables, transition)) {
		config_error(&builder->loader->report, here,
			     "\"%s\" is fired elsewhere: give each scan and point a transition of its own",
			     name);
		return SYNCH_NOTHING;
	}
	return transition;
}

static uint8_t read_hook(struct synch_builder *builder, const struct config_place *module,
			 const struct config_rule *rule, const struct config_value *value)
{
	const struct config_place here = config_key_of(module, rule->name);

	return value->given ? take_transition(builder, &here, value->text) : SYNCH_NOTHING;
}

static void add_point(struct synch_builder *builder, const struct config_place *here, uint8_t participant,
		      const struct config_value *values)
{
	struct synch_tables *tables = builder->tables;
	const struct config_place transition = config_key_of(here, point_rules[POINT_TRANSITION].name);
	const struct synch_net net = synch_net_of(tables);
	struct synch_point *point;

	if (!check_name(builder, here, values[POINT_NAME].text))
		return;
	if (synch_point_named(&net, participant, values[POINT_NAME].text) != SYNCH_NOTHING)
		config_error(&builder->loader->report, here, "\"%s\" is the name of another of its points",
			     values[POINT_NAME].text);
	if (tables->point_count == SYNCH_POINTS_MAX) {
		config_error(&builder->loader->report, here, "is one point too many, expected at most %d",
			     SYNCH_POINTS_MAX);
		return;
	}
	point = &tables->points[tables->point_count];
	*point = (struct synch_point){
	    .participant = participant,
	    .transition = take_transition(builder, &transition, values[POINT_TRANSITION].text)};
	snprintf(point->name, sizeof(point->name), "%s", values[POINT_NAME].text);
	if (point->transition != SYNCH_NOTHING)
		tables->point_count++;
}

static void read_points(struct synch_builder *builder, const struct config_place *module, uint8_t participant,
			const json_t *points)
{
	const struct config_place array = config_key_of(module, module_rules[MODULE_POINTS].name);

	for (size_t i = 0; i < json_array_size(points); i++) {
		const struct config_place here = config_element_of(&array, i);
		struct config_value values[POINT_KEYS];

		config_read_keys(&builder->loader->report, &here, json_array_get(points, i), point_rules,
				 POINT_KEYS, values);
		if (values[POINT_NAME].given && values[POINT_TRANSITION].given)
			add_point(builder, &here, participant, values);
	}
}

static void check_line(struct synch_builder *builder, const struct config_place *module,
		       const struct synch_participant *record, const struct config_value *values)
{
	if (!record->waits &&
	    (values[MODULE_BEGIN].given || values[MODULE_POINTS].given || values[MODULE_DEATH].given))
		config_error(&builder->loader->report, module,
			     "\"%s\" is a line, which waits for nobody: it has a scan_end alone",
			     record->name);
}

/* Each module of the net is read before the arrows, which add hooks where it has none. */
static void read_module(struct synch_builder *builder, const struct config_place *here, const json_t *json)
{
	const uint32_t before = builder->tables->participant_count;
	const struct config_place name = config_key_of(here, CONFIG_KEY_NAME);
	struct config_value values[MODULE_KEYS];
	struct synch_participant *record;
	uint8_t participant;

	config_read_keys(&builder->loader->report, here, json, module_rules, MODULE_KEYS, values);
	if (!values[MODULE_NAME].given)
		return;
	participant = synch_take_participant(builder, &name, values[MODULE_NAME].text);
	if (participant == SYNCH_NOTHING)
		return;
	if (builder->tables->participant_count == before) {
		config_error(&builder->loader->report, &name, "\"%s\" is there twice",
			     values[MODULE_NAME].text);
		return;
	}
	record = &builder->tables->participants[participant];
	check_line(builder, here, record, values);
	record->on_death = (uint8_t)values[MODULE_DEATH].integer;
	record->begin = read_hook(builder, here, &module_rules[MODULE_BEGIN], &values[MODULE_BEGIN]);
	record->end = read_hook(builder, here, &module_rules[MODULE_END], &values[MODULE_END]);
	if (values[MODULE_POINTS].given)
		read_points(builder, here, participant, values[MODULE_POINTS].json);
}

/* ---- the net ----------------------------------------------------------------------------- */

typedef void read_element(struct synch_builder *builder, const struct config_place *here, const json_t *json);

static void read_transition(struct synch_builder *builder, const struct config_place *here,
			    const json_t *json)
{
	const char *name = json_string_value(json);

	if (check_name(builder, here, name))
		synch_add_transition(builder, here, name);
}

static void read_arc_text(struct synch_builder *builder, const struct config_place *here, const json_t *json)
{
	read_arc(builder, here, json_string_value(json));
}

void synch_read_net(struct synch_builder *builder, const struct config_place *place, const json_t *net)
{
	static read_element *const readers[NET_KEYS] = {[NET_PLACES] = read_place,
							[NET_TRANSITIONS] = read_transition,
							[NET_ARCS] = read_arc_text,
							[NET_MODULES] = read_module};
	struct config_value values[NET_KEYS];

	config_read_keys(&builder->loader->report, place, net, net_rules, NET_KEYS, values);
	for (int key = 0; key < NET_KEYS; key++) {
		const struct config_place array = config_key_of(place, net_rules[key].name);

		for (size_t i = 0; values[key].given && i < json_array_size(values[key].json); i++) {
			const struct config_place here = config_element_of(&array, i);

			readers[key](builder, &here, json_array_get(values[key].json, i));
		}
	}
}

void synch_check_fired(struct synch_builder *builder, const struct config_place *place)
{
	const struct config_place here = config_key_of(place, net_rules[NET_TRANSITIONS].name);

	for (uint32_t i = 0; i < builder->tables->transition_count; i++)
		if (!is_fired(builder->tables, (uint8_t)i))
			config_error(
			    &builder->loader->report, &here,
			    "nothing fires \"%s\": give it to a scan_begin, a scan_end or a point of "
			    "\"modules\"",
			    builder->tables->transitions[i].name);
}
