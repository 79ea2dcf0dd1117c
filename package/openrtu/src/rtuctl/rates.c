/* SPDX-License-Identifier: GPL-3.0-or-later */
#include "rtuctl/rates.h"

#include <err.h>
#include <inttypes.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <unistd.h>

#include "map/time_ns.h"
#include "modbus/config.h"
#include "modbus/stats.h"
#include "rtuctl/rtuctl.h"

#define STAT_SIZE 512

/* ---- processes --------------------------------------------------------------------------- */

/* Ticks of the processor that a process has had, proc_pid_stat(5): 14 and 15. False: it is not there. */
static bool read_ticks(int32_t pid, uint64_t *ticks)
{
	char path[64], line[STAT_SIZE], *name_end;
	uint64_t user, kernel;
	FILE *file;

	snprintf(path, sizeof(path), "/proc/%d/stat", pid);
	file = fopen(path, "re");
	if (file == NULL)
		return false;
	line[fread(line, 1, sizeof(line) - 1, file)] = '\0';
	fclose(file);
	name_end = strrchr(line, ')');
	if (name_end == NULL ||
	    sscanf(name_end + 1, " %*c %*d %*d %*d %*d %*d %*u %*u %*u %*u %*u %" SCNu64 " %" SCNu64, &user,
		   &kernel) != 2)
		return false;
	*ticks = user + kernel;
	return true;
}

static void look_at_module(struct rates *rates, uint32_t index, double seconds)
{
	__typeof__(&rates->modules[0]) known = &rates->modules[index];
	struct map_module module;
	uint64_t ticks = 0;
	bool there;

	map_module(rates->map, index, &module);
	there = module.pid != 0 && read_ticks(module.pid, &ticks);
	known->cpu_percent = -1;
	if (there && known->pid == module.pid && seconds > 0)
		known->cpu_percent =
		    100.0 * (double)(ticks - known->ticks) / (double)sysconf(_SC_CLK_TCK) / seconds;
	known->pid = there ? module.pid : 0;
	known->ticks = ticks;
}

/* ---- lines and events -------------------------------------------------------------------- */

static uint32_t errors_of(const struct modbus_line_stats *stats)
{
	return stats->exceptions + stats->timeouts + stats->crc_errors + stats->wrong_units +
	       stats->wrong_functions + stats->wrong_lengths + stats->wrong_answers + stats->port_errors;
}

/* Of counters that wrap; a line's process that was started anew counts from 0. */
static double rate(uint32_t now, uint32_t before, double seconds)
{
	return seconds > 0 && now >= before ? (now - before) / seconds : 0;
}

static void look_at_line(struct rates *rates, uint32_t index, double seconds)
{
	const struct modbus_line_stats *stats = modbus_line_stats(rates->map, index);
	struct rates_line *line = &rates->lines[index];
	uint32_t requests = stats->requests, errors = errors_of(stats);

	line->requests_s = rate(requests, line->requests, seconds);
	line->errors_s = rate(errors, line->errors, seconds);
	line->requests = requests;
	line->errors = errors;
}

static void look_at_events(struct rates *rates, double seconds)
{
	struct map_event event;
	unsigned long count = 0;

	while (map_event_next(rates->map, &rates->cursor, &event))
		count++;
	count += rates->cursor.lost;
	rates->cursor.lost = 0;
	rates->events_s = seconds > 0 ? (double)count / seconds : 0;
}

/* ---- all --------------------------------------------------------------------------------- */

void rates_look(struct rates *rates)
{
	int64_t now_ns = map_now_ns();
	double seconds = rates->at_ns != 0 ? (double)(now_ns - rates->at_ns) / NS_PER_S : 0;

	for (uint32_t i = 0; i < map_module_count(rates->map); i++)
		look_at_module(rates, i, seconds);
	for (uint32_t i = 0; i < modbus_port_count(map_config(rates->map)); i++)
		look_at_line(rates, i, seconds);
	look_at_events(rates, seconds);
	rates->at_ns = now_ns;
}

void rates_begin(struct rates *rates, const struct map *map)
{
	*rates = (struct rates){.map = map};
	rates->lines = calloc(modbus_port_count(map_config(map)) + 1u, sizeof(*rates->lines));
	if (rates->lines == NULL)
		errx(RTUCTL_FAILED, "out of memory");
	map_cursor_to_end(map, &rates->cursor);
	rates_look(rates);
}

void rates_end(struct rates *rates)
{
	free(rates->lines);
}
