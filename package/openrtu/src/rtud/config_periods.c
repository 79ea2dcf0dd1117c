/* SPDX-License-Identifier: GPL-3.0-or-later */
/* Whether a line can hold the periods of its devices' objects: docs/limit.md. */
#include "modbus/configured.h"
#include "rtud/config_parts.h"
#include "rtud/limit.h"

#define NS_PER_MS 1e6

/* What the scheduler leaves to reads with a period when others wait, too. */
#define HELD_LOAD ((double)MODBUS_DUE_IN_ROW / (MODBUS_DUE_IN_ROW + 1))

static double read_ms(const struct modbus_line *line, const struct modbus_read *read, int64_t reaction_ns)
{
	return (double)modbus_read_ns(&line->wire, read->function, read->count, reaction_ns) / NS_PER_MS;
}

/* The read that takes the longest, but for one; NULL: there is no other. */
static const struct modbus_read *longest_but(const struct modbus_line *line, const struct modbus_read *one)
{
	const struct modbus_read *longest = NULL;

	for (uint32_t i = 0; i < line->device_count; i++)
		for (uint32_t j = 0; j < line->devices[i].read_count; j++) {
			const struct modbus_read *read = &line->devices[i].reads[j];

			if (read != one &&
			    (longest == NULL || read_ms(line, read, 0) > read_ms(line, longest, 0)))
				longest = read;
		}
	return longest;
}

static void check_read(struct config_loader *loader, const struct config_place *slave,
		       const struct modbus_line *line, const struct modbus_read *read)
{
	double least_ms = read_ms(line, read, 0), period_ms = (double)read->period_ns / NS_PER_MS;

	if (read->period_ns > 0 && least_ms > period_ms)
		config_error(&loader->report, slave,
			     "function %u from address %u takes at least %.1f ms, expected a longer period "
			     "than %.0f ms",
			     read->function, read->address, least_ms, period_ms);
}

/* A line's devices are its slaves in the order of the file. */
static void check_reads(struct config_loader *loader, const struct config_place *port,
			const struct modbus_line *line)
{
	const struct config_place slaves = config_key_of(port, CONFIG_KEY_SLAVES);

	for (uint32_t i = 0; i < line->device_count; i++) {
		const struct config_place slave = config_element_of(&slaves, i);

		for (uint32_t j = 0; j < line->devices[i].read_count; j++)
			check_read(loader, &slave, line, &line->devices[i].reads[j]);
	}
}

/* A request is never broken off: who is due meanwhile waits for it. One note a line says enough. */
static void check_waiting(struct config_loader *loader, const struct config_place *port,
			  const struct modbus_line *line)
{
	const struct modbus_read *longest = longest_but(line, NULL);
	const struct modbus_read *second = longest_but(line, longest);

	for (uint32_t i = 0; i < line->device_count; i++)
		for (uint32_t j = 0; j < line->devices[i].read_count; j++) {
			const struct modbus_read *read = &line->devices[i].reads[j];
			const struct modbus_read *other = read == longest ? second : longest;
			double period_ms = (double)read->period_ns / NS_PER_MS;

			if (read->period_ns == 0 || other == NULL ||
			    period_ms >= read_ms(line, read, MODBUS_REACTION_NS) +
					     read_ms(line, other, MODBUS_REACTION_NS))
				continue;
			config_note(&loader->report, port,
				    "a period of %.0f ms is missed when a request of %.1f ms is under way",
				    period_ms, read_ms(line, other, MODBUS_REACTION_NS));
			return;
		}
}

/* Impossible is what even devices that answer at once could not do; what a slower one spoils is worth a note. */
static void check_load(struct config_loader *loader, const struct config_place *port,
		       const struct modbus_line *line)
{
	double least = limit_load(line, 0), assumed = limit_load(line, MODBUS_REACTION_NS);

	if (least > 1)
		config_error(&loader->report, port,
			     "its periods need at least %.0f %% of the line's time, expected longer ones",
			     100 * least);
	else if (assumed > HELD_LOAD)
		config_note(
		    &loader->report, port,
		    "its periods need %.0f %% of the line's time when devices react after %.0f ms, and will "
		    "not all be held",
		    100 * assumed, (double)MODBUS_REACTION_NS / NS_PER_MS);
	else
		check_waiting(loader, port, line);
}

static bool check_line(struct config_loader *loader, uint32_t number)
{
	const struct config_place file = {.in = NULL};
	const struct config_place ports = config_key_of(&file, CONFIG_KEY_PORTS);
	const struct config_place port = config_element_of(&ports, loader->port_of_line[number]);
	struct modbus_line line = {.device_count = 0};
	bool made = modbus_line_configure(&line, loader->config, number);
	unsigned errors = loader->report.errors;

	if (made)
		check_reads(loader, &port, &line);
	if (made && loader->report.errors == errors)
		check_load(loader, &port, &line);
	modbus_line_release(&line);
	return made;
}

bool config_check_periods(struct config_loader *loader)
{
	for (uint32_t i = 0; i < loader->config->line_count; i++)
		if (!check_line(loader, i))
			return false;
	return true;
}
