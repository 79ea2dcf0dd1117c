/* SPDX-License-Identifier: GPL-3.0-or-later */
#include "modules/modbus/line_counters.h"

#include <stdatomic.h>
#include <string.h>

#include "map/time_ns.h"
#include "modbus/stats.h"

static void show(_Atomic uint32_t *counter, uint32_t value)
{
	atomic_store_explicit(counter, value, memory_order_relaxed);
}

static void show_histogram(struct map_histogram *shown, const struct modbus_histogram *histogram)
{
	_Static_assert(MAP_BUCKETS == MODBUS_BUCKETS, "they are the same");
	for (uint32_t i = 0; i < MODBUS_BUCKETS; i++)
		show(&shown->counts[i], histogram->counts[i]);
	show(&shown->longest_us, histogram->longest_us);
}

static void show_learned(struct modbus_learned_stats *shown, const struct modbus_learned *learned)
{
	show(&shown->given_bits, learned->given_bits);
	show(&shown->given_registers, learned->given_registers);
	show(&shown->refused_bits, learned->refused_bits);
	show(&shown->refused_registers, learned->refused_registers);
	show(&shown->silent_bits, learned->silent_bits);
	show(&shown->silent_registers, learned->silent_registers);
	show(&shown->hole_function, learned->hole.function);
	show(&shown->hole_address, learned->hole.address);
	show(&shown->hole_count, learned->hole.count);
	show(&shown->hole_exception, learned->hole.exception);
	show(&shown->hole_read, learned->hole.read);
	show(&shown->lacking_function, learned->lacking.function);
	show(&shown->lacking_address, learned->lacking.address);
	show(&shown->lacking_exception, learned->lacking.exception);
	show(&shown->lacking_count, learned->lacking.count);
	show(&shown->holes_given, learned->holes_given);
	show(&shown->unclear, learned->unclear);
	show(&shown->open, learned->open);
}

static void show_device(struct modbus_device_stats *stats, struct modbus_device *device)
{
	show(&stats->requests, device->counters.requests);
	show(&stats->answers, device->counters.answers);
	show(&stats->exceptions, device->counters.exceptions);
	show(&stats->timeouts, device->counters.timeouts);
	show(&stats->errors, device->counters.errors);
	show(&stats->alive, device->alive);
	show(&stats->next_probe_ms, (uint32_t)(device->backoff_ns / NS_PER_MS));
	show(&stats->latency_us, device->counters.latency_us);
	show(&stats->planned_requests, device->read_count);
	show(&stats->missed_periods, device->counters.missed_periods);
	show(&stats->kept, device->counters.kept);
	show(&stats->kept_failed, device->counters.kept_failed);
	show(&stats->too_late, device->counters.too_late);
	show(&stats->latest_ms, (uint32_t)((device->latest_ns + NS_PER_MS - 1) / NS_PER_MS));
	show(&stats->writes_coils, device->writes.coils);
	show(&stats->writes_registers, device->writes.registers);
	show(&stats->pause_us, (uint32_t)(modbus_pause_learned_ns(&device->pause) / NS_PER_US));
	show(&stats->latency_least_us, device->latency.least_us);
	show(&stats->latency_typical_us, device->latency.typical_us);
	show(&stats->latency_most_us, device->latency.most_us);
	if (device->news) {
		struct modbus_learned learned = modbus_learn(device->reads, device->read_count);

		show_learned(&stats->learned, &learned);
		device->news = false;
	}
}

/* One that dies within this has nothing to go on with. */
static void show_commanded(struct modbus_commanded_stats *stats, const struct modbus_request *request)
{
	show(&stats->request, 0);
	for (uint32_t i = 0; i < MODBUS_WRITE_MAX / 2; i++)
		show(&stats->values[i], request->values[2 * i] | (uint32_t)request->values[2 * i + 1] << 16);
	atomic_store_explicit(&stats->request,
			      (uint32_t)request->function << 24 | (uint32_t)request->count << 16 |
				  request->address,
			      memory_order_release);
}

static void show_all_commanded(const struct map *map, struct modbus_device *device)
{
	for (uint32_t i = 0; i < device->kept_count; i++) {
		struct modbus_kept *kept = &device->kept[i];

		if (!kept->news)
			continue;
		kept->news = false;
		show_commanded(modbus_commanded_stats(map, kept->tag), &kept->request);
	}
}

/* Nobody reads them while they are written. */
static void show_identity(const struct map *map, uint32_t number, struct modbus_identity *identity)
{
	struct modbus_identity_stats *stats;
	uint32_t words[MODBUS_IDENTITY_SIZE / sizeof(uint32_t)];

	if (identity == NULL || !identity->news)
		return;
	identity->news = false;
	stats = modbus_identity_stats(map, number);
	memcpy(words, identity->texts, sizeof(words));
	atomic_store_explicit(&stats->size, 0, memory_order_seq_cst);
	for (uint32_t i = 0; i < sizeof(words) / sizeof(words[0]); i++)
		show(&stats->texts[i], words[i]);
	show(&stats->silences, identity->silences);
	show(&stats->state, identity->state);
	atomic_store_explicit(&stats->size, identity->size, memory_order_release);
}

/* ---- of a former process ---------------------------------------------------------------------- */

static void take_histogram(struct modbus_histogram *histogram, const struct map_histogram *shown)
{
	for (uint32_t i = 0; i < MODBUS_BUCKETS; i++)
		histogram->counts[i] = shown->counts[i];
	histogram->longest_us = shown->longest_us;
}

static void take_device(struct modbus_device *device, const struct modbus_device_stats *stats)
{
	device->counters = (struct modbus_device_counters){
	    .requests = stats->requests,
	    .answers = stats->answers,
	    .exceptions = stats->exceptions,
	    .timeouts = stats->timeouts,
	    .errors = stats->errors,
	    .missed_periods = stats->missed_periods,
	    .kept = stats->kept,
	    .kept_failed = stats->kept_failed,
	};
	modbus_take_functions(device, stats->writes_coils, stats->writes_registers);
	modbus_pause_take(&device->pause, stats->pause_us * NS_PER_US, map_now_ns());
}

static void take_commanded(struct modbus_request *request, const struct modbus_commanded_stats *stats,
			   uint8_t unit)
{
	*request = (struct modbus_request){.unit = unit,
					   .function = (uint8_t)(stats->request >> 24),
					   .count = stats->request >> 16 & 0xFF,
					   .address = (uint16_t)stats->request};
	for (uint32_t i = 0; i < MODBUS_WRITE_MAX; i++)
		request->values[i] = (uint16_t)(stats->values[i / 2] >> 16 * (i % 2));
}

static void take_all_commanded(const struct map *map, struct modbus_device *device)
{
	for (uint32_t i = 0; i < device->kept_count; i++)
		if (device->kept[i].constants == NULL)
			take_commanded(&device->kept[i].request,
				       modbus_commanded_stats(map, device->kept[i].tag), device->unit);
}

static void take_connection(struct modbus_connection *connection, const struct modbus_line_stats *stats)
{
	connection->closes = stats->closes;
	connection->hung = stats->hung;
	connection->idle_ns = stats->idle_ms * NS_PER_MS;
	modbus_connection_take(connection, stats->settle_us * NS_PER_US);
}

void line_counters_take(struct port *port)
{
	const struct modbus_line_stats *stats = modbus_line_stats(port->map, port->number);
	struct modbus_line_counters *counters = &port->line.counters;

	*counters = (struct modbus_line_counters){
	    .requests = stats->requests,
	    .answers = stats->answers,
	    .exceptions = stats->exceptions,
	    .timeouts = stats->timeouts,
	    .crc_errors = stats->crc_errors,
	    .wrong_units = stats->wrong_units,
	    .wrong_functions = stats->wrong_functions,
	    .wrong_lengths = stats->wrong_lengths,
	    .wrong_answers = stats->wrong_answers,
	    .late_answers = stats->late_answers,
	    .unasked_frames = stats->unasked_frames,
	    .echoes = stats->echoes,
	    .noise_bytes = stats->noise_bytes,
	    .stuck_s = stats->stuck_s,
	    .commands = stats->commands,
	};
	take_histogram(&counters->transactions, &stats->transactions);
	take_histogram(&port->wakeups, &stats->wakeups);
	take_connection(&port->line.connection, stats);
	for (uint32_t i = 0; i < port->line.device_count; i++) {
		take_device(&port->line.devices[i],
			    modbus_device_stats(port->map, port->config->first_device + i));
		take_all_commanded(port->map, &port->line.devices[i]);
		if (port->line.devices[i].identity != NULL)
			port->line.devices[i].identity->silences =
			    (uint8_t)modbus_identity_stats(port->map, port->config->first_device + i)
				->silences;
	}
}

/* ---- of this one ------------------------------------------------------------------------------ */

static void show_connection(struct modbus_line_stats *stats, const struct modbus_connection *connection)
{
	show(&stats->closes, connection->closes);
	show(&stats->hung, connection->hung);
	show(&stats->idle_ms, (uint32_t)((connection->idle_ns + NS_PER_MS - 1) / NS_PER_MS));
	show(&stats->settle_us, connection->settled ? (uint32_t)(connection->settle_ns / NS_PER_US) : 0);
}

void line_counters_show(struct port *port)
{
	const struct modbus_line_counters *counters = &port->line.counters;
	struct map *map = port->map;
	struct modbus_line_stats *stats = modbus_line_stats(map, port->number);

	show(&stats->requests, counters->requests);
	show(&stats->answers, counters->answers);
	show(&stats->exceptions, counters->exceptions);
	show(&stats->timeouts, counters->timeouts);
	show(&stats->crc_errors, counters->crc_errors);
	show(&stats->wrong_units, counters->wrong_units);
	show(&stats->wrong_functions, counters->wrong_functions);
	show(&stats->wrong_lengths, counters->wrong_lengths);
	show(&stats->wrong_answers, counters->wrong_answers);
	show(&stats->late_answers, counters->late_answers);
	show(&stats->unasked_frames, counters->unasked_frames);
	show(&stats->echoes, counters->echoes);
	show(&stats->noise_bytes, counters->noise_bytes);
	show(&stats->stuck_s, counters->stuck_s);
	show(&stats->commands, counters->commands);
	show(&stats->scan_us, counters->scan_us);
	show(&stats->open, port_is_open(port));
	show_histogram(&stats->wakeups, &port->wakeups);
	show_histogram(&stats->transactions, &counters->transactions);
	show_connection(stats, &port->line.connection);
	for (uint32_t i = 0; i < port->line.device_count; i++) {
		show_device(modbus_device_stats(map, port->config->first_device + i), &port->line.devices[i]);
		show_all_commanded(map, &port->line.devices[i]);
		show_identity(map, port->config->first_device + i, port->line.devices[i].identity);
	}
}
