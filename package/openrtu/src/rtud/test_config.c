/* SPDX-License-Identifier: GPL-3.0-or-later */
/* What a good file becomes in the map's tables. Wrong files: tests/config/test_config.py, through rtud --check. */
#include "iec104/config.h"
#include "journal/config.h"
#include "modbus/config.h"
#include "rtud/config.h"

#include <setjmp.h>
#include <stdarg.h>
#include <stddef.h>
#include <stdlib.h>
#include <string.h>
#include <sys/mman.h>
#include <unistd.h>

#include <cmocka.h>

/* The JSON of these tests has ' for ", for the reader's sake. */
#define LINE(value, slaves)                                                                                  \
	"{'value': " value                                                                                   \
	", 'active': 1, 'baud_rate': 19200, 'data_bits': 8, 'stop_bits': 2, 'parity': 0, "                   \
	"'slaves': [" slaves "]}"

static enum config_result load_with(struct config_modules modules, const char *text,
				    struct map_config *config, FILE *messages)
{
	int file = memfd_create("gateway.json", 0);
	enum config_result result;
	char path[32];

	for (const char *c = text; *c != '\0'; c++)
		assert_int_equal(write(file, *c == '\'' ? "\"" : c, 1), 1);
	snprintf(path, sizeof(path), "/proc/self/fd/%d", file);
	result = config_load(path, NULL, modules, config, messages);
	close(file);
	return result;
}

static struct map_config load(const char *text)
{
	const struct config_modules all = {
	    .iec104 = true, .iec61850 = true, .modbus = true, .snmp = true, .tls = true, .web = true};
	struct map_config config;

	assert_int_equal(load_with(all, text, &config, stderr), CONFIG_GOOD);
	return config;
}

static void assert_name(const struct map_config *config, size_t point, const char *expected)
{
	char name[MAP_NAME_SIZE];

	map_point_name(config, &config->points[point], name);
	assert_string_equal(name, expected);
}

/* Figure 4.9, with its objects in another order. */
static void test_report_file(void **state)
{
	struct map_config config = load("{'port': ["
					"{'value': 1, 'active': 0, 'baud_rate': 0, 'data_bits': 0, "
					"'stop_bits': 0, 'parity': 0, 'slaves': []}," LINE(
					    "3", "{'id': 35, 'description': 'Temperature sensor',"
						 "'holding_registers': [{'address': 1}, {'address': 0}],"
						 "'coils': [{'address': 2}],"
						 "'input_registers': [{'address': 9999}],"
						 "'discrete_inputs': [{'address': 0}]}") "]}");
	static const struct {
		const char *name;
		uint32_t ioa;
		enum map_type type;
		unsigned flags;
	} expected[] = {
	    {"p3.35.c2", 3, MAP_SINGLE, MAP_POINT_COMMAND},
	    {"p3.35.d0", 10001, MAP_SINGLE, 0},
	    {"p3.35.i9999", 40000, MAP_SCALED, 0},
	    {"p3.35.h0", 40001, MAP_SCALED, MAP_POINT_COMMAND},
	    {"p3.35.h1", 40002, MAP_SCALED, MAP_POINT_COMMAND},
	};

	(void)state;
	assert_int_equal(modbus_port_count(&config), 1);
	assert_int_equal(modbus_ports(&config)[0].port, 3);
	assert_int_equal(modbus_ports(&config)[0].baud, 19200);
	assert_int_equal(modbus_ports(&config)[0].stop_bits, 2);
	assert_int_equal(modbus_ports(&config)[0].parity, MODBUS_PARITY_NONE);
	assert_int_equal(modbus_ports(&config)[0].process, 1);
	assert_string_equal(modbus_ports(&config)[0].device, "ttyS3");
	assert_int_equal(config.set_count, 1);
	assert_int_equal(config.sets[0].ca, 3035);
	assert_int_equal(modbus_slaves(&config)[0].unit, 35);
	assert_int_equal(modbus_slaves(&config)[0].retries, 1);
	assert_int_equal(modbus_slaves(&config)[0].response_timeout_ms, 500);
	assert_int_equal(modbus_slaves(&config)[0].response_timeout_min_ms, 100);
	assert_string_equal(config.sets[0].name, "Temperature sensor");
	assert_int_equal(config.point_count, 5);
	for (size_t i = 0; i < config.point_count; i++) {
		assert_name(&config, i, expected[i].name);
		assert_int_equal(config.points[i].ioa, expected[i].ioa);
		assert_int_equal(config.points[i].type, expected[i].type);
		assert_int_equal(config.points[i].flags, expected[i].flags);
		assert_int_equal(modbus_points(&config)[i].width, 1);
		assert_true(modbus_points(&config)[i].scale == 1.0f &&
			    modbus_points(&config)[i].offset == 0.0f);
	}
	config_free(&config);
}

static void test_settings_defaults(void **state)
{
	struct map_config config = load("{'port': []}");
	const struct iec104_settings *settings = iec104_settings(&config);

	(void)state;
	assert_string_equal(settings->address, "0.0.0.0");
	assert_int_equal(settings->port, 2404);
	assert_int_equal(settings->k, 12);
	assert_int_equal(settings->w, 8);
	assert_int_equal(settings->t1_s, 15);
	assert_int_equal(settings->t2_s, 10);
	assert_int_equal(settings->t3_s, 20);
	assert_int_equal(settings->max_connections, 8);
	assert_int_equal(settings->connections_per_address, 4);
	assert_false(settings->command_without_clock);
	assert_false(settings->ignore_summer_bit);
	assert_int_equal(config.settings.select_timeout_s, 30);
	assert_int_equal(config.settings.command_timeout_s, 10);
	assert_int_equal(config.settings.clock, MAP_CLOCK_GATEWAY);
	assert_int_equal(settings->clock_master_count, 0);
	assert_int_equal(modbus_settings(&config)->priority, 45);
	assert_int_equal(modbus_settings(&config)->heartbeat_limit_ms, 100);
	assert_int_equal(config.settings.event_ring, 4096);
	assert_int_equal(settings->master_count, 0);
	assert_int_equal(config.settings.queue_count, 0);
	for (unsigned i = 0; i < 8; i++)
		assert_int_equal(settings->originators_refused[i], 0);
	assert_false(iec104_tls_used(settings));
	config_free(&config);
}

static void test_time_outs_of_commands(void **state)
{
	static const struct {
		const char *file;
		uint16_t select_s, command_s;
	} files[] = {
	    {"{'port': [], 'commands': {'select_timeout': 5, 'command_timeout': 4}}", 5, 4},
	    {"{'port': [], 'commands': {'select_timeout': 5}, 'iec104': {'command_timeout': 8}}", 5, 8},
	    {"{'port': [], 'commands': {'select_timeout': 5}, 'iec104': {'select_timeout': 5}}", 5, 10},
	};

	(void)state;
	for (size_t i = 0; i < sizeof(files) / sizeof(files[0]); i++) {
		struct map_config config = load(files[i].file);

		assert_int_equal(config.settings.select_timeout_s, files[i].select_s);
		assert_int_equal(config.settings.command_timeout_s, files[i].command_s);
		config_free(&config);
	}
}

static void test_settings(void **state)
{
	struct map_config config = load(
	    "{'port': [], 'iec104': {'address': '::1', 'port': 2405, 'k': 6, 'w': 4, 't1': 9,"
	    "'t2': 5, 't3': 172800, 'max_connections': 5, 'connections_per_address': 5, 'select_timeout': 7, "
	    "'command_timeout': 8, 'command_without_clock': true, 'ignore_summer_bit': true,"
	    "'clock_masters': ['192.0.2.1', '2001:db8::1']}, 'clock': 'system',"
	    "'modbus': {'priority': 0, 'heartbeat_limit_ms': 2500}, 'event_ring': 64}");
	const struct iec104_settings *settings = iec104_settings(&config);

	(void)state;
	assert_string_equal(settings->address, "::1");
	assert_int_equal(settings->port, 2405);
	assert_int_equal(settings->k, 6);
	assert_int_equal(settings->w, 4);
	assert_int_equal(settings->t1_s, 9);
	assert_int_equal(settings->t2_s, 5);
	assert_int_equal(settings->t3_s, 172800);
	assert_int_equal(settings->max_connections, 5);
	assert_int_equal(settings->connections_per_address, 5);
	assert_true(settings->command_without_clock);
	assert_true(settings->ignore_summer_bit);
	assert_int_equal(config.settings.select_timeout_s, 7);
	assert_int_equal(config.settings.command_timeout_s, 8);
	assert_int_equal(config.settings.clock, MAP_CLOCK_SYSTEM);
	assert_int_equal(settings->clock_master_count, 2);
	assert_string_equal(settings->clock_masters[1], "2001:db8::1");
	assert_int_equal(modbus_settings(&config)->priority, 0);
	assert_int_equal(modbus_settings(&config)->heartbeat_limit_ms, 2500);
	assert_int_equal(config.settings.event_ring, 64);
	config_free(&config);
}

static void test_controlling_stations(void **state)
{
	struct map_config config =
	    load("{'port': [], 'event_ring': 1024, 'masters': ['192.0.2.1', '::1', '192.0.2.7', "
		 "'192.0.2.8', '192.0.2.2', '::ffff:192.0.2.1'], 'originators': [0, 33, 255],"
		 "'redundancy_groups': [{'name': 'a', 'masters': ['192.0.2.7', '192.0.2.8'], 'queue': 100},"
		 "{'name': 'b', 'masters': ['::1']}]}");
	const struct iec104_settings *settings = iec104_settings(&config);

	(void)state;
	assert_int_equal(settings->master_count, 6);
	assert_int_equal(settings->lone_masters, 2); /* one of them said twice */
	assert_string_equal(settings->masters[1], "::1");
	assert_int_equal(config.settings.queue_count, 2);
	assert_string_equal(config.settings.queues[0].name, "a");
	assert_int_equal(settings->groups[0].master_count, 2);
	assert_string_equal(settings->groups[0].masters[1], "192.0.2.8");
	assert_int_equal(config.settings.queues[0].limit, 100);
	assert_int_equal(config.settings.queues[1].limit, 1023);
	assert_int_equal(settings->originators_refused[0], 0xfffffffe);
	assert_int_equal(settings->originators_refused[1], 0xfffffffd);
	assert_int_equal(settings->originators_refused[2], 0xffffffff);
	assert_int_equal(settings->originators_refused[7], 0x7fffffff);
	config_free(&config);
}

#define FILES "'certificate': '/own.pem', 'key': '/own.key', 'ca': '/ca.pem'"

static void test_tls_defaults(void **state)
{
	struct map_config config = load("{'port': [], 'tls': {" FILES "}}");
	const struct iec104_settings *settings = iec104_settings(&config);

	(void)state;
	assert_true(iec104_tls_used(settings));
	assert_int_equal(settings->port, 19998);
	assert_string_equal(settings->tls.certificate, "/own.pem");
	assert_string_equal(settings->tls.key, "/own.key");
	assert_string_equal(settings->tls.ca, "/ca.pem");
	assert_string_equal(settings->tls.crl, "");
	assert_int_equal(settings->tls.versions, CHANNEL_TLS_1_2 | CHANNEL_TLS_1_3);
	assert_int_equal(settings->tls.peer_count, 0);
	assert_int_equal(settings->tls.resumption_s, 86400);
	assert_int_equal(settings->tls.renewal_s, 86400);
	config_free(&config);
}

static void test_tls(void **state)
{
	struct map_config config =
	    load("{'port': [], 'iec104': {'port': 2404}, 'tls': {" FILES
		 ", 'crl': '/crl.pem', 'versions': ['1.3'], 'resumption_s': 0, 'renewal_s': 10,"
		 "'masters': ['centre 1', '00:11:22:33:44:55:66:77:88:99:aa:bb:cc:dd:"
		 "ee:FF:00:11:22:33:44:55:66:77:88:99:AA:BB:CC:DD:EE:FF']}}");
	const struct iec104_settings *settings = iec104_settings(&config);

	(void)state;
	assert_int_equal(settings->port, 2404);
	assert_string_equal(settings->tls.crl, "/crl.pem");
	assert_int_equal(settings->tls.versions, CHANNEL_TLS_1_3);
	assert_int_equal(settings->tls.resumption_s, 0);
	assert_int_equal(settings->tls.renewal_s, 10);
	assert_int_equal(settings->tls.peer_count, 2);
	assert_string_equal(settings->tls.peers[0], "centre 1");
	assert_int_equal(strlen(settings->tls.peers[1]), 95);
	config_free(&config);
}

static void test_object_keys(void **state)
{
	struct map_config config = load("{'port': [" LINE(
	    "6", "{'id': 1, 'coils': [{'address': 4, 'type': 'double', 'bit_order': "
		 "'on_off', 'select': true, 'name': 'breaker'}],"
		 "'input_registers': ["
		 "{'address': 0, 'signed': false, 'scale': 0.5, 'offset': -2, 'deadband': 3,"
		 " 'group': 16, 'cyclic_ms': 1000, 'byte_order': 'little'},"
		 "{'address': 65534, 'type': 'float', 'word_order': 'little', "
		 "'ioa': 16777215, 'name': 'level'}]}") "]}");
	const struct map_point *point = config.points;
	const struct modbus_point *wire = modbus_points(&config);

	(void)state;
	assert_string_equal(modbus_ports(&config)[0].device, "ttyS8");
	assert_string_equal(config.sets[0].name, "p6.1");
	assert_int_equal(config.point_count, 3);
	assert_name(&config, 0, "breaker");
	assert_name(&config, 1, "p6.1.i0");
	assert_name(&config, 2, "level");
	assert_int_equal(point[0].type, MAP_DOUBLE);
	assert_int_equal(wire[0].width, 2);
	assert_int_equal(point[0].ioa, 5);
	assert_int_equal(wire[0].flags, MODBUS_BITS_SWAPPED);
	assert_int_equal(point[0].flags, MAP_POINT_SELECT | MAP_POINT_COMMAND);
	assert_int_equal(wire[1].flags, MODBUS_BYTES_SWAPPED);
	assert_true(wire[1].scale == 0.5f && wire[1].offset == -2.0f && point[1].deadband == 3.0f);
	assert_int_equal(point[1].group, 16);
	assert_int_equal(point[1].send_period_ms, 1000);
	assert_int_equal(wire[2].flags, MODBUS_WORDS_SWAPPED);
	assert_int_equal(wire[2].address, 65534);
	assert_int_equal(wire[2].width, 2);
	assert_int_equal(point[2].ioa, 16777215);
	config_free(&config);
}

/* The points are put in order behind the file's back; a status bit is found by its name, given or not. */
static void test_status_bits(void **state)
{
	struct map_config config = load("{'port': [" LINE(
	    "1", "{'id': 1, 'coils': [{'address': 0}]}, "
		 "{'id': 2, 'input_registers': [{'address': 9, 'blocked_by': 'test', "
		 "'not_topical_by': 'p1.2.c4'}],"
		 "'discrete_inputs': [{'address': 8, 'name': 'test'}, {'address': 1}],"
		 "'coils': [{'address': 4}, {'address': 2, 'substituted_by': 'p1.2.d1'}]}") "]}");
	const uint32_t first = config.sets[1].first_point;
	const struct modbus_point *wire = modbus_points(&config) + first;

	(void)state;
	assert_int_equal(config.sets[1].point_count, 5);
	assert_name(&config, first + 4, "p1.2.i9");
	assert_name(&config, first + modbus_extra_of(&config, &wire[4])->links[MODBUS_BLOCKED_BY] - 1,
		    "test");
	assert_name(&config, first + modbus_extra_of(&config, &wire[4])->links[MODBUS_NOT_TOPICAL_BY] - 1,
		    "p1.2.c4");
	assert_int_equal(modbus_extra_of(&config, &wire[4])->links[MODBUS_SUBSTITUTED_BY], 0);
	assert_name(&config, first + 0, "p1.2.c2");
	assert_name(&config, first + modbus_extra_of(&config, &wire[0])->links[MODBUS_SUBSTITUTED_BY] - 1,
		    "p1.2.d1");
	config_free(&config);
}

static void test_an_object_has_its_own_period_or_its_slaves(void **state)
{
	struct map_config config = load("{'port': [" LINE(
	    "3", "{'id': 1, 'period_ms': 500, 'coils': [{'address': 0}, "
		 "{'address': 1, 'period_ms': 200}]}, {'id': 2, 'coils': [{'address': 0}]}") "]}");

	(void)state;
	assert_int_equal(modbus_points(&config)[0].scan_period_ms, 500);
	assert_int_equal(modbus_points(&config)[1].scan_period_ms, 200);
	assert_int_equal(modbus_points(&config)[2].scan_period_ms, 0);
	config_free(&config);
}

static void test_a_slave_has_its_limits_or_the_protocols(void **state)
{
	struct map_config config = load(
	    "{'port': [" LINE("3", "{'id': 1, 'max_bits': 32, 'max_registers': 4, 'holes': false, "
				   "'reaction_ms': 12.5, 'pause_ms': 300, 'write_function': 'multiple'}, "
				   "{'id': 2, 'holes': true}") "]}");

	(void)state;
	assert_int_equal(modbus_slaves(&config)[0].max_bits, 32);
	assert_int_equal(modbus_slaves(&config)[0].max_registers, 4);
	assert_true(modbus_slaves(&config)[0].no_holes);
	assert_int_equal(modbus_slaves(&config)[0].reaction_us, 12500);
	assert_int_equal(modbus_slaves(&config)[0].pause_ms, 300);
	assert_true(modbus_slaves(&config)[0].writes_multiple);
	assert_false(modbus_slaves(&config)[1].writes_multiple);
	assert_int_equal(modbus_slaves(&config)[1].max_bits, 2000);
	assert_int_equal(modbus_slaves(&config)[1].max_registers, 125);
	assert_false(modbus_slaves(&config)[1].no_holes);
	assert_int_equal(modbus_slaves(&config)[1].reaction_us, 0);
	assert_int_equal(modbus_slaves(&config)[1].pause_ms, 0);
	config_free(&config);
}

/* It takes all tables and keys there. */
static void test_unit_0_of_a_connection_is_no_broadcast(void **state)
{
	struct map_config config = load(
	    "{'port': [{'value': 7, 'active': 1, 'host': '192.0.2.7', 'slaves': [{'id': 0, 'pause_ms': 5, "
	    "'input_registers': [{'address': 0, 'period_ms': 100}]}]}]}");

	(void)state;
	assert_int_equal(modbus_slaves(&config)[0].unit, 0);
	assert_false(config.points[0].flags & MAP_POINT_NEVER_READ);
	assert_string_equal(config.sets[0].prefix, "p7.0");
	config_free(&config);
}

/* Behind a server that passes on what it is sent is a line, with its broadcast. */
static void test_rtu_over_tcp_is_a_line_with_a_connection(void **state)
{
	struct map_config config =
	    load("{'port': [{'value': 7, 'active': 1, 'host': '192.0.2.7', 'framing': 'rtu', 'slaves': "
		 "[{'id': 0, 'coils': [{'address': 0}]}]}, {'value': 8, 'active': 1, 'host': '192.0.2.8',"
		 " 'framing': 'tcp', 'slaves': []}, {'value': 9, 'active': 1, 'host': '192.0.2.9',"
		 " 'slaves': []}]}");

	(void)state;
	assert_true(modbus_is_tcp(&modbus_ports(&config)[0]));
	assert_int_equal(modbus_ports(&config)[0].framing, MODBUS_FRAMING_RTU);
	assert_int_equal(modbus_ports(&config)[1].framing, MODBUS_FRAMING_TCP);
	assert_int_equal(modbus_ports(&config)[2].framing, MODBUS_FRAMING_TCP);
	assert_true(config.points[0].flags & MAP_POINT_NEVER_READ);
	config_free(&config);
}

static void test_an_object_is_read_back_as_it_says_or_its_slave(void **state)
{
	static const bool read_back[] = {true, false, false, true, true};
	struct map_config config = load("{'port': [" LINE(
	    "3", "{'id': 1, 'coils': [{'address': 0}, {'address': 1, 'read_back': false}]},"
		 "{'id': 2, 'read_back': false, 'coils': [{'address': 0}, {'address': 1, 'read_back': true}],"
		 " 'input_registers': [{'address': 0}]}") "]}");

	(void)state;
	for (size_t i = 0; i < sizeof(read_back) / sizeof(read_back[0]); i++)
		assert_int_equal(!(modbus_points(&config)[i].flags & MODBUS_NO_READ_BACK), read_back[i]);
	config_free(&config);
}

static void test_an_object_is_written_elsewhere_or_only_written(void **state)
{
	struct map_config config = load("{'port': [" LINE(
	    "3", "{'id': 1, 'coils': [{'address': 0}, {'address': 1, 'write_only': true},"
		 " {'address': 2, 'write_only': false}],"
		 " 'discrete_inputs': [{'address': 0, 'write_address': 65535}, {'address': 1}],"
		 " 'input_registers': [{'address': 5, 'type': 'float', 'write_address': 7,"
		 " 'blocked_by': 'p3.1.c0'}]}") "]}");
	const struct modbus_point *wire = modbus_points(&config);

	(void)state;
	assert_int_equal(config.points[0].flags, MAP_POINT_COMMAND);
	assert_int_equal(config.points[1].flags, MAP_POINT_COMMAND | MAP_POINT_NEVER_READ);
	assert_int_equal(config.points[2].flags, MAP_POINT_COMMAND);
	assert_int_equal(config.points[3].flags, MAP_POINT_COMMAND);
	assert_int_equal(config.points[4].flags, 0);
	assert_int_equal(modbus_written(&config, &wire[0]).address, 0);
	assert_int_equal(modbus_written(&config, &wire[3]).table, MODBUS_COILS);
	assert_int_equal(modbus_written(&config, &wire[3]).address, 65535);
	assert_int_equal(modbus_written(&config, &wire[5]).table, MODBUS_HOLDING_REGISTERS);
	assert_int_equal(modbus_written(&config, &wire[5]).address, 7);
	assert_int_equal(wire[5].address, 5);
	assert_int_equal(modbus_extra_of(&config, &wire[5])->links[MODBUS_BLOCKED_BY], 1);
	config_free(&config);
}

/* Behind all others, on a line that is none. */
static void test_own_station(void **state)
{
	struct map_config config =
	    load("{'iec104': {'own_ca': 900}, 'redundancy_groups': [{'name': 'a', 'masters': ['::1']}], "
		 "'port': [" LINE("1", "{'id': 1, 'coils': [{'address': 0}]}") "]}");
	const struct map_point *point = config.points + 1;

	(void)state;
	assert_int_equal(modbus_port_count(&config), 1);
	assert_int_equal(modbus_slave_count(&config), 1);
	assert_int_equal(config.sets[1].ca, 900);
	assert_int_equal(config.set_count, 2);
	assert_int_equal(config.sets[1].point_count, 4);
	assert_int_equal(config.point_count, 5);
	assert_name(&config, 1 + 0, "gateway.queue-1.losing");
	assert_name(&config, 1 + 1, "gateway.queue-others.losing");
	assert_int_equal(point[1].ioa, 9);
	assert_name(&config, 1 + 2, "gateway.queue-1.lost");
	assert_int_equal(point[2].type, MAP_BITSTRING);
	assert_int_equal(point[3].ioa, 109);
	assert_int_equal(point[3].flags, 0);
	config_free(&config);
}

/* Points by device, devices by line; the second line's first device has none. */
static void test_tables_refer_to_each_other(void **state)
{
	struct map_config config = load("{'port': [" LINE(
	    "2", "{'id': 9, 'coils': [{'address': 1}, {'address': 0}]},"
		 "{'id': 0, 'coils': [{'address': 5}]}") "," LINE("1", "{'id': 4}, {'id': 3, 'coils': "
								       "[{'address': 7}]}") "]}");

	(void)state;
	assert_int_equal(modbus_port_count(&config), 2);
	assert_int_equal(modbus_ports(&config)[0].port, 2);
	assert_int_equal(modbus_ports(&config)[0].first_device, 0);
	assert_int_equal(modbus_ports(&config)[0].device_count, 2);
	assert_int_equal(modbus_ports(&config)[1].first_device, 2);
	assert_int_equal(modbus_ports(&config)[1].device_count, 2);
	assert_int_equal(config.sets[1].ca, 2000);
	assert_int_equal(config.sets[1].first_point, 2);
	assert_int_equal(config.sets[1].point_count, 1);
	assert_int_equal(modbus_slaves(&config)[2].port, 1);
	assert_int_equal(config.sets[2].first_point, 3);
	assert_int_equal(config.sets[2].point_count, 0);
	assert_int_equal(config.sets[3].first_point, 3);
	assert_int_equal(config.sets[3].point_count, 1);
	assert_name(&config, 0, "p2.9.c0");
	assert_name(&config, 1, "p2.9.c1");
	assert_int_equal(config.points[3].set, 3);
	config_free(&config);
}

/* Each file with none of the modules, with some, with all: which are refused, and what is said. */
static void test_modules_that_are_not_there(void **state)
{
	static const struct {
		const char *text;
		bool needs_iec104, needs_modbus, needs_tls;
	} files[] = {
	    {"{'port': []}", false, false, false},
	    {"{'port': [{'value': 1, 'active': 0, 'slaves': [{'id': 1}]}], 'modbus': {}}", false, false,
	     false},
	    {"{'port': [], 'iec104': {}}", true, false, false},
	    {"{'port': [], 'originators': [1]}", true, false, false},
	    {"{'port': [" LINE("1", "") "]}", false, true, false},
	    {"{'port': [" LINE("1", "{'id': 1}") "], 'iec104': {}}", true, true, false},
	    {"{'port': [], 'tls': {" FILES "}}", false, false, true},
	    {"{'port': [], 'iec104': {}, 'tls': {" FILES "}}", true, false, true},
	};

	(void)state;
	for (size_t i = 0; i < sizeof(files) / sizeof(files[0]); i++)
		for (unsigned mask = 0; mask < 8; mask++) {
			const struct config_modules modules = {
			    .iec104 = mask & 1u, .modbus = mask & 2u, .tls = mask & 4u};
			bool no_iec104 = files[i].needs_iec104 && !modules.iec104;
			bool no_modbus = files[i].needs_modbus && !modules.modbus;
			bool no_tls = files[i].needs_tls && !(modules.tls && modules.iec104);
			struct map_config config;
			char said[1024] = "";
			FILE *messages = fmemopen(said, sizeof(said), "w");
			enum config_result result = load_with(modules, files[i].text, &config, messages);

			fclose(messages);
			assert_int_equal(result,
					 no_iec104 || no_modbus || no_tls ? CONFIG_UNUSABLE : CONFIG_GOOD);
			assert_int_equal(strstr(said, ": this build has no rtu-iec104: ") != NULL, no_iec104);
			assert_int_equal(strstr(said, "tls: this build has no rtu-iec104-tls: ") != NULL,
					 no_tls);
			assert_int_equal(strstr(said, "port: this build has no rtu-modbus: ") != NULL,
					 no_modbus);
			config_free(&config);
		}
}

int main(void)
{
	const struct CMUnitTest tests[] = {
	    cmocka_unit_test(test_report_file),
	    cmocka_unit_test(test_settings_defaults),
	    cmocka_unit_test(test_settings),
	    cmocka_unit_test(test_time_outs_of_commands),
	    cmocka_unit_test(test_controlling_stations),
	    cmocka_unit_test(test_tls_defaults),
	    cmocka_unit_test(test_tls),
	    cmocka_unit_test(test_object_keys),
	    cmocka_unit_test(test_status_bits),
	    cmocka_unit_test(test_an_object_has_its_own_period_or_its_slaves),
	    cmocka_unit_test(test_a_slave_has_its_limits_or_the_protocols),
	    cmocka_unit_test(test_unit_0_of_a_connection_is_no_broadcast),
	    cmocka_unit_test(test_rtu_over_tcp_is_a_line_with_a_connection),
	    cmocka_unit_test(test_an_object_is_read_back_as_it_says_or_its_slave),
	    cmocka_unit_test(test_an_object_is_written_elsewhere_or_only_written),
	    cmocka_unit_test(test_own_station),
	    cmocka_unit_test(test_tables_refer_to_each_other),
	    cmocka_unit_test(test_modules_that_are_not_there),
	};

	return cmocka_run_group_tests(tests, NULL, NULL);
}
