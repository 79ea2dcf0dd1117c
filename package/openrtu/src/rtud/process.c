/* SPDX-License-Identifier: GPL-3.0-or-later */
#include "rtud/process.h"

#include <errno.h>
#include <fcntl.h>
#include <grp.h>
#include <limits.h>
#include <sched.h>
#include <signal.h>
#include <stdio.h>
#include <string.h>
#include <sys/prctl.h>
#include <sys/resource.h>
#include <unistd.h>

#include "map/supervise.h"

#define EXIT_NOT_STARTED 127 /* the shell's word for "could not be executed" */

int process_set_priority(pid_t pid, int priority)
{
	struct sched_param parameter = {.sched_priority = priority};

	return sched_setscheduler(pid, priority ? SCHED_FIFO : SCHED_OTHER, &parameter);
}

/* The group that Debian and Buildroot give serial devices to. Who faces the network shall not reach a line. */
static int set_groups(const struct process_plan *plan)
{
	const struct group *serial = plan->serial ? getgrnam("dialout") : NULL;

	return setgroups(serial ? 1 : 0, serial ? &serial->gr_gid : NULL);
}

static int drop_privileges(const struct process_plan *plan)
{
	if (plan->uid && (set_groups(plan) < 0 || setgid(plan->gid) < 0 || setuid(plan->uid) < 0))
		return -1;
	return prctl(PR_SET_NO_NEW_PRIVS, 1, 0, 0, 0);
}

static void reset_signals(void)
{
	sigset_t none;

	signal(SIGPIPE, SIG_DFL);
	signal(SIGHUP, SIG_IGN); /* a terminal that closes sends it to all in the foreground */
	sigemptyset(&none);
	sigprocmask(SIG_SETMASK, &none, NULL);
}

/* rtud may have inherited more than it opened. Its epoll came first: neither descriptor has the segment's number. */
static void keep_only(int segment, int program)
{
	dup2(segment, MAP_SEGMENT_FD);
	close_range(MAP_SEGMENT_FD + 1, (unsigned)program - 1, 0);
	close_range((unsigned)program + 1, UINT_MAX, 0);
}

__attribute__((noreturn)) static void run(const struct process_plan *plan, int program, pid_t parent)
{
	const char *const arguments[] = {plan->program, "--map", plan->map, "--module",
					 plan->module,  "--dev", plan->dev, NULL};
	const char *const environment[] = {"PATH=/usr/bin:/bin", NULL};
	const struct rlimit unlimited = {RLIM_INFINITY, RLIM_INFINITY};

	reset_signals();
	keep_only(plan->segment, program);
	setrlimit(RLIMIT_MEMLOCK, &unlimited); /* the module says when it cannot lock its memory */
	process_set_priority(0, 0);
	if (drop_privileges(plan) < 0) {
		fprintf(stderr, "rtud: cannot give up privileges for %s: %s\n", plan->module,
			strerror(errno));
		_exit(EXIT_NOT_STARTED);
	}
	/*
	 * After setuid, which clears it; and the parent may have gone before. SIGKILL: a module that hangs must not stay on its
	 * line beside the next rtud's.
	 */
	prctl(PR_SET_PDEATHSIG, SIGKILL);
	if (getppid() != parent)
		_exit(EXIT_NOT_STARTED);
	fexecve(program, (char *const *)arguments, (char *const *)environment); /* which does not write */
	fprintf(stderr, "rtud: cannot execute %s: %s\n", plan->program, strerror(errno));
	_exit(EXIT_NOT_STARTED);
}

pid_t process_start(const struct process_plan *plan)
{
	/* Opened here: the module's user need not be able to walk to the program's folder. */
	int program = open(plan->program, O_PATH | O_CLOEXEC);
	pid_t parent = getpid(), pid;

	if (program < 0)
		return -1;
	pid = fork();
	if (pid == 0)
		run(plan, program, parent);
	close(program);
	return pid;
}
