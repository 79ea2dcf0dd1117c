/* SPDX-License-Identifier: GPL-3.0-or-later */
/*
 * rtu-journal: writes what no controlling station has acknowledged to a file that outlives a power cut. A process of its
 * own, since a flash may take long to synchronise: rtud's watchdog and the lines do not wait for it.
 */
#include <errno.h>
#include <poll.h>
#include <stdlib.h>
#include <string.h>
#include <unistd.h>

#include "journal/config.h"
#include "journal/file.h"
#include "journal/follow.h"
#include "journal/stats.h"
#include "journal/wear.h"
#include "map/map.h"
#include "map/time_ns.h"
#include "process/module.h"

#define TICK_MS 1000 /* a heartbeat each */

static struct map *map;
static const struct journal_settings *settings;
static struct journal_stats *stats;
static struct journal_follower follower;
static struct journal_file file = {.fd = -1};

/* ---- records ----------------------------------------------------------------------------- */

static void note_failure(void)
{
	map_count(&stats->failures, 1);
	if (!atomic_load(&stats->failing))
		map_log(map, MAP_LOG_ERROR, "cannot write in %s: %s; a power cut would lose events",
			settings->path, strerror(errno));
	atomic_store(&stats->failing, 1);
}

static void note_success(int64_t begun_ns)
{
	uint32_t took_ms = (uint32_t)((map_now_ns() - begun_ns) / NS_PER_MS);

	journal_written(&follower);
	if (atomic_load(&stats->failing))
		map_log(map, MAP_LOG_INFO, "writes again in %s", settings->path);
	if (follower.left_out != 0)
		map_log(map, MAP_LOG_WARNING, "the oldest %u events have no room: increase size_kb",
			follower.left_out);
	atomic_store(&stats->failing, 0);
	map_count(&stats->records, 1);
	map_count(&stats->kib, (uint32_t)((follower.record.used + 1023) / 1024));
	map_count(&stats->left_out, follower.left_out);
	atomic_store(&stats->written_s, (uint32_t)(map_now_ns() / NS_PER_S));
	if (took_ms > atomic_load(&stats->longest_ms))
		atomic_store(&stats->longest_ms, took_ms);
}

static int write_record(void)
{
	int result = journal_is_first(&follower) ? journal_file_begin(&file, &follower.record)
						 : journal_file_append(&file, &follower.record);

	if (file.fd < 0)
		journal_abandon(&follower);
	return result;
}

static void write_news(void)
{
	const off_t size = (off_t)settings->size_kb * 1024;
	int64_t begun_ns = map_now_ns();

	*map_kept_number(map) = (uint32_t)(begun_ns / NS_PER_S);
	if (!journal_make(&follower, false))
		return;
	if (!journal_is_first(&follower) && file.size + (off_t)follower.record.used > size)
		journal_make(&follower, true);
	if (write_record() < 0)
		note_failure();
	else
		note_success(begun_ns);
	atomic_store(&stats->events, journal_pending(&follower));
}

/* ---- start and loop ---------------------------------------------------------------------- */

static int pause_ms(int64_t next_ns)
{
	int64_t left_ms = (next_ns - map_now_ns()) / NS_PER_MS + 1;

	return left_ms < 0 ? 0 : left_ms < TICK_MS ? (int)left_ms : TICK_MS;
}

/* Places in rings stay what they are. */
static void follow_configuration(void)
{
	struct map_config before;
	char error[MAP_ERROR_SIZE];

	if (!map_is_changed(map))
		return;
	if (map_renew(map, &before, error) < 0)
		map_log(map, MAP_LOG_ERROR, "cannot take the changed configuration: %s", error);
	else
		settings = journal_settings(map_config(map));
	map_forget(map);
}

/* Until it is asked to stop: then what came last is written too. */
static void run(int stop)
{
	struct pollfd asked = {.fd = stop, .events = POLLIN};
	const int64_t interval_ns = settings->interval_s * NS_PER_S;
	/* At once, since what was restored may have been acknowledged; a process that dies often wears nothing out. */
	const bool at_once = *map_kept_number(map) == 0 || atomic_exchange(&stats->moved, 0) != 0;
	int64_t next_ns = at_once ? map_now_ns() : *map_kept_number(map) * NS_PER_S + interval_ns;

	while (map_may_run(map)) {
		map_heartbeat(map);
		follow_configuration();
		if (map_now_ns() >= next_ns) {
			next_ns = map_now_ns() + interval_ns;
			write_news();
		}
		if (poll(&asked, 1, pause_ms(next_ns)) > 0)
			break;
	}
	write_news();
}

/* Returns the descriptor that asks to stop; -1 with errno. */
static int start(void)
{
	uint8_t *memory;
	size_t size;

	settings = journal_settings(map_config(map));
	stats = journal_stats_of(map);
	if (settings == NULL || stats == NULL) {
		errno = ENOENT;
		return -1;
	}
	journal_name_counters(map);
	size = journal_record_max(settings);
	memory = calloc(1, size);
	if (memory == NULL)
		return -1;
	file.folder = settings->path;
	journal_follow(&follower, map, memory, size);
	return module_stop_fd();
}

int main(int argc, char **argv)
{
	struct options options;
	int stop;

	map = module_begin(argc, argv, &options);
	stop = start();
	if (stop < 0) {
		map_log(map, MAP_LOG_ERROR, "cannot start: %s", strerror(errno));
		return MODULE_FAILED;
	}
	if (!module_confine(map, &options, settings->size_kb * 1024))
		return MODULE_FAILED;
	run(stop);
	map_detach(map);
	return MODULE_ENDED;
}
