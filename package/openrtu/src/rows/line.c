/* SPDX-License-Identifier: GPL-3.0-or-later */
#include "rows/rows.h"

#include "modbus/config.h"
#include "modbus/stats.h"

/* As engineers write it: 19200 8N2, 9600 7E1 ASCII, TCP 502, UDP 502, RTU over TCP 4001 */
static json_t *line_format(const struct modbus_port *line)
{
	static const char parities[] = {
	    [MODBUS_PARITY_NONE] = 'N', [MODBUS_PARITY_ODD] = 'O', [MODBUS_PARITY_EVEN] = 'E'};

	static const char *const tcp[] = {[MODBUS_FRAMING_RTU] = "RTU over TCP",
					  [MODBUS_FRAMING_TCP] = "TCP",
					  [MODBUS_FRAMING_ASCII] = "ASCII over TCP"};

	if (modbus_is_udp(line))
		return json_sprintf("UDP %u", line->tcp_port);
	if (modbus_is_tcp(line))
		return json_sprintf("%s %u", tcp[line->framing], line->tcp_port);
	return json_sprintf("%u %u%c%u%s", line->baud, line->data_bits, parities[line->parity],
			    line->stop_bits, line->framing == MODBUS_FRAMING_ASCII ? " ASCII" : "");
}

static json_t *line_devices(const struct map *map, const struct modbus_port *line)
{
	json_t *devices = json_array();

	for (uint32_t i = 0; i < line->device_count; i++)
		json_array_append_new(devices, rows_device(map, line->first_device + i));
	return devices;
}

static void add_connection(json_t *row, const struct modbus_line_stats *stats)
{
	json_object_set_new(row, "closes", json_integer(stats->closes));
	json_object_set_new(row, "hung", json_integer(stats->hung));
	json_object_set_new(row, "idle_ms", json_integer(stats->idle_ms));
	json_object_set_new(row, "settle_ms", rows_milliseconds(stats->settle_us));
}

json_t *rows_line(const struct map *map, uint32_t index)
{
	const struct modbus_port *line = &modbus_ports(map_config(map))[index];
	const struct modbus_line_stats *stats = modbus_line_stats(map, index);
	json_t *row = json_object();

	json_object_set_new(row, "port", json_integer(line->port));
	json_object_set_new(row, "device", json_string(line->device));
	json_object_set_new(row, "format", line_format(line));
	json_object_set_new(row, "module", rows_module_name(map, line->module));
	json_object_set_new(row, "open", json_boolean(modbus_line_is_open(map, index)));
	json_object_set_new(row, "scan_ms", rows_milliseconds(stats->scan_us));
	json_object_set_new(row, "requests", json_integer(stats->requests));
	json_object_set_new(row, "answers", json_integer(stats->answers));
	json_object_set_new(row, "exceptions", json_integer(stats->exceptions));
	json_object_set_new(row, "timeouts", json_integer(stats->timeouts));
	json_object_set_new(row, "crc_errors", json_integer(stats->crc_errors));
	json_object_set_new(row, "late_answers", json_integer(stats->late_answers));
	json_object_set_new(row, "wrong_units", json_integer(stats->wrong_units));
	json_object_set_new(row, "wrong_functions", json_integer(stats->wrong_functions));
	json_object_set_new(row, "wrong_lengths", json_integer(stats->wrong_lengths));
	json_object_set_new(row, "wrong_answers", json_integer(stats->wrong_answers));
	json_object_set_new(row, "unasked_frames", json_integer(stats->unasked_frames));
	json_object_set_new(row, "echoes", json_integer(stats->echoes));
	json_object_set_new(row, "noise_bytes", json_integer(stats->noise_bytes));
	json_object_set_new(row, "stuck_s", json_integer(stats->stuck_s));
	json_object_set_new(row, "commands", json_integer(stats->commands));
	json_object_set_new(row, "port_errors", json_integer(stats->port_errors));
	if (modbus_is_tcp(line) && !modbus_is_udp(line))
		add_connection(row, stats);
	json_object_set_new(row, "devices", line_devices(map, line));
	return row;
}
