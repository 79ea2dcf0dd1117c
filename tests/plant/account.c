/* SPDX-License-Identifier: GPL-3.0-or-later */
/* What a process holds: descriptors and memory, from some time after its begin on. Its trace has none of it. */
#include <errno.h>
#include <fcntl.h>
#include <stdlib.h>
#include <string.h>
#include <unistd.h>

#include "client.h"

#define SETTLED_NS (20 * PLANT_NS)
#define EACH_NS    (10 * PLANT_NS)

static uint32_t count_descriptors(void)
{
	uint32_t count = 0;

	for (int fd = 0; fd < CLIENT_FDS; fd++)
		count += fcntl(fd, F_GETFD) >= 0;
	return count;
}

/* In KiB; 0: the host does not say. */
static uint32_t resident(void)
{
	const int fd = real.openat(AT_FDCWD, "/proc/self/statm", O_RDONLY | O_CLOEXEC);
	char text[64] = "";
	const ssize_t size = fd < 0 ? -1 : real.read(fd, text, sizeof(text) - 1);
	const char *second = size > 0 ? strchr(text, ' ') : NULL;

	if (fd >= 0)
		real.close(fd);
	return second ? (uint32_t)(strtoul(second, NULL, 10) * (unsigned long)sysconf(_SC_PAGESIZE) / 1024)
		      : 0;
}

static struct plant_account *own_account(const struct plant_process *self)
{
	struct plant_account *account = plant->accounts;

	for (; account < plant->accounts + plant->account_count; account++)
		if (account->life == self->life && strcmp(account->name, self->name) == 0)
			return account;
	if (plant->account_count == PLANT_ACCOUNTS)
		return NULL;
	plant->account_count++;
	*account = (struct plant_account){
	    .life = self->life, .first_descriptors = count_descriptors(), .first_kib = resident()};
	memcpy(account->name, self->name, sizeof(account->name));
	return account;
}

static void keep_account(const struct plant_process *self)
{
	const int error = errno;
	struct plant_account *account = own_account(self);

	if (account) {
		const uint32_t descriptors = count_descriptors();

		if (descriptors > account->most_descriptors)
			account->most_descriptors = descriptors;
		account->last_kib = resident();
	}
	errno = error;
}

void account_begin(void)
{
	plant->processes[client_self].account_ns = plant->now_ns + SETTLED_NS;
}

void account_look(void)
{
	struct plant_process *self = &plant->processes[client_self];

	if (!self->account_ns || plant->now_ns < self->account_ns)
		return;
	self->account_ns = plant->now_ns + EACH_NS;
	keep_account(self);
}
