/* SPDX-License-Identifier: GPL-3.0-or-later */
/*
 * rtu-logic that dies in each phase of a scan in turn, for tests/logic/test_logic_gateway.py: the linker puts it around what a
 * scan calls. Which phase it is tells the number of scans, which outlives the process.
 */
#include "modules/logic/host.h"

#define LIFE   60 /* scans */
#define PHASES 9

static struct host *host;
static uint32_t begun;

static void die_in(uint32_t phase)
{
	const uint32_t scans = host == NULL ? 0 : atomic_load(&host->stats->scans.count);

	if (scans >= begun + LIFE && begun / LIFE % PHASES == phase)
		__builtin_trap();
}

void __real_points_freeze(struct host *whose);
void __wrap_points_freeze(struct host *whose);
bool __real_logic_scan(struct logic *logic, const struct logic_times *times, uint32_t budget);
bool __wrap_logic_scan(struct logic *logic, const struct logic_times *times, uint32_t budget);

void __wrap_points_freeze(struct host *whose)
{
	if (host == NULL)
		begun = atomic_load(&whose->stats->scans.count);
	host = whose;
	die_in(0);
	__real_points_freeze(whose);
}

bool __wrap_logic_scan(struct logic *logic, const struct logic_times *times, uint32_t budget)
{
	die_in(1);
	return __real_logic_scan(logic, times, budget);
}

#define DIES_BEFORE(function, phase)                                                                         \
	void __real_##function(struct host *whose);                                                          \
	void __wrap_##function(struct host *whose);                                                          \
	void __wrap_##function(struct host *whose)                                                           \
	{                                                                                                    \
		die_in(phase);                                                                               \
		__real_##function(whose);                                                                    \
	}
#define DIES_BEFORE_AT(function, phase)                                                                      \
	void __real_##function(struct host *whose, int64_t now_ns);                                          \
	void __wrap_##function(struct host *whose, int64_t now_ns);                                          \
	void __wrap_##function(struct host *whose, int64_t now_ns)                                           \
	{                                                                                                    \
		die_in(phase);                                                                               \
		__real_##function(whose, now_ns);                                                            \
	}

DIES_BEFORE_AT(commands_before, 2)
DIES_BEFORE(requests_before, 3)
DIES_BEFORE(requests_judge, 4)
DIES_BEFORE_AT(points_publish, 5)
DIES_BEFORE_AT(requests_after, 6)
DIES_BEFORE_AT(commands_after, 7)
DIES_BEFORE(kept_store, 8)
