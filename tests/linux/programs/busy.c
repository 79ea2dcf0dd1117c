/* SPDX-License-Identifier: GPL-3.0-or-later */
/*
 * busy TAKES LEAVES COMMAND...: runs a command while a process of the highest priority takes the processor for so many
 * milliseconds and leaves it for so many, in turns. Ends as the command does.
 */
#include <sched.h>
#include <signal.h>
#include <stdint.h>
#include <stdio.h>
#include <stdlib.h>
#include <sys/prctl.h>
#include <sys/wait.h>
#include <time.h>
#include <unistd.h>

static void fail(const char *what)
{
	perror(what);
	exit(1);
}

static int64_t now_ms(void)
{
	struct timespec now;

	clock_gettime(CLOCK_MONOTONIC, &now);
	return now.tv_sec * INT64_C(1000) + now.tv_nsec / 1000000;
}

static void take_turns(int takes_ms, int leaves_ms)
{
	const struct sched_param first = {.sched_priority = sched_get_priority_max(SCHED_FIFO)};

	if (sched_setscheduler(0, SCHED_FIFO, &first) || prctl(PR_SET_PDEATHSIG, SIGKILL))
		fail("busy");
	for (;;) {
		const int64_t end = now_ms() + takes_ms;

		while (now_ms() < end)
			;
		usleep((useconds_t)leaves_ms * 1000);
	}
}

int main(int argc, char **argv)
{
	if (argc < 4) {
		fputs("busy TAKES LEAVES COMMAND...\n", stderr);
		return 1;
	}
	const pid_t busy = fork();

	if (busy < 0)
		fail("fork");
	if (!busy)
		take_turns(atoi(argv[1]), atoi(argv[2]));

	const pid_t command = fork();
	int status;

	if (command < 0)
		fail("fork");
	if (!command) {
		execvp(argv[3], argv + 3);
		fail(argv[3]);
	}
	if (waitpid(command, &status, 0) != command || kill(busy, SIGKILL))
		fail("busy");
	return WIFEXITED(status) ? WEXITSTATUS(status) : 1;
}
