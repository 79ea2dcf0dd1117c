/* SPDX-License-Identifier: GPL-3.0-or-later */
/*
 * busy TAKES LEAVES COMMAND...: runs a command and takes the processor from it for so many milliseconds, by the highest
 * priority, and leaves it for so many, in turns. Ends as the command does.
 */
#include <sched.h>
#include <stdint.h>
#include <stdio.h>
#include <stdlib.h>
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

static void take(int ms)
{
	const int64_t end = now_ms() + ms;

	while (now_ms() < end)
		;
}

int main(int argc, char **argv)
{
	const struct sched_param first = {.sched_priority = sched_get_priority_max(SCHED_FIFO)};
	int status = 0;

	if (argc < 4) {
		fputs("busy TAKES LEAVES COMMAND...\n", stderr);
		return 1;
	}
	const pid_t command = fork();

	if (command < 0)
		fail("fork");
	if (!command) {
		execvp(argv[3], argv + 3);
		fail(argv[3]);
	}
	if (sched_setscheduler(0, SCHED_FIFO, &first))
		fail("SCHED_FIFO");
	while (!waitpid(command, &status, WNOHANG)) {
		take(atoi(argv[1]));
		usleep((useconds_t)atoi(argv[2]) * 1000);
	}
	return WIFEXITED(status) ? WEXITSTATUS(status) : 1;
}
