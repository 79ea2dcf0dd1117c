/* SPDX-License-Identifier: GPL-3.0-or-later */
/* What went over the lines last, and what goes now: as lines of text, as JSON, or for Wireshark. */
#include "rtuctl/rtuctl.h"

#include <err.h>
#include <errno.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <time.h>

#include <jansson.h>

#include "modbus/config.h"
#include "rows/frames.h"
#include "rows/words.h"
#include "rtuctl/listing.h"
#include "rtuctl/pcapng.h"
#include "rtuctl/renew.h"

#define SHOWN_OCTETS 16U

static const struct timespec LOOK_PERIOD = {.tv_nsec = 50 * 1000 * 1000};

struct monitor {
	struct map *map;
	const struct rtuctl_request *request;
	struct frame_source *sources;
	uint32_t source_count;
	struct frame *frames; /* since the last look */
	size_t frame_count;
	int64_t told_ns;  /* the last one */
	int64_t after_ns; /* what is of this time, or before, was told before a reload */
	unsigned long told;
	struct pcapng pcapng;
};

/* ---- frames are taken -------------------------------------------------------------------- */

static enum modbus_framing framing_of(const struct monitor *monitor, uint32_t line)
{
	return (enum modbus_framing)modbus_ports(map_config(monitor->map))[line].framing;
}

static void keep_frame(void *context, const struct frame *frame)
{
	struct monitor *monitor = context;

	if (frame->time_ns <= monitor->after_ns)
		return;
	monitor->frames = reallocarray(monitor->frames, monitor->frame_count + 1, sizeof(*monitor->frames));
	if (monitor->frames == NULL)
		errx(RTUCTL_FAILED, "out of memory");
	monitor->frames[monitor->frame_count++] = *frame;
}

static int by_time(const void *left, const void *right)
{
	const struct frame *a = left, *b = right;

	return (a->time_ns > b->time_ns) - (a->time_ns < b->time_ns);
}

/* Of all lines, in order of time. */
static void look(struct monitor *monitor)
{
	for (uint32_t i = 0; i < monitor->source_count; i++) {
		struct frame_source *source = &monitor->sources[i];

		frames_take(monitor->map, source, keep_frame, monitor);
		if (source->reader.has_lost)
			fprintf(stderr, "rtuctl: frames of port %u were overwritten before they were read\n",
				modbus_ports(map_config(monitor->map))[source->line].port);
		source->reader.has_lost = false;
	}
	if (monitor->frame_count > 0)
		qsort(monitor->frames, monitor->frame_count, sizeof(*monitor->frames), by_time);
}

/* ---- frames are told --------------------------------------------------------------------- */

static void print_line(const struct frame *frame, const json_t *row)
{
	const char *octets = json_string_value(json_object_get(row, "octets"));
	char hex[3 * SHOWN_OCTETS + 1] = "";

	for (size_t i = 0; i < frame->length && i < SHOWN_OCTETS; i++)
		snprintf(hex + 3 * i, 4, "%.2s ", octets + 2 * i);
	printf("%s  %lld %c %-*s%c  %s\n", json_string_value(json_object_get(row, "time")),
	       json_integer_value(json_object_get(row, "port")), frame->direction == MODBUS_SENT ? '>' : '<',
	       (int)(3 * SHOWN_OCTETS), hex, frame->length > SHOWN_OCTETS ? '+' : ' ',
	       json_string_value(json_object_get(row, "text")));
}

static uint32_t source_of(const struct monitor *monitor, const struct frame *frame)
{
	uint32_t source = 0;

	while (monitor->sources[source].line != frame->line)
		source++;
	return source;
}

static void save_frame(struct monitor *monitor, const struct frame *frame)
{
	/* Wireshark's own. It has none for ASCII: that is text. */
	static const char *const dissectors[] = {[MODBUS_FRAMING_RTU] = "mbrtu",
						 [MODBUS_FRAMING_TCP] = "mbtcp",
						 [MODBUS_FRAMING_ASCII] = "data-text-lines"};

	pcapng_frame(&monitor->pcapng, source_of(monitor, frame),
		     dissectors[framing_of(monitor, frame->line)], frame->direction == MODBUS_SENT,
		     frame->octets, frame->length, map_wall_ns(map_clock_read(monitor->map), frame->time_ns));
}

static void print_frame(const struct monitor *monitor, const struct frame *frame)
{
	json_t *row = rows_frame(monitor->map, frame);

	if (row == NULL)
		errx(RTUCTL_FAILED, "out of memory");
	if (monitor->request->json) {
		listing_print_json(row);
		return;
	}
	print_line(frame, row);
	json_decref(row);
}

/* From the frame first on. False: as many as were wanted. */
static bool tell(struct monitor *monitor, size_t first)
{
	const unsigned long most = monitor->request->follow ? monitor->request->count : 0;

	for (size_t i = first; i < monitor->frame_count; i++) {
		if (monitor->request->pcapng != NULL)
			save_frame(monitor, &monitor->frames[i]);
		else
			print_frame(monitor, &monitor->frames[i]);
		monitor->told_ns = monitor->frames[i].time_ns;
		if (++monitor->told == most)
			return false;
	}
	monitor->frame_count = 0;
	fflush(stdout);
	return monitor->request->pcapng == NULL || pcapng_flush(&monitor->pcapng);
}

/* ---- the command ------------------------------------------------------------------------- */

static bool is_wanted(const struct monitor *monitor, uint32_t line)
{
	const char *wanted = monitor->request->arguments[0];
	char number[WORDS_SIZE];

	snprintf(number, sizeof(number), "%u", modbus_ports(map_config(monitor->map))[line].port);
	return wanted == NULL || strcmp(wanted, number) == 0;
}

/* After a reload, too: what was told before is not told again. */
static void find_sources(struct monitor *monitor)
{
	const uint32_t lines = modbus_port_count(map_config(monitor->map));

	free(monitor->sources);
	monitor->source_count = 0;
	monitor->sources = calloc(lines + 1u, sizeof(*monitor->sources));
	if (monitor->sources == NULL)
		errx(RTUCTL_FAILED, "out of memory");
	for (uint32_t line = 0; line < lines; line++)
		if (is_wanted(monitor, line))
			monitor->sources[monitor->source_count++].line = line;
}

static int begin_file(struct monitor *monitor)
{
	const struct modbus_port *ports = modbus_ports(map_config(monitor->map));
	char name[WORDS_SIZE];

	if (!pcapng_begin(&monitor->pcapng, monitor->request->pcapng)) {
		fprintf(stderr, "rtuctl: %s: %s\n", monitor->request->pcapng, strerror(errno));
		return RTUCTL_USAGE;
	}
	for (uint32_t i = 0; i < monitor->source_count; i++) {
		snprintf(name, sizeof(name), "port %u", ports[monitor->sources[i].line].port);
		pcapng_interface(&monitor->pcapng, name);
	}
	return RTUCTL_DONE;
}

static int follow(struct monitor *monitor)
{
	while (map_alive(monitor->map, MAP_RTUD)) {
		if (renew_map(monitor->map)) {
			monitor->after_ns = monitor->told_ns;
			find_sources(monitor);
		}
		look(monitor);
		if (!tell(monitor, 0))
			return RTUCTL_DONE;
		nanosleep(&LOOK_PERIOD, NULL);
	}
	fputs("rtuctl: rtud has ended\n", stderr);
	return RTUCTL_FAILED;
}

static int tell_kept(struct monitor *monitor)
{
	const unsigned long count = monitor->request->count;

	look(monitor);
	tell(monitor, count != 0 && monitor->frame_count > count ? monitor->frame_count - count : 0);
	return RTUCTL_DONE;
}

int rtuctl_frames(struct map *map, const struct rtuctl_request *request)
{
	struct monitor monitor = {.map = map, .request = request};
	int result;

	find_sources(&monitor);
	if (monitor.source_count == 0) {
		fprintf(stderr, "rtuctl: no line has port %s: \"rtuctl lines\" lists them\n",
			request->arguments[0] != NULL ? request->arguments[0] : "at all");
		free(monitor.sources);
		return RTUCTL_FAILED;
	}
	result = request->pcapng != NULL ? begin_file(&monitor) : RTUCTL_DONE;
	if (result == RTUCTL_DONE)
		result = request->follow ? follow(&monitor) : tell_kept(&monitor);
	if (monitor.pcapng.file != NULL && !pcapng_end(&monitor.pcapng)) {
		fprintf(stderr, "rtuctl: %s: %s\n", request->pcapng, strerror(errno));
		result = RTUCTL_FAILED;
	}
	free(monitor.frames);
	free(monitor.sources);
	return result;
}
