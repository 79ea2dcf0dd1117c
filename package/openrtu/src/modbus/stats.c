/* SPDX-License-Identifier: GPL-3.0-or-later */
#include "modbus/stats.h"

#include <stddef.h>
#include <string.h>

#include "modbus/config.h"
#include "modbus/same.h"

/* What lies before it in its module's section, or of all lines of that process. */
struct place {
	uint32_t lines, devices, asked; /* devices that are asked what they are */
};

/* Of the port's first devices, so many. */
static uint32_t asked_before(const struct map_config *config, const struct modbus_port *port,
			     uint32_t devices)
{
	uint32_t asked = 0;

	for (uint32_t i = port->first_device; i < port->first_device + devices; i++)
		asked += modbus_is_asked(config, i);
	return asked;
}

static struct place place_of(const struct map_config *config, uint16_t process, uint32_t end)
{
	const struct modbus_port *ports = modbus_ports(config);
	struct place place = {0};

	for (uint32_t i = 0; i < end; i++) {
		if (ports[i].process != process)
			continue;
		place.lines++;
		place.devices += ports[i].device_count;
		place.asked += asked_before(config, &ports[i], ports[i].device_count);
	}
	return place;
}

/* Points below end, whose last command the gateway writes again, and whose lines are the process'. */
static uint32_t commanded_before(const struct map_config *config, uint16_t process, uint32_t end)
{
	const struct modbus_keep *keeps = modbus_keeps(config);
	const uint32_t records = map_record_count(config, MODBUS_KEEPS);
	uint32_t count = 0;

	for (uint32_t i = 0; i < records && keeps[i].point < end; i++) {
		const struct modbus_slave *slave = &modbus_slaves(config)[config->points[keeps[i].point].set];

		count += !keeps[i].has_value && modbus_ports(config)[slave->port].process == process;
	}
	return count;
}

/* The lines of its process, then all their devices, all their frames, what was commanded, and what devices are: what other processes have changes nothing in it. */
size_t modbus_stats_size(const struct map_config *config, uint16_t process)
{
	const struct place all = place_of(config, process, modbus_port_count(config));

	return all.lines * (sizeof(struct modbus_line_stats) + sizeof(struct modbus_frames)) +
	       all.devices * sizeof(struct modbus_device_stats) +
	       commanded_before(config, process, MAP_NONE) * sizeof(struct modbus_commanded_stats) +
	       all.asked * sizeof(struct modbus_identity_stats);
}

static bool sizes_are_known(const struct map *map)
{
	const struct map_config *config = map_config(map);
	const struct modbus_port *ports = modbus_ports(config);

	for (uint32_t i = 0; i < modbus_port_count(config); i++)
		if (map_section(map, ports[i].module, modbus_stats_size(config, ports[i].process)) == NULL)
			return false;
	return true;
}

bool modbus_is_known(const struct map *map)
{
	const struct map_config *config = map_config(map);

	return modbus_settings(config) != NULL && modbus_ports(config) != NULL &&
	       modbus_slaves(config) != NULL && modbus_points(config) != NULL && sizes_are_known(map);
}

static void *stats_of(const struct map *map, const struct modbus_port *port)
{
	return map_section(map, port->module, modbus_stats_size(map_config(map), port->process));
}

static size_t offset_of_line(const struct map_config *config, uint32_t line)
{
	const struct modbus_port *port = &modbus_ports(config)[line];

	return place_of(config, port->process, line).lines * sizeof(struct modbus_line_stats);
}

static size_t offset_of_device(const struct map_config *config, uint32_t device)
{
	const uint32_t line = modbus_slaves(config)[device].port;
	const struct modbus_port *port = &modbus_ports(config)[line];
	const uint32_t lines = place_of(config, port->process, modbus_port_count(config)).lines;
	const uint32_t devices = place_of(config, port->process, line).devices + device - port->first_device;

	return lines * sizeof(struct modbus_line_stats) + devices * sizeof(struct modbus_device_stats);
}

static size_t offset_of_frames(const struct map_config *config, uint32_t line)
{
	const struct modbus_port *port = &modbus_ports(config)[line];
	const struct place all = place_of(config, port->process, modbus_port_count(config));

	return all.lines * sizeof(struct modbus_line_stats) +
	       all.devices * sizeof(struct modbus_device_stats) +
	       place_of(config, port->process, line).lines * sizeof(struct modbus_frames);
}

static size_t offset_of_commanded(const struct map_config *config, uint32_t point)
{
	const struct modbus_slave *slave = &modbus_slaves(config)[config->points[point].set];
	const uint16_t process = modbus_ports(config)[slave->port].process;
	const struct place all = place_of(config, process, modbus_port_count(config));

	return all.lines * (sizeof(struct modbus_line_stats) + sizeof(struct modbus_frames)) +
	       all.devices * sizeof(struct modbus_device_stats) +
	       commanded_before(config, process, point) * sizeof(struct modbus_commanded_stats);
}

static size_t offset_of_identity(const struct map_config *config, uint32_t device)
{
	const uint32_t line = modbus_slaves(config)[device].port;
	const struct modbus_port *port = &modbus_ports(config)[line];
	const uint32_t asked = place_of(config, port->process, line).asked +
			       asked_before(config, port, device - port->first_device);

	return modbus_stats_size(config, port->process) -
	       (place_of(config, port->process, modbus_port_count(config)).asked - asked) *
		   sizeof(struct modbus_identity_stats);
}

struct modbus_line_stats *modbus_line_stats(const struct map *map, uint32_t line)
{
	const struct map_config *config = map_config(map);
	uint8_t *section = stats_of(map, &modbus_ports(config)[line]);

	return (void *)(section + offset_of_line(config, line));
}

struct modbus_device_stats *modbus_device_stats(const struct map *map, uint32_t device)
{
	const struct map_config *config = map_config(map);
	uint8_t *section = stats_of(map, &modbus_ports(config)[modbus_slaves(config)[device].port]);

	return (void *)(section + offset_of_device(config, device));
}

struct modbus_frames *modbus_line_frames(const struct map *map, uint32_t line)
{
	const struct map_config *config = map_config(map);
	uint8_t *section = stats_of(map, &modbus_ports(config)[line]);

	return (void *)(section + offset_of_frames(config, line));
}

struct modbus_identity_stats *modbus_identity_stats(const struct map *map, uint32_t device)
{
	const struct map_config *config = map_config(map);
	uint8_t *section = stats_of(map, &modbus_ports(config)[modbus_slaves(config)[device].port]);

	return (void *)(section + offset_of_identity(config, device));
}

struct modbus_commanded_stats *modbus_commanded_stats(const struct map *map, uint32_t point)
{
	const struct map_config *config = map_config(map);
	const struct modbus_slave *slave = &modbus_slaves(config)[config->points[point].set];
	uint8_t *section = stats_of(map, &modbus_ports(config)[slave->port]);

	return (void *)(section + offset_of_commanded(config, point));
}

bool modbus_line_is_open(const struct map *map, uint32_t line)
{
	return modbus_line_stats(map, line)->open != 0 &&
	       map_alive(map, modbus_ports(map_config(map))[line].module);
}

bool modbus_device_answers(const struct map *map, uint32_t device)
{
	const struct map_config *config = map_config(map);

	return modbus_device_stats(map, device)->alive != 0 &&
	       map_alive(map, modbus_ports(config)[modbus_slaves(config)[device].port].module);
}

/* ---- what passes over to another process ------------------------------------------------------ */

static uint32_t find_line(const struct map_config *config, const struct modbus_port *port)
{
	const struct modbus_port *ports = modbus_ports(config);

	for (uint32_t i = 0; i < modbus_port_count(config); i++)
		if (ports[i].port == port->port && ports[i].process == port->process)
			return i;
	return MAP_NONE;
}

static uint32_t find_device(const struct map_config *config, const struct modbus_port *port, uint8_t unit)
{
	for (uint32_t i = port->first_device; i < port->first_device + port->device_count; i++)
		if (modbus_slaves(config)[i].unit == unit)
			return i;
	return MAP_NONE;
}

/* The point of the device whose last command is kept, and which is the same; MAP_NONE: there is none. */
static uint32_t find_commanded(const struct map_config *before, uint32_t device, const struct map_config *now,
			       uint32_t point)
{
	const struct map_set *set = &before->sets[device];
	const struct modbus_keep *keep;

	for (uint32_t i = set->first_point; i < set->first_point + set->point_count; i++)
		if (modbus_keeps_of(before, i, &keep) > 0 && !keep->has_value &&
		    modbus_same_point(before, i, now, point))
			return i;
	return MAP_NONE;
}

/* With another scale, the same octets would be another value: only a point that is the same goes on with them. */
static void carry_commanded(const struct map_config *before, uint32_t former, const uint8_t *from,
			    const struct map_config *now, uint32_t device, uint8_t *to)
{
	const struct map_set *set = &now->sets[device];
	const struct modbus_keep *keep;

	for (uint32_t i = set->first_point; i < set->first_point + set->point_count; i++) {
		const bool commanded = modbus_keeps_of(now, i, &keep) > 0 && !keep->has_value;
		const uint32_t point = commanded ? find_commanded(before, former, now, i) : MAP_NONE;

		if (point != MAP_NONE)
			memcpy(to + offset_of_commanded(now, i), from + offset_of_commanded(before, point),
			       sizeof(struct modbus_commanded_stats));
	}
}

static void carry_devices(const struct map_config *before, const struct modbus_port *former,
			  const uint8_t *from, const struct map_config *now, const struct modbus_port *port,
			  uint8_t *to)
{
	for (uint32_t i = port->first_device; i < port->first_device + port->device_count; i++) {
		const uint32_t device = find_device(before, former, modbus_slaves(now)[i].unit);

		if (device == MAP_NONE)
			continue;
		memcpy(to + offset_of_device(now, i), from + offset_of_device(before, device),
		       offsetof(struct modbus_device_stats, alive));
		carry_commanded(before, device, from, now, i, to);
		if (modbus_is_asked(before, device) && modbus_is_asked(now, i))
			memcpy(to + offset_of_identity(now, i), from + offset_of_identity(before, device),
			       offsetof(struct modbus_identity_stats, state));
	}
}

/* What has a name passes over by that: map_name_counter. */
void modbus_carry_stats(const struct map_config *before, const void *from, const struct map_config *now,
			void *to, uint16_t process)
{
	const size_t named = offsetof(struct modbus_line_stats, wakeups);

	for (uint32_t i = 0; i < modbus_port_count(now); i++) {
		const struct modbus_port *port = &modbus_ports(now)[i];
		const uint32_t line = port->process == process ? find_line(before, port) : MAP_NONE;

		if (line == MAP_NONE)
			continue;
		memcpy((uint8_t *)to + offset_of_line(now, i) + named,
		       (const uint8_t *)from + offset_of_line(before, line) + named,
		       sizeof(struct modbus_line_stats) - named);
		memcpy((uint8_t *)to + offset_of_frames(now, i),
		       (const uint8_t *)from + offset_of_frames(before, line), sizeof(struct modbus_frames));
		carry_devices(before, &modbus_ports(before)[line], from, now, port, to);
	}
}

void modbus_name_counters(struct map *map, uint32_t line)
{
	const struct modbus_line_stats *stats = modbus_line_stats(map, line);
	const struct {
		const char *name;
		const _Atomic uint32_t *counter;
	} counters[] = {
	    {"requests", &stats->requests},
	    {"answers", &stats->answers},
	    {"exceptions", &stats->exceptions},
	    {"timeouts", &stats->timeouts},
	    {"crc_errors", &stats->crc_errors},
	    {"wrong_units", &stats->wrong_units},
	    {"wrong_functions", &stats->wrong_functions},
	    {"wrong_lengths", &stats->wrong_lengths},
	    {"wrong_answers", &stats->wrong_answers},
	    {"late_answers", &stats->late_answers},
	    {"unasked_frames", &stats->unasked_frames},
	    {"echoes", &stats->echoes},
	    {"noise_bytes", &stats->noise_bytes},
	    {"stuck_s", &stats->stuck_s},
	    {"commands", &stats->commands},
	    {"scan_us", &stats->scan_us},
	    {"port_errors", &stats->port_errors},
	    {"open", &stats->open},
	};

	_Static_assert(sizeof(counters) / sizeof(counters[0]) == MODBUS_LINE_COUNTERS, "all are planned");
	for (size_t i = 0; i < MODBUS_LINE_COUNTERS; i++)
		map_name_counter(map, counters[i].counter, "p%u.%s", modbus_ports(map_config(map))[line].port,
				 counters[i].name);
}
