/* SPDX-License-Identifier: GPL-3.0-or-later */
#include "real.h"

#include <dlfcn.h>
#include <string.h>

struct real real;

static void find(void *member, size_t size, const char *name)
{
	void *found = dlsym(RTLD_NEXT, name);

	memcpy(member, &found, size); /* ISO C casts no object's pointer to a function's */
}

#define FIND(type, name, parameters) find(&real.name, sizeof(real.name), #name);

void real_find(void)
{
	if (real.syscall)
		return;
	PLANT_REAL(FIND)
}
