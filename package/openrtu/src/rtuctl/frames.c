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

#include "map/time_ns.h"
#include "modbus/config.h"
#include "modbus/describe.h"
#include "modbus/stats.h"
#include "rows/words.h"
#include "rtuctl/listing.h"
#include "rtuctl/pcapng.h"
#include "rtuctl/renew.h"

#define GAP_NS       (50 * NS_PER_MS) /* between two pieces of one frame, at the most */
#define FRAME_OCTETS (2 * MODBUS_PIECE_MAX)
#define SHOWN_OCTETS 16U

static const struct timespec LOOK_PERIOD = {.tv_nsec = 50 * 1000 * 1000};

struct frame {
	uint32_t line;
	enum modbus_direction direction;
	int64_t time_ns; /* of its first piece */
	size_t length;
	uint8_t octets[FRAME_OCTETS];
};

/* One that is looked at. */
struct source {
	uint32_t line; /* of the configuration */
	struct modbus_frames_reader reader;
	struct frame begun; /* length 0: none */
	int64_t last_ns;    /* of its last piece */
};

struct monitor {
	struct map *map;
	const struct rtuctl_request *request;
	struct source *sources;
	uint32_t source_count;
	struct frame *frames; /* since the last look */
	size_t frame_count;
	int64_t told_ns; /* the last one */
	unsigned long told;
	struct pcapng pcapng;
};

/* ---- pieces become frames ---------------------------------------------------------------- */

static enum modbus_framing framing_of(const struct monitor *monitor, uint32_t line)
{
	return (enum modbus_framing)modbus_ports(map_config(monitor->map))[line].framing;
}

static void end_frame(struct monitor *monitor, struct source *source)
{
	if (source->begun.length == 0)
		return;
	monitor->frames = reallocarray(monitor->frames, monitor->frame_count + 1, sizeof(*monitor->frames));
	if (monitor->frames == NULL)
		errx(RTUCTL_FAILED, "out of memory");
	monitor->frames[monitor->frame_count++] = source->begun;
	source->begun.length = 0;
}

static bool goes_on(const struct source *source, const struct modbus_piece *piece)
{
	return source->begun.length > 0 && piece->direction == MODBUS_RECEIVED &&
	       piece->time_ns - source->last_ns < GAP_NS &&
	       source->begun.length + piece->length <= FRAME_OCTETS;
}

static bool is_whole(const struct monitor *monitor, const struct frame *frame)
{
	char words[MODBUS_WORDS_SIZE];

	return frame->direction == MODBUS_SENT ||
	       modbus_describe(framing_of(monitor, frame->line), frame->direction, frame->octets,
			       frame->length, words);
}

static void take_piece(struct monitor *monitor, struct source *source, const struct modbus_piece *piece)
{
	struct frame *begun = &source->begun;

	if (!goes_on(source, piece)) {
		end_frame(monitor, source);
		*begun = (struct frame){
		    .line = source->line, .direction = piece->direction, .time_ns = piece->time_ns};
	}
	memcpy(begun->octets + begun->length, piece->octets, piece->length);
	begun->length += piece->length;
	source->last_ns = piece->time_ns;
	if (is_whole(monitor, begun))
		end_frame(monitor, source);
}

static int by_time(const void *left, const void *right)
{
	const struct frame *a = left, *b = right;

	return (a->time_ns > b->time_ns) - (a->time_ns < b->time_ns);
}

/* What has begun may have its end: all of it when nobody waits for more. */
static void look(struct monitor *monitor, bool waits)
{
	for (uint32_t i = 0; i < monitor->source_count; i++) {
		struct source *source = &monitor->sources[i];
		struct modbus_piece piece;

		modbus_frames_look(modbus_line_frames(monitor->map, source->line), &source->reader);
		while (modbus_frames_next(&source->reader, &piece))
			if (piece.time_ns > monitor->told_ns || source->begun.length > 0)
				take_piece(monitor, source, &piece);
		if (!waits || map_now_ns() - source->last_ns > GAP_NS)
			end_frame(monitor, source);
		if (source->reader.has_lost)
			fprintf(stderr, "rtuctl: frames of port %u were overwritten before they were read\n",
				modbus_ports(map_config(monitor->map))[source->line].port);
		source->reader.has_lost = false;
	}
	if (monitor->frame_count > 0)
		qsort(monitor->frames, monitor->frame_count, sizeof(*monitor->frames), by_time);
}

/* ---- frames are told --------------------------------------------------------------------- */

static const char *direction_name(const struct frame *frame)
{
	return frame->direction == MODBUS_SENT ? "sent" : "received";
}

static void put_hex(const struct frame *frame, size_t most, const char *between, char *out)
{
	out[0] = '\0';
	for (size_t i = 0; i < frame->length && i < most; i++)
		out += sprintf(out, "%s%02x", i > 0 ? between : "", frame->octets[i]);
}

static void print_row(const struct monitor *monitor, const struct frame *frame, const char *time,
		      const char *words)
{
	char hex[2 * FRAME_OCTETS + 1];

	put_hex(frame, FRAME_OCTETS, "", hex);
	listing_print_json(json_pack("{s:s, s:i, s:s, s:s, s:s}", "time", time, "port",
				     (int)modbus_ports(map_config(monitor->map))[frame->line].port,
				     "direction", direction_name(frame), "octets", hex, "text", words));
}

static void print_line(const struct monitor *monitor, const struct frame *frame, const char *time,
		       const char *words)
{
	char hex[3 * SHOWN_OCTETS + 1];

	put_hex(frame, SHOWN_OCTETS, " ", hex);
	printf("%s  %u %c %-*s %c  %s\n", time, modbus_ports(map_config(monitor->map))[frame->line].port,
	       frame->direction == MODBUS_SENT ? '>' : '<', (int)(3 * SHOWN_OCTETS) - 1, hex,
	       frame->length > SHOWN_OCTETS ? '+' : ' ', words);
}

static uint32_t source_of(const struct monitor *monitor, const struct frame *frame)
{
	uint32_t source = 0;

	while (monitor->sources[source].line != frame->line)
		source++;
	return source;
}

static void tell_frame(struct monitor *monitor, const struct frame *frame)
{
	const int64_t wall_ns = map_wall_ns(map_clock_read(monitor->map), frame->time_ns);
	/* Wireshark's own. It has none for ASCII: that is text. */
	static const char *const dissectors[] = {[MODBUS_FRAMING_RTU] = "mbrtu",
						 [MODBUS_FRAMING_TCP] = "mbtcp",
						 [MODBUS_FRAMING_ASCII] = "data-text-lines"};
	char time[WORDS_SIZE], words[MODBUS_WORDS_SIZE];

	if (monitor->request->pcapng != NULL) {
		pcapng_frame(&monitor->pcapng, source_of(monitor, frame),
			     dissectors[framing_of(monitor, frame->line)], frame->direction == MODBUS_SENT,
			     frame->octets, frame->length, wall_ns);
		return;
	}
	words_time_us(wall_ns, time);
	modbus_describe(framing_of(monitor, frame->line), frame->direction, frame->octets, frame->length,
			words);
	if (monitor->request->json)
		print_row(monitor, frame, time, words);
	else
		print_line(monitor, frame, time, words);
}

/* From the frame first on. False: as many as were wanted. */
static bool tell(struct monitor *monitor, size_t first)
{
	const unsigned long most = monitor->request->follow ? monitor->request->count : 0;

	for (size_t i = first; i < monitor->frame_count; i++) {
		tell_frame(monitor, &monitor->frames[i]);
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
		if (renew_map(monitor->map))
			find_sources(monitor);
		look(monitor, true);
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

	look(monitor, false);
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
