/* SPDX-License-Identifier: GPL-3.0-or-later */
/* How punctual the lines are, and the modules that scan, after LinuxCNC's latency-histogram. */
#include <stdio.h>
#include <sys/utsname.h>

#include "modbus/config.h"
#include "modbus/stats.h"
#include "rtuctl/listing.h"
#include "rtuctl/realtime.h"
#include "rtuctl/rtuctl.h"

#define COUNT(array) (sizeof(array) / sizeof((array)[0]))

static const struct listing_column columns[] = {
    {"below_us", "BELOW US", LISTING_RIGHT},
    {"wakeups", "WAKE-UPS", LISTING_RIGHT},
    {"transactions", "TRANSACTIONS", LISTING_RIGHT},
};

static const struct listing_column scan_columns[] = {
    {"below_us", "BELOW US", LISTING_RIGHT},
    {"wakeups", "WAKE-UPS", LISTING_RIGHT},
    {"scans", "SCANS", LISTING_RIGHT},
};

static bool is_realtime(void)
{
	struct utsname system;

	return uname(&system) == 0 && realtime_kernel("/sys/kernel/realtime", system.version);
}

/* Of a line: its process, and what the kernel has given that. */
static struct realtime_grant grant_of(const struct map *map, uint32_t index, struct map_module *module)
{
	map_module(map, modbus_ports(map_config(map))[index].module, module);
	if (!module->alive)
		return (struct realtime_grant){.running = false};
	return realtime_granted("/proc", module->pid);
}

static const char *verdict(const struct map *map, const struct realtime_grant *grant,
			   const struct modbus_line_stats *stats)
{
	return realtime_verdict(is_realtime(), grant, modbus_settings(map_config(map))->priority,
				stats->wakeups.longest_us);
}

static json_t *bound_of(uint32_t bucket)
{
	return bucket == MAP_BUCKETS - 1 ? json_string("more") : json_integer(1 << bucket);
}

/* Of two histograms, under the keys of the second and the third of these columns. */
static void print_buckets(const struct listing_column *titles, const struct map_histogram *a,
			  const struct map_histogram *b)
{
	struct listing listing;

	listing_begin(&listing, titles, COUNT(columns), false);
	for (uint32_t i = 0; i < MAP_BUCKETS; i++) {
		uint32_t in_a = a->counts[i], in_b = b->counts[i];

		if (in_a > 0 || in_b > 0)
			listing_add(&listing,
				    json_pack("{s:o, s:I, s:I}", "below_us", bound_of(i), titles[1].key,
					      (json_int_t)in_a, titles[2].key, (json_int_t)in_b));
	}
	listing_end(&listing);
}

static void print_line(const struct map *map, uint32_t index)
{
	const struct modbus_line_stats *stats = modbus_line_stats(map, index);
	struct map_module module;
	struct realtime_grant grant = grant_of(map, index, &module);
	char words[REALTIME_WORDS_SIZE];

	printf("%sport %u: longest wake-up %u us late, longest transaction %u us\n", index > 0 ? "\n" : "",
	       modbus_ports(map_config(map))[index].port, (unsigned)stats->wakeups.longest_us,
	       (unsigned)stats->transactions.longest_us);
	print_buckets(columns, &stats->wakeups, &stats->transactions);
	realtime_words(&grant, words);
	printf("%s: %s\n", module.name, words);
	printf("verdict: %s\n", verdict(map, &grant, stats));
}

static json_t *histogram_json(const struct map_histogram *histogram)
{
	json_t *counts = json_array();

	for (uint32_t i = 0; i < MAP_BUCKETS; i++)
		json_array_append_new(counts, json_integer(histogram->counts[i]));
	return json_pack("{s:I, s:o}", "longest_us", (json_int_t)histogram->longest_us, "counts", counts);
}

static json_t *process_json(const struct map_module *module, const struct realtime_grant *grant)
{
	return json_pack("{s:s, s:b, s:b, s:I, s:I}", "name", module->name, "running", grant->running, "fifo",
			 grant->fifo, "priority", (json_int_t)grant->priority, "locked_kib",
			 (json_int_t)grant->locked_kib);
}

static json_t *line_json(const struct map *map, uint32_t index)
{
	const struct modbus_line_stats *stats = modbus_line_stats(map, index);
	struct map_module module;
	struct realtime_grant grant = grant_of(map, index, &module);

	return json_pack(
	    "{s:i, s:o, s:o, s:o, s:b, s:b, s:s}", "port", modbus_ports(map_config(map))[index].port,
	    "wakeups", histogram_json(&stats->wakeups), "transactions", histogram_json(&stats->transactions),
	    "process", process_json(&module, &grant), "realtime_kernel", is_realtime(), "realtime",
	    realtime_is(is_realtime(), &grant), "verdict", verdict(map, &grant, stats));
}

int rtuctl_histogram(struct map *map, const struct rtuctl_request *request)
{
	struct listing listing;

	if (request->json)
		listing_begin(&listing, columns, COUNT(columns), true);
	for (uint32_t i = 0; i < modbus_port_count(map_config(map)); i++) {
		if (request->json)
			listing_add(&listing, line_json(map, i));
		else
			print_line(map, i);
	}
	if (request->json)
		listing_end(&listing);
	return RTUCTL_DONE;
}

/* ---- modules that scan ------------------------------------------------------------------- */

static void print_scans(const char *name, const struct map_scans *scans, bool first)
{
	printf("%s%s: longest wake-up %u us late, longest scan %u us; periods missed: %u of %u\n",
	       first ? "" : "\n", name, (unsigned)scans->wakeups.longest_us,
	       (unsigned)scans->durations.longest_us, (unsigned)scans->missed,
	       (unsigned)scans->missed + (unsigned)scans->count);
	print_buckets(scan_columns, &scans->wakeups, &scans->durations);
}

static json_t *scans_json(const char *name, const struct map_scans *scans)
{
	return json_pack("{s:s, s:o, s:o, s:I, s:I}", "name", name, "wakeups",
			 histogram_json(&scans->wakeups), "scans", histogram_json(&scans->durations), "count",
			 (json_int_t)scans->count, "missed", (json_int_t)scans->missed);
}

int rtuctl_scan_histogram(struct map *map, const struct rtuctl_request *request)
{
	struct listing listing;
	struct map_module module;
	bool first = true;

	if (request->json)
		listing_begin(&listing, scan_columns, COUNT(scan_columns), true);
	for (uint32_t i = 0; i < map_module_count(map); i++) {
		const struct map_scans *scans = map_scans_of(map, i);

		map_module(map, i, &module);
		if (scans == NULL || (module.flags & MAP_IS_GONE))
			continue;
		if (request->json)
			listing_add(&listing, scans_json(module.name, scans));
		else
			print_scans(module.name, scans, first);
		first = false;
	}
	if (request->json)
		listing_end(&listing);
	else if (first)
		puts("no module scans: neither a program of \"logic\" nor one of \"modules\"");
	return RTUCTL_DONE;
}
