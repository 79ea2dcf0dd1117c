/* SPDX-License-Identifier: GPL-3.0-or-later */
/* What the gateway's page may change of the file: each key that there is, and who tries to get around its row. */
#include "config/page.h"
#include "iec104/config.h"
#include "modbus/config.h"
#include "rtud/config_parts.h"
#include "rtud/kinds.h"
#include "web/config.h"

#include <setjmp.h>
#include <stdarg.h>
#include <stddef.h>
#include <stdlib.h>
#include <string.h>

#include <cmocka.h>

/* ' for ", for the reader's sake */
static json_t *parse(const char *text, char **kept)
{
	char *copy = strdup(text);
	json_error_t error;
	json_t *json;

	for (char *c = copy; *c != '\0'; c++)
		*c = *c == '\'' ? '"' : *c;
	json = json_loads(copy, JSON_DECODE_ANY | JSON_REJECT_DUPLICATES, &error);
	assert_non_null(json);
	*kept = copy;
	return json;
}

static unsigned check_json(const json_t *was, const json_t *is, const char *text, FILE *messages)
{
	const struct config_part *parts[KINDS_MAX];
	struct config_rule rules[CONFIG_FILE_KEYS_MAX];
	const struct config_inside file = {.rules = rules,
					   .count = config_file_rules(parts, kinds_parts(parts), rules)};
	struct config_report report = {.messages = messages, .source = {"f", text, strlen(text)}};

	config_check_page(&report, was, is, &file);
	return report.errors;
}

static unsigned check(const char *was, const char *is, char said[512])
{
	char *was_text, *is_text;
	json_t *from = parse(was, &was_text), *to = parse(is, &is_text);
	FILE *messages;
	unsigned errors;

	memset(said, 0, 512);
	messages = fmemopen(said, 511, "w");
	errors = check_json(from, to, is_text, messages);
	fclose(messages);
	json_decref(from);
	json_decref(to);
	free(was_text);
	free(is_text);
	return errors;
}

static void assert_free(const char *was, const char *is)
{
	char said[512];

	if (check(was, is, said) != 0)
		fail_msg("%s", said);
	assert_int_equal(check(is, was, said), 0);
}

/* Also the way back. */
static void assert_refused(const char *was, const char *is, const char *message)
{
	char said[512];

	assert_int_not_equal(check(was, is, said), 0);
	assert_non_null(strstr(said, message));
	assert_int_not_equal(check(is, was, said), 0);
}

#define LINE(slaves)   "{'port': [{'value': 3, 'slaves': [" slaves "]}]}"
#define SLAVE(objects) LINE("{'id': 1, 'coils': [" objects "]}")

static void test_lines_devices_points_and_periods_are_free(void **state)
{
	(void)state;
	assert_free("{'port': []}", LINE(""));
	assert_free(LINE("{'id': 1}"), LINE("{'id': 2}, {'id': 1, 'period_ms': 100}"));
	assert_free(SLAVE("{'address': 1}"), SLAVE("{'address': 2, 'name': 'x', 'bits': [0, 1]}"));
	assert_free(LINE("{'id': 1, 'template': 'meter'}"), LINE("{'id': 1, 'template': '../../x'}"));
	assert_free("{'templates': {}}", "{'templates': {'a': {'coils': [{'address': 1}]}}}");
	assert_free(LINE("{'id': 1}"), LINE("{'id': 1, 'overrides': {'a': null, 'b': {'scale': 2}}}"));
	assert_free("{'port': [{'host': '192.0.2.1'}]}",
		    "{'port': [{'host': '192.0.2.2', 'tcp_port': 503}]}");
}

static void test_order_of_keys_is_no_difference(void **state)
{
	(void)state;
	assert_free("{'web': {'port': 1, 'users': '/a'}, 'snmp': {}}",
		    "{'snmp': {}, 'web': {'users': '/a', 'port': 1}}");
}

static void test_what_else_differs_is_refused_at_its_line(void **state)
{
	(void)state;
	assert_refused("{'modules': [{'program': '/a'}]}", "{\n'modules': [{'program': '/b'}]}",
		       "f:2: modules: is another one");
	assert_refused("{'port': []}", "{'port': [],\n'web': {'setup': true}}", "f:2: web: is new");
	assert_refused("{'port': [],\n 'web': {}}", "{'port': []}", "f:1: web: is missing");
	assert_refused("{'event_ring': 64}", "{'event_ring': 64.0}", "event_ring: is another one");
	assert_refused("{'include': ['a']}", "{'include': ['../../etc/shadow']}", "include: is another one");
	assert_refused("{'include': ['a', 'b']}", "{'include': ['b', 'a']}", "include: is another one");
	assert_refused("{}", "{'no_such_key': 1}", "no_such_key: is new");
}

/* Inside what the page may change. */
static void test_a_device_of_the_machine_is_refused(void **state)
{
	(void)state;
	assert_refused(LINE(""), "{'port': [{'value': 3,\n'device': '/etc/x', 'slaves': []}]}",
		       "f:2: port[0].device: is new");
	assert_refused("{'port': []}", "{'port': [{'device': 'ttyS1'}]}", "port[0].device: is new");
	assert_refused("{'port': []}", "{'port': [{'pass_through': {'address': '0.0.0.0'}}]}",
		       "port[0].pass_through: is new");
	assert_refused(SLAVE("{'address': 1}"), SLAVE("{'address': 1, 'no_such': 1}"),
		       "port[0].slaves[0].coils[0].no_such: is new");
	assert_refused(LINE("{'id': 1}"), LINE("{'id': 1, 'overrides': {'a': {'program': '/x'}}}"),
		       "port[0].slaves[0].overrides.a.program: is new");
	assert_refused("{}", "{'templates': {'a': {'id': 1}}}", "templates.a.id: is new");
	assert_refused("{'templates': {'a': {'program': 1}}}", "{'templates': {'b': {'program': 1}}}",
		       "templates.b.program: is new");
}

/* What is locked stays where it is, whatever comes before it and goes. */
static void test_locked_elements_keep_their_order(void **state)
{
	(void)state;
	assert_free("{'port': [{'value': 7, 'device': 'a'}, {'value': 8, 'device': 'b'}]}",
		    "{'port': [{'value': 1}, {'value': 7, 'device': 'a'}, {'value': 2}, {'value': 8, "
		    "'device': 'b', 'baud_rate': 9600}]}");
	assert_refused("{'port': [{'device': 'a'}, {'device': 'b'}]}",
		       "{'port': [{'device': 'b'}, {'device': 'a'}]}", "port[0].device: is another one");
	assert_refused("{'port': [{'device': 'a'}, {'device': 'b'}]}", "{'port': [{'device': 'a'}]}",
		       "device: is missing");
	assert_refused("{'port': [{'device': 'a'}]}", "{'port': [{'device': 'a'}, {'device': 'a'}]}",
		       "port[1].device: is new");
}

/* An installer commands nothing: not by what the gateway writes itself, either. */
static void test_what_the_gateway_writes_itself_is_refused(void **state)
{
	(void)state;
	assert_refused(SLAVE("{'address': 1}"), SLAVE("{'address': 1, 'write_values': [1]}"),
		       "coils[0].write_values: is new");
	assert_refused(SLAVE(""), SLAVE("{'address': 1, 'write_at_return': true}"),
		       "coils[0].write_at_return: is new");
	assert_refused(SLAVE("{'address': 1, 'write_every_ms': 1000}"),
		       SLAVE("{'address': 1, 'write_every_ms': 100}"), "write_every_ms: is another one");
	assert_refused(LINE("{'id': 1}"), LINE("{'id': 1, 'page_address': 7}"), "page_address: is new");
	assert_refused(SLAVE("{'address': 1}"), SLAVE("{'address': 1, 'page': 7}"), "page: is new");
	assert_refused(LINE("{'id': 1}"), LINE("{'id': 1, 'overrides': {'a': {'write_values': [1]}}}"),
		       "overrides.a.write_values: is new");
}

/* Nor by moving that to where it does something else. */
static void test_what_is_locked_acts_on_what_it_did(void **state)
{
	(void)state;
	assert_refused("{'port': [{'value': 7, 'pass_through': {}}, {'value': 8}]}",
		       "{'port': [{'value': 8, 'pass_through': {}}, {'value': 7}]}",
		       "port[0].value: is not as in the file in force");
	assert_refused("{'port': [{'active': 0, 'pass_through': {}}]}",
		       "{'port': [{'active': 1, 'pass_through': {}}]}", "port[0].active: is not as");
	assert_refused("{'port': [{'host': 'a', 'tcp_port': 1, 'process': 2}]}",
		       "{'port': [{'host': 'b', 'process': 2}]}", "port[0].tcp_port: is not as");
	assert_refused(SLAVE("{'address': 1, 'write_values': [1]}"),
		       SLAVE("{'address': 2, 'write_values': [1]}"), "coils[0].address: is not as");
	assert_refused(SLAVE("{'address': 1, 'write_values': [1]}"),
		       SLAVE("{'address': 1, 'write_values': [1], 'inverted': true}"),
		       "coils[0].inverted: is not as");
	assert_refused(LINE("{'id': 1, 'page_address': 7}"), LINE("{'id': 2, 'page_address': 7}"),
		       "slaves[0].id: is not as");
	assert_free(
	    LINE("{'id': 1, 'page_address': 7}"),
	    LINE("{'id': 3}, {'id': 1, 'page_address': 7, 'period_ms': 100, 'coils': [{'address': 1}]}"));
}

static void test_other_forms_hide_nothing(void **state)
{
	(void)state;
	assert_refused("{'port': []}", "{'port': {'device': 'a'}}", "port: is another one");
	assert_refused("{'port': []}", "{'port': 'x'}", "port: is another one");
	assert_refused("{'port': []}", "{'port': [[{'device': 'a'}]]}", "port[0]: is new");
	assert_refused("{'templates': {}}", "{'templates': [{'program': 1}]}", "templates: is another one");
	assert_refused("{'web': {}}", "[]", "the file: is another one");
	assert_free("{'port': []}", "{'port': [null]}"); /* which rtud --check refuses */
}

/* ---- each key that there is ------------------------------------------------------------------ */

#if OPENRTU_SCHEMA
#define DEPTH_MAX 8

/* The keys that lead to a table. */
struct path {
	const struct config_rule *rules[DEPTH_MAX];
	unsigned depth;
};

static unsigned tried, allowed;

static bool is_named(const struct config_rule *rule)
{
	return rule->kind == CONFIG_OBJECT && rule->table == NULL;
}

/* With the path's last key, or everything but that. */
static json_t *file_with(const struct path *path, bool last)
{
	json_t *inner = last ? json_pack("{s:s}", path->rules[path->depth - 1]->name, "x") : json_object();

	for (unsigned i = path->depth - 1; i-- > 0;) {
		const struct config_rule *rule = path->rules[i];

		if (rule->kind == CONFIG_OBJECT)
			inner = json_pack("{s:o}", rule->name,
					  is_named(rule) ? json_pack("{s:o}", "a", inner) : inner);
		else
			inner = json_pack("{s:[o]}", rule->name, inner);
	}
	return inner;
}

static void try_key(const struct path *path)
{
	json_t *without = file_with(path, false), *with = file_with(path, true);
	const struct config_rule *last = path->rules[path->depth - 1];
	FILE *nowhere = fopen("/dev/null", "w");
	bool marked = true;

	for (unsigned i = 0; i < path->depth; i++)
		marked &= path->rules[i]->page;
	/* "x" is no array and no object. */
	marked &= last->inside == NULL;
	if ((check_json(without, with, "", nowhere) == 0) != marked)
		fail_msg("%s, %u deep: its row says %s", last->name, path->depth, marked ? "page" : "not");
	tried++;
	allowed += marked;
	fclose(nowhere);
	json_decref(without);
	json_decref(with);
}

static void try_table(const struct config_table *table, struct path path);

static void try_tables(const struct config_table *const *tables, struct path path)
{
	for (; tables != NULL && *tables != NULL; tables++)
		try_table(*tables, path);
}

static void try_rule(const struct config_rule *rule, struct path path)
{
	assert_true(path.depth < DEPTH_MAX);
	path.rules[path.depth++] = rule;
	try_key(&path);
	if (rule->table != NULL)
		try_table(rule->table, path);
	try_tables(rule->forms, path);
}

static void try_table(const struct config_table *table, struct path path)
{
	for (size_t i = 0; i < table->count; i++)
		try_rule(&table->rules[i], path);
	if (table->own != NULL)
		try_rule(table->own, path);
	try_tables(table->forms, path);
}

static void test_each_key_is_refused_unless_its_row_lets_it(void **state)
{
	const struct config_part *parts[KINDS_MAX];
	struct config_rule rules[CONFIG_FILE_KEYS_MAX];
	const struct config_table file = {.rules = rules,
					  .count = config_file_rules(parts, kinds_parts(parts), rules)};

	(void)state;
	try_table(&file, (struct path){.depth = 0});
	assert_true(tried > 300 && allowed > 100 && allowed < tried);
}

/* Whoever marks one more outermost key thinks of what it opens. */
static void test_the_page_reaches_lines_and_templates_alone(void **state)
{
	const struct config_part *parts[KINDS_MAX];
	struct config_rule rules[CONFIG_FILE_KEYS_MAX];
	const size_t count = config_file_rules(parts, kinds_parts(parts), rules);

	(void)state;
	for (size_t i = 0; i < count; i++)
		assert_int_equal(rules[i].page, strcmp(rules[i].name, "port") == 0 ||
						    strcmp(rules[i].name, "templates") == 0);
}
#endif

static uint32_t flags_of_page(struct web_settings web)
{
	struct modbus_settings modbus = {.priority = 45};
	struct iec104_settings iec104 = {.port = 2404};
	struct map_module_plan modules[MAP_MODULES_MAX] = {0};
	struct map_config config = {.settings.event_ring = 64, .modules = modules};

	map_add_section(&config, MODBUS_SETTINGS, sizeof(modbus), 1, &modbus);
	map_add_section(&config, IEC104_SETTINGS, sizeof(iec104), 1, &iec104);
	map_add_section(&config, WEB_SETTINGS, sizeof(web), 1, &web);
	assert_true(kinds_plan(&config));
	for (uint32_t i = 0; i < config.module_count; i++)
		if (strcmp(modules[i].kind, WEB_KIND) == 0)
			return modules[i].flags;
	skip(); /* a gateway that is built without its page */
	return 0;
}

/* What a process with these flags may, map/test_hostile.c shows. */
static void test_the_process_requests_what_the_file_lets_it(void **state)
{
	(void)state;
	assert_int_equal(flags_of_page((struct web_settings){.port = 443}), 0);
	assert_int_equal(flags_of_page((struct web_settings){.setup = true}),
			 MAP_MAY_REQUEST | MAP_ASKS_SETUP | MAP_REQUESTS_LISTED);
	assert_int_equal(flags_of_page((struct web_settings){.commands = true}), MAP_MAY_REQUEST);
	assert_int_equal(flags_of_page((struct web_settings){.commands = true, .setup = true}),
			 MAP_MAY_REQUEST | MAP_ASKS_SETUP);
}

int main(void)
{
	const struct CMUnitTest tests[] = {
		cmocka_unit_test(test_lines_devices_points_and_periods_are_free),
		cmocka_unit_test(test_order_of_keys_is_no_difference),
		cmocka_unit_test(test_what_else_differs_is_refused_at_its_line),
		cmocka_unit_test(test_a_device_of_the_machine_is_refused),
		cmocka_unit_test(test_locked_elements_keep_their_order),
		cmocka_unit_test(test_what_the_gateway_writes_itself_is_refused),
		cmocka_unit_test(test_what_is_locked_acts_on_what_it_did),
		cmocka_unit_test(test_other_forms_hide_nothing),
		cmocka_unit_test(test_the_process_requests_what_the_file_lets_it),
#if OPENRTU_SCHEMA
		cmocka_unit_test(test_each_key_is_refused_unless_its_row_lets_it),
		cmocka_unit_test(test_the_page_reaches_lines_and_templates_alone),
#endif
	};

	return cmocka_run_group_tests(tests, NULL, NULL);
}
