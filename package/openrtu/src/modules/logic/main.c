/* SPDX-License-Identifier: GPL-3.0-or-later */
/*
 * rtu-logic: one program of Structured Text, scan by scan. It opens nothing: rtud has read and verified the program, which
 * lies in the map.
 */
#include <errno.h>
#include <poll.h>
#include <stdlib.h>
#include <string.h>

#include "logic/config.h"
#include "logic/value.h"
#include "map/time_ns.h"
#include "modules/logic/host.h"
#include "process/module.h"

#define BEAT_MS    100              /* a tenth of the limit of its heartbeat */
#define LOOK_NS    (50 * NS_PER_MS) /* between two looks at inputs that the first scan waits for */
#define SILENCE_NS (10 * NS_PER_S)  /* between two lines of the log about faults */

static struct host host;

/* What the net has been asked, and not answered yet. */
static enum { ASKED_NOTHING, ASKED_BEGIN, ASKED_END } asked;

/* The turn before was held up. */
static bool scans_again;

/* What the log has said of faults. */
static struct {
	uint32_t counted;
	int64_t said_ns;
} faults;

/* ---- a scan ------------------------------------------------------------------------------ */

static uint32_t count_faults(void)
{
	uint32_t sum = 0;

	for (unsigned i = 0; i < LOGIC_FAULTS; i++) {
		atomic_store(&host.stats->faults[i], host.logic.faults[i]);
		sum += host.logic.faults[i];
	}
	atomic_store(&host.stats->last_fault, host.logic.last_fault);
	atomic_store(&host.stats->last_line, host.logic.last_line);
	return sum;
}

static void report_faults(int64_t now_ns)
{
	uint32_t sum = count_faults();

	if (sum == faults.counted || (faults.said_ns != 0 && now_ns < faults.said_ns + SILENCE_NS))
		return;
	map_log(host.map, MAP_LOG_WARNING, "line %u: %s; faults since the last message: %u",
		host.logic.last_line, logic_fault_name(host.logic.last_fault), sum - faults.counted);
	faults.counted = sum;
	faults.said_ns = now_ns;
}

static struct logic_times times_of(int64_t now_ns, int64_t begun_ns, int64_t last_ns)
{
	return (struct logic_times){
	    .uptime_us = (now_ns - begun_ns) / NS_PER_US,
	    .elapsed_us = (now_ns - last_ns) / NS_PER_US,
	    .now_us = map_wall_ns(map_clock_read(host.map), now_ns) / NS_PER_US,
	};
}

/* While the turn is odd, whoever watches the variables waits. It stays odd where a process is killed in a scan. */
static void begin_turn(void)
{
	uint32_t turn = atomic_load_explicit(&host.stats->turn, memory_order_relaxed) | 1;

	atomic_store_explicit(&host.stats->turn, turn, memory_order_relaxed);
	atomic_thread_fence(memory_order_release);
}

static void end_turn(void)
{
	uint32_t turn = atomic_load_explicit(&host.stats->turn, memory_order_relaxed) + 1;

	atomic_store_explicit(&host.stats->turn, turn, memory_order_release);
}

static void scan(int64_t now_ns, const struct logic_times *times)
{
	begin_turn();
	points_freeze(&host);
	commands_before(&host, now_ns);
	requests_before(&host);
	logic_scan(&host.logic, times, host.instance->budget);
	requests_judge(&host);
	points_publish(&host, now_ns);
	requests_after(&host, now_ns);
	commands_after(&host, now_ns);
	kept_store(&host);
	end_turn();
	report_faults(now_ns);
	messages_say(&host, now_ns);
	map_histogram_add(&host.stats->scans.durations, map_now_ns() - now_ns);
	map_count(&host.stats->scans.count, 1);
}

/* For longer than a scan within its budget takes: this process was stopped meanwhile. */
static bool was_held_up(int64_t begun_ns, int64_t now_ns)
{
	return now_ns - begun_ns > map_heartbeat_limit_ms(host.map, map_self(host.map)) * NS_PER_MS;
}

/* Each period; a program that takes longer than half of it leaves as much to others. */
static int64_t next_scan(int64_t due_ns, int64_t begun_ns)
{
	const int64_t period_ns = host.instance->period_ms * NS_PER_MS;

	if (!host.instance->period_given && synched_waits(&host.synched))
		return begun_ns;
	int64_t now_ns = map_now_ns(), took_ns = was_held_up(begun_ns, now_ns) ? 0 : now_ns - begun_ns;
	int64_t earliest_ns = now_ns + took_ns;
	int64_t periods = 1;

	if (due_ns + period_ns < earliest_ns)
		periods = (earliest_ns - due_ns + period_ns - 1) / period_ns;
	map_count(&host.stats->scans.missed, (uint32_t)(periods - 1));
	return due_ns + periods * period_ns;
}

/* ---- the net ----------------------------------------------------------------------------- */

/* Nothing here waits: requests are served meanwhile. */
static bool may_scan(void)
{
	if (asked == ASKED_NOTHING && synched_waits(&host.synched)) {
		synched_ask_begin(&host.synched);
		asked = ASKED_BEGIN;
	}
	if (asked == ASKED_BEGIN && synched_answer(&host.synched) != SYNCH_OPEN) {
		asked = ASKED_NOTHING;
		return true;
	}
	return asked == ASKED_NOTHING;
}

static void end_scan(void)
{
	if (synched_ask_end(&host.synched))
		asked = ASKED_END;
}

static void hear_net(void)
{
	if (asked == ASKED_END && synched_answer(&host.synched) != SYNCH_OPEN)
		asked = ASKED_NOTHING;
}

/* One that the net lets begin has a period only if the file says so; periods that it waits for others are not late. */
static int64_t due_now(int64_t due_ns, int64_t now_ns)
{
	const int64_t period_ns = host.instance->period_ms * NS_PER_MS;

	if (!synched_waits(&host.synched) || now_ns < due_ns + period_ns)
		return due_ns;
	return due_ns + (now_ns - due_ns) / period_ns * period_ns;
}

/* ---- the first scan ---------------------------------------------------------------------- */

/* In a net, its author says who goes first. */
static bool has_begun(int64_t now_ns, int64_t *last_ns)
{
	if (host.stats->begun_ns != 0)
		return true;
	if (!synched_waits(&host.synched) && !inputs_are_known(&host, now_ns))
		return false;
	host.stats->begun_ns = *last_ns = now_ns;
	return true;
}

/* ---- the loop ---------------------------------------------------------------------------- */

/* Another scan comes before the heartbeat that makes old outputs good. Once: a host may be as busy again. */
static bool is_to_scan_again(int64_t begun_ns)
{
	scans_again = !scans_again && was_held_up(begun_ns, map_now_ns());
	return scans_again;
}

static int pause_ms(int64_t due_ns)
{
	int64_t left_ms = (due_ns - map_now_ns() + NS_PER_MS - 1) / NS_PER_MS;

	if (left_ms <= 0)
		return asked == ASKED_NOTHING ? 0 : BEAT_MS; /* an answer rings the bell */
	return left_ms < BEAT_MS ? (int)left_ms : BEAT_MS;
}

static void run(int stop)
{
	struct pollfd waited[] = {{.fd = stop, .events = POLLIN},
				  {.fd = map_bell_fd(host.map), .events = POLLIN}};
	int64_t due_ns = map_now_ns(), last_ns = due_ns;

	if (host.stats->begun_ns == 0)
		inputs_begin(&host);
	while (map_may_run(host.map)) {
		int64_t now_ns;

		map_bell_clear(host.map);
		now_ns = map_now_ns();
		hear_net();
		requests_take(&host, now_ns);
		if (!has_begun(now_ns, &last_ns)) {
			due_ns = now_ns + LOOK_NS;
		} else if (now_ns >= due_ns && may_scan()) {
			struct logic_times times = times_of(now_ns, host.stats->begun_ns, last_ns);

			if (!synched_waits(&host.synched)) /* or it waited for others */
				map_histogram_add(&host.stats->scans.wakeups, now_ns - due_ns);
			scan(now_ns, &times);
			last_ns = now_ns;
			due_ns = next_scan(due_now(due_ns, now_ns), now_ns);
			end_scan();
		}
		if (is_to_scan_again(now_ns)) {
			due_ns = map_now_ns();
			continue;
		}
		map_heartbeat(
		    host.map); /* behind the scan: what it was silent for has not made old outputs good */
		if (poll(waited, 2, pause_ms(due_ns)) > 0 && waited[0].revents != 0)
			break;
	}
}

/* ---- start ------------------------------------------------------------------------------- */

static bool load_program(const struct map_config *config)
{
	const uint8_t *program = logic_programs(config) + host.instance->program;
	const char *refusal =
	    logic_load(&host.logic, logic_memory_of(host.stats, host.instance), program, host.instance->size);

	if (refusal != NULL)
		map_log(host.map, MAP_LOG_ERROR, "cannot load the program: %s", refusal);
	return refusal == NULL;
}

static void link_points(const struct map_config *config)
{
	const struct logic_link *links = logic_links(config) + host.instance->first_link;

	for (uint16_t i = 0; i < host.logic.head->points; i++) {
		struct host_point *point = &host.points[i];
		union map_value initial = {0};

		point->point = links[i].point;
		point->type = config->points[links[i].point].type;
		point->own = config->points[links[i].point].set == host.instance->set;
		point->sample.quality = MAP_INVALID;
		point->sample.time_ns = map_now_ns();
		if (!links[i].has_initial)
			continue;
		logic_map_value(point->type, host.logic.points[i].type, (double)links[i].initial, &initial);
		point->sample.value = initial;
		point->sample.quality = MAP_GOOD;
	}
}

/*
 * Own points that outlive a process and, with a journal, a power cut: what the program writes begins with the value that it
 * had. What masters have set is in force, so that it is as topical as it was.
 */
static void restore_points(const struct map_config *config)
{
	for (uint16_t i = 0; i < host.logic.head->points; i++) {
		const struct logic_point *variable = &host.logic.points[i];
		struct host_point *point = &host.points[i];
		struct map_sample sample;
		struct logic_value value;

		if (!point->own || !(config->points[point->point].flags & MAP_POINT_RETAIN))
			continue;
		sample = map_own_sample(host.map, point->point);
		if (sample.time_ns == 0 || point->kept)
			continue;
		if (!variable->written)
			sample.quality &= (uint8_t)~MAP_NOT_TOPICAL;
		point->sample = sample;
		logic_take_sample(point->type, variable->type, &sample, &value);
		value.time_us = 0;
		logic_set(&host.logic, variable, &value);
	}
}

static void link_blocks(void)
{
	const struct logic *logic = &host.logic;

	for (uint16_t i = 0; i < logic->head->commands; i++) {
		host.commands[i].point = points_named(&host, logic->commands[i].name);
		host.commands[i].type = logic->points[host.commands[i].point - host.points].type;
		host.commands[i].asked = &logic_asked_of(host.stats, host.instance)[i];
	}
	for (uint16_t i = 0; i < logic->head->requests; i++)
		host.requests[i].point = points_named(&host, logic->requests[i].name);
}

static void name_counters(void)
{
	static const char *const names[LOGIC_FAULTS] = {
	    [LOGIC_DIVISION] = "faults_division", [LOGIC_RANGE] = "faults_range",
	    [LOGIC_BOUNDS] = "faults_bounds",     [LOGIC_DOMAIN] = "faults_domain",
	    [LOGIC_BUDGET] = "faults_budget",
	};

	map_name_counter(host.map, &host.stats->scans.count, "scans");
	map_name_counter(host.map, &host.stats->scans.missed, "late_periods");
	for (unsigned i = 0; i < LOGIC_FAULTS; i++)
		map_name_counter(host.map, &host.stats->faults[i], "%s", names[i]);
}

static bool allocate(void)
{
	const struct logic_head *head = host.logic.head;

	host.points = calloc(head->points + 1U, sizeof(*host.points));
	host.commands = calloc(head->commands + 1U, sizeof(*host.commands));
	host.commanding = calloc(head->commands + 1U, sizeof(*host.commanding));
	host.requests = calloc(head->requests + 1U, sizeof(*host.requests));
	host.updates = calloc(head->points + 1U, sizeof(*host.updates));
	return host.points && host.commands && host.commanding && host.requests && host.updates;
}

static bool start(void)
{
	const struct map_config *config = map_config(host.map);

	begin_turn();
	if (!load_program(config) || !allocate())
		return false;
	link_points(config);
	link_blocks();
	kept_restore(&host);
	restore_points(config);
	commands_restore(&host);
	end_turn();
	name_counters();
	synched_begin(&host.synched, host.map, host.instance->name);
	return true;
}

int main(int argc, char **argv)
{
	struct options options;
	int stop;

	host.map = module_begin(argc, argv, &options);
	host.instance = logic_instance_of(host.map, map_self(host.map));
	if (host.instance != NULL)
		host.stats = logic_stats_of(host.map, host.instance);
	if (host.stats == NULL)
		return module_is_of_another_build(host.map);
	if (!start())
		return MODULE_FAILED;
	stop = module_stop_fd();
	if (stop < 0 || !module_confine(host.map, &options, 0))
		return MODULE_FAILED;
	map_log(host.map, MAP_LOG_INFO, "runs %s each %u ms", logic_name(&host.logic, host.logic.head->name),
		host.instance->period_ms);
	run(stop);
	map_detach(host.map);
	return MODULE_ENDED;
}
