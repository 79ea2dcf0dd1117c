/* SPDX-License-Identifier: GPL-3.0-or-later */
/* A device of a line, as all lists show it. */
#include <jansson.h>

#include "map/time_ns.h"
#include "modbus/config.h"
#include "modbus/stats.h"
#include "rows/identity.h"
#include "rows/learned.h"
#include "rows/rows.h"

json_t *rows_milliseconds(uint32_t us)
{
	return json_real(us / (double)US_PER_MS);
}

json_t *rows_device(const struct map *map, uint32_t index)
{
	const struct map_config *config = map_config(map);
	const struct map_set *set = &config->sets[index];
	const struct modbus_slave *slave = &modbus_slaves(config)[index];
	const struct modbus_device_stats *stats = modbus_device_stats(map, index);
	json_t *row = json_object();

	json_object_set_new(row, "port", json_integer(modbus_ports(config)[slave->port].port));
	json_object_set_new(row, "id", json_integer(slave->unit));
	json_object_set_new(row, "description", json_string(set->name));
	json_object_set_new(row, "ca", json_integer(set->ca));
	json_object_set_new(row, "alive", json_boolean(modbus_device_answers(map, index)));
	json_object_set_new(row, "latency_ms", rows_milliseconds(stats->latency_us));
	json_object_set_new(row, "latency_least_ms", rows_milliseconds(stats->latency_least_us));
	json_object_set_new(row, "latency_typical_ms", rows_milliseconds(stats->latency_typical_us));
	json_object_set_new(row, "latency_most_ms", rows_milliseconds(stats->latency_most_us));
	json_object_set_new(row, "pause_ms", rows_milliseconds(stats->pause_us));
	json_object_set_new(row, "too_late", json_integer(stats->too_late));
	json_object_set_new(row, "latest_ms", json_integer(stats->latest_ms));
	json_object_set_new(row, "writes_coils", json_integer(stats->writes_coils));
	json_object_set_new(row, "writes_registers", json_integer(stats->writes_registers));
	json_object_set_new(row, "learned", learned_json(&stats->learned));
	rows_add_identity(row, map, index);
	json_object_set_new(row, "planned_requests", json_integer(stats->planned_requests));
	json_object_set_new(row, "missed_periods", json_integer(stats->missed_periods));
	json_object_set_new(row, "kept_writes", json_integer(stats->kept));
	json_object_set_new(row, "kept_writes_failed", json_integer(stats->kept_failed));
	json_object_set_new(row, "requests", json_integer(stats->requests));
	json_object_set_new(row, "answers", json_integer(stats->answers));
	json_object_set_new(row, "exceptions", json_integer(stats->exceptions));
	json_object_set_new(row, "timeouts", json_integer(stats->timeouts));
	json_object_set_new(row, "errors", json_integer(stats->errors));
	json_object_set_new(row, "next_probe_ms", json_integer(stats->next_probe_ms));
	return row;
}
