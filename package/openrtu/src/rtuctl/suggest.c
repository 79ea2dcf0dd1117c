/* SPDX-License-Identifier: GPL-3.0-or-later */
/*
 * What was learned of the devices, as keys for the configuration. Only what follows (modbus/learned.h) is suggested, and
 * only what costs the line no more time than the plan in force; why, or why not, is said on the standard error.
 */
#include <math.h>
#include <stdarg.h>
#include <stdatomic.h>
#include <stdio.h>

#include "map/time_ns.h"
#include "modbus/config.h"
#include "modbus/configured.h"
#include "modbus/stats.h"
#include "rows/learned.h"
#include "rtuctl/rtuctl.h"

#define ILLEGAL_ADDRESS 2 /* MODBUS Application Protocol V1.1b3, 7 */
#define TENTHS          10.0
#define REAL_DIGITS     6

#define LATE_ANSWERS     3 /* fewer may be a busy moment */
#define TIME_OUT_STEP_MS 100
#define TIME_OUT_MAX_MS  10000

/* A reaction that differs by less is as it was: this part of it, and so much more. */
#define REACTION_PART 0.25
#define REACTION_MS   1.0

/* What is learned of reads of bits, or of registers. */
struct length {
	const char *key, *unit;
	uint32_t given, refused, silent;
	uint32_t configured; /* 0: nothing */
};

struct device {
	const struct modbus_slave *config;
	const struct modbus_port *line;
	const struct modbus_device_stats *stats;
	json_t *keys;
};

static void remark(struct device *device, const char *format, ...) __attribute__((format(printf, 2, 3)));

static void remark(struct device *device, const char *format, ...)
{
	va_list arguments;

	fprintf(stderr, "rtuctl: port %u, slave %u: ", device->line->port, device->config->unit);
	va_start(arguments, format);
	vfprintf(stderr, format, arguments);
	va_end(arguments);
	fputc('\n', stderr);
}

static struct length length_of(const struct device *device, bool bits)
{
	const struct modbus_learned_stats *learned = &device->stats->learned;

	if (bits)
		return (struct length){.key = "max_bits",
				       .unit = "bits",
				       .given = learned->given_bits,
				       .refused = learned->refused_bits,
				       .silent = learned->silent_bits,
				       .configured = device->config->max_bits};
	return (struct length){.key = "max_registers",
			       .unit = "registers",
			       .given = learned->given_registers,
			       .refused = learned->refused_registers,
			       .silent = learned->silent_registers,
			       .configured = device->config->max_registers};
}

static bool is_bounded(const struct length *length)
{
	return length->given > 0 && length->refused > length->given &&
	       (length->configured == 0 || length->given < length->configured);
}

static void suggest_length(struct device *device, const struct length *length)
{
	json_object_set_new(device->keys, length->key, json_integer(length->given));
}

static void judge_length(struct device *device, bool bits)
{
	struct length length = length_of(device, bits);

	if (length.refused == 0)
		return;
	if (!is_bounded(&length)) {
		remark(
		    device,
		    "no key for the read of %u %s that it refused, and gives in two: it gives %u elsewhere",
		    length.refused, length.unit, length.given);
		return;
	}
	suggest_length(device, &length);
	remark(device, "%s %u: it refused %u in one read, and gives them in two", length.key, length.given,
	       length.refused);
}

/* It did not answer what is longer than all that it gives, and noise was not the cause: none of its answers was damaged. */
static bool judge_silence(struct device *device, bool bits)
{
	struct length length = length_of(device, bits);

	if (length.silent <= length.given || length.given == 0 || length.refused != 0 ||
	    device->stats->errors > 0 || (length.configured != 0 && length.given >= length.configured))
		return false;
	suggest_length(device, &length);
	remark(device, "%s %u: it did not answer %u in one read, and gives them in two", length.key,
	       length.given, length.silent);
	return true;
}

/* The read over the hole was longer than anything that the device gives: by the exception, it was too long. */
static void suggest_either(struct device *device, const struct length *length, const char *hole)
{
	suggest_length(device, length);
	remark(device,
	       "%s %u: it refused %u in one read as an illegal value, and gives them in two; if that was for "
	       "the hole at %s, \"holes\": false is the better key",
	       length->key, length->given, device->stats->learned.hole_read, hole);
}

static void judge_hole(struct device *device)
{
	const struct modbus_learned_stats *learned = &device->stats->learned;
	struct length length = length_of(device, learned_is_of_bits(learned->hole_function));
	bool certain = learned->hole_read <= length.given;
	char hole[LEARNED_WORDS_SIZE];

	/* Too long it was anyway; what the device makes of the hole shows when that is spared. */
	if (learned->hole_count == 0 || length.given == 0 ||
	    (is_bounded(&length) && length.refused <= learned->hole_read))
		return;
	learned_objects(learned->hole_function, learned->hole_address, learned->hole_count, hole);
	if (!certain && learned->hole_exception != ILLEGAL_ADDRESS) {
		suggest_either(device, &length, hole);
	} else if (learned->holes_given > 0) {
		remark(
		    device,
		    "no key for the hole at %s, which it refuses: without any holes, it would be asked more "
		    "often, for it gives %u other reads over holes",
		    hole, learned->holes_given);
	} else {
		json_object_set_new(device->keys, "holes", json_false());
		remark(device,
		       "holes false: it refused a read over %s, which nobody asked for (exception %u)%s",
		       hole, learned->hole_exception, certain ? "" : "; or that read was too long for it");
	}
}

static void judge_lacking(struct device *device)
{
	const struct modbus_learned_stats *learned = &device->stats->learned;
	char object[LEARNED_WORDS_SIZE], others[LEARNED_WORDS_SIZE] = "", reason[] = "exception 4294967295";

	if (learned->lacking_count == 0)
		return;
	learned_objects(learned->lacking_function, learned->lacking_address, 1, object);
	if (learned->lacking_count > 1)
		snprintf(others, sizeof(others), ", and %u other objects", learned->lacking_count - 1);
	if (learned->lacking_exception > 0)
		snprintf(reason, sizeof(reason), "exception %u", learned->lacking_exception);
	else
		snprintf(reason, sizeof(reason), "no answer");
	remark(device, "no key for %s, which it does not give (%s)%s", object, reason, others);
}

static void judge_unclear(struct device *device)
{
	const struct modbus_learned_stats *learned = &device->stats->learned;

	if (learned->unclear > 0)
		remark(device,
		       "no key for %u reads that it gives in two only: it had not answered them, or refused "
		       "them with another exception than 2 and 3",
		       learned->unclear);
}

static void judge_reaction(struct device *device)
{
	double latency_ms = atomic_load_explicit(&device->stats->latency_typical_us, memory_order_relaxed) /
			    (double)US_PER_MS;
	struct modbus_limits limits = modbus_limits_of(device->config);
	double known_ms = (double)modbus_reaction_ns(&limits) / NS_PER_MS;
	struct modbus_wire wire = modbus_wire_of(device->line);
	/* What else comes before the answer's first character is the line's. */
	double reaction_ms = latency_ms - (double)(wire.silence_ns + wire.char_ns) / NS_PER_MS;

	if (latency_ms == 0 || fabs(reaction_ms - known_ms) <= REACTION_PART * known_ms + REACTION_MS)
		return;
	/* How much faster than it may be asked makes no difference. */
	if (fmax(reaction_ms, known_ms) < (double)wire.least_ns / NS_PER_MS)
		return;
	reaction_ms = fmax(round(TENTHS * reaction_ms), 1) / TENTHS;
	json_object_set_new(device->keys, "reaction_ms", json_real(reaction_ms));
	remark(device, "reaction_ms %.1f: its answers typically begin %.1f ms after the request", reaction_ms,
	       latency_ms);
}

static void judge_pause(struct device *device)
{
	uint32_t pause_us = atomic_load_explicit(&device->stats->pause_us, memory_order_relaxed);
	uint32_t pause_ms = (uint32_t)((pause_us + US_PER_MS - 1) / US_PER_MS);

	if (pause_us == 0)
		return;
	json_object_set_new(device->keys, "pause_ms", json_integer(pause_ms));
	remark(device, "pause_ms %u: it does not answer what comes sooner behind its answer", pause_ms);
}

/* Registers decide: most devices have more of them to be written. */
static void judge_functions(struct device *device)
{
	uint32_t registers = device->stats->writes_registers, coils = device->stats->writes_coils;
	uint32_t function = registers != 0 ? registers : coils;
	bool multiple = function == MODBUS_WRITE_COILS || function == MODBUS_WRITE_REGISTERS;
	const char *value = multiple ? "multiple" : "single";

	if (function == 0 || multiple == device->config->writes_multiple)
		return;
	json_object_set_new(device->keys, "write_function", json_string(value));
	remark(device, "write_function %s: it refused the other as an illegal function, and took %u", value,
	       function);
}

/* With half as much again: the next one may be later. */
static void judge_time_out(struct device *device)
{
	const struct modbus_device_stats *stats = device->stats;
	uint32_t enough_ms =
	    (stats->latest_ms * 3 / 2 + TIME_OUT_STEP_MS - 1) / TIME_OUT_STEP_MS * TIME_OUT_STEP_MS;

	if (stats->too_late < LATE_ANSWERS || enough_ms <= device->config->response_timeout_ms)
		return;
	if (enough_ms > TIME_OUT_MAX_MS)
		enough_ms = TIME_OUT_MAX_MS;
	json_object_set_new(device->keys, "response_timeout_ms", json_integer(enough_ms));
	remark(device, "response_timeout_ms %u: %u of its answers came later than %u ms, one after %u",
	       enough_ms, stats->too_late, device->config->response_timeout_ms, stats->latest_ms);
}

static void judge(struct device *device)
{
	bool silent;

	judge_time_out(device);
	judge_pause(device);
	judge_functions(device);
	if (device->stats->learned.open > 0) {
		remark(device, "%u of its reads were not answered yet, try again later",
		       device->stats->learned.open);
		return;
	}
	judge_reaction(device);
	judge_length(device, true);
	judge_length(device, false);
	judge_hole(device);
	judge_lacking(device);
	silent = judge_silence(device, true);
	silent |= judge_silence(device, false);
	if (!silent)
		judge_unclear(device);
}

/* The slave as an element of its port's array, NULL: nothing is suggested for it. */
static json_t *slave_of(const struct map *map, const struct modbus_port *line, uint32_t index)
{
	struct device device = {.config = &modbus_slaves(map_config(map))[index],
				.line = line,
				.stats = modbus_device_stats(map, index),
				.keys = json_object()};
	json_t *slave = NULL;

	judge(&device);
	if (json_object_size(device.keys) > 0) {
		slave = json_pack("{s:i}", "id", device.config->unit);
		json_object_update(slave, device.keys);
	}
	json_decref(device.keys);
	return slave;
}

static json_t *slaves_of(const struct map *map, const struct modbus_port *line)
{
	json_t *slaves = json_array();

	for (uint32_t i = 0; i < line->device_count; i++) {
		json_t *slave = slave_of(map, line, line->first_device + i);

		if (slave != NULL)
			json_array_append_new(slaves, slave);
	}
	return slaves;
}

/* Keys of the port itself, in its object. */
static void judge_connection(const struct map *map, uint32_t index, json_t *port)
{
	const struct modbus_line_stats *stats = modbus_line_stats(map, index);
	const unsigned number = modbus_ports(map_config(map))[index].port;
	uint32_t settle_ms = (uint32_t)((stats->settle_us + US_PER_MS - 1) / US_PER_MS);

	if (settle_ms > 0) {
		json_object_set_new(port, "settle_ms", json_integer(settle_ms));
		fprintf(stderr,
			"rtuctl: port %u: settle_ms %u: what comes sooner behind a connect gets no answer\n",
			number, settle_ms);
	}
	if (stats->idle_ms > 0)
		fprintf(stderr,
			"rtuctl: port %u: no key for its peer, which hangs up when idle for %u ms: it is "
			"connected "
			"when a read is due\n",
			number, stats->idle_ms);
	if (stats->hung > 0)
		fprintf(stderr,
			"rtuctl: port %u: no key for its connections, of which %u brought nothing any more "
			"and were "
			"made anew\n",
			number, stats->hung);
}

static json_t *port_of(const struct map *map, uint32_t index)
{
	const struct modbus_port *line = &modbus_ports(map_config(map))[index];
	json_t *port = json_pack("{s:i}", "value", line->port);
	json_t *slaves;

	judge_connection(map, index, port);
	slaves = slaves_of(map, line);
	if (json_array_size(slaves) > 0)
		json_object_set(port, "slaves", slaves);
	json_decref(slaves);
	return port;
}

int rtuctl_suggest(struct map *map, const struct rtuctl_request *request)
{
	const struct map_config *config = map_config(map);
	json_t *ports = json_array(), *file;

	for (uint32_t i = 0; i < modbus_port_count(config); i++) {
		json_t *port = port_of(map, i);

		if (json_object_size(port) > 1)
			json_array_append(ports, port);
		json_decref(port);
	}
	if (json_array_size(ports) == 0)
		fputs("rtuctl: nothing to suggest\n", stderr);
	file = json_pack("{s:o}", "port", ports);
	json_dumpf(file, stdout, JSON_REAL_PRECISION(REAL_DIGITS) | (request->json ? 0 : JSON_INDENT(2)));
	putchar('\n');
	json_decref(file);
	return RTUCTL_DONE;
}
