/* SPDX-License-Identifier: GPL-3.0-or-later */
/* rtu-synch: the one that owns the marking of the net. Modules ask it by a word each, and it answers in its section. */
#include <errno.h>
#include <poll.h>
#include <string.h>

#include "map/map.h"
#include "process/module.h"
#include "synch/config.h"
#include "synch/stats.h"

#define TICK_MS     50 /* how soon it sees that a module is dead */
#define STAND_IN_MS 10 /* the same while a scan of a dead one may be due */

static struct map *map;
static struct synch_stats *stats;
static struct synch_coordinator coordinator;

static void show(_Atomic uint32_t *shown, const uint32_t *values, uint32_t count)
{
	for (uint32_t i = 0; i < count; i++)
		atomic_store_explicit(&shown[i], values[i], memory_order_relaxed);
}

static void show_all(void)
{
	const struct synch_counts *counts = &coordinator.counts;
	const uint32_t participants = coordinator.net.participant_count;

	show(stats->firings, counts->firings, coordinator.net.transition_count);
	show(stats->lost, counts->lost, coordinator.net.place_count);
	show(stats->left_out, counts->left_out, participants);
	show(stats->deaths, counts->deaths, participants);
	show(stats->stood_in, counts->stood_in, participants);
	show(&stats->refused, &counts->refused, 1);
	for (uint32_t i = 0; i < participants; i++) {
		const uint32_t word = coordinator.open[i];
		const uint8_t transition = synch_wish_of(word) == SYNCH_END
					       ? coordinator.net.participants[i].end
					       : synch_transition_of(word);

		atomic_store_explicit(&stats->since_ms[i], (uint32_t)(coordinator.since_ns[i] / NS_PER_MS),
				      memory_order_relaxed);
		atomic_store_explicit(&stats->waits_for[i], word == 0 ? 0 : transition + 1u,
				      memory_order_relaxed);
	}
}

static void take(uint32_t *values, const _Atomic uint32_t *shown, uint32_t count)
{
	for (uint32_t i = 0; i < count; i++)
		values[i] = atomic_load_explicit(&shown[i], memory_order_relaxed);
}

/* What a process before has counted: counters count since the gateway started. */
static void take_counts(void)
{
	struct synch_counts *counts = &coordinator.counts;

	take(counts->firings, stats->firings, SYNCH_TRANSITIONS_MAX);
	take(counts->lost, stats->lost, SYNCH_PLACES_MAX);
	take(counts->left_out, stats->left_out, SYNCH_PARTICIPANTS_MAX);
	take(counts->deaths, stats->deaths, SYNCH_PARTICIPANTS_MAX);
	take(counts->stood_in, stats->stood_in, SYNCH_PARTICIPANTS_MAX);
	take(&counts->refused, &stats->refused, 1);
}

static void look(struct synch_seen *seen)
{
	for (uint32_t i = 0; i < coordinator.net.participant_count; i++) {
		const uint32_t module = coordinator.net.participants[i].module;

		seen[i].alive = map_alive(map, module);
		seen[i].word = map_synch_said(map, module, i);
	}
}

static void ring(void)
{
	for (uint32_t i = 0; i < coordinator.net.participant_count; i++)
		if (coordinator.rung & 1u << i)
			map_synch_ring(map, coordinator.net.participants[i].module);
}

/* Each death is a restart, or a hang of some periods: they are seldom enough to be said. */
static void say_deaths(const uint32_t *before)
{
	static const char *const becomes[] = {[SYNCH_RETURN] = "its tokens are back",
					      [SYNCH_HOLD] = "its next process has its tokens",
					      [SYNCH_FIRE] = "its scan is ended in its stead"};

	for (uint32_t i = 0; i < coordinator.net.participant_count; i++)
		if (coordinator.counts.deaths[i] != before[i])
			map_log(map, MAP_LOG_WARNING, "%s died or hangs in its scan: %s",
				coordinator.net.participants[i].name,
				becomes[coordinator.net.participants[i].on_death]);
}

static void take_turn(void)
{
	struct synch_seen seen[SYNCH_PARTICIPANTS_MAX];
	uint32_t deaths[SYNCH_PARTICIPANTS_MAX];

	memcpy(deaths, coordinator.counts.deaths, sizeof(deaths));
	look(seen);
	if (synch_turn(&coordinator, seen, map_begin_cycle(map)))
		synch_store(stats, &coordinator.state, synch_state_size(&coordinator.net));
	show_all();
	ring();
	say_deaths(deaths);
}

static void run(int stop)
{
	struct pollfd waited[] = {{.fd = stop, .events = POLLIN}, {.fd = map_bell_fd(map), .events = POLLIN}};

	while (map_may_run(map)) {
		map_heartbeat(map);
		map_bell_clear(map);
		take_turn();
		if (poll(waited, 2, coordinator.stands_in ? STAND_IN_MS : TICK_MS) > 0 &&
		    waited[0].revents != 0)
			break;
	}
}

static bool start(void)
{
	struct synch_tables *tables = synch_tables(map_config(map));
	struct synch_net net;

	stats = synch_stats_of(map);
	if (tables == NULL || stats == NULL)
		return false;
	net = synch_net_of(tables);
	synch_begin(&coordinator, &net, &stats->copies[latch_whole_copy(&stats->latch)]);
	take_counts();
	for (uint32_t i = 0; i < net.transition_count; i++)
		map_name_counter(map, &stats->firings[i], "%s", net.transitions[i].name);
	return true;
}

int main(int argc, char **argv)
{
	struct options options;
	int stop;

	map = module_begin(argc, argv, &options);
	if (!start())
		return module_is_of_another_build(map);
	stop = module_stop_fd();
	if (stop < 0 || !module_confine(map, &options, 0))
		return MODULE_FAILED;
	run(stop);
	map_detach(map);
	return MODULE_ENDED;
}
