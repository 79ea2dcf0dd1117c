/* SPDX-License-Identifier: GPL-3.0-or-later */
#include "modbus/limit.h"

#include "map/time_ns.h"
#include "modbus/config.h"
#include "modbus/configured.h"

int64_t modbus_limit_read_ns(const struct modbus_line *line, const struct modbus_device *device,
			     const struct modbus_read *read, bool at_once)
{
	const int64_t reaction_ns = at_once ? 0 : modbus_reaction_ns(&device->limits);

	return modbus_read_ns(&line->wire, read->function, read->count, reaction_ns) +
	       (read->page != 0 ? modbus_page_ns(&line->wire, reaction_ns) : 0);
}

static int64_t device_ns(const struct modbus_line *line, const struct modbus_device *device)
{
	int64_t sum = 0;

	for (uint32_t i = 0; i < device->read_count; i++)
		sum += modbus_limit_read_ns(line, device, &device->reads[i], false);
	return sum;
}

/* From one request to the next one to that device, if it rests as long as it is configured to. */
static int64_t rested_read_ns(const struct modbus_line *line, const struct modbus_device *device,
			      const struct modbus_read *read)
{
	int64_t taken_ns = modbus_limit_read_ns(line, device, read, false);

	return later(taken_ns,
		     taken_ns - later(line->wire.silence_ns, line->wire.least_ns) + device->pause_ns);
}

static int64_t rested_device_ns(const struct modbus_line *line, const struct modbus_device *device)
{
	int64_t sum = 0;

	for (uint32_t i = 0; i < device->read_count; i++)
		sum += rested_read_ns(line, device, &device->reads[i]);
	return sum;
}

/* While one rests, the others are asked. */
static int64_t line_ns(const struct modbus_line *line)
{
	int64_t sum = 0, longest_ns = 0;

	for (uint32_t i = 0; i < line->device_count; i++) {
		sum += device_ns(line, &line->devices[i]);
		longest_ns = later(longest_ns, rested_device_ns(line, &line->devices[i]));
	}
	return later(sum, longest_ns);
}

/* A write of two registers is as long as a read of four. */
static double kept_load(const struct modbus_line *line, const struct modbus_device *device, bool at_once)
{
	const int64_t write_ns = modbus_read_ns(&line->wire, MODBUS_READ_HOLDING_REGISTERS, 4,
						at_once ? 0 : modbus_reaction_ns(&device->limits));
	double load = 0;

	for (uint32_t i = 0; i < device->kept_count; i++)
		if (device->kept[i].period_ns > 0)
			load += (double)write_ns / (double)device->kept[i].period_ns;
	return load;
}

double modbus_limit_load(const struct modbus_line *line, bool at_once)
{
	double load = 0;

	for (uint32_t i = 0; i < line->device_count; i++) {
		const struct modbus_device *device = &line->devices[i];

		load += kept_load(line, device, at_once);
		for (uint32_t j = 0; j < device->read_count; j++) {
			const struct modbus_read *read = &device->reads[j];

			if (read->period_ns > 0)
				load += (double)modbus_limit_read_ns(line, device, read, at_once) /
					(double)read->period_ns;
		}
	}
	return load;
}

static uint32_t line_requests(const struct modbus_line *line)
{
	uint32_t count = 0;

	for (uint32_t i = 0; i < line->device_count; i++)
		count += line->devices[i].read_count;
	return count;
}

static const char *plural(uint32_t count)
{
	return count == 1 ? "" : "s";
}

/* What has no period is read in the time that is left. */
static void print_load(const struct modbus_line *line, FILE *out)
{
	double load = modbus_limit_load(line, false);
	int64_t rest_ns = 0;

	if (!(load > 0))
		return;
	for (uint32_t i = 0; i < line->device_count; i++)
		for (uint32_t j = 0; j < line->devices[i].read_count; j++)
			if (line->devices[i].reads[j].period_ns == 0)
				rest_ns += modbus_limit_read_ns(line, &line->devices[i],
								&line->devices[i].reads[j], false);
	fprintf(out, ", periods take %.0f %%", 100 * load);
	if (rest_ns > 0 && load < 1)
		fprintf(out, ", the rest is read every %.1f ms", (double)rest_ns / (1 - load) / NS_PER_MS);
}

static void print_medium(const struct modbus_port *config, FILE *out)
{
	static const char parities[] = {
	    [MODBUS_PARITY_NONE] = 'N', [MODBUS_PARITY_ODD] = 'O', [MODBUS_PARITY_EVEN] = 'E'};
	static const char *const over_tcp[] = {[MODBUS_FRAMING_RTU] = "RTU over TCP, ",
					       [MODBUS_FRAMING_TCP] = "",
					       [MODBUS_FRAMING_ASCII] = "ASCII over TCP, "};

	if (modbus_is_tcp(config))
		fprintf(out, "port %u: %s port %u, %s", config->port, config->device, config->tcp_port,
			modbus_is_udp(config) ? "UDP, " : over_tcp[config->framing]);
	else
		fprintf(out, "port %u: %u bit/s %u%c%u, %s", config->port, (unsigned)config->baud,
			config->data_bits, parities[config->parity], config->stop_bits,
			config->framing == MODBUS_FRAMING_ASCII ? "ASCII, " : "");
}

static void print_summary(const struct modbus_port *config, const struct modbus_line *line, FILE *out)
{
	uint32_t requests = line_requests(line);

	print_medium(config, out);
	if (requests == 0)
		fputs("nothing to read", out);
	else
		fprintf(out, "%u request%s, shortest scan %.1f ms", requests, plural(requests),
			(double)line_ns(line) / NS_PER_MS);
	print_load(line, out);
	fputc('\n', out);
}

static void print_read(const struct modbus_line *line, const struct modbus_device *device,
		       const struct modbus_read *read, FILE *out)
{
	uint8_t frame[MODBUS_FRAME_MAX];
	const struct modbus_request request = {
	    .unit = device->unit, .function = read->function, .address = read->address, .count = read->count};
	size_t octets = modbus_request_frame(&request, frame) + modbus_answer_length(&request);

	/* Each of the two frames has MBAP's prefix, and no CRC. */
	if (line->wire.framing == MODBUS_FRAMING_TCP)
		octets += 2 * (MODBUS_MBAP_PREFIX - MODBUS_CRC_LENGTH);
	/* Each: a colon, two digits an octet and the LRC, CR and LF. */
	if (line->wire.framing == MODBUS_FRAMING_ASCII)
		octets = 2 * (octets - 2 * MODBUS_CRC_LENGTH) + 2 * (1 + 2 + 2);
	fprintf(out, "  %4u  %8u  %7u  %5u  %6zu  %7.2f", device->unit, read->function, read->address,
		read->count, octets, (double)modbus_limit_read_ns(line, device, read, false) / NS_PER_MS);
	if (read->page != 0)
		fprintf(out, "  behind a write of %u to register %u", device->pages->values[read->page - 1],
			device->pages->address);
	if (read->period_ns > 0)
		fprintf(out, "  every %.0f ms", (double)read->period_ns / NS_PER_MS);
	fputc('\n', out);
}

/* Of a device on a network nothing is assumed. */
static void print_reaction(const struct modbus_line *line, const struct modbus_limits *limits, FILE *out)
{
	if (limits->reaction_ns == 0 && line->wire.char_ns == 0)
		return;
	fprintf(out, ", reacts in %.1f ms%s", (double)modbus_reaction_ns(limits) / NS_PER_MS,
		limits->reaction_ns == 0 ? " (assumed)" : "");
}

static void print_device(const struct modbus_line *line, const struct modbus_device *device, const char *name,
			 FILE *out)
{
	double own_ns = (double)device_ns(line, device);

	if (device->read_count == 0)
		return;
	for (uint32_t i = 0; i < device->read_count; i++)
		print_read(line, device, &device->reads[i], out);
	fprintf(out, "  %4u  %s: %u request%s, %.1f ms, %.0f %%", device->unit, name, device->read_count,
		plural(device->read_count), own_ns / NS_PER_MS, 100 * own_ns / (double)line_ns(line));
	print_reaction(line, &device->limits, out);
	fputc('\n', out);
}

static void print_requests(const struct map_config *config, const struct modbus_port *from,
			   const struct modbus_line *line, FILE *out)
{
	if (line_requests(line) == 0)
		return;
	if (line->wire.char_ns == 0)
		fprintf(out, "  a request takes as long as its answer does, but at least %.0f ms\n",
			(double)line->wire.least_ns / NS_PER_MS);
	else
		fprintf(out, "  a character takes %.3f ms, a silence %.3f ms\n",
			(double)line->wire.char_ns / NS_PER_MS, (double)line->wire.silence_ns / NS_PER_MS);
	fputs("  UNIT  FUNCTION  ADDRESS  COUNT  OCTETS       MS\n", out);
	for (uint32_t i = 0; i < line->device_count; i++)
		print_device(line, &line->devices[i], config->sets[from->first_device + i].name, out);
}

static bool print_line(const struct map_config *config, uint32_t number, bool requests, FILE *out)
{
	const struct modbus_port *from = &modbus_ports(config)[number];
	struct modbus_line line = {.device_count = 0};
	bool made = modbus_line_configure(&line, config, number);

	if (made)
		print_summary(from, &line, out);
	if (made && requests)
		print_requests(config, from, &line, out);
	modbus_line_release(&line);
	return made;
}

bool modbus_limit_print(const struct map_config *config, bool requests, FILE *out)
{
	for (uint32_t i = 0; i < modbus_port_count(config); i++)
		if (!print_line(config, i, requests, out))
			return false;
	return true;
}
