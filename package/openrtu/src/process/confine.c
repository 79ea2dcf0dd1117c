/* SPDX-License-Identifier: GPL-3.0-or-later */
#include "process/confine.h"

#include <errno.h>
#include <linux/filter.h>
#include <linux/seccomp.h>
#include <signal.h>
#include <sys/prctl.h>
#include <sys/resource.h>
#include <sys/syscall.h>
#include <unistd.h>

#define FILTER_MAX 512 /* instructions; rtud's longest has not half of them */

static struct map *map_of_handler;

/* The second one within the handler of the first, where SIGSYS is blocked, ends the process: no filter has it. */
static void end_by_the_call(int signal_number, siginfo_t *info, void *context)
{
	(void)signal_number, (void)context;
	map_note_forbidden(map_of_handler, info->si_syscall);
	syscall(SYS_getppid);
}

static int limit(int resource, rlim_t most)
{
	const struct rlimit limits = {most, most};

	return setrlimit(resource, &limits);
}

static int take_filter(int fd)
{
	struct sock_filter instructions[FILTER_MAX];
	ssize_t size = read(fd, instructions, sizeof(instructions));
	struct sock_fprog filter = {.filter = instructions};

	close(fd);
	if (size <= 0 || size % (ssize_t)sizeof(instructions[0]) != 0) {
		errno = EINVAL;
		return -1;
	}
	filter.len = (unsigned short)((size_t)size / sizeof(instructions[0]));
	return prctl(PR_SET_SECCOMP, SECCOMP_MODE_FILTER, &filter);
}

int confine(struct map *map, int filter_fd, size_t file_size)
{
	const struct sigaction action = {.sa_sigaction = end_by_the_call, .sa_flags = SA_SIGINFO};

	if (OPENRTU_INSTRUMENTED)
		return 0;
	map_of_handler = map;
	map_note_forbidden(map, -1);
	signal(SIGXFSZ, SIG_IGN); /* a file that would grow too long is an error of its writer: EFBIG */
	if (limit(RLIMIT_NPROC, 0) < 0 || limit(RLIMIT_FSIZE, file_size) < 0 ||
	    sigaction(SIGSYS, &action, NULL) < 0)
		return -1;
	return filter_fd < 0 ? 0 : take_filter(filter_fd);
}
