/* SPDX-License-Identifier: GPL-3.0-or-later */
/* What its devices ask of a line's time: whether it can hold their periods, what probes cost. docs/limit.md. */
#include "map/time_ns.h"
#include "modbus/config_loader.h"
#include "modbus/configured.h"
#include "modbus/limit.h"

/* What the scheduler leaves to reads with a period when others wait, too. */
#define HELD_LOAD ((double)MODBUS_DUE_IN_ROW / (MODBUS_DUE_IN_ROW + 1))

/* A read and how long it takes. */
struct timed_read {
	const struct modbus_read *read; /* NULL: none */
	double ms;
};

static struct timed_read timed(const struct modbus_line *line, const struct modbus_device *device,
			       const struct modbus_read *read)
{
	return (struct timed_read){read, (double)modbus_limit_read_ns(line, device, read, false) / NS_PER_MS};
}

/* The read that takes the longest, but for one. */
static struct timed_read longest_but(const struct modbus_line *line, const struct modbus_read *one)
{
	struct timed_read longest = {.read = NULL};

	for (uint32_t i = 0; i < line->device_count; i++)
		for (uint32_t j = 0; j < line->devices[i].read_count; j++) {
			const struct modbus_device *device = &line->devices[i];
			struct timed_read read = timed(line, device, &device->reads[j]);

			if (read.read != one && read.ms > longest.ms)
				longest = read;
		}
	return longest;
}

static void check_read(struct modbus_loader *loader, const struct config_place *slave,
		       const struct modbus_line *line, const struct modbus_device *device,
		       const struct modbus_read *read)
{
	double least_ms = (double)modbus_limit_read_ns(line, device, read, true) / NS_PER_MS;
	double period_ms = (double)read->period_ns / NS_PER_MS;

	if (read->period_ns > 0 && least_ms > period_ms)
		config_error(loader->report, slave,
			     "function %u from address %u takes at least %.1f ms, expected a longer period "
			     "than %.0f ms",
			     read->function, read->address, least_ms, period_ms);
}

/* ---- values and what scales them --------------------------------------------------------- */

/* The read that has the point; NULL: it is not read. */
static const struct modbus_read *read_of(const struct modbus_device *device, uint32_t point)
{
	for (uint32_t i = 0; i < device->read_count; i++)
		for (uint32_t j = 0; j < device->reads[i].objects; j++)
			if (device->objects[device->reads[i].first + j].tag == point)
				return &device->reads[i];
	return NULL;
}

/* Of two with one period, the value would otherwise be without its scale until the next time. */
static void check_scale(struct modbus_loader *loader, const struct modbus_device *device, uint32_t point,
			unsigned link)
{
	const struct modbus_entry *entry = &loader->entries[point];
	const struct modbus_extra *extra = modbus_extra_of(loader->config, &entry->wire);
	const uint32_t other = loader->config->sets[entry->point.set].first_point + extra->links[link] - 1u;
	struct config_place links[MODBUS_ENTRY_LINKS];
	const struct config_place here =
	    config_key_of(modbus_entry_place(entry, links), modbus_link_keys[link]);

	if (entry->wire.scan_period_ms > 0 &&
	    entry->wire.scan_period_ms == loader->entries[other].wire.scan_period_ms &&
	    read_of(device, point) != read_of(device, other))
		config_error(loader->report, &here, MODBUS_READ_TOO_LATE, entry->links[link]);
}

static void check_scales(struct modbus_loader *loader, const struct modbus_device *device)
{
	for (uint32_t i = 0; i < device->object_count; i++) {
		const uint32_t point = device->objects[i].tag;

		for (unsigned link = MODBUS_STATUS_BITS; link < MODBUS_LINKS; link++)
			if (loader->entries[point].links[link] != NULL)
				check_scale(loader, device, point, link);
	}
}

/* A line's devices are its slaves in the order of the file. */
static void check_reads(struct modbus_loader *loader, const struct config_place *port,
			const struct modbus_line *line)
{
	const struct config_place slaves = config_key_of(port, MODBUS_KEY_SLAVES);

	for (uint32_t i = 0; i < line->device_count; i++) {
		const struct config_place slave = config_element_of(&slaves, i);

		for (uint32_t j = 0; j < line->devices[i].read_count; j++)
			check_read(loader, &slave, line, &line->devices[i], &line->devices[i].reads[j]);
	}
}

/* A request is never broken off: who is due meanwhile waits for it. One note a line says enough. */
static void check_waiting(struct modbus_loader *loader, const struct config_place *port,
			  const struct modbus_line *line)
{
	struct timed_read longest = longest_but(line, NULL);
	struct timed_read second = longest_but(line, longest.read);

	for (uint32_t i = 0; i < line->device_count; i++)
		for (uint32_t j = 0; j < line->devices[i].read_count; j++) {
			const struct modbus_device *device = &line->devices[i];
			struct timed_read read = timed(line, device, &device->reads[j]);
			struct timed_read other = read.read == longest.read ? second : longest;
			double period_ms = (double)read.read->period_ns / NS_PER_MS;

			if (read.read->period_ns == 0 || other.read == NULL ||
			    period_ms >= read.ms + other.ms)
				continue;
			config_note(loader->report, port,
				    "a period of %.0f ms is missed when a request of %.1f ms is under way",
				    period_ms, other.ms);
			return;
		}
}

/* Impossible is what even devices that answer at once could not do; what a slower one spoils is worth a note. */
static void check_load(struct modbus_loader *loader, const struct config_place *port,
		       const struct modbus_line *line)
{
	double least = modbus_limit_load(line, true), expected = modbus_limit_load(line, false);

	if (least > 1)
		config_error(loader->report, port,
			     "its periods need at least %.0f %% of the line's time, expected longer ones",
			     100 * least);
	else if (expected > HELD_LOAD)
		config_note(loader->report, port,
			    "its periods need %.0f %% of the line's time, its devices' reactions included, "
			    "and some will be missed",
			    100 * expected);
	else
		check_waiting(loader, port, line);
}

/* A probe that the key asks for earlier than a dead device's share of the time would have it. */
static void check_probes(struct modbus_loader *loader, const struct config_place *port,
			 const struct modbus_line *line)
{
	const struct config_place slaves = config_key_of(port, MODBUS_KEY_SLAVES);

	for (uint32_t i = 0; line->device_count > 1 && i < line->device_count; i++) {
		const struct modbus_device *device = &line->devices[i];
		const struct config_place slave = config_element_of(&slaves, i);
		const struct config_place here = config_key_of(&slave, MODBUS_KEY_PROBE_MAX);
		int64_t vain_ns = modbus_vain_probe_ns(&line->wire, device->response_timeout_ns);
		double share = (double)vain_ns / (double)(device->probe_max_ns + vain_ns);

		if (device->probe_max_ns > 0 && share * MODBUS_DEAD_SHARE > 1)
			config_note(loader->report, &here,
				    "while the device is dead, it costs the line up to %.0f %% of its time; "
				    "without the key %.0f %%",
				    100 * share, 100.0 / MODBUS_DEAD_SHARE);
	}
}

static bool check_line(struct modbus_loader *loader, uint32_t number)
{
	const struct config_place file = {.in = NULL};
	const struct config_place ports = config_key_of(&file, MODBUS_KEY_PORTS);
	const struct config_place port = config_element_of(&ports, loader->port_of_line[number]);
	struct modbus_line line = {.device_count = 0};
	bool made = modbus_line_configure(&line, loader->config, number);
	unsigned errors = loader->report->errors;

	if (made)
		check_reads(loader, &port, &line);
	for (uint32_t i = 0; made && i < line.device_count; i++)
		check_scales(loader, &line.devices[i]);
	if (made && loader->report->errors == errors)
		check_load(loader, &port, &line);
	if (made)
		check_probes(loader, &port, &line);
	modbus_line_release(&line);
	return made;
}

bool modbus_check_periods(struct modbus_loader *loader)
{
	for (uint32_t i = 0; i < modbus_port_count(loader->config); i++)
		if (!check_line(loader, i))
			return false;
	return true;
}
