/* SPDX-License-Identifier: GPL-3.0-or-later */
#include "modules/gps/source.h"

#include <errno.h>
#include <poll.h>
#include <stdio.h>
#include <string.h>
#include <unistd.h>

#include "channel/serial.h"
#include "channel/tcp.h"
#include "map/time_ns.h"

#define CONNECT_NS    (3 * NS_PER_S)
#define READ_SIZE     512
#define READS_A_CYCLE 16
#define STOP_BITS     1 /* NMEA 0183: 8 data bits, no parity */

_Static_assert(TCP_ERROR_SIZE == SERIAL_ERROR_SIZE, "both are a source's");

static bool is_gpsd(const struct source *source)
{
	return source->settings->device[0] == '\0';
}

void source_init(struct source *source, struct map *map, const struct gps_settings *settings,
		 struct gps_stats *stats, const char *directory, int32_t built_days)
{
	*source = (struct source){.map = map,
				  .settings = settings,
				  .stats = stats,
				  .fd = -1,
				  .attempts = attempts_begin(ATTEMPTS_FIRST_NS, ATTEMPTS_MOST_NS)};
	if (settings->device[0] == '/')
		snprintf(source->path, sizeof(source->path), "%s", settings->device);
	else if (!is_gpsd(source))
		snprintf(source->path, sizeof(source->path), "%s/%s", directory, settings->device);
	else
		snprintf(source->path, sizeof(source->path), "gpsd at %s port %u", settings->gpsd,
			 settings->gpsd_port);
	gps_receiver_init(&source->nmea, settings->silence_ns, built_days);
	gpsd_reader_init(&source->gpsd, settings->gpsd_device, built_days);
	atomic_store(&stats->open, 0); /* a process before may have been killed */
}

void source_close(struct source *source)
{
	if (source->fd < 0)
		return;
	if (is_gpsd(source))
		close(source->fd);
	else
		serial_close(source->fd);
	source->fd = -1;
	source->connecting = false;
	atomic_store(&source->stats->open, 0);
}

/* hint: what to do about it, or nothing. */
static void lose_with_hint(struct source *source, const char *error, const char *hint, int64_t now_ns)
{
	const bool said = attempts_failed(&source->attempts, error, now_ns);
	char text[ATTEMPTS_TEXT_SIZE];

	source_close(source);
	source->due_ns = now_ns + source->attempts.pause_ns;
	map_count(&source->stats->failures, 1);
	if (!said)
		return;
	map_log(source->map, MAP_LOG_ERROR, "%s: %s %s%s", source->settings->name, source->path, error,
		attempts_failure(&source->attempts, now_ns, text));
	if (source->attempts.trouble.failures == 1 && hint[0] != '\0')
		map_log(source->map, MAP_LOG_ERROR, "%s: %s", source->settings->name, hint);
}

static void lose(struct source *source, const char *error, int64_t now_ns)
{
	lose_with_hint(source, error, "", now_ns);
}

static void say_open(const struct source *source, const char *again)
{
	map_log(source->map, MAP_LOG_INFO, "%s: %s is open%s", source->settings->name, source->path, again);
}

static void note_open(struct source *source, int64_t now_ns)
{
	source->connecting = false;
	source->told = false;
	retry_opened(&source->attempts.retry, now_ns);
	atomic_store(&source->stats->open, 1);
	if (!source->attempts.trouble.is)
		say_open(source, "");
}

/* It told a position, or has lasted. */
static void note_use(struct source *source, int64_t now_ns)
{
	char text[MAP_TROUBLE_SIZE];

	if (source->fd < 0 || source->connecting ||
	    (!source->told && !retry_has_lasted(&source->attempts.retry, now_ns)))
		return;
	retry_was_useful(&source->attempts.retry);
	if (map_trouble_well(&source->attempts.trouble, now_ns))
		say_open(source, map_trouble_ended(&source->attempts.trouble, now_ns, text));
}

/* ---- opening ----------------------------------------------------------------------------- */

static void open_serial(struct source *source, int64_t now_ns)
{
	const struct serial_settings line = {.baud = source->settings->baud, .stop_bits = STOP_BITS};
	char error[SERIAL_ERROR_SIZE], hint[SERIAL_HINT_SIZE];
	bool carries_parity;

	source->fd = serial_open(source->path, &line, &carries_parity, error, hint);
	if (source->fd >= 0)
		note_open(source, now_ns);
	else
		lose_with_hint(source, error, hint, now_ns);
}

static void begin_connection(struct source *source, int64_t now_ns)
{
	char error[TCP_ERROR_SIZE];

	source->fd = tcp_connect(source->settings->gpsd, source->settings->gpsd_port, error);
	if (source->fd < 0) {
		lose(source, error, now_ns);
		return;
	}
	source->connecting = true;
	source->due_ns = now_ns + CONNECT_NS;
}

/* gpsd says nothing before it was told to. */
static void ask_gpsd(struct source *source, int64_t now_ns)
{
	const ssize_t size = (ssize_t)strlen(GPSD_WATCH);

	gpsd_reader_init(&source->gpsd, source->settings->gpsd_device, source->gpsd.calendar.built_days);
	if (write(source->fd, GPSD_WATCH, (size_t)size) == size)
		note_open(source, now_ns);
	else
		lose(source, "does not accept a request", now_ns);
}

static void end_connecting(struct source *source, int64_t now_ns)
{
	char error[TCP_ERROR_SIZE];

	switch (tcp_look(source->fd, error)) {
	case TCP_PENDING:
		if (now_ns >= source->due_ns)
			lose(source, "does not answer", now_ns);
		break;
	case TCP_FAILED:
		lose(source, error, now_ns);
		break;
	case TCP_CONNECTED:
		ask_gpsd(source, now_ns);
		break;
	}
}

/* ---- reading ----------------------------------------------------------------------------- */

static bool next_fix(struct source *source, const uint8_t **bytes, size_t *size, int64_t now_ns,
		     struct gps_fix *fix)
{
	return is_gpsd(source) ? gpsd_reader_take(&source->gpsd, bytes, size, now_ns, fix)
			       : gps_receiver_take(&source->nmea, bytes, size, now_ns, fix);
}

static void show_counters(struct source *source)
{
	const uint32_t *counters = is_gpsd(source) ? source->gpsd.counters : source->nmea.line.counters;
	const struct gps_calendar *calendar =
	    is_gpsd(source) ? &source->gpsd.calendar : &source->nmea.burst.calendar;
	struct gps_stats *stats = source->stats;

	atomic_store(&stats->sentences, counters[NMEA_TAKEN]);
	atomic_store(&stats->damaged, counters[NMEA_DAMAGED]);
	atomic_store(&stats->unknown, counters[NMEA_UNKNOWN]);
	atomic_store(&stats->stray, counters[NMEA_STRAY]);
	atomic_store(&stats->era_corrected, calendar->corrected);
	atomic_store(&stats->dates_refused, calendar->refused);
}

/* Once: a place that is not the expected receiver's is not seen to be another's. */
static void say_several(struct source *source)
{
	const struct gpsd_reader *gpsd = &source->gpsd;

	if (source->several || gpsd->other[0] == '\0' || gpsd->wanted[0] != '\0')
		return;
	source->several = true;
	map_log(source->map, MAP_LOG_WARNING,
		"%s: %s has several receivers: %s counts, %s does not; \"gpsd_device\" says which",
		source->settings->name, source->path, gpsd->device, gpsd->other);
}

static void read_source(struct source *source, int64_t now_ns, source_fix *take, void *context)
{
	for (int reads = 0; reads < READS_A_CYCLE && source->fd >= 0; reads++) {
		uint8_t octets[READ_SIZE];
		const uint8_t *bytes = octets;
		ssize_t length = read(source->fd, octets, sizeof(octets));
		size_t size = length > 0 ? (size_t)length : 0;
		struct gps_fix fix;

		map_count(&source->stats->octets, (uint32_t)size);
		while (next_fix(source, &bytes, &size, now_ns, &fix)) {
			source->told = true;
			take(context, &fix);
		}
		say_several(source);
		note_use(source, now_ns);
		if (length == 0 || (length < 0 && errno != EAGAIN && errno != EINTR))
			lose(source, length == 0 ? "hung up" : strerror(errno), now_ns);
		if (length < (ssize_t)sizeof(octets))
			return;
	}
}

void source_run(struct source *source, int64_t now_ns, source_fix *take, void *context)
{
	struct gps_fix fix;

	if (source->fd >= 0 && source->connecting)
		end_connecting(source, now_ns);
	else if (source->fd < 0 && now_ns >= source->due_ns)
		(is_gpsd(source) ? begin_connection : open_serial)(source, now_ns);
	if (source->fd >= 0 && !source->connecting)
		read_source(source, now_ns, take, context);
	if (!is_gpsd(source) && gps_receiver_run(&source->nmea, now_ns, &fix)) {
		source->told = source->fd >= 0;
		take(context, &fix);
	}
	note_use(source, now_ns);
	show_counters(source);
}

short source_events(const struct source *source)
{
	if (source->fd < 0)
		return 0;
	return source->connecting ? POLLOUT : POLLIN;
}

int64_t source_deadline(const struct source *source)
{
	const int64_t silent_ns = is_gpsd(source) ? INT64_MAX : gps_receiver_deadline(&source->nmea);
	const bool due = source->fd < 0 || source->connecting;

	return due && source->due_ns < silent_ns ? source->due_ns : silent_ns;
}
