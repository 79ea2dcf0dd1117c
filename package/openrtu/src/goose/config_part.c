/* SPDX-License-Identifier: GPL-3.0-or-later */
/* The object "goose": what is published, and what is subscribed to. */
#include "goose/config_part.h"

#include <float.h>
#include <stdlib.h>
#include <string.h>

#include "config/names.h"
#include "config/sets.h"
#include "goose/config.h"
#include "goose/publisher.h"
#include "map/map.h"
#include "map/type.h"

#define PRIORITY      39 /* below the interrupts of Ethernet: docs/realtime.md */
#define PRIORITY_MOST 98
#define APP_ID_MOST   0x3fff /* IEC 61850-8-1, C.1.4: of GOOSE type 1 */
#define GROUP_BIT     0x01   /* of a MAC address's first octet */
#define NO_SET        UINT16_MAX

/* Of what is published and of what is subscribed to. */
enum { NAME, CONTROL, DATA_SET, DESTINATION, APP_ID, CONF_REV, SIMULATION, STREAM_KEYS };
#define STREAM_RULES(is_needed, name_says, set_says, simulation_says)                                        \
	[NAME] =                                                                                             \
	    {CONFIG_KEY_NAME,       CONFIG_TEXT, .required = true, .low = 1, .high = GOOSE_NAME_SIZE - 1,    \
	     CONFIG_SAYS(name_says)},                                                                        \
	[CONTROL] = {"control_block",                                                                        \
		     CONFIG_TEXT,                                                                            \
		     .required = true,                                                                       \
		     .low = 1,                                                                               \
		     .high = GOOSE_REFERENCE_SIZE - 1,                                                       \
		     CONFIG_SAYS("Reference of the control block, as `IED1LD0/LLN0$GO$trip`.")},             \
	[DATA_SET] = {"data_set",                                                                            \
		      CONFIG_TEXT,                                                                           \
		      .required = is_needed,                                                                 \
		      .low = 1,                                                                              \
		      .high = GOOSE_REFERENCE_SIZE - 1,                                                      \
		      CONFIG_SAYS(set_says)},                                                                \
	[DESTINATION] = {"destination", CONFIG_TEXT, .low = 17, .high = 17,                                  \
			 CONFIG_SAYS("Address of the group that the messages are for.",                      \
				     .otherwise_text = "01:0c:cd:01:00:00",                                  \
				     .pattern = "^[0-9A-Fa-f][13579bdfBDF](:[0-9A-Fa-f]{2}){5}$",            \
				     .json = CONFIG_JSON({"examples" : ["01:0c:cd:01:00:05"]}))},            \
	[APP_ID] = {"app_id", CONFIG_INTEGER,      .required = true,                                         \
		    .low = 0, .high = APP_ID_MOST, CONFIG_SAYS("APPID of the messages.")},                   \
	[CONF_REV] = {"conf_rev",         CONFIG_INTEGER, .low = 1,                                          \
		      .high = UINT32_MAX, .fallback = 1,  CONFIG_SAYS("Revision of the control block.")},    \
	[SIMULATION] = {"simulation", CONFIG_BOOLEAN, CONFIG_SAYS(simulation_says)}

enum { ID = STREAM_KEYS, VLAN, VLAN_PRIORITY, LEAST, MOST, WITH_QUALITY, WITH_TIME, POINTS, PUBLISHED_KEYS };
static const struct config_rule published_rules[PUBLISHED_KEYS] = {
    STREAM_RULES(true, "Name, that of its counters begins with it.",
		 "Reference of the data set, as `IED1LD0/LLN0$trip`.",
		 "The messages say that they are simulated."),
    [ID] = {"id", CONFIG_TEXT, .low = 1, .high = GOOSE_REFERENCE_SIZE - 1,
	    CONFIG_SAYS("GoID of the messages; without it, the name.")},
    [VLAN] = {"vlan", CONFIG_INTEGER, .low = 0, .high = 4094,
	      CONFIG_SAYS("VLAN of the messages, 0 for the priority alone; without it, they have no tag.",
			  .unset = true)},
    [VLAN_PRIORITY] = {"vlan_priority", CONFIG_INTEGER, .low = 0, .high = 7, .fallback = 4,
		       CONFIG_SAYS("Priority in the tag.")},
    [LEAST] = {"min_ms", CONFIG_INTEGER, .low = 1, .high = 1000, .fallback = 4,
	       CONFIG_SAYS("Milliseconds from a change to its first repetition; each time twice as many.")},
    [MOST] = {"max_ms", CONFIG_INTEGER, .low = 10, .high = 60000, .fallback = 1000,
	      CONFIG_SAYS(
		  "Milliseconds between repetitions at most; what is sent is to live three times as long.")},
    [WITH_QUALITY] = {"quality", CONFIG_BOOLEAN, .fallback = true,
		      CONFIG_SAYS("Each value is followed by its quality.")},
    [WITH_TIME] = {"time", CONFIG_BOOLEAN,
		   CONFIG_SAYS("Each value, with its quality, is followed by the time of the state.")},
    [POINTS] = {"points", CONFIG_ARRAY, .required = true, .high = GOOSE_ITEMS_MAX,
		CONFIG_SAYS(
		    "Names of the points, in the order of the data set.",
		    .json = CONFIG_JSON(
			{"minItems" : 1, "items" : {"type" : "string", "minLength" : 1, "maxLength" : 39}}))},
};
CONFIG_TABLE(goose_publication_table, .name = "goose_publication", .rules = published_rules,
	     .count = PUBLISHED_KEYS);

enum { POINT_NAME, POINT_TYPE, POINT_IOA, POINT_DEADBAND, POINT_GROUP, POINT_LN, POINT_KEYS };
static const struct config_rule point_rules[POINT_KEYS] = {
    [POINT_NAME] = {CONFIG_KEY_NAME, CONFIG_TEXT, .required = true, .low = 1, .high = MAP_NAME_SIZE - 1,
		    CONFIG_SAYS(
			"Name of the point, once in the file, without spaces and the characters `*?[]\\`.",
			.pattern = "^[^ *?\\[\\]\\\\\\u0000-\\u001f\\u007f]*$")},
    [POINT_TYPE] = {"type", CONFIG_CHOICE, .required = true, .choices = map_type_names,
		    CONFIG_SAYS("Type of the point.")},
    [POINT_IOA] = {"ioa", CONFIG_INTEGER, .required = true, .low = 1, .high = 16777215,
		   CONFIG_SAYS("Information object address.")},
    [POINT_DEADBAND] = {"deadband", CONFIG_NUMBER, .low = 0, .high = FLT_MAX,
			CONFIG_SAYS("Change of the value that is an event, in its unit; 0: every change.")},
    [POINT_GROUP] = {"group", CONFIG_INTEGER, .low = 1, .high = 16,
		     CONFIG_SAYS("Interrogation group; without it, none.")},
    [POINT_LN] = CONFIG_LN_RULE,
};
CONFIG_TABLE(goose_point_table, .name = "goose_point", .rules = point_rules, .count = POINT_KEYS);

enum { CA = STREAM_KEYS, ALIVE_MOST, DATA, SUBSCRIBED_KEYS };
static const struct config_rule subscribed_rules[SUBSCRIBED_KEYS] = {
    STREAM_RULES(false, "Name of its set of points; that of its counters begins with it.",
		 "Reference of the data set; without it, any.",
		 "From the first simulated message on, only such are taken."),
    [CA] = {"ca", CONFIG_INTEGER, .required = true, .low = 1, .high = 65534,
	    CONFIG_SAYS("Common address of its points, which no device has.")},
    [ALIVE_MOST] = {"alive_max_ms", CONFIG_INTEGER, .low = 10, .high = 600000, .fallback = 60000,
		    CONFIG_SAYS(
			"Milliseconds that a message holds at most, whatever its timeAllowedtoLive says.")},
    [DATA] = {"data", CONFIG_ARRAY, .required = true, .high = GOOSE_ITEMS_MAX,
	      CONFIG_SAYS("The data set, entry for entry: a point, or of the point before its quality or its "
			  "time, or unused. A structure is the entries in it.",
			  .forms = CONFIG_FORMS(&goose_point_table),
			  .json = CONFIG_JSON({
				  "minItems" : 1,
				  "items" : {
					  "anyOf" : [
						  {"$ref" : "#/$defs/goose_point"},
						  {"enum" : [ "quality", "time", "unused" ]}
					  ]
				  }
			  }))},
};
CONFIG_TABLE(goose_subscription_table, .name = "goose_subscription", .rules = subscribed_rules,
	     .count = SUBSCRIBED_KEYS);

enum { KEY_INTERFACE, KEY_PRIORITY, KEY_PUBLISH, KEY_SUBSCRIBE, KEYS };
static const struct config_rule rules[KEYS] = {
    [KEY_INTERFACE] = {"interface", CONFIG_TEXT, .required = true, .low = 1, .high = GOOSE_INTERFACE_SIZE - 1,
		       CONFIG_SAYS("Network interface that the messages go through.")},
    [KEY_PRIORITY] = {"priority", CONFIG_INTEGER, .low = 0, .high = PRIORITY_MOST, .fallback = PRIORITY,
		      CONFIG_SAYS("SCHED_FIFO priority, below that of the lines; 0: none.")},
    [KEY_PUBLISH] = {"publish", CONFIG_ARRAY, .high = GOOSE_PUBLISHED_MAX,
		     CONFIG_SAYS("Points that are published, an object for each control block.",
				 .table = &goose_publication_table)},
    [KEY_SUBSCRIBE] = {"subscribe", CONFIG_ARRAY, .high = GOOSE_SUBSCRIBED_MAX,
		       CONFIG_SAYS("Messages of others that become points, an object for each control block.",
				   .table = &goose_subscription_table)},
};
CONFIG_TABLE(goose_table, .name = "goose", .rules = rules, .count = KEYS,
	     .json = CONFIG_JSON({
		     "anyOf" : [
			     {"required" : ["publish"], "properties" : {"publish" : {"minItems" : 1}}},
			     {"required" : ["subscribe"], "properties" : {"subscribe" : {"minItems" : 1}}}
		     ]
	     }));

static const struct config_rule file_rule = {
    .name = "goose",
    .kind = CONFIG_OBJECT,
    CONFIG_SAYS("GOOSE of IEC 61850, published and subscribed to: rtu-goose.", .table = &goose_table)};

struct own {
	const json_t *object;
	const json_t *publish, *subscribe;
	uint32_t *members;
	uint32_t member_count;
};

/* ---- what both have ---------------------------------------------------------------------- */

/* 01:0c:cd:01:00:00 and on are GOOSE's (IEC 61850-8-1, annex B). */
static void read_destination(struct config_loader *loader, const struct config_place *place,
			     const struct config_value *value, struct goose_stream *stream)
{
	static const uint8_t first[] = {0x01, 0x0c, 0xcd, 0x01, 0x00, 0x00};
	const struct config_place here = config_key_of(place, subscribed_rules[DESTINATION].name);
	uint8_t *mac = stream->destination;
	int read = 0;

	memcpy(mac, first, sizeof(first));
	if (!value->given)
		return;
	if (sscanf(value->text, "%2hhx:%2hhx:%2hhx:%2hhx:%2hhx:%2hhx%n", &mac[0], &mac[1], &mac[2], &mac[3],
		   &mac[4], &mac[5], &read) != 6 ||
	    value->text[read] != '\0' || !(mac[0] & GROUP_BIT))
		config_error(&loader->report, &here,
			     "\"%s\" is no address of a group, expected one as 01:0c:cd:01:00:01",
			     value->text);
}

static void keep_text(char *out, size_t size, const struct config_value *value, const char *otherwise)
{
	snprintf(out, size, "%s", value->given ? value->text : otherwise);
}

static void read_stream(struct config_loader *loader, const struct config_place *place,
			const struct config_value *values, struct goose_stream *stream)
{
	keep_text(stream->name, sizeof(stream->name), &values[NAME], "");
	keep_text(stream->control, sizeof(stream->control), &values[CONTROL], "");
	keep_text(stream->data_set, sizeof(stream->data_set), &values[DATA_SET], "");
	read_destination(loader, place, &values[DESTINATION], stream);
	stream->app_id = (uint16_t)values[APP_ID].integer;
	stream->conf_rev = (uint32_t)values[CONF_REV].integer;
	stream->simulation = values[SIMULATION].integer != 0;
}

/* ---- what is subscribed to ------------------------------------------------------------------ */

static void add_point(struct config_loader *loader, const struct config_place *place, const json_t *json)
{
	const struct config_place name = config_key_of(place, CONFIG_KEY_NAME);
	const unsigned errors = loader->report.errors;
	struct config_value values[POINT_KEYS];
	struct map_point *point;

	config_read_keys(&loader->report, place, json, point_rules, POINT_KEYS, values);
	if (loader->report.errors != errors)
		return;
	point =
	    config_add_point(loader, place, values[POINT_NAME].text,
			     (enum map_type)values[POINT_TYPE].integer, (uint32_t)values[POINT_IOA].integer);
	config_check_name(&loader->report, &name, values[POINT_NAME].text);
	point->deadband = (float)values[POINT_DEADBAND].number;
	point->group = (uint8_t)values[POINT_GROUP].integer;
	if (values[POINT_LN].given)
		config_take_ln(loader, place, loader->config->point_count - 1, values[POINT_LN].text);
}

/* An element of "data": a point, or a word for what it is to the point before. */
static void read_leaf(struct config_loader *loader, const struct config_place *place, const json_t *json,
		      struct goose_leaf *leaf, uint32_t *points)
{
	const char *word = json_string_value(json);

	leaf->use = GOOSE_UNUSED;
	if (json_is_object(json)) {
		*leaf = (struct goose_leaf){.use = GOOSE_VALUE, .place = (uint16_t)(*points)++};
		add_point(loader, place, json);
		return;
	}
	if (word != NULL && strcmp(word, "unused") == 0)
		return;
	if (word != NULL && strcmp(word, "quality") == 0)
		leaf->use = GOOSE_QUALITY;
	else if (word != NULL && strcmp(word, "time") == 0)
		leaf->use = GOOSE_MOMENT;
	else
		config_error(
		    &loader->report, place,
		    "is no entry of a data set, expected a point, \"quality\", \"time\" or \"unused\"");
	if (leaf->use != GOOSE_UNUSED && *points == 0)
		config_error(&loader->report, place, "\"%s\" has no point before it", word);
	leaf->place = (uint16_t)(*points - 1);
}

static bool has_points(const json_t *data)
{
	const json_t *leaf;
	size_t i;

	json_array_foreach(data, i, leaf) if (json_is_object(leaf)) return true;
	return false;
}

static void read_subscription(struct config_loader *loader, const struct config_place *place,
			      const json_t *json)
{
	const struct config_place ca = config_key_of(place, subscribed_rules[CA].name);
	const struct config_place data = config_key_of(place, subscribed_rules[DATA].name);
	struct goose_subscription *subscription = map_next_record(loader->config, GOOSE_SUBSCRIPTIONS);
	struct config_value values[SUBSCRIBED_KEYS];
	uint32_t points = 0;

	config_read_keys(&loader->report, place, json, subscribed_rules, SUBSCRIBED_KEYS, values);
	read_stream(loader, place, values, &subscription->stream);
	subscription->alive_most_ms = (uint32_t)values[ALIVE_MOST].integer;
	subscription->set = NO_SET;
	subscription->first_leaf = map_record_count(loader->config, GOOSE_LEAVES);
	if (!values[DATA].given)
		return;
	if (!has_points(values[DATA].json)) {
		config_error(&loader->report, &data, "has no point, expected one at least");
		return;
	}
	subscription->set = (uint16_t)loader->config->set_count;
	config_add_set(loader, &ca, (uint16_t)values[CA].integer, subscription->stream.name);
	subscription->leaf_count = (uint32_t)json_array_size(values[DATA].json);
	for (uint32_t i = 0; i < subscription->leaf_count; i++) {
		const struct config_place here = config_element_of(&data, i);

		read_leaf(loader, &here, json_array_get(values[DATA].json, i),
			  map_next_record(loader->config, GOOSE_LEAVES), &points);
	}
}

/* ---- what is published ---------------------------------------------------------------------- */

static void add_member(struct config_loader *loader, const struct config_place *place, struct own *own,
		       const json_t *json)
{
	const char *name = json_string_value(json);
	const uint32_t point =
	    name == NULL ? MAP_NONE : config_index_name(&loader->index, loader->config, name);

	if (point == MAP_NONE)
		config_error(&loader->report, place, "is the name of no point");
	else if (loader->config->points[point].flags & MAP_POINT_NEVER_READ)
		config_error(&loader->report, place, "\"%s\" takes commands and has no value", name);
	else
		own->members[own->member_count++] = point;
}

static void check_publication(struct config_loader *loader, const struct config_place *place,
			      const struct own *own, const struct goose_publication *publication)
{
	if (publication->member_count == 0)
		config_error(&loader->report, place, "publishes no point, expected one at least");
	else if (goose_longest(publication, &own->members[publication->first_member],
			       loader->config->points) == 0)
		config_error(
		    &loader->report, place,
		    "does not fit into one message of 1500 octets and %u values: expected fewer points",
		    GOOSE_ITEMS_MAX);
	if (publication->least_ms > publication->most_ms)
		config_error(&loader->report, place, "has min_ms greater than max_ms");
}

static void read_publication(struct config_loader *loader, const struct config_place *place, struct own *own,
			     const json_t *json)
{
	const struct config_place points = config_key_of(place, published_rules[POINTS].name);
	struct goose_publication *publication = map_next_record(loader->config, GOOSE_PUBLICATIONS);
	const unsigned errors = loader->report.errors;
	struct config_value values[PUBLISHED_KEYS];

	config_read_keys(&loader->report, place, json, published_rules, PUBLISHED_KEYS, values);
	read_stream(loader, place, values, &publication->stream);
	keep_text(publication->id, sizeof(publication->id), &values[ID], publication->stream.name);
	if (publication->stream.data_set[0] == '\0')
		config_error(&loader->report, place,
			     "needs \"data_set\", the reference of what it publishes");
	publication->tagged = values[VLAN].given;
	publication->vlan = (uint16_t)values[VLAN].integer;
	publication->vlan_priority = (uint8_t)values[VLAN_PRIORITY].integer;
	publication->least_ms = (uint32_t)values[LEAST].integer;
	publication->most_ms = (uint32_t)values[MOST].integer;
	publication->with_quality = values[WITH_QUALITY].integer != 0;
	publication->with_time = values[WITH_TIME].integer != 0;
	publication->first_member = own->member_count;
	for (size_t i = 0; values[POINTS].given && i < json_array_size(values[POINTS].json); i++) {
		const struct config_place here = config_element_of(&points, i);

		add_member(loader, &here, own, json_array_get(values[POINTS].json, i));
	}
	publication->member_count = own->member_count - publication->first_member;
	if (loader->report.errors == errors)
		check_publication(loader, place, own, publication);
}

/* ---- the part ---------------------------------------------------------------------------- */

static uint32_t count_all(const json_t *array, const char *key)
{
	const json_t *element;
	size_t i, count = 0;

	json_array_foreach(array, i, element) count += json_array_size(json_object_get(element, key));
	return (uint32_t)count;
}

/* Nothing is reserved for a file that claims more than can be. */
static const json_t *array_of(const json_t *root, const char *key, size_t most)
{
	const json_t *array = json_object_get(json_object_get(root, file_rule.name), key);

	return json_array_size(array) > most ? NULL : array;
}

static bool begin(struct config_loader *loader, void *own_memory, const json_t *root)
{
	const json_t *publish = array_of(root, rules[KEY_PUBLISH].name, GOOSE_PUBLISHED_MAX);
	const json_t *subscribe = array_of(root, rules[KEY_SUBSCRIBE].name, GOOSE_SUBSCRIBED_MAX);
	const uint32_t published = (uint32_t)json_array_size(publish);
	const uint32_t subscribed = (uint32_t)json_array_size(subscribe);
	const uint32_t members = count_all(publish, published_rules[POINTS].name);
	const uint32_t leaves = count_all(subscribe, subscribed_rules[DATA].name);
	struct own *own = own_memory;
	void *settings, *publications, *subscriptions, *all_leaves;

	if (!json_is_object(json_object_get(root, file_rule.name)))
		return true;
	settings = config_allocate(1, sizeof(struct goose_settings));
	publications = config_allocate(published, sizeof(struct goose_publication));
	subscriptions = config_allocate(subscribed, sizeof(struct goose_subscription));
	all_leaves = config_allocate(leaves, sizeof(struct goose_leaf));
	own->members = config_allocate(members, sizeof(uint32_t));
	map_add_section(loader->config, GOOSE_SETTINGS, sizeof(struct goose_settings), 1, settings);
	map_add_section(loader->config, GOOSE_PUBLICATIONS, sizeof(struct goose_publication), 0,
			publications);
	map_add_section(loader->config, GOOSE_SUBSCRIPTIONS, sizeof(struct goose_subscription), 0,
			subscriptions);
	map_add_section(loader->config, GOOSE_LEAVES, sizeof(struct goose_leaf), 0, all_leaves);
	loader->sets_max += subscribed;
	loader->points_max += leaves;
	return settings && publications && subscriptions && all_leaves && own->members;
}

static void read_part(struct config_loader *loader, void *own_memory, const struct config_value *value)
{
	const struct config_place file = {.in = NULL};
	const struct config_place place = config_key_of(&file, file_rule.name);
	struct goose_settings *settings = goose_settings(loader->config);
	struct config_value values[KEYS];
	struct own *own = own_memory;

	if (!value->given)
		return;
	config_read_keys(&loader->report, &place, value->json, rules, KEYS, values);
	keep_text(settings->interface, sizeof(settings->interface), &values[KEY_INTERFACE], "");
	settings->priority = (int32_t)values[KEY_PRIORITY].integer;
	own->publish = values[KEY_PUBLISH].given ? values[KEY_PUBLISH].json : NULL;
	own->subscribe = values[KEY_SUBSCRIBE].given ? values[KEY_SUBSCRIBE].json : NULL;
	if (json_array_size(own->publish) + json_array_size(own->subscribe) == 0)
		config_error(&loader->report, &place, "has nothing to do, expected publish or subscribe");
}

static struct config_place place_of(const struct config_place *object, unsigned key)
{
	return config_key_of(object, rules[key].name);
}

static bool finish(struct config_loader *loader, void *own_memory)
{
	const struct config_place file = {.in = NULL};
	const struct config_place object = config_key_of(&file, file_rule.name);
	const struct config_place array = place_of(&object, KEY_SUBSCRIBE);
	const struct own *own = own_memory;
	const json_t *subscription;
	size_t i;

	json_array_foreach(own->subscribe, i, subscription)
	{
		const struct config_place place = config_element_of(&array, i);

		read_subscription(loader, &place, subscription);
	}
	return true;
}

static bool link_points(struct config_loader *loader, void *own_memory)
{
	const struct config_place file = {.in = NULL};
	const struct config_place object = config_key_of(&file, file_rule.name);
	const struct config_place array = place_of(&object, KEY_PUBLISH);
	struct own *own = own_memory;
	const json_t *publication;
	size_t i;

	if (!config_index_renew(&loader->index, loader->config))
		return false;
	json_array_foreach(own->publish, i, publication)
	{
		const struct config_place place = config_element_of(&array, i);

		read_publication(loader, &place, own, publication);
	}
	if (own->members != NULL)
		map_add_section(loader->config, GOOSE_MEMBERS, sizeof(uint32_t), own->member_count,
				own->members);
	own->members = NULL;
	return true;
}

static void end(void *own_memory)
{
	const struct own *own = own_memory;

	free(own->members);
}

const struct config_part goose_part = {
    .keys = &file_rule,
    .key_count = 1,
    .own_size = sizeof(struct own),
    .begin = begin,
    .read = read_part,
    .finish = finish,
    .link = link_points,
    .end = end,
};
