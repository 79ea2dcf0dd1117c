/* SPDX-License-Identifier: GPL-3.0-or-later */
/* The file that a plugin of QEMU counts in, as -plugin ...,count=FILE names it, for whoever looks while it runs. */
#ifndef PLUGIN_FILE_H
#define PLUGIN_FILE_H

#include <fcntl.h>
#include <stddef.h>
#include <string.h>
#include <sys/mman.h>
#include <unistd.h>

#define PLUGIN_KEY "count="

/* So many octets of it. NULL: no such file was named. */
static inline void *plugin_file(int argc, char **argv, size_t size)
{
	void *octets;
	int fd;

	if (argc != 1 || strncmp(argv[0], PLUGIN_KEY, strlen(PLUGIN_KEY)) != 0)
		return NULL;
	fd = open(argv[0] + strlen(PLUGIN_KEY), O_RDWR);
	if (fd < 0 || ftruncate(fd, (off_t)size) < 0)
		return NULL;
	octets = mmap(NULL, size, PROT_READ | PROT_WRITE, MAP_SHARED, fd, 0);
	close(fd);
	return octets == MAP_FAILED ? NULL : octets;
}

#endif
