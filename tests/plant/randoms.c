/* SPDX-License-Identifier: GPL-3.0-or-later */
/* Random numbers of libraries that mix the host's into those of the kernel: OpenSSL reads the processor's counter. */
#include <stddef.h>
#include <sys/random.h>
#include <unistd.h>

#include "client.h"

int getentropy(void *out, size_t size)
{
	return getrandom(out, size, 0) == (ssize_t)size ? 0 : -1;
}

int RAND_bytes(unsigned char *out, int size);
int RAND_bytes(unsigned char *out, int size)
{
	return getentropy(out, (size_t)size) == 0;
}

int RAND_priv_bytes(unsigned char *out, int size);
int RAND_priv_bytes(unsigned char *out, int size)
{
	return RAND_bytes(out, size);
}
