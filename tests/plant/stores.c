/* SPDX-License-Identifier: GPL-3.0-or-later */
/*
 * Between two stores into memory that others see: a process may die or stop there. While a fault waits for such a store, that
 * memory is read-only: a store is a SIGSEGV, which is counted and let through alone, by a step of one instruction.
 */
#include <errno.h>
#include <stdlib.h>
#include <sys/mman.h>
#include <sys/syscall.h>
#include <ucontext.h>

#include "client.h"

#define SEGMENTS  64
#define TRAP_FLAG 0x100

struct segment {
	uint8_t *memory;
	size_t size;
};

static struct segment segments[SEGMENTS];
static const struct plant_fault *waiting; /* for its store */
static uint32_t stores;

static void protect(int protection)
{
	for (unsigned i = 0; i < SEGMENTS; i++)
		if (segments[i].memory)
			real_syscall(SYS_mprotect, (long)segments[i].memory, (long)segments[i].size,
				     protection, 0, 0, 0);
}

void stores_map(void *memory, size_t size)
{
	struct segment *free = segments;

	while (free->memory)
		if (++free == segments + SEGMENTS)
			abort();
	*free = (struct segment){memory, size};
	if (waiting)
		protect(PROT_READ);
}

void stores_unmap(const void *memory)
{
	for (unsigned i = 0; i < SEGMENTS; i++)
		if (segments[i].memory == memory)
			segments[i].memory = NULL;
}

#ifdef __x86_64__
static bool is_shared(const uint8_t *address)
{
	for (unsigned i = 0; i < SEGMENTS; i++)
		if (segments[i].memory && address >= segments[i].memory &&
		    address < segments[i].memory + segments[i].size)
			return true;
	return false;
}

static void step(void *context, bool begins)
{
	greg_t *flags = &((ucontext_t *)context)->uc_mcontext.gregs[REG_EFL];

	*flags = begins ? *flags | TRAP_FLAG : *flags & ~(greg_t)TRAP_FLAG;
	protect(begins ? PROT_READ | PROT_WRITE : PROT_READ);
}

static void on_store(int number, siginfo_t *info, void *context)
{
	const struct plant_fault *fault = waiting;
	const int error = errno;

	if (!fault || !is_shared(info->si_addr)) {
		signal(number, SIG_DFL); /* a fault of its own, which comes again */
	} else if (++stores < fault->stores) {
		step(context, true);
	} else {
		stores_forget();
		client_suffer(fault);
	}
	errno = error;
}

static void on_stored(int number, siginfo_t *info, void *context)
{
	(void)number;
	(void)info;
	step(context, false);
}

static void handle(int number, void (*handler)(int, siginfo_t *, void *))
{
	struct sigaction action = {.sa_sigaction = handler, .sa_flags = SA_SIGINFO};
	sigset_t own;

	sigfillset(&action.sa_mask);
	sigaction(number, &action, NULL);
	sigemptyset(&own);
	sigaddset(&own, number);
	sigprocmask(SIG_UNBLOCK, &own, NULL);
}

void stores_await(const struct plant_fault *fault)
{
	waiting = fault;
	stores = 0;
	handle(SIGSEGV, on_store);
	handle(SIGTRAP, on_stored);
	protect(PROT_READ);
}
#else
/* Nothing lets one instruction alone through: it suffers at its call. */
void stores_await(const struct plant_fault *fault)
{
	client_suffer(fault);
}
#endif

void stores_forget(void)
{
	if (!waiting)
		return;
	waiting = NULL;
	protect(PROT_READ | PROT_WRITE);
}

void stores_look(void)
{
	if (waiting && waiting->to_ns <= plant->now_ns)
		stores_forget();
}
