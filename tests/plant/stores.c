/* SPDX-License-Identifier: GPL-3.0-or-later */
/*
 * Between two stores into memory that others see: a process may die or stop there. While a fault waits for such a store, that
 * memory is read-only: a store is a SIGSEGV, which is counted and let through alone, by a step of one instruction. Most are into
 * what counts something. For a rare one it waits a second; a page that was written often meanwhile does not count.
 */
#include <errno.h>
#include <stdlib.h>
#include <string.h>
#include <sys/mman.h>
#include <sys/syscall.h>
#include <ucontext.h>

#include "client.h"

#define SEGMENTS  64
#define TRAP_FLAG 0x100
#define PAGE      4096u
#define PAGES     4096u /* each has a place in a table; another one has the same, seldom */
#define OFTEN     12u
#define RARE_NS   PLANT_NS

struct segment {
	uint8_t *memory;
	size_t size;
};

static struct segment segments[SEGMENTS];
static const struct plant_fault *waiting; /* for its store */

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

static uint32_t stores;
static int64_t since_ns;
static uint8_t written[PAGES];
static uint8_t *opened[2]; /* pages: a store may be into two */

static void protect_page(uint8_t *page, int protection)
{
	real_syscall(SYS_mprotect, (long)page, PAGE, protection, 0, 0, 0);
}

static void let_through(uint8_t *page, void *context)
{
	protect_page(page, PROT_READ | PROT_WRITE);
	opened[opened[0] != NULL] = page;
	((ucontext_t *)context)->uc_mcontext.gregs[REG_EFL] |= TRAP_FLAG;
}

static bool is_of_the_first_second(void)
{
	return plant->now_ns - since_ns < RARE_NS;
}

/* False: its page is written often, and stays writable. */
static bool is_rare(uint8_t *page)
{
	uint8_t *times = &written[(uintptr_t)page / PAGE % PAGES];

	if (!is_of_the_first_second() || ++*times < OFTEN)
		return true;
	protect_page(page, PROT_READ | PROT_WRITE);
	return false;
}

static bool is_the_one(const struct plant_fault *fault)
{
	return !(fault->rare && is_of_the_first_second()) && ++stores >= fault->stores;
}

static void on_store(int number, siginfo_t *info, void *context)
{
	const struct plant_fault *fault = waiting;
	uint8_t *page = (uint8_t *)((uintptr_t)info->si_addr & ~(uintptr_t)(PAGE - 1));
	const int error = errno;

	if (!fault || !is_shared(info->si_addr)) {
		signal(number, SIG_DFL); /* a fault of its own, which comes again */
	} else if (!fault->rare || is_rare(page)) {
		if (!is_the_one(fault)) {
			let_through(page, context);
		} else {
			stores_forget();
			client_suffer(fault);
		}
	}
	errno = error;
}

static void on_stored(int number, siginfo_t *info, void *context)
{
	(void)number;
	(void)info;
	for (unsigned i = 0; i < 2; i++)
		if (opened[i])
			protect_page(opened[i], PROT_READ);
	opened[0] = opened[1] = NULL;
	((ucontext_t *)context)->uc_mcontext.gregs[REG_EFL] &= ~(greg_t)TRAP_FLAG;
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
	since_ns = plant->now_ns;
	memset(written, 0, sizeof(written));
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
