/* SPDX-License-Identifier: GPL-3.0-or-later */
/* The program itself on a map whose rtud and rtu-modbus are played by this test. argv[1]: the program. */
#include <fcntl.h>
#include <poll.h>
#include <setjmp.h>
#include <signal.h>
#include <stdarg.h>
#include <stddef.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <sys/syscall.h>
#include <sys/wait.h>
#include <unistd.h>

#include <cmocka.h>
#include <jansson.h>

#include "iec104/config.h"
#include "iec104/counters.h"
#include "map/station.h"
#include "map/supervise.h"
#include "modbus/config.h"
#include "modbus/stats.h"
#include "rtud/kinds.h"

#define OUTPUT_SIZE 32768
#define DEADLINE_S  20
#define PUBLISH_MS  5

enum { LAMP, BREAKER, LEVEL, CURRENT, LONGITUDE, WEIGHT, POINTS };

static struct modbus_port lines[] = {{.port = 3,
				      .process = 1,
				      .device_count = 1,
				      .data_bits = 8,
				      .stop_bits = 2,
				      .baud = 19200,
				      .device = "ttyS3"}};
static struct modbus_slave slaves[] = {{.unit = 67, .response_timeout_ms = 500}};
static struct modbus_point wire[POINTS];
static struct modbus_settings modbus_keys = {.heartbeat_limit_ms =
						 5000}; /* a busy host does not end the owner */
static struct iec104_settings iec104_keys = {.k = 12, .w = 8};
static struct map_set sets[] = {{.ca = 3067, .point_count = POINTS, .name = "Pump"}};
static struct {
	char none[1], lamp[sizeof("pump/lamp")], breaker[sizeof("pump/breaker")], level[sizeof("level")],
	    current[sizeof("current")], longitude[sizeof("longitude")], weight[sizeof("weight")];
} names = {"", "pump/lamp", "pump/breaker", "level", "current", "longitude", "weight"};
static struct map_point points[POINTS] = {
    [LAMP] = {.name = offsetof(__typeof__(names), lamp),
	      .type = MAP_SINGLE,
	      .ioa = 1,
	      .flags = MAP_POINT_COMMAND,
	      .short_pulse_ms = 400},
    [BREAKER] = {.name = offsetof(__typeof__(names), breaker),
		 .type = MAP_DOUBLE,
		 .ioa = 2,
		 .flags = MAP_POINT_COMMAND | MAP_POINT_SELECT},
    [LEVEL] = {.name = offsetof(__typeof__(names), level), .type = MAP_SCALED, .ioa = 30001},
    [CURRENT] = {.name = offsetof(__typeof__(names), current), .type = MAP_FLOAT, .ioa = 30002},
    [LONGITUDE] = {.name = offsetof(__typeof__(names), longitude),
		   .type = MAP_ANGLE,
		   .ioa = 50001,
		   .flags = MAP_POINT_COMMAND},
    [WEIGHT] = {.name = offsetof(__typeof__(names), weight), .type = MAP_INTEGER, .ioa = 50002},
};
static struct map_module_plan modules[MAP_MODULES_MAX];
static struct map_config config = {
    .settings = {.command_timeout_s = 10,
		 .select_timeout_s = 30,
		 .event_ring = 64,
		 .queue_count = 1,
		 .queues = {{.name = "Control centre", .limit = 50}}},
    .set_count = 1,
    .point_count = POINTS,
    .sets = sets,
    .sections = {{MODBUS_PORTS, sizeof(lines[0]), 1, lines},
		 {MODBUS_SLAVES, sizeof(slaves[0]), 1, slaves},
		 {MODBUS_POINTS, sizeof(wire[0]), POINTS, wire},
		 {MODBUS_SETTINGS, sizeof(modbus_keys), 1, &modbus_keys},
		 {IEC104_SETTINGS, sizeof(iec104_keys), 1, &iec104_keys}},
    .section_count = 5,
    .points = points,
    .names = (char *)&names,
    .names_size = sizeof(names),
    .modules = modules,
};

static const char *program;
static char dir[] = "/dev/shm/test_rtuctl.XXXXXX";
static struct map *rtud, *owner;

static struct {
	enum map_command_result result; /* the device's answer to commands */
	uint8_t detail;
	struct map_request request; /* the last command that reached it */
	int32_t level;              /* published again and again while changing */
	bool changing;
	bool warning; /* of its module, with each change */
} device;

static char output[OUTPUT_SIZE];

/* ---- the gateway ------------------------------------------------------------------------- */

static void publish(int32_t level)
{
	struct map_update updates[POINTS] = {
	    {.point = LAMP, .sample = {.value.u = 1, .time_ns = map_now_ns()}},
	    {.point = BREAKER, .sample = {.value.u = 3, .time_ns = map_now_ns()}},
	    {.point = LEVEL, .sample = {.value.i = level, .quality = MAP_OVERFLOW, .time_ns = map_now_ns()}},
	    {.point = CURRENT,
	     .sample = {.value.f = 0.1f, .quality = MAP_INVALID | MAP_NOT_TOPICAL, .time_ns = map_now_ns()}},
	    {.point = LONGITUDE, .sample = {.value.i = -1451234567, .time_ns = map_now_ns()}},
	    {.point = WEIGHT, .sample = {.value.i = 16777217, .time_ns = map_now_ns()}},
	};

	map_publish(owner, updates, POINTS);
}

static void serve_commands(void)
{
	struct map_request request;

	while (map_request_next(owner, &request)) {
		if (!map_command_request(owner, &request))
			continue;
		device.request = request;
		map_command_confirm(owner, request.point); /* no end yet */
		map_command_finish(owner, request.point, device.result, device.detail);
	}
}

static void run_gateway(void)
{
	map_heartbeat(rtud);
	map_heartbeat(owner);
	serve_commands();
	if (device.changing)
		publish(++device.level);
	if (device.warning)
		map_log(owner, MAP_LOG_WARNING, "silent for 165 ms");
}

/* ---- the program ------------------------------------------------------------------------- */

static pid_t start(const char *const *words, int write_end)
{
	const char *arguments[16] = {program, "--map", dir};
	size_t count = 3;
	pid_t pid;

	while (*words != NULL)
		arguments[count++] = *words++;
	pid = fork();
	if (pid != 0)
		return pid;
	dup2(write_end, STDOUT_FILENO);
	dup2(write_end, STDERR_FILENO);
	execv(program, (char *const *)arguments);
	_exit(127);
}

/* Runs rtuctl with these arguments while the gateway works. Returns its exit code, its output is in output. */
static int run(const char *const *words)
{
	int64_t deadline_ns = map_now_ns() + DEADLINE_S * 1000000000ll;
	struct pollfd pipe_end = {.events = POLLIN};
	size_t used = 0;
	int ends[2], status;
	ssize_t got = 1;
	pid_t pid;

	assert_int_equal(pipe2(ends, O_CLOEXEC), 0);
	pid = start(words, ends[1]);
	close(ends[1]);
	pipe_end.fd = ends[0];
	while (got > 0) {
		run_gateway();
		if (map_now_ns() > deadline_ns)
			kill(pid, SIGKILL);
		if (poll(&pipe_end, 1, PUBLISH_MS) > 0) {
			got = read(ends[0], output + used, sizeof(output) - 1 - used);
			used += got > 0 ? (size_t)got : 0;
		}
	}
	output[used] = '\0';
	close(ends[0]);
	assert_int_equal(waitpid(pid, &status, 0), pid);
	assert_true(WIFEXITED(status));
	return WEXITSTATUS(status);
}

#define RUN(...) run((const char *const[]){__VA_ARGS__, NULL})

static void assert_contains(const char *text)
{
	if (strstr(output, text) == NULL)
		fail_msg("\"%s\" is not in:\n%s", text, output);
}

static json_t *parse_output(void)
{
	json_error_t error;
	json_t *json = json_loads(output, 0, &error);

	if (json == NULL)
		fail_msg("%s in:\n%s", error.text, output);
	return json;
}

/* ---- tests ------------------------------------------------------------------------------- */

static void test_points(void **state)
{
	(void)state;
	assert_int_equal(RUN("points"), 0);
	assert_contains(
	    "NAME            CA    IOA  TYPE             VALUE  QUALITY                AGE  OWNER\n");
	assert_contains("pump/lamp     3067      1  single              on  good ");
	assert_contains("pump/breaker  3067      2  double   indeterminate  good ");
	assert_contains("level         3067  30001  scaled              -5  overflow ");
	assert_contains("current       3067  30002  float              0.1  invalid,not topical  ");
	assert_contains("longitude     3067  50001  angle     -145.1234567  good ");
	assert_contains("weight        3067  50002  integer       16777217  good ");
	assert_contains("  rtu-modbus-1\n");
}

/* Where a float would have 7 digits: in what is shown of one point, in events, in JSON, and in a command. */
static void test_an_angle_keeps_its_digits(void **state)
{
	json_t *json;

	(void)state;
	assert_int_equal(RUN("show", "longitude"), 0);
	assert_contains("value           -145.1234567\n");
	assert_int_equal(RUN("events"), 0);
	assert_contains("longitude = -145.1234567  good");
	assert_int_equal(RUN("--json", "show", "longitude"), 0);
	json = parse_output();
	assert_int_equal(map_round(json_real_value(json_object_get(json, "value")) * 1e7), -1451234567);
	json_decref(json);
	device.result = MAP_RESULT_DONE;
	assert_int_equal(RUN("set", "longitude", "-179.9999999"), 0);
	assert_int_equal(device.request.value.i, -1799999999);
	assert_int_equal(RUN("commands", "longitude"), 0);
	assert_contains("-179.9999999");
	assert_int_equal(RUN("set", "longitude", "180.1"), 2);
	assert_contains("degrees from -180 to 180");
}

static void test_pattern(void **state)
{
	(void)state;
	assert_int_equal(RUN("points", "pump/*"), 0);
	assert_contains("pump/lamp");
	assert_null(strstr(output, "level"));
	assert_int_equal(RUN("points", "none*"), 1);
	assert_contains("rtuctl: no point matches \"none*\"");
	assert_null(strstr(output, "QUALITY")); /* the head of a table without rows */
	assert_int_equal(RUN("commands", "none*"), 1);
	assert_contains("rtuctl: no command matches \"none*\"");
	assert_null(strstr(output, "REQUESTER"));
}

static void test_points_json(void **state)
{
	json_t *json, *row;

	(void)state;
	assert_int_equal(RUN("--json", "points"), 0);
	json = parse_output();
	assert_int_equal(json_array_size(json), POINTS);
	row = json_array_get(json, LEVEL);
	assert_string_equal(json_string_value(json_object_get(row, "name")), "level");
	assert_int_equal(json_integer_value(json_object_get(row, "value")), -5);
	assert_string_equal(json_string_value(json_object_get(row, "quality")), "overflow");
	assert_int_equal(json_integer_value(json_object_get(row, "ca")), 3067);
	assert_int_equal(json_integer_value(json_object_get(row, "ioa")), 30001);
	assert_true(json_is_real(json_object_get(row, "age_s")));
	json_decref(json);
}

static void test_modules(void **state)
{
	(void)state;
	assert_int_equal(RUN("modules"), 0);
	assert_contains("rtu-modbus-1  modbus      running  yes");
	assert_contains("rtu-iec104    iec104      stopped  no");
	assert_null(strstr(output, "data:"));
	assert_int_equal(RUN("modules", "--histogram"), 0);
	assert_contains("no module scans: ");
	assert_int_equal(RUN("--json", "modules", "--histogram"), 0);
	assert_string_equal(output, "[]\n");
}

static void test_counters_of_any_module(void **state)
{
	json_t *json, *row;

	(void)state;
	assert_true(map_name_counter(owner, &modbus_line_stats(owner, 0)->requests, "p3.requests"));
	assert_true(map_name_counter(owner, &modbus_line_stats(owner, 0)->stuck_s, "p3.stuck\033[2J"));
	atomic_store(&modbus_line_stats(owner, 0)->stuck_s, 4000000000u);
	assert_int_equal(RUN("counters"), 0);
	assert_contains("MODULE        COUNTER ");
	assert_contains("rtu-modbus-1  p3.requests ");
	assert_int_equal(RUN("--json", "counters", "rtu-modbus-1"), 0);
	json = parse_output();
	assert_int_equal(json_array_size(json), 2);
	row = json_array_get(json, 1);
	assert_string_equal(json_string_value(json_object_get(row, "counter")), "p3.stuck?[2J");
	assert_int_equal(json_integer_value(json_object_get(row, "value")), 4000000000);
	json_decref(json);
	atomic_store(&modbus_line_stats(owner, 0)->stuck_s, 0);
	assert_int_equal(RUN("counters", "rtud"), 0); /* it has none */
	assert_int_equal(RUN("counters", "rtu-none"), 1);
	assert_contains("rtuctl: there is no module \"rtu-none\"");
	assert_null(strstr(output, "COUNTER"));
	assert_int_equal(RUN("logic", "none"), 1);
	assert_contains("rtuctl: there is no such program");
	assert_null(strstr(output, "PERIOD"));
	assert_int_equal(RUN("gps", "none"), 1);
	assert_contains("rtuctl: there is no such receiver");
	assert_null(strstr(output, "LATITUDE"));
}

static void test_clock(void **state)
{
	struct map_clock clock = {.offset_ns = 1800000000LL * 1000000000 - map_now_ns(),
				  .since_ns = map_now_ns() - 100 * 1000000000LL,
				  .error_us = 20000,
				  .leap_due_s = 1,
				  .source = MAP_CLOCK_SYNCHRONISED,
				  .set = true};
	json_t *json, *row;

	(void)state;
	map_clock_write(rtud, clock);
	assert_int_equal(RUN("clock"), 0);
	assert_contains("2027-01-15T08:00:0");
	assert_contains("yes    system, synchronised  100 s   0.02     -  inserted");
	clock.source = MAP_CLOCK_HELD;
	clock.until_ns = map_now_ns() + 3600 * 1000000000LL;
	clock.leap_due_s = 0;
	map_clock_write(rtud, clock);
	assert_int_equal(RUN("--json", "clock"), 0);
	json = json_loads(output, 0, NULL);
	row = json_array_get(json, 0);
	assert_string_equal(json_string_value(json_object_get(row, "source")),
			    "system, no longer synchronised");
	assert_true(json_is_null(json_object_get(row, "error_s")));
	assert_in_range((int)json_real_value(json_object_get(row, "left_s")), 3500, 3600);
	json_decref(json);
	map_clock_write(rtud, (struct map_clock){.set = false});
	assert_int_equal(RUN("clock"), 0);
	assert_contains("no     none");
}

static void test_modules_say_where_the_data_is(void **state)
{
	char path[sizeof(dir) + sizeof("/data")];
	FILE *file;
	bool good, closed;

	(void)state;
	snprintf(path, sizeof(path), "%s/data", dir);
	file = fopen(path, "w");
	assert_non_null(file);
	good = fputs("memory: no UBI volume\n", file) >= 0;
	closed = fclose(file) == 0;
	assert_true(good && closed);
	assert_int_equal(RUN("modules"), 0);
	assert_contains("\n\ndata: in memory, lost at restart: no UBI volume\n");
	assert_int_equal(unlink(path), 0);
}

static void test_lines(void **state)
{
	json_t *json, *row;

	(void)state;
	modbus_line_stats(owner, 0)->requests = 17;
	modbus_line_stats(owner, 0)->wrong_lengths = 5;
	modbus_line_stats(owner, 0)->echoes = 6;
	modbus_device_stats(owner, 0)->timeouts = 4;
	assert_int_equal(RUN("lines"), 0);
	assert_contains("   3  ttyS3   19200 8N2  no          0        17");
	assert_contains(
	    "PORT  EXCEPT  TIME-OUTS  CRC  LATE  UNIT  FUNCTION  LENGTH  WRONG  UNASKED  ECHO  NOISE  "
	    "STUCK S\n   3       0          0    0     0     0         0       5      0        0     6"
	    "      0        0\n");
	assert_contains("   3  67  Pump         3067");
	assert_int_equal(RUN("lines", "--json"), 0);
	json = parse_output();
	row = json_array_get(json_object_get(json_array_get(json, 0), "devices"), 0);
	assert_int_equal(json_integer_value(json_object_get(row, "timeouts")), 4);
	json_decref(json);
}

/* The lines' process is this one. */
static void test_histogram_says_what_the_kernel_has_given(void **state)
{
	bool locked;
	json_t *json, *process;

	(void)state;
	assert_int_equal(RUN("lines", "--histogram"), 0);
	assert_contains("\nrtu-modbus-1: ");
	assert_contains(", memory not locked\nverdict: none: ");
	/* Not by mlock, which does nothing under AddressSanitizer. */
	locked = syscall(SYS_mlock, output, sizeof(output)) == 0;
	assert_int_equal(RUN("--json", "lines", "--histogram"), 0);
	syscall(SYS_munlock, output, sizeof(output));
	json = parse_output();
	process = json_object_get(json_array_get(json, 0), "process");
	assert_string_equal(json_string_value(json_object_get(process, "name")), "rtu-modbus-1");
	assert_true(json_is_true(json_object_get(process, "running")));
	assert_int_equal(json_integer_value(json_object_get(process, "locked_kib")) > 0, locked);
	assert_false(json_is_true(json_object_get(json_array_get(json, 0), "realtime")));
	json_decref(json);
}

/* As rtu-modbus would leave it for a device with a limit, a hole and an object that is not there. */
static void learn(void)
{
	struct modbus_learned_stats *learned = &modbus_device_stats(owner, 0)->learned;

	memset(learned, 0, sizeof(*learned));
	learned->given_registers = 16;
	learned->refused_registers = 20;
}

static void forget(void)
{
	memset(&modbus_device_stats(owner, 0)->learned, 0, sizeof(struct modbus_learned_stats));
	modbus_device_stats(owner, 0)->latency_typical_us = 0;
	modbus_device_stats(owner, 0)->pause_us = 0;
}

static void find_hole(uint32_t read, uint32_t exception)
{
	struct modbus_learned_stats *learned = &modbus_device_stats(owner, 0)->learned;

	learned->hole_function = 3;
	learned->hole_address = 5;
	learned->hole_count = 3;
	learned->hole_exception = exception;
	learned->hole_read = read;
}

static void test_lines_show_what_was_learned(void **state)
{
	struct modbus_learned_stats *learned = &modbus_device_stats(owner, 0)->learned;
	json_t *json, *row;

	(void)state;
	learn();
	find_hole(12, 2);
	learned->lacking_function = 1;
	learned->lacking_address = 9;
	learned->lacking_count = 3;
	modbus_device_stats(owner, 0)->latency_least_us = 1500;
	modbus_device_stats(owner, 0)->latency_typical_us = 2500;
	modbus_device_stats(owner, 0)->latency_most_us = 10000;
	modbus_device_stats(owner, 0)->pause_us = 20000;
	assert_int_equal(RUN("lines"), 0);
	assert_contains("PORT  ID  LEAST MS  TYPICAL MS  MOST MS  PAUSE MS  BITS  REGISTERS  REFUSED\n"
			"   3  67       1.5         2.5       10        20     0         16  20 registers; "
			"hole at holding "
			"registers 5 to 7; coil 9; 2 other objects\n");
	assert_int_equal(RUN("lines", "--json"), 0);
	json = parse_output();
	row = json_array_get(json_object_get(json_array_get(json, 0), "devices"), 0);
	row = json_object_get(row, "learned");
	assert_int_equal(json_integer_value(json_object_get(row, "given_registers")), 16);
	assert_int_equal(json_integer_value(json_object_get(json_object_get(row, "hole"), "address")), 5);
	assert_int_equal(json_integer_value(json_object_get(json_object_get(row, "lacking"), "count")), 3);
	json_decref(json);
	forget();
}

/* Asserts what is suggested for the only slave, remarks apart. keys: as JSON has them, "" for none. */
static void assert_suggested(const char *keys)
{
	char expected[OUTPUT_SIZE / 2];

	assert_int_equal(RUN("--json", "lines", "--suggest"), 0);
	if (keys[0] == '\0')
		snprintf(expected, sizeof(expected), "{\"port\": []}\n");
	else
		snprintf(expected, sizeof(expected),
			 "{\"port\": [{\"value\": 3, \"slaves\": [{\"id\": 67, %s}]}]}\n", keys);
	assert_contains(expected);
}

static void test_suggest_a_length(void **state)
{
	(void)state;
	learn();
	assert_suggested("\"max_registers\": 16");
	assert_contains(
	    "rtuctl: port 3, slave 67: max_registers 16: it refused 20 in one read, and gives them in two\n");
	modbus_device_stats(owner, 0)->learned.given_registers = 30;
	assert_suggested("");
	assert_contains(
	    "no key for the read of 20 registers that it refused, and gives in two: it gives 30 elsewhere\n");
	assert_contains("rtuctl: nothing to suggest\n");
	learn();
	modbus_device_stats(owner, 0)->learned.given_bits = 100;
	modbus_device_stats(owner, 0)->learned.refused_bits = 101;
	assert_suggested("\"max_bits\": 100, \"max_registers\": 16");
	forget();
	assert_suggested("");
}

/* At 19200 bit/s 8N2 a silence and a character are 2.6 ms, and 5 ms are assumed: what is near is no news. */
static void test_suggest_a_reaction(void **state)
{
	(void)state;
	forget();
	modbus_device_stats(owner, 0)->latency_typical_us = 22600;
	assert_suggested("\"reaction_ms\": 20.0");
	assert_contains(
	    "rtuctl: port 3, slave 67: reaction_ms 20.0: its answers typically begin 22.6 ms after "
	    "the request\n");
	modbus_device_stats(owner, 0)->latency_typical_us = 9800;
	assert_suggested("");
	modbus_device_stats(owner, 0)->latency_typical_us = 9900;
	assert_suggested("\"reaction_ms\": 7.3");
	modbus_device_stats(owner, 0)->latency_typical_us = 1000;
	assert_suggested("\"reaction_ms\": 0.1");
	forget();
}

static void test_suggest_a_pause(void **state)
{
	(void)state;
	forget();
	modbus_device_stats(owner, 0)->pause_us = 312345;
	assert_suggested("\"pause_ms\": 313");
	assert_contains("rtuctl: port 3, slave 67: pause_ms 313: it does not answer what comes sooner behind "
			"its answer\n");
	forget();
}

/* Where no answer was damaged: noise spoils the long ones first. */
static void test_suggest_a_length_that_is_answered(void **state)
{
	struct modbus_device_stats *stats = modbus_device_stats(owner, 0);

	(void)state;
	forget();
	stats->errors = 0;
	stats->learned.given_registers = 25;
	stats->learned.silent_registers = 50;
	stats->learned.unclear = 1;
	assert_suggested("\"max_registers\": 25");
	assert_contains("max_registers 25: it did not answer 50 in one read, and gives them in two\n");
	assert_null(strstr(output, "no key"));
	stats->errors = 1;
	assert_suggested("");
	assert_contains("no key for 1 reads that it gives in two only");
	stats->errors = 0;
	stats->learned.given_registers = 60;
	assert_suggested("");
	forget();
}

static void test_suggest_a_time_out(void **state)
{
	struct modbus_device_stats *stats = modbus_device_stats(owner, 0);

	(void)state;
	forget();
	stats->latest_ms = 1420;
	stats->too_late = 2;
	assert_suggested("");
	stats->too_late = 3;
	assert_suggested("\"response_timeout_ms\": 2200");
	assert_contains("response_timeout_ms 2200: 3 of its answers came later than ");
	stats->latest_ms = 9000;
	assert_suggested("\"response_timeout_ms\": 10000");
	stats->latest_ms = stats->too_late = 0;
}

static void test_suggest_a_write_function(void **state)
{
	struct modbus_device_stats *stats = modbus_device_stats(owner, 0);

	(void)state;
	forget();
	stats->writes_registers = 16;
	assert_suggested("\"write_function\": \"multiple\"");
	assert_contains(
	    "write_function multiple: it refused the other as an illegal function, and took 16\n");
	stats->writes_registers = 6; /* which is the configuration's */
	assert_suggested("");
	stats->writes_coils = 15;
	assert_suggested("");
	stats->writes_registers = 0;
	assert_suggested("\"write_function\": \"multiple\"");
	stats->writes_coils = 0;
}

/* Of the connection: a key of its port, and what needs none. */
static void test_suggest_what_a_connection_needs(void **state)
{
	struct modbus_line_stats *stats = modbus_line_stats(owner, 0);

	(void)state;
	forget();
	stats->settle_us = 2000500;
	stats->idle_ms = 3000;
	stats->hung = 2;
	assert_int_equal(RUN("--json", "lines", "--suggest"), 0);
	assert_contains("{\"port\": [{\"value\": 3, \"settle_ms\": 2001}]}\n");
	assert_contains(
	    "rtuctl: port 3: settle_ms 2001: what comes sooner behind a connect gets no answer\n");
	assert_contains("which hangs up when idle for 3000 ms");
	assert_contains("of which 2 brought nothing");
	stats->settle_us = stats->idle_ms = stats->hung = 0;
}

static void test_suggest_no_holes(void **state)
{
	struct modbus_learned_stats *learned = &modbus_device_stats(owner, 0)->learned;

	(void)state;
	forget();
	learned->given_registers = 16;
	find_hole(12, 2); /* shorter than what it gives */
	assert_suggested("\"holes\": false");
	assert_contains("holes false: it refused a read over holding registers 5 to 7, which nobody asked "
			"for (exception 2)\n");
	learned->holes_given = 2;
	assert_suggested("");
	assert_contains("it gives 2 other reads over holes");
	learned->holes_given = 0;
	find_hole(17, 2);
	assert_suggested("\"holes\": false");
	assert_contains("; or that read was too long for it\n");
	find_hole(17, 3); /* which says that it was */
	assert_suggested("\"max_registers\": 16");
	learned->refused_registers = 17;
	find_hole(17, 2);
	assert_suggested("\"max_registers\": 16");
	assert_null(strstr(output, "hole"));
	forget();
}

static void test_suggest_nothing_unsound(void **state)
{
	struct modbus_learned_stats *learned = &modbus_device_stats(owner, 0)->learned;

	(void)state;
	learn();
	learned->open = 1;
	assert_suggested("");
	assert_contains("1 of its reads were not answered yet, try again later\n");
	forget();
	learned->given_registers = 4;
	learned->lacking_function = 3;
	learned->lacking_address = 5;
	learned->lacking_exception = 2;
	learned->lacking_count = 1;
	learned->unclear = 2;
	assert_suggested("");
	assert_contains("no key for holding register 5, which it does not give (exception 2)\n");
	assert_contains("no key for 2 reads that it gives in two only");
	learned->lacking_exception = 0;
	learned->lacking_count = 3;
	assert_suggested("");
	assert_contains("which it does not give (no answer), and 2 other objects\n");
	forget();
	assert_int_equal(RUN("lines", "--suggest", "--histogram"), 2);
	assert_int_equal(RUN("points", "--suggest"), 2);
	assert_contains(" takes no --suggest");
}

/* As of a rtu-iec104 that runs, after two acknowledged events and one that was only sent. */
static void fill_station(void)
{
	struct iec104_connection_stats *stats;
	struct map_queue_place place = {.refresh_all = 0};
	struct map_event event;
	struct map *station;
	char error[MAP_ERROR_SIZE];

	map_module_starting(rtud, 1);
	assert_int_equal(map_attach(&station, dir, "rtu-iec104", error), 0);
	map_queue_assign(station, 9, "192.0.2.9", &place);
	while (map_events_behind(station, &place.cursor) > 3)
		assert_true(map_event_next(station, &place.cursor, &event));
	map_queue_move(station, 0, &place);
	map_queue_set_unacknowledged(station, 0, 1);
	map_queue_count_lost(station, 0, 7);
	stats = &iec104_stats_of(station)->connections[2];
	strcpy(stats->peer, "192.0.2.1 port 40000");
	stats->open = stats->started = 1;
	stats->since_s = (uint32_t)(map_now_ns() / 1000000000) - 90;
	stats->next_ns = 32767;
	stats->next_nr = 4;
	stats->unacknowledged = 3;
	stats->owed = 2;
	iec104_stats_of(station)->counters[IEC104_COUNT_TESTFR_ACT_IN] = 4711;
	map_detach(station);
}

static void end_station(void)
{
	map_module_ended(rtud, 1, false);
}

static void test_iec104(void **state)
{
	(void)state;
	fill_station();
	assert_int_equal(RUN("iec104", "connections"), 0);
	assert_contains(
	    "PEER                  QUEUE           SINCE  STARTED   N(S)  N(R)  UNACKED   K  OWED  "
	    "W\n192.0.2.1 port 40000  Control centre  ");
	assert_contains("  yes      32767     4        3  12     2  8\n");
	assert_int_equal(RUN("iec104", "queues"), 0);
	assert_contains("QUEUE           GROUP  WAITING  UNACKED  LOST  LIMIT\n"
			"Control centre  yes          3        1     7     50\n"
			"192.0.2.9       no ");
	assert_int_equal(RUN("iec104"), 0);
	assert_contains("PEER ");
	assert_contains("\n\nQUEUE ");
	assert_contains("\n\nCOUNTER ");
	assert_contains("\ntestfr_act_in                4711\n");
	assert_int_equal(RUN("iec104", "queue"), 2);
	assert_contains("expected connections, queues or counters");
	end_station();
	assert_int_equal(RUN("iec104"), 0);
	assert_null(strstr(output, "192.0.2.1 port 40000"));
	assert_contains("\ntestfr_act_in                4711\n");
}

static void test_iec104_json(void **state)
{
	json_t *json, *row;

	(void)state;
	fill_station();
	assert_int_equal(RUN("--json", "iec104", "queues"), 0);
	json = parse_output();
	row = json_array_get(json, 0);
	assert_string_equal(json_string_value(json_object_get(row, "name")), "Control centre");
	assert_int_equal(json_integer_value(json_object_get(row, "waiting")), 3);
	json_decref(json);
	assert_int_equal(RUN("--json", "iec104"), 0);
	json = parse_output();
	assert_int_equal(json_array_size(json), 1);
	row = json_array_get(json_object_get(json_array_get(json, 0), "connections"), 0);
	assert_int_equal(json_integer_value(json_object_get(row, "ns")), 32767);
	row =
	    json_array_get(json_object_get(json_array_get(json, 0), "counters"), IEC104_COUNT_TESTFR_ACT_IN);
	assert_string_equal(json_string_value(json_object_get(row, "counter")), "testfr_act_in");
	json_decref(json);
	end_station();
}

static void test_set(void **state)
{
	(void)state;
	device.result = MAP_RESULT_DONE;
	assert_int_equal(RUN("set", "pump/lamp", "on"), 0);
	assert_string_equal(output, "pump/lamp = on: executed command: done\n");
	assert_int_equal(device.request.value.u, 1);
	assert_int_equal(RUN("commands", "pump/lamp"), 0);
	assert_contains("pump/lamp  inactive command  done       on");
	assert_contains("  rtuctl\n");
}

static void test_set_refused_by_device(void **state)
{
	(void)state;
	device.result = MAP_RESULT_EXCEPTION;
	device.detail = 2;
	assert_int_equal(RUN("set", "pump/lamp", "off"), 1);
	assert_string_equal(output,
			    "pump/lamp = off: refused command: the device answered with exception 2\n");
	assert_int_equal(RUN("--json", "set", "pump/lamp", "off"), 1);
	assert_contains("\"state\": \"refused command\", \"result\": \"exception\"");
	assert_contains("\"exception\": 2");
}

static void test_set_with_selection(void **state)
{
	(void)state;
	device.result = MAP_RESULT_DONE;
	assert_int_equal(RUN("set", "pump/breaker", "on"), 1);
	assert_string_equal(output,
			    "pump/breaker = on: refused command: not selected: the point needs --select\n");
	assert_int_equal(RUN("set", "pump/breaker", "on", "--select"), 0);
	assert_string_equal(output, "pump/breaker = on: executed command: done\n");
	assert_int_equal(device.request.value.u, 2);
}

static void test_set_with_pulse(void **state)
{
	(void)state;
	device.result = MAP_RESULT_DONE;
	assert_int_equal(RUN("set", "pump/lamp", "on", "--pulse", "short"), 0);
	assert_string_equal(output, "pump/lamp = on: executed command: done\n");
	assert_int_equal(device.request.pulse_ms, 400);
	assert_int_equal(RUN("set", "pump/lamp", "on", "--pulse", "long"), 2);
	assert_contains("rtuctl: \"long\" is not a pulse of pump/lamp");
	assert_int_equal(RUN("points", "--pulse", "short"), 2);
	assert_contains(" takes no --pulse");
}

static void test_step(void **state)
{
	(void)state;
	device.result = MAP_RESULT_OUT_OF_RANGE;
	assert_int_equal(RUN("step", "pump/lamp", "lower"), 1);
	assert_string_equal(output, "pump/lamp = lower: refused command: out of range\n");
	assert_int_equal(device.request.step, -1);
	device.result = MAP_RESULT_DONE;
	assert_int_equal(RUN("step", "pump/lamp", "higher"), 0);
	assert_int_equal(device.request.step, 1);
	assert_int_equal(RUN("step", "pump/lamp", "up"), 2);
	assert_string_equal(output, "rtuctl: \"up\" is not a direction, expected higher or lower\n");
	assert_int_equal(RUN("step", "lamp", "higher"), 1);
}

static void test_set_what_cannot_be_set(void **state)
{
	(void)state;
	assert_int_equal(RUN("set", "level", "5"), 1);
	assert_contains("refused command: not commandable");
	assert_int_equal(RUN("set", "pump/lamp", "5"), 2);
	assert_string_equal(output, "rtuctl: \"5\" is not a value of type single, expected on or off\n");
	assert_int_equal(RUN("set", "lamp", "on"), 1);
	assert_contains("there is no point \"lamp\"");
}

static void test_watch(void **state)
{
	(void)state;
	device.changing = true;
	assert_int_equal(RUN("watch", "level", "--count", "3"), 0);
	device.changing = false;
	assert_contains("Z  level = ");
	assert_contains("  overflow\n");
	assert_null(strstr(output, "pump"));
}

static void test_watch_says_what_the_log_warns_of(void **state)
{
	(void)state;
	map_log(owner, MAP_LOG_WARNING, "before");
	device.changing = device.warning = true;
	assert_int_equal(RUN("watch", "level", "--count", "20"), 0);
	assert_contains("Z  rtu-modbus-1  warning: silent for 165 ms\n");
	assert_null(strstr(output, "before"));
	assert_int_equal(RUN("watch", "level", "--count", "20", "--json"), 0);
	assert_contains("\"text\": \"silent for 165 ms\", \"event\": \"log\"}\n");
	device.changing = device.warning = false;
}

static void test_events(void **state)
{
	json_t *row;

	(void)state;
	map_announce(rtud, MAP_EVENT_MODULE_DOWN, map_self(owner));
	assert_int_equal(RUN("events", "--count", "1", "--json"), 0);
	row = parse_output();
	assert_string_equal(json_string_value(json_object_get(row, "event")), "module down");
	assert_string_equal(json_string_value(json_object_get(row, "name")), "rtu-modbus-1");
	json_decref(row);
}

static void test_log(void **state)
{
	(void)state;
	map_log(owner, MAP_LOG_WARNING, "device 67 is dead");
	map_log(rtud, MAP_LOG_INFO, "later");
	assert_int_equal(RUN("log"), 0);
	assert_contains("Z  rtu-modbus-1  warning: device 67 is dead\n");
	assert_contains("Z  rtud  info: later\n");
	assert_true(strstr(output, "dead") < strstr(output, "later"));
	/* On a busy host the last line may say that the owner was silent. */
	assert_int_equal(RUN("log", "--count", "1"), 0);
	assert_ptr_equal(strchr(output, '\n'), strrchr(output, '\n'));
	assert_null(strstr(output, "dead"));
}

static void test_wrong_usage(void **state)
{
	(void)state;
	assert_int_equal(RUN("pionts"), 2);
	assert_contains("unknown command pionts, did you mean points?");
	assert_int_equal(RUN("status"), 2);
	assert_contains("unknown command status, expected one of points, top, show,");
	assert_contains(", forces: try \"rtuctl --help\"");
	assert_int_equal(RUN("set", "pump/lamp"), 2);
	assert_int_equal(RUN("points", "--count", "3"), 2);
	assert_contains("takes no --count");
	assert_int_equal(RUN("watch", "--count", "many"), 2);
	assert_int_equal(RUN("--map", "/nowhere", "points"), 2);
	assert_contains("no map in /nowhere");
	assert_contains("Start the gateway");
	assert_int_equal(RUN("set", "--help"), 0);
	assert_contains("usage: rtuctl [--map DIR] [--json] set NAME VALUE [--select] [--pulse LENGTH]\n");
}

static void test_records_of_another_build_are_not_read(void **state)
{
	struct map_config *known = (struct map_config *)map_config(rtud);

	(void)state;
	assert_true(modbus_is_known(rtud) && iec104_is_known(rtud));
	for (uint32_t i = 0; i < known->section_count; i++) {
		known->sections[i].record_size++;
		assert_false(modbus_is_known(rtud) && iec104_is_known(rtud));
		known->sections[i].record_size--;
	}
}

/* ---- set-up ------------------------------------------------------------------------------ */

static uint32_t module_index(const char *name)
{
	struct map_module module;

	for (uint32_t i = 0; i < map_module_count(rtud); i++) {
		map_module(rtud, i, &module);
		if (strcmp(module.name, name) == 0)
			return i;
	}
	return MAP_NONE;
}

static int set_up(void **state)
{
	char error[MAP_ERROR_SIZE] = "";
	uint32_t modbus;

	(void)state;
	assert_non_null(mkdtemp(dir));
	assert_true(kinds_plan(&config));
	if (map_create(&rtud, dir, &config, 0, error) < 0)
		fail_msg("%s", error);
	modbus = module_index("rtu-modbus-1");
	map_module_starting(rtud, modbus);
	if (map_attach(&owner, dir, "rtu-modbus-1", error) < 0)
		fail_msg("%s", error);
	map_module_started(rtud, modbus, getpid());
	map_module_running(rtud, modbus);
	device.level = -5;
	publish(device.level);
	return 0;
}

static int tear_down(void **state)
{
	(void)state;
	map_detach(owner);
	map_remove(rtud);
	map_detach(rtud);
	return rmdir(dir);
}

int main(int argc, char **argv)
{
	const struct CMUnitTest tests[] = {
	    cmocka_unit_test(test_points),
	    cmocka_unit_test(test_an_angle_keeps_its_digits),
	    cmocka_unit_test(test_pattern),
	    cmocka_unit_test(test_points_json),
	    cmocka_unit_test(test_modules),
	    cmocka_unit_test(test_counters_of_any_module),
	    cmocka_unit_test(test_clock),
	    cmocka_unit_test(test_modules_say_where_the_data_is),
	    cmocka_unit_test(test_lines),
	    cmocka_unit_test(test_histogram_says_what_the_kernel_has_given),
	    cmocka_unit_test(test_lines_show_what_was_learned),
	    cmocka_unit_test(test_suggest_a_length),
	    cmocka_unit_test(test_suggest_a_reaction),
	    cmocka_unit_test(test_suggest_a_pause),
	    cmocka_unit_test(test_suggest_what_a_connection_needs),
	    cmocka_unit_test(test_suggest_a_length_that_is_answered),
	    cmocka_unit_test(test_suggest_a_time_out),
	    cmocka_unit_test(test_suggest_a_write_function),
	    cmocka_unit_test(test_suggest_no_holes),
	    cmocka_unit_test(test_suggest_nothing_unsound),
	    cmocka_unit_test(test_iec104),
	    cmocka_unit_test(test_iec104_json),
	    cmocka_unit_test(test_set),
	    cmocka_unit_test(test_set_refused_by_device),
	    cmocka_unit_test(test_set_with_selection),
	    cmocka_unit_test(test_set_what_cannot_be_set),
	    cmocka_unit_test(test_set_with_pulse),
	    cmocka_unit_test(test_step),
	    cmocka_unit_test(test_watch),
	    cmocka_unit_test(test_watch_says_what_the_log_warns_of),
	    cmocka_unit_test(test_events),
	    cmocka_unit_test(test_log),
	    cmocka_unit_test(test_wrong_usage),
	    cmocka_unit_test(test_records_of_another_build_are_not_read),
	};

	if (argc != 2) {
		fputs("usage: test_rtuctl RTUCTL\n", stderr);
		return 2;
	}
	program = argv[1];
	return cmocka_run_group_tests(tests, set_up, tear_down);
}
