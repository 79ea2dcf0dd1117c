/* SPDX-License-Identifier: GPL-3.0-or-later */
#include "client.h"

#include <errno.h>
#include <fcntl.h>
#include <stdlib.h>
#include <string.h>
#include <sys/mman.h>
#include <sys/syscall.h>
#include <unistd.h>

#define SPINS_MAX 100000 /* calls in one instant: whoever waits for time by asking for it shall see it pass */
#define SPIN_NS   1000000

struct plant *plant;
uint32_t client_self;

static bool begun;

static struct plant *attach(const char *path)
{
	const int fd = open(path, O_RDWR | O_CLOEXEC);
	void *shared =
	    fd < 0 ? MAP_FAILED : mmap(NULL, sizeof(struct plant), PROT_READ | PROT_WRITE, MAP_SHARED, fd, 0);

	if (fd >= 0)
		real.close(fd);
	return shared == MAP_FAILED ? NULL : shared;
}

/* By execve() it has the baton still. */
static void come_in(void)
{
	struct plant_process *process = &plant->processes[client_self];

	if (!atomic_load(&process->attached)) {
		process->pid = getpid();
		atomic_store(&process->attached, 1);
		plant_take(plant, client_self);
	}
	if (process->parent != PLANT_RUNNER) /* else the world has named it */
		plant_name(plant, client_self, program_invocation_short_name);
	account_begin();
	process->refused_ns = plant_starves_until_ns(plant, process->name);
	client_tell("begins%s", process->refused_ns ? " without memory" : "");
}

void client_begin(void)
{
	const char *path = getenv(PLANT_SHARED_VARIABLE), *number = getenv(PLANT_PROCESS_VARIABLE);

	if (begun)
		return;
	begun = true;
	real_find();
	if (!path || !number)
		return;
	client_self = (uint32_t)strtoul(number, NULL, 10);
	plant = attach(path);
	if (plant)
		come_in();
}

__attribute__((constructor)) static void constructor(void)
{
	client_begin();
}

__attribute__((destructor)) static void destructor(void)
{
	if (plant)
		client_leave("exits");
}

void client_changes(void)
{
	plant->changes++;
}

/* Gives the baton away for the last time. */
static void part(void)
{
	struct plant *left = plant;

	plant = NULL;
	plant_pass(left, client_self);
}

void client_leave(const char *how)
{
	if (!plant->processes[client_self].alive)
		return;
	client_tell("%s", how);
	plant_bury(plant, client_self);
	part();
}

/* The baton goes first: with its parent the kernel kills this process. Who has it then waits for all that are dying. */
__attribute__((noreturn)) static void lose_power(void)
{
	int32_t pids[PLANT_PROCESSES];
	size_t count;

	disk_loses_power();
	client_tell("is killed");
	plant_bury(plant, client_self);
	count = plant_bury_machine(plant, client_self, pids);
	part();
	for (size_t i = 0; i < count; i++)
		real_syscall(SYS_kill, pids[i], SIGKILL, 0, 0, 0, 0);
	real_syscall(SYS_kill, getpid(), SIGKILL, 0, 0, 0, 0);
	abort();
}

void client_suffer(const struct plant_fault *fault)
{
	sigset_t all, own;

	if (fault->kind == PLANT_MEMORY) {
		client_tell("gets no memory for %lld ns", (long long)fault->for_ns);
		plant->processes[client_self].refused_ns = plant->now_ns + fault->for_ns;
		return;
	}
	if (fault->kind == PLANT_POWER)
		lose_power();
	if (fault->kind == PLANT_KILL) {
		client_leave("is killed");
		real_syscall(SYS_kill, getpid(), SIGKILL, 0, 0, 0, 0);
	}
	sigfillset(&all); /* who is stopped handles no signal */
	sigprocmask(SIG_BLOCK, &all, &own);
	client_tell("stops for %lld ns", (long long)fault->for_ns);
	plant->processes[client_self].stopped_ns = plant->now_ns + fault->for_ns;
	plant_pass(plant, client_self);
	client_tell("goes on");
	sigprocmask(SIG_SETMASK, &own, NULL);
}

void client_spin(void)
{
	if (++plant->spins < SPINS_MAX)
		return;
	plant->now_ns += SPIN_NS;
	plant->spins = 0;
	plant->changes++;
}

void client_call(void)
{
	const struct plant_fault *fault;

	plant->processes[client_self].calls++;
	client_spin();
	account_look();
	stores_look();
	fault = plant_fault_at(plant, client_self);
	if (fault && fault->stores)
		stores_await(fault);
	else if (fault)
		client_suffer(fault);
}
