/* SPDX-License-Identifier: GPL-3.0-or-later */
/* One slave of a port, and the device it becomes. */
#include "map/time_ns.h"
#include "modbus/config_object.h"
#include "modbus/config_part.h"
#include "modbus/plan.h"

#include <string.h>

#define DESCRIPTION_MAX 63 /* octets: as the report's program takes it */
/* MODBUS Messaging on TCP/IP Implementation Guide V1.0b, 4.4.1.2: who is at the connection's end itself. */
#define UNIT_ITSELF 255
#define CA_PER_PORT 1000

#define OVERRIDES_MAX 256 /* objects that one slave has differently */

/* MODBUS Application Protocol V1.1b3, 6.1 to 6.4. */
#define READ_BITS_MAX      2000
#define READ_REGISTERS_MAX 125

/* A slave's tables come first, so that enum modbus_table indexes them. */
enum {
	SLAVE_DESCRIPTION = MODBUS_TABLES,
	SLAVE_RESPONSE_TIMEOUT,
	SLAVE_RESPONSE_TIMEOUT_MIN,
	SLAVE_RETRIES,
	SLAVE_PROBE_MAX,
	SLAVE_PERIOD,
	SLAVE_REACTION,
	SLAVE_PAUSE,
	SLAVE_MAX_BITS,
	SLAVE_MAX_REGISTERS,
	SLAVE_HOLES,
	SLAVE_PAGE_ADDRESS,
	SLAVE_IDENTIFY,
	SLAVE_IDENTIFICATION,
	SLAVE_READ_BACK,
	SLAVE_WRITE_FUNCTION,
	SLAVE_CA,
	SLAVE_IOA_OFFSET,
	SLAVE_NAME_PREFIX,
	SLAVE_OF_TEMPLATE, /* so many keys a template has */
	SLAVE_ID = SLAVE_OF_TEMPLATE,
	SLAVE_TEMPLATE,
	SLAVE_OVERRIDES,
	SLAVE_KEYS
};
static const char *const write_functions[] = {"single", "multiple", NULL};
static const struct config_inside modbus_overrides_inside = {
    .rules = modbus_object_rules, .count = OBJECT_KEYS, .by_name = true, .whole = true};
static const struct config_rule slave_rules[SLAVE_KEYS] = {
    [MODBUS_COILS] = {"coils", CONFIG_ARRAY, .page = true, .inside = &modbus_object_inside,
		      .high = CONFIG_POINTS_MAX,
		      CONFIG_SAYS("Objects read with function 1 and written with 5 or 15.",
				  .table = &modbus_coil_table)},
    [MODBUS_DISCRETE_INPUTS] = {"discrete_inputs", CONFIG_ARRAY, .page = true,
				.inside = &modbus_object_inside, .high = CONFIG_POINTS_MAX,
				CONFIG_SAYS("Objects read with function 2.",
					    .table = &modbus_discrete_input_table)},
    [MODBUS_INPUT_REGISTERS] = {"input_registers", CONFIG_ARRAY, .page = true,
				.inside = &modbus_object_inside, .high = CONFIG_POINTS_MAX,
				CONFIG_SAYS("Objects read with function 4.",
					    .table = &modbus_input_register_table)},
    [MODBUS_HOLDING_REGISTERS] = {"holding_registers", CONFIG_ARRAY, .page = true,
				  .inside = &modbus_object_inside, .high = CONFIG_POINTS_MAX,
				  CONFIG_SAYS("Objects read with function 3 and written with 6 or 16.",
					      .table = &modbus_holding_register_table)},
    [SLAVE_DESCRIPTION] =
	{"description", CONFIG_TEXT, .page = true, .low = 0, .high = DESCRIPTION_MAX,
	 CONFIG_SAYS(
	     "Name of the device in UTF-8, of which the gateway keeps 39 bytes. Without it, p⟨port⟩.⟨id⟩.")},
    [SLAVE_RESPONSE_TIMEOUT] =
	{"response_timeout_ms", CONFIG_INTEGER, .page = true, .low = 20, .high = 10000, .fallback = 500,
	 CONFIG_SAYS(
	     "Longest time from the end of a request to the first byte of the answer, in milliseconds.")},
    [SLAVE_RESPONSE_TIMEOUT_MIN] =
	{"response_timeout_min_ms", CONFIG_INTEGER, .page = true, .low = 10, .high = 10000, .fallback = 100,
	 CONFIG_SAYS(
	     "Milliseconds that are waited for an answer at least, when a shorter time-out was learned. Not "
	     "above response_timeout_ms; without it, that where it is less than the default.")},
    [SLAVE_RETRIES] = {"retries", CONFIG_INTEGER, .page = true, .low = 0, .high = 5, .fallback = 1,
		       CONFIG_SAYS(
			   "Reads repeated before the device counts as dead. Writes are never repeated.")},
    [SLAVE_PROBE_MAX] =
	{MODBUS_KEY_PROBE_MAX, CONFIG_INTEGER, .page = true, .low = 1, .high = UINT8_MAX,
	 CONFIG_SAYS("Seconds between two probes of the device while it is dead, at most. Without it, up to "
		     "60, and as many as keep what they cost below 5 % of the line's time.")},
    [SLAVE_PERIOD] = {"period_ms", CONFIG_INTEGER, .page = true, .low = 10, .high = 86400000,
		      CONFIG_SAYS("Milliseconds between two reads of the device's objects, where they say "
				  "nothing else. Without it, they are read in turn.")},
    [SLAVE_REACTION] = {"reaction_ms", CONFIG_NUMBER, .page = true, .low = 0.1, .high = 10000,
			CONFIG_SAYS(
			    "Milliseconds that the device takes, from the silence behind a request to the "
			    "first byte of its answer: for the plan of its reads, and for what rtud --check "
			    "says. Not above response_timeout_ms. Without it, 5 are assumed.",
			    .json = CONFIG_JSON({"examples" : [ 0.1, 12.5, 500 ]}))},
    [SLAVE_PAUSE] = {"pause_ms", CONFIG_INTEGER, .page = true, .low = 0, .high = 10000, .fallback = 0,
		     CONFIG_SAYS("Milliseconds between the end of the device's answer and the next request "
				 "to it, at least; others of the line are asked meanwhile. A longer pause "
				 "that the device needs is learned.",
				 .see = "limit.md#pauses")},
    [SLAVE_MAX_BITS] = {"max_bits", CONFIG_INTEGER, .page = true, .low = 1, .high = READ_BITS_MAX,
			.fallback = READ_BITS_MAX,
			CONFIG_SAYS(
			    "Coils or discrete inputs that one request may read of the device, at most.")},
    [SLAVE_MAX_REGISTERS] = {"max_registers", CONFIG_INTEGER, .page = true, .low = 1,
			     .high = READ_REGISTERS_MAX, .fallback = READ_REGISTERS_MAX,
			     CONFIG_SAYS("Registers that one request may read of the device, at most.")},
    [SLAVE_HOLES] = {"holes", CONFIG_BOOLEAN, .page = true, .fallback = true,
		     CONFIG_SAYS(
			 "A request may read addresses between the objects where that is faster than another "
			 "request. With false, the device is asked for the objects' addresses only.")},
    [SLAVE_IDENTIFY] = {"identify", CONFIG_BOOLEAN, .page = true,
			CONFIG_SAYS(
			    "The device is asked what it is (function 43/14) when it answers for the "
			    "first time and when it is back. By default only one with an object of it in "
			    "identification.",
			    .see = "configuration.md#what-a-device-is")},
    [SLAVE_IDENTIFICATION] =
	{"identification", CONFIG_OBJECT, .page = true, .inside = &modbus_identification_inside,
	 CONFIG_SAYS("What it shall say that it is, and which registers tell it from others. "
		     "`rtuctl lines` and `openrtu scan` compare it.",
		     .table = &modbus_identification_table, .see = "configuration.md#what-a-device-is")},
    [SLAVE_PAGE_ADDRESS] =
	{"page_address", CONFIG_INTEGER, .low = 0, .high = MODBUS_ADDRESS_LAST,
	 CONFIG_SAYS("Modbus address of the holding register that chooses what the device has at the "
		     "addresses of objects with `page`. The gateway writes it before each read of these.",
		     .see = "configuration.md#pages", .unset = true)},
    [SLAVE_READ_BACK] =
	{"read_back", CONFIG_BOOLEAN, .page = true, .fallback = true,
	 CONFIG_SAYS("What a command has written is read at once, and the command ends with that, where the "
		     "objects say nothing else. With false, it ends with the device's confirmation.",
		     .see = "telecontrol.md#without-read-back")},
    [SLAVE_WRITE_FUNCTION] = {"write_function", CONFIG_CHOICE, .page = true, .choices = write_functions,
			      CONFIG_SAYS("How one coil or one register is written at first: single with "
					  "function 5 or 6, multiple with 15 or "
					  "16. After exception 1 (illegal function) it is the other.",
					  .see = "telecontrol.md#which-function-writes")},
    [SLAVE_CA] = {"ca", CONFIG_INTEGER, .page = true, .low = 1, .high = 65534,
		  CONFIG_SAYS(
		      "Common address, which several slaves may share. Without it, 1000 × port + id.")},
    [SLAVE_IOA_OFFSET] =
	{"ioa_offset", CONFIG_INTEGER, .page = true, .low = 0, .high = 16777214,
	 CONFIG_SAYS(
	     "Added to the information object address of each of the slave's objects, given or not.")},
    [SLAVE_NAME_PREFIX] =
	{"name_prefix", CONFIG_TEXT, .page = true, .low = 0, .high = MAP_NAME_SIZE - 2,
	 CONFIG_SAYS(
	     "Put before each name that an object of the slave has, and before the names of status bits.",
	     .pattern = "^[^\\u0000-\\u0020\\u007f*?\\[\\]\\\\]*$")},
    [SLAVE_ID] = {"id", CONFIG_INTEGER, .page = true, .stays = true, .required = true,
		  .low = MODBUS_BROADCAST, .high = MODBUS_UNIT_MAX,
		  CONFIG_SAYS("Modbus address, once on a line. 0 is the broadcast: coils and "
			      "holding_registers only, written and never read.")},
    [SLAVE_TEMPLATE] = {MODBUS_KEY_TEMPLATE, CONFIG_TEXT, .page = true, .low = 1, .high = MAP_NAME_SIZE - 1,
			CONFIG_SAYS("Name of the template whose keys and objects the slave has; its own keys "
				    "override those, its own objects are added.",
				    .see = "configuration.md#templates",
				    .json = CONFIG_JSON({"examples" : ["meter"]}))},
    [SLAVE_OVERRIDES] = {"overrides", CONFIG_OBJECT, .page = true, .inside = &modbus_overrides_inside,
			 CONFIG_SAYS("By their names in the template: what its objects have differently "
				     "here, an object of keys; null leaves one out.",
				     .json = CONFIG_JSON({
					     "maxProperties" : 256,
					     "additionalProperties" : {"type" : [ "object", "null" ]},
					     "examples" : [ {} ]
				     }))},
};
const struct config_inside modbus_slave_inside = {.rules = slave_rules, .count = SLAVE_KEYS};
const struct config_inside modbus_templates_inside = {
    .rules = slave_rules, .count = SLAVE_OF_TEMPLATE, .by_name = true};
CONFIG_SHARED_TABLE(modbus_slave_table, .name = "slave", .rules = slave_rules, .count = SLAVE_KEYS,
		    .json = CONFIG_JSON({
			    "if" : {"required" : ["id"], "properties" : {"id" : {"const" : 0}}},
			    "then" : {
				    "properties" : {
					    "discrete_inputs" : {"maxItems" : 0},
					    "input_registers" : {"maxItems" : 0},
					    "period_ms" : false,
					    "reaction_ms" : false,
					    "pause_ms" : false,
					    "max_bits" : false,
					    "max_registers" : false,
					    "holes" : false,
					    "identify" : false,
					    "identification" : false,
					    "page_address" : false
				    }
			    }
		    }));

CONFIG_SHARED_TABLE(modbus_template_table, .name = "template", .rules = slave_rules,
		    .count = SLAVE_OF_TEMPLATE, .like = &modbus_slave_table);

/* On a TCP connection 0 is a unit like others, and 255 its end itself. */
static const struct config_rule tcp_id_rule = {
    "id",
    CONFIG_INTEGER,
    .page = true,
    .required = true,
    .low = 0,
    .high = UNIT_ITSELF,
    CONFIG_SAYS(
	"Unit identifier, once on a connection: 255 or 0 for the device itself, 1 to 247 behind a "
	"gateway, or what the device's manual says; 248 to 254 are reserved. 0 is no broadcast here: it is "
	"read and answers like others.",
	.json = CONFIG_JSON({"not" : {"minimum" : 248, "maximum" : 254}}))};
CONFIG_SHARED_TABLE(modbus_tcp_slave_table, .name = "tcp_slave", .rules = slave_rules, .count = SLAVE_KEYS,
		    .own = &tcp_id_rule, .like = &modbus_slave_table);

static void rules_of_line(const struct modbus_port *line, struct config_rule rules[SLAVE_KEYS])
{
	memcpy(rules, slave_rules, sizeof(slave_rules));
	if (line->framing == MODBUS_FRAMING_TCP)
		rules[SLAVE_ID] = tcp_id_rule;
}

static void check_unit(struct modbus_loader *loader, const struct config_place *slave, int64_t unit)
{
	const struct config_place here = config_key_of(slave, slave_rules[SLAVE_ID].name);

	if (unit > MODBUS_UNIT_MAX && unit < UNIT_ITSELF)
		config_error(loader->report, &here, "%lld is reserved, expected 0 to %d or %d",
			     (long long)unit, MODBUS_UNIT_MAX, UNIT_ITSELF);
}

static void check_broadcast(struct modbus_loader *loader, const struct config_place *slave,
			    const struct config_value *values)
{
	for (size_t table = 0; table < MODBUS_TABLES; table++) {
		const struct config_place here = config_key_of(slave, modbus_table_names[table]);

		if (!modbus_is_writable((enum modbus_table)table) && json_array_size(values[table].json) > 0)
			config_error(loader->report, &here,
				     "slave 0 is the broadcast address, which is never read, expected only "
				     "coils and holding_registers");
	}
	for (size_t key = SLAVE_PROBE_MAX; key <= SLAVE_TEMPLATE; key++) {
		const struct config_place here = config_key_of(slave, slave_rules[key].name);

		if ((key <= SLAVE_IDENTIFICATION || key == SLAVE_TEMPLATE) && values[key].given)
			config_error(loader->report, &here,
				     "has no meaning for slave 0: the broadcast address is never read");
	}
}

static uint32_t span(const struct modbus_point *point)
{
	const struct modbus_extent extent = modbus_extent_of(point);

	return extent.last - extent.first + 1;
}

/* An object is read whole. The device's, which are the last entries. */
static void check_spans(struct modbus_loader *loader, const struct map_set *set)
{
	const struct modbus_slave *slave =
	    &modbus_slaves(loader->config)[modbus_slave_count(loader->config) - 1];

	for (uint32_t i = set->first_point; i < loader->config->point_count; i++) {
		const struct modbus_entry *entry = &loader->entries[i];
		bool bits = entry->wire.table <= MODBUS_DISCRETE_INPUTS;
		uint32_t limit = bits ? slave->max_bits : slave->max_registers;
		struct config_place links[MODBUS_ENTRY_LINKS];

		if (span(&entry->wire) > limit)
			config_error(loader->report, modbus_entry_place(entry, links),
				     "is read with %u %s at once, which is more than %s of its slave",
				     span(&entry->wire), bits ? "bits" : "registers",
				     slave_rules[bits ? SLAVE_MAX_BITS : SLAVE_MAX_REGISTERS].name);
	}
}

/* It has more pages than the plan has room for. */
static void check_pages(struct modbus_loader *loader, const struct config_place *slave,
			const struct map_set *set)
{
	const struct config_place here = config_key_of(slave, slave_rules[SLAVE_PAGE_ADDRESS].name);
	uint32_t pages[MODBUS_PAGES_MAX], count = 0;

	for (uint32_t i = set->first_point; i < loader->config->point_count; i++) {
		const uint32_t page = loader->entries[i].page;
		uint32_t place = 0;

		while (place < count && pages[place] != page)
			place++;
		if (page == 0 || place < count)
			continue;
		if (count == MODBUS_PAGES_MAX) {
			config_error(loader->report, &here, "is of more than %d pages", MODBUS_PAGES_MAX);
			return;
		}
		pages[count++] = page;
	}
}

/* The floor of a time-out, which is the ceiling where that is lower than the default. */
static uint16_t least_timeout_ms(struct modbus_loader *loader, const struct config_place *slave,
				 const struct config_value *values)
{
	const struct config_place here = config_key_of(slave, slave_rules[SLAVE_RESPONSE_TIMEOUT_MIN].name);
	int64_t least_ms = values[SLAVE_RESPONSE_TIMEOUT_MIN].integer;
	int64_t whole_ms = values[SLAVE_RESPONSE_TIMEOUT].integer;

	if (least_ms <= whole_ms)
		return (uint16_t)least_ms;
	if (values[SLAVE_RESPONSE_TIMEOUT_MIN].given)
		config_error(loader->report, &here, "%lld is above response_timeout_ms, %lld",
			     (long long)least_ms, (long long)whole_ms);
	return (uint16_t)whole_ms;
}

static uint32_t reaction_us(struct modbus_loader *loader, const struct config_place *slave,
			    const struct config_value *values)
{
	const struct config_place here = config_key_of(slave, slave_rules[SLAVE_REACTION].name);
	int64_t whole_ms = values[SLAVE_RESPONSE_TIMEOUT].integer;

	if (values[SLAVE_REACTION].number > (double)whole_ms)
		config_error(loader->report, &here, "%g is above response_timeout_ms, %lld",
			     values[SLAVE_REACTION].number, (long long)whole_ms);
	return (uint32_t)(US_PER_MS * values[SLAVE_REACTION].number + 0.5);
}

/* As much as a name holds, of whole characters. */
static void take_description(char name[MAP_NAME_SIZE], const char *text)
{
	size_t length = strnlen(text, MAP_NAME_SIZE);

	if (length == MAP_NAME_SIZE)
		for (length--; length > 0 && ((uint8_t)text[length] & 0xc0) == 0x80; length--)
			;
	memcpy(name, text, length);
	name[length] = '\0';
}

/* Of itself nobody is: a device may hang at a function that it does not know. */
static bool is_asked(const struct config_value *values)
{
	return values[SLAVE_IDENTIFY].given ? values[SLAVE_IDENTIFY].integer != 0
					    : modbus_says_objects(values[SLAVE_IDENTIFICATION].json);
}

static void add_device(struct modbus_loader *loader, const struct config_place *place,
		       const struct config_value *values)
{
	struct map_config *config = loader->config;
	struct modbus_port *port = &modbus_ports(config)[modbus_port_count(config) - 1];
	struct modbus_slave *slave = map_next_record(config, MODBUS_SLAVES);
	struct map_set *set = &config->sets[config->set_count++];
	uint8_t unit = (uint8_t)values[SLAVE_ID].integer;

	*set = (struct map_set){
	    .ca = values[SLAVE_CA].given ? (uint16_t)values[SLAVE_CA].integer
					 : (uint16_t)(CA_PER_PORT * port->port + unit),
	    .first_point = config->point_count,
	};
	*slave = (struct modbus_slave){
	    .port = (uint16_t)(modbus_port_count(config) - 1),
	    .unit = unit,
	    .retries = (uint8_t)values[SLAVE_RETRIES].integer,
	    .response_timeout_ms = (uint16_t)values[SLAVE_RESPONSE_TIMEOUT].integer,
	    .max_bits = (uint16_t)values[SLAVE_MAX_BITS].integer,
	    .max_registers = (uint16_t)values[SLAVE_MAX_REGISTERS].integer,
	    .no_holes = !values[SLAVE_HOLES].integer,
	    .probe_max_s = (uint8_t)values[SLAVE_PROBE_MAX].integer,
	    .response_timeout_min_ms = least_timeout_ms(loader, place, values),
	    .reaction_us = reaction_us(loader, place, values),
	    .pause_ms = (uint16_t)values[SLAVE_PAUSE].integer,
	    .writes_multiple = values[SLAVE_WRITE_FUNCTION].integer != 0,
	    .not_asked = !is_asked(values),
	    .page_address = (uint16_t)values[SLAVE_PAGE_ADDRESS].integer,
	};
	snprintf(set->prefix, sizeof(set->prefix), "p%u.%u", port->port, unit);
	if (values[SLAVE_DESCRIPTION].given && values[SLAVE_DESCRIPTION].text[0] != '\0')
		take_description(set->name, values[SLAVE_DESCRIPTION].text);
	else
		snprintf(set->name, sizeof(set->name), "%s", set->prefix);
	port->device_count++;
}

/* slave_of[id]: 1 + index of the slave of this port that has the id */
static void claim_unit(struct modbus_loader *loader, const struct config_place *slave, int64_t unit,
		       size_t slave_of[UNIT_ITSELF + 1])
{
	const struct config_place here = config_key_of(slave, slave_rules[SLAVE_ID].name);

	if (slave_of[unit] != 0)
		config_error(loader->report, &here, "%lld is already the id of slaves[%zu] of this port",
			     (long long)unit, slave_of[unit] - 1);
	else
		slave_of[unit] = slave->index + 1;
}

/* ---- templates --------------------------------------------------------------------------- */

/* Its keys are those of a slave, without an id or a template of its own. */
static void check_template(struct modbus_loader *loader, struct config_template *template)
{
	const struct config_place file = config_template_file(template, NULL);
	const struct config_place templates = config_key_of(&file, CONFIG_KEY_TEMPLATES);
	const struct config_place here = config_key_of(&templates, template->name);
	struct config_value values[SLAVE_OF_TEMPLATE];
	unsigned errors = loader->report->errors;

	config_read_keys(loader->report, &here, template->json, slave_rules, SLAVE_OF_TEMPLATE, values);
	template->wrong = loader->report->errors != errors;
}

void modbus_check_templates(struct modbus_loader *loader)
{
	for (uint32_t i = 0; i < loader->files->template_count; i++)
		check_template(loader, &loader->files->templates[i]);
}

/* The template that the slave names, NULL: none, or none that could be used. */
static struct config_template *template_of(struct modbus_loader *loader, const struct config_place *slave,
					   const json_t *json)
{
	const struct config_place here = config_key_of(slave, MODBUS_KEY_TEMPLATE);
	const char *name = json_string_value(json_object_get(json, MODBUS_KEY_TEMPLATE));
	struct config_template *template = name == NULL ? NULL : config_find_template(loader->files, name);

	if (name != NULL && template == NULL)
		config_error(loader->report, &here, "there is no template with this name%s",
			     loader->files->template_count == 0
				 ? ": neither the file nor those that it includes have any"
				 : "");
	return template != NULL && !template->wrong ? template : NULL;
}

/* The slave's keys, and the template's where the slave has none; the template's objects are read apart. */
static const json_t *merged(struct modbus_loader *loader, const struct config_template *template,
			    const json_t *slave)
{
	json_t *both = json_copy((json_t *)template->json);

	for (size_t table = 0; table < MODBUS_TABLES; table++)
		json_object_del(both, modbus_table_names[table]);
	if (both == NULL || json_object_update(both, (json_t *)slave) < 0 ||
	    json_array_append_new(loader->files->kept, both) < 0) {
		config_out_of_memory(loader->report);
		return slave;
	}
	return both;
}

static bool has_object(const json_t *template, const char *name)
{
	for (size_t table = 0; table < MODBUS_TABLES; table++) {
		const json_t *object;
		size_t i;

		json_array_foreach(json_object_get(template, modbus_table_names[table]), i, object)
		{
			const char *other = json_string_value(json_object_get(object, CONFIG_KEY_NAME));

			if (other != NULL && strcmp(other, name) == 0)
				return true;
		}
	}
	return false;
}

static void check_overrides(struct modbus_loader *loader, const struct config_place *slave,
			    const json_t *overrides, const struct config_template *template)
{
	const struct config_place here = config_key_of(slave, slave_rules[SLAVE_OVERRIDES].name);
	const char *name;
	json_t *json;

	if (json_object_size(overrides) > OVERRIDES_MAX) {
		config_error(loader->report, &here, "has %zu keys, expected at most %d",
			     json_object_size(overrides), OVERRIDES_MAX);
		return;
	}
	json_object_foreach((json_t *)overrides, name, json)
	{
		const struct config_place place = config_key_of(&here, name);

		if (!json_is_object(json) && !json_is_null(json))
			config_error(loader->report, &place,
				     "is neither an object { }, whose keys replace the template's, nor null, "
				     "which leaves the object out");
		else if (template == NULL || !has_object(template->json, name))
			config_error(loader->report, &place, "is not the name of an object of the template");
	}
}

/* What is wrong with the template is said for the first of its slaves, unless that has something of its own there. */
static void read_template_objects(struct modbus_loader *loader, const struct config_place *slave,
				  struct config_template *template, struct modbus_entry entry)
{
	const struct config_place file = config_template_file(template, slave);
	const struct config_place templates = config_key_of(&file, CONFIG_KEY_TEMPLATES);
	const struct config_place place = config_key_of(&templates, template->name);
	unsigned errors = loader->report->errors;

	entry.template = template;
	for (size_t table = 0; table < MODBUS_TABLES; table++)
		modbus_read_objects(loader, &place,
				    json_object_get(template->json, modbus_table_names[table]),
				    (enum modbus_table)table, entry);
	template->wrong = loader->report->errors != errors &&entry.overrides == NULL;
}

/* ---- slaves ------------------------------------------------------------------------------ */

/* What all objects of the slave have of it. */
static void fill_entry(struct modbus_entry *entry, const struct config_value *values)
{
	entry->period_ms = (uint32_t)values[SLAVE_PERIOD].integer;
	entry->read_back = values[SLAVE_READ_BACK].integer;
	entry->may_be_paged = values[SLAVE_PAGE_ADDRESS].given;
	entry->ioa_offset = (uint32_t)values[SLAVE_IOA_OFFSET].integer;
	entry->prefix = values[SLAVE_NAME_PREFIX].given ? values[SLAVE_NAME_PREFIX].text : "";
	entry->overrides = values[SLAVE_OVERRIDES].given ? values[SLAVE_OVERRIDES].json : NULL;
}

static void read_slave(struct modbus_loader *loader, const struct config_place *place, const json_t *json,
		       struct modbus_entry entry, size_t slave_of[UNIT_ITSELF + 1])
{
	const struct config_place prefix = config_key_of(place, slave_rules[SLAVE_NAME_PREFIX].name);
	struct config_template *template = template_of(loader, place, json);
	const struct modbus_port *line = &modbus_ports(loader->config)[modbus_port_count(loader->config) - 1];
	struct config_rule rules[SLAVE_KEYS];
	struct config_value values[SLAVE_KEYS];
	struct map_set *set;

	rules_of_line(line, rules);
	if (template != NULL)
		json = merged(loader, template, json);
	config_read_keys(loader->report, place, json, rules, SLAVE_KEYS, values);
	if (values[SLAVE_ID].given) {
		check_unit(loader, place, values[SLAVE_ID].integer);
		claim_unit(loader, place, values[SLAVE_ID].integer, slave_of);
		if (values[SLAVE_ID].integer == MODBUS_BROADCAST && line->framing != MODBUS_FRAMING_TCP)
			check_broadcast(loader, place, values);
	}
	if (values[SLAVE_OVERRIDES].given && (template != NULL || !values[SLAVE_TEMPLATE].given))
		check_overrides(loader, place, values[SLAVE_OVERRIDES].json, template);
	if (values[SLAVE_NAME_PREFIX].given)
		config_check_name(loader->report, &prefix, values[SLAVE_NAME_PREFIX].text);
	add_device(loader, place, values);
	set = &loader->config->sets[loader->config->set_count - 1];
	entry.ca = set->ca;
	fill_entry(&entry, values);
	if (template != NULL)
		read_template_objects(loader, place, template, entry);
	for (size_t table = 0; table < MODBUS_TABLES; table++)
		modbus_read_objects(loader, place, values[table].json, (enum modbus_table)table, entry);
	set->point_count = loader->config->point_count - set->first_point;
	check_spans(loader, set);
	check_pages(loader, place, set);
	if (values[SLAVE_IDENTIFICATION].given)
		modbus_read_identification(loader, place, slave_rules[SLAVE_IDENTIFICATION].name,
					   values[SLAVE_IDENTIFICATION].json);
}

void modbus_read_slaves(struct modbus_loader *loader, const struct config_place *port, const json_t *slaves)
{
	const struct config_place array = config_key_of(port, MODBUS_KEY_SLAVES);
	size_t slave_of[UNIT_ITSELF + 1] = {0};
	const json_t *json;
	size_t i;

	json_array_foreach(slaves, i, json)
	{
		const struct config_place place = config_element_of(&array, i);

		read_slave(loader, &place, json,
			   (struct modbus_entry){.port = (uint32_t)port->index, .slave = (uint32_t)i},
			   slave_of);
	}
}
