/* SPDX-License-Identifier: GPL-3.0-or-later */
/* load-module FILE ARGUMENTS: loads a kernel module, as insmod does, which the board's BusyBox has not. */
#include <fcntl.h>
#include <stdio.h>
#include <sys/syscall.h>
#include <unistd.h>

int main(int argc, char **argv)
{
	const int file = argc == 3 ? open(argv[1], O_RDONLY) : -1;

	if (file < 0 || syscall(SYS_finit_module, file, argv[2], 0)) {
		perror("load-module");
		return 1;
	}
	return 0;
}
