/* SPDX-License-Identifier: GPL-3.0-or-later */
/* The scheduler. No process of its own: who gives the baton away computes who is next, from what all share. */
#include <errno.h>
#include <linux/futex.h>
#include <poll.h>
#include <signal.h>
#include <stdarg.h>
#include <stdio.h>
#include <string.h>
#include <sys/syscall.h>
#include <sys/wait.h>
#include <time.h>
#include <unistd.h>

#include "real.h"
#include "shared.h"

#define PATIENCE_NS (PLANT_NS / 2)

bool plant_futex_wait(_Atomic uint32_t *word, uint32_t value, int64_t most_ns)
{
	const struct timespec most = {most_ns / PLANT_NS, most_ns % PLANT_NS};

	return real_syscall(SYS_futex, (long)word, FUTEX_WAIT, (long)value, (long)&most, 0, 0) == 0 ||
	       errno != ETIMEDOUT;
}

void plant_futex_wake(_Atomic uint32_t *word)
{
	real_syscall(SYS_futex, (long)word, FUTEX_WAKE, 1, 0, 0, 0);
}

/* Whoever killed the runner, as an interrupted make does, leaves no process behind. */
static void wait_in(const struct plant *plant, _Atomic uint32_t *word, uint32_t value)
{
	if (plant_futex_wait(word, value, PATIENCE_NS))
		return;
	if (real_syscall(SYS_kill, (long)plant->id, 0, 0, 0, 0, 0) < 0 && errno == ESRCH)
		real._exit(1);
}

/* splitmix64 */
uint64_t plant_random(struct plant *plant)
{
	uint64_t mixed = plant->random += 0x9e3779b97f4a7c15u;

	mixed = (mixed ^ mixed >> 30) * 0xbf58476d1ce4e5b9u;
	mixed = (mixed ^ mixed >> 27) * 0x94d049bb133111ebu;
	return mixed ^ mixed >> 31;
}

/* ---- the trace --------------------------------------------------------------------------- */

/* The runner writes it: a process may not open a file. */
static void flush(struct plant *plant)
{
	atomic_store(&plant->runner, 1);
	plant_futex_wake(&plant->runner);
	while (atomic_load(&plant->runner))
		wait_in(plant, &plant->runner, 1);
}

void plant_tell(struct plant *plant, uint32_t process, const char *format, ...)
{
	const struct plant_process *teller = &plant->processes[process];
	char *line;
	va_list arguments;
	int size;

	if (plant->trace_size + PLANT_LINE > PLANT_TRACE)
		flush(plant);
	line = plant->trace + plant->trace_size;
	size = snprintf(line, PLANT_LINE, "%lld.%09lld %s#%u ", (long long)(plant->now_ns / PLANT_NS),
			(long long)(plant->now_ns % PLANT_NS), teller->name, teller->life);
	va_start(arguments, format);
	size += vsnprintf(line + size, PLANT_LINE - (size_t)size, format, arguments);
	va_end(arguments);
	if (size > PLANT_LINE - 1)
		size = PLANT_LINE - 1;
	line[size] = '\n';
	plant->trace_size += (uint32_t)size + 1;
}

/* ---- processes --------------------------------------------------------------------------- */

uint32_t plant_add(struct plant *plant, uint32_t parent)
{
	uint32_t process = 0;

	while (process < plant->process_count && plant->processes[process].alive)
		process++;
	if (process == PLANT_PROCESSES)
		return PLANT_RUNNER;
	if (process == plant->process_count)
		plant->process_count++;
	plant->processes[process] = (struct plant_process){.alive = true, .parent = parent};
	return process;
}

void plant_name(struct plant *plant, uint32_t process, const char *name)
{
	struct plant_process *named = &plant->processes[process];
	struct plant_name *found = plant->names;

	if (strncmp(named->name, name, PLANT_NAME_SIZE - 1) == 0)
		return;
	snprintf(named->name, sizeof(named->name), "%s", name);
	while (found < plant->names + PLANT_NAMES - 1 && found->name[0] &&
	       strcmp(found->name, named->name) != 0)
		found++;
	memcpy(found->name, named->name, sizeof(found->name));
	named->life = ++found->lives;
}

void plant_bury(struct plant *plant, uint32_t process)
{
	struct plant_process *dead = &plant->processes[process];

	dead->alive = false;
	plant->changes++;
	if (plant->dying_count < PLANT_DYING)
		plant->dying[plant->dying_count++] = dead->pid;
	for (uint32_t i = 0; i < plant->process_count; i++) {
		const struct plant_process *child = &plant->processes[i];

		if (child->alive && child->parent == process && child->ends_with_parent)
			plant_bury(plant, i);
	}
}

/* What the world has started. */
static uint32_t origin_of(const struct plant *plant, uint32_t process)
{
	while (plant->processes[process].parent != PLANT_RUNNER)
		process = plant->processes[process].parent;
	return process;
}

size_t plant_bury_machine(struct plant *plant, uint32_t process, int32_t pids[PLANT_PROCESSES])
{
	const uint32_t origin = origin_of(plant, process);
	size_t count = 0;

	for (uint32_t i = plant->process_count; i-- > 0;) {
		if (i == origin || i == process || !plant->processes[i].alive ||
		    origin_of(plant, i) != origin)
			continue;
		pids[count++] = plant->processes[i].pid;
		plant_tell(plant, i, "is killed");
		plant_bury(plant, i);
	}
	return count;
}

/*
 * Until its descriptors are closed and its parent has been told. The second is done under a lock that waitid() takes, after the
 * descriptor of the process has become readable.
 */
static void await_death(int32_t pid)
{
	siginfo_t info;
	struct pollfd death = {.fd = (int)real_syscall(SYS_pidfd_open, pid, 0, 0, 0, 0, 0), .events = POLLIN};

	if (death.fd < 0)
		return;
	while (real.poll(&death, 1, -1) < 0 && errno == EINTR)
		continue;
	real.close(death.fd);
	waitid(P_ALL, 0, &info, WEXITED | WNOHANG | WNOWAIT);
}

void plant_await_the_dying(struct plant *plant)
{
	while (plant->dying_count)
		await_death(plant->dying[--plant->dying_count]);
}

/* ---- faults ------------------------------------------------------------------------------ */

static bool is_over(const struct plant *plant, const struct plant_fault *fault)
{
	return fault->done || fault->to_ns <= plant->now_ns;
}

static bool lasts(const struct plant *plant, enum plant_fault_kind kind, uint16_t port)
{
	for (uint32_t i = plant->fault_first; i < plant->fault_count; i++) {
		const struct plant_fault *fault = &plant->faults[i];

		if (fault->from_ns > plant->now_ns)
			break;
		if (fault->kind == kind && fault->port == port && !is_over(plant, fault))
			return true;
	}
	return false;
}

bool plant_is_cut(const struct plant *plant, uint16_t port)
{
	return lasts(plant, PLANT_CUT, port);
}

int64_t plant_starves_until_ns(const struct plant *plant, const char *name)
{
	int64_t until_ns = 0;

	for (uint32_t i = plant->fault_first; i < plant->fault_count; i++) {
		const struct plant_fault *fault = &plant->faults[i];

		if (fault->kind == PLANT_STARVES && fault->from_ns <= plant->now_ns &&
		    !is_over(plant, fault) && strcmp(fault->name, name) == 0)
			until_ns = fault->to_ns;
	}
	return until_ns;
}

bool plant_disk_is(const struct plant *plant, enum plant_fault_kind kind)
{
	return lasts(plant, kind, 0);
}

bool plant_is_lost(const struct plant *plant, uint16_t port, int64_t since_ns)
{
	for (uint32_t i = 0; i < plant->loss_count; i++) {
		const struct plant_loss *loss = &plant->losses[i];

		if (loss->port == port && since_ns < loss->at_ns && loss->at_ns <= plant->now_ns)
			return true;
	}
	return false;
}

/* From its time on, the calls of whoever has that name count; those of its next life anew. */
static bool is_due(struct plant_fault *fault, const struct plant_process *caller)
{
	if (!fault->counts || fault->first_call > caller->calls)
		fault->first_call = caller->calls;
	fault->counts = true;
	return caller->calls - fault->first_call >= fault->calls;
}

const struct plant_fault *plant_fault_at(struct plant *plant, uint32_t process)
{
	const struct plant_process *caller = &plant->processes[process];

	while (plant->fault_first < plant->fault_count && is_over(plant, &plant->faults[plant->fault_first]))
		plant->fault_first++;
	for (uint32_t i = plant->fault_first; i < plant->fault_count; i++) {
		struct plant_fault *fault = &plant->faults[i];

		if (fault->from_ns > plant->now_ns)
			break;
		if (fault->kind >= PLANT_CUT || is_over(plant, fault) ||
		    strcmp(fault->name, caller->name) != 0 || !is_due(fault, caller))
			continue;
		fault->done = true;
		return fault;
	}
	return NULL;
}

static void take_earlier(int64_t *time_ns, int64_t other_ns)
{
	if (other_ns < *time_ns)
		*time_ns = other_ns;
}

/* When a cut begins or ends, who waits at its port must look again. */
static int64_t next_cut_ns(const struct plant *plant)
{
	int64_t next_ns = PLANT_NEVER;

	for (uint32_t i = plant->fault_first; i < plant->fault_count; i++) {
		const struct plant_fault *fault = &plant->faults[i];

		if (fault->kind != PLANT_CUT)
			continue;
		if (fault->to_ns > plant->now_ns)
			take_earlier(&next_ns, fault->to_ns);
		if (fault->from_ns > plant->now_ns) {
			take_earlier(&next_ns, fault->from_ns);
			break;
		}
	}
	return next_ns;
}

int64_t plant_ahead_ns(const struct plant *plant)
{
	return plant->wall_ns + (plant->now_ns - PLANT_BEGIN_NS) / 1000000 * plant->drift_ppm;
}

static int64_t next_step_ns(const struct plant *plant)
{
	int64_t next_ns = PLANT_NEVER;

	for (uint32_t i = 0; i < plant->step_count; i++)
		if (!plant->steps[i].done)
			take_earlier(&next_ns, plant->steps[i].at_ns);
	return next_ns > plant->now_ns ? next_ns : plant->now_ns;
}

static void take_steps(struct plant *plant)
{
	for (uint32_t i = 0; i < plant->step_count; i++) {
		struct plant_step *step = &plant->steps[i];

		if (step->done || step->at_ns > plant->now_ns)
			continue;
		plant->wall_ns += step->by_ns;
		step->done = true;
	}
}

/* ---- the baton --------------------------------------------------------------------------- */

static bool may_be_ready(const struct plant *plant, const struct plant_process *process)
{
	return process->alive && process->stopped_ns <= plant->now_ns &&
	       (process->asked != plant->changes || process->deadline_ns <= plant->now_ns);
}

static uint32_t choose(struct plant *plant)
{
	uint32_t ready[PLANT_PROCESSES], count = 0;

	for (uint32_t i = 0; i < plant->process_count; i++)
		if (may_be_ready(plant, &plant->processes[i]))
			ready[count++] = i;
	if (count == 0)
		return PLANT_RUNNER;
	return ready[count == 1 ? 0 : plant_random(plant) % count];
}

/* False: nothing will ever happen before the end. */
static bool move_clock(struct plant *plant)
{
	int64_t network_ns = next_cut_ns(plant), next_ns;

	take_earlier(&network_ns, plant_next_arrival_ns(plant));
	next_ns = network_ns;
	take_earlier(&next_ns, next_step_ns(plant));
	for (uint32_t i = 0; i < plant->process_count; i++) {
		const struct plant_process *process = &plant->processes[i];
		const bool stopped = process->stopped_ns > plant->now_ns;

		if (process->alive)
			take_earlier(&next_ns, stopped ? process->stopped_ns : process->deadline_ns);
	}
	if (next_ns >= plant->end_ns) {
		plant->now_ns = plant->end_ns;
		return false;
	}
	plant->now_ns = next_ns;
	plant->spins = 0;
	plant->changes += next_ns == network_ns;
	take_steps(plant);
	return true;
}

static void end(struct plant *plant)
{
	plant->ended = true;
	atomic_store(&plant->holder, PLANT_RUNNER);
	atomic_store(&plant->runner, 1);
	plant_futex_wake(&plant->runner);
}

void plant_take(struct plant *plant, uint32_t self)
{
	struct plant_process *process = &plant->processes[self];

	while (!atomic_load(&process->has_baton))
		wait_in(plant, &process->has_baton, 0);
	atomic_store(&process->has_baton, 0);
	plant_await_the_dying(plant);
}

void plant_pass(struct plant *plant, uint32_t self)
{
	/* Looked at now: who has the baton next may bury this one before it runs again. */
	const bool takes_again = self != PLANT_RUNNER && plant->processes[self].alive;
	uint32_t next = plant->now_ns < plant->end_ns ? choose(plant) : PLANT_RUNNER;

	while (next == PLANT_RUNNER && move_clock(plant))
		next = choose(plant);
	if (next == self && self != PLANT_RUNNER) {
		plant_await_the_dying(plant);
		return;
	}
	atomic_fetch_add(&plant->turns, 1);
	if (next == PLANT_RUNNER) {
		end(plant);
	} else {
		atomic_store(&plant->holder, next);
		atomic_store(&plant->processes[next].has_baton, 1);
		plant_futex_wake(&plant->processes[next].has_baton);
	}
	if (takes_again)
		plant_take(plant, self);
}
