/* SPDX-License-Identifier: GPL-3.0-or-later */
/* Memory that is refused for a while: each allocation fails, in what a process does itself and in what its libraries do for it. */
#include <errno.h>
#include <stdlib.h>
#include <sys/mman.h>
#include <sys/syscall.h>

#include "client.h"

/* The C library's own, which asks for no name: this is called before any is found. */
extern void *__libc_malloc(size_t size);
extern void *__libc_calloc(size_t count, size_t size);
extern void *__libc_realloc(void *old, size_t size);

static bool is_refused(void)
{
	if (!plant || plant->processes[client_self].refused_ns <= plant->now_ns)
		return false;
	errno = ENOMEM;
	return true;
}

void *malloc(size_t size)
{
	return is_refused() ? NULL : __libc_malloc(size);
}

void *calloc(size_t count, size_t size)
{
	return is_refused() ? NULL : __libc_calloc(count, size);
}

/* What becomes smaller has its place. */
void *realloc(void *old, size_t size)
{
	return size != 0 && is_refused() ? NULL : __libc_realloc(old, size);
}

void *reallocarray(void *old, size_t count, size_t size)
{
	size_t whole;

	if (!__builtin_mul_overflow(count, size, &whole))
		return realloc(old, whole);
	errno = ENOMEM;
	return NULL;
}

void *mmap(void *address, size_t size, int protection, int flags, int fd, off_t at)
{
	void *memory;

	client_begin();
	if (is_refused())
		return MAP_FAILED;
	memory = (void *)real_syscall(SYS_mmap, (long)address, (long)size, protection, flags, fd, at);
	if (plant && memory != MAP_FAILED && flags & MAP_SHARED && protection & PROT_WRITE)
		stores_map(memory, size);
	return memory;
}

int munmap(void *memory, size_t size)
{
	client_begin();
	stores_unmap(memory);
	return (int)real_syscall(SYS_munmap, (long)memory, (long)size, 0, 0, 0, 0);
}

#define SAME(name, as) __asm__(#name) __attribute__((alias(#as), copy(name)))
void *plain_mmap(void *address, size_t size, int protection, int flags, int fd, off_t at) SAME(mmap, mmap64);
